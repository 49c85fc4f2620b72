"""The options that belong to the closest point method."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from cpmkit.errors import InputError, shown
from cpmkit.grid.band import check_degree
from cpmkit.runtime.options import DeclaredOptions, option
from cpmkit.scene.conditions import check_order


def _check_sheets(sheets: Any, what: str) -> bool:
    """Return ``sheets`` if it is True or False, else raise an InputError, which calls the option ``what``."""
    if isinstance(sheets, bool):
        return sheets
    instead = '; use form="galerkin", which needs no unfolding' if sheets == "unfolded" else ""
    raise InputError(f"{what} must be true or false, got {shown(sheets)}{instead}.")


def refuse_removed(names: Iterable[str]) -> None:
    """Raise an InputError, with the replacement, if the former option "balance" of collocation is among ``names``."""
    if "balance" in names:
        raise InputError(
            'there is no option `balance` any more: use form="galerkin", in which fluxes balance by construction, and '
            "leave it out."
        )


@dataclass(frozen=True)
class CollocationOptions(DeclaredOptions):
    """The options that belong to the closest point method. Raises InputError if a value is not accepted."""

    degree: int = option(
        3,
        "Degree of the interpolation in the form ``collocation``, 2 to 5, 3 by default, which is right for most; 2 is "
        "quicker and irregular.",
        check_degree,
    )
    order: int = option(2, "Order of accuracy of the conditions at boundaries and edges: 1 or 2.", check_order)
    sheets: bool = option(
        True,
        "Whether a node that several sheets of the surface share gets an unknown for each. False is the plain method, "
        "for comparisons: where sheets share a band it mixes them, and the solution is wrong there.",
        _check_sheets,
        methods={"plain": False},
    )
