"""A diffusivity that depends on the solution, at one state: what families of equations hand to a form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from cpmkit.protocols import Floats


@dataclass(frozen=True, eq=False)
class AtState:
    """A coefficient where u is known: forms read u and its slope at the places where they want it.

    Attributes
    ----------
    coefficient : callable
        Of the values (k,) of u, its tangential gradients (k, d) and the points (k, d), in the scene's coordinates:
        returns numbers (k,) or symmetric tensors (k, d, d).
    u : (n, 1) float64
        The unknowns.
    holding : callable, optional
        Of the same, returns numbers (k,): what terms of the form's own are in units of, such as penalties. Unless given
        the coefficient is, and of a tensor its mean. A tangent has that of what it is the tangent of.
    """

    needs_state: ClassVar[bool] = True
    coefficient: Callable[[Floats, Floats, Floats], Floats]
    u: Floats
    holding: Callable[[Floats, Floats, Floats], Floats] | None = None
