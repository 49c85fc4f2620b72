"""The options that belong to the Galerkin form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cpmkit.errors import InputError, shown
from cpmkit.runtime.declared import Declared, option

#: How strongly what the samples do not see is held, by name: e1 and e2 weigh the first and second derivative across the
#: manifold, g the third differences along the axes.
STRENGTHS = {"default": (1e-2, 1e-2, 1e-4), "accurate": (1e-3, 1e-3, 1e-4)}


def _check_strength(strength: Any, what: str) -> Any:
    if not isinstance(strength, str) or strength not in STRENGTHS:
        raise InputError(f"{what} must be {' or '.join(map(repr, STRENGTHS))}, got {shown(strength)}.")
    return strength


@dataclass(frozen=True)
class GalerkinOptions(Declared):
    """The options that belong to the Galerkin form.

    Raises
    ------
    InputError
        If a value is not accepted.
    """

    strength: str = option(
        "default",
        "How strongly the Galerkin form holds what samples of the manifold do not see. ``accurate`` leaves .5 to .7 of "
        "the error of ``default``, for 1.4 to 2 times the iterations.",
        _check_strength,
    )
