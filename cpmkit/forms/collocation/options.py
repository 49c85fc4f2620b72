"""The options that belong to the closest point method."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

from cpmkit.errors import InputError, shown
from cpmkit.grid.stencils import check_degree
from cpmkit.runtime.arrays import whole
from cpmkit.runtime.options import Declared, option

#: The highest degree of polynomials that fluxes balance against, 165 of them in space; higher ones see what a spacing
#: does not resolve.
HIGHEST_POLYNOMIAL_DEGREE = 8


def _check_sheets(sheets: Any, what: str) -> Any:
    if not isinstance(sheets, bool) and sheets != "unfolded":
        raise InputError(
            f"{what} must be true, false or 'unfolded', got {shown(sheets)}; true parts sheets that share a band, "
            "'unfolded' unfolds sharp bends, too."
        )
    return sheets


@dataclass(frozen=True)
class CollocationOptions(Declared):
    """The options that belong to the closest point method.

    Raises
    ------
    InputError
        If a value is not accepted, or not beside the others.
    """

    degree: int = option(
        3,
        "Degree of the interpolation in the form ``collocation``, 2 to 5, 3 by default, which is right for most; 2 is "
        "quicker and irregular.",
        check_degree,
    )
    order: int = option(
        2,
        "Order of accuracy of the conditions at boundaries and edges: 1, 2, or 3, which makes second order more "
        "regular. 4 makes the Laplacian fourth order too, needs degree 4 or 5, and an exact, smooth source whose "
        "curvature leaves room for a wider tube.",
        partial(whole, least=1, most=4),
    )
    sheets: bool | Literal["unfolded"] = option(
        True,
        'Whether a node that several sheets of the surface share gets an unknown for each. With ``"unfolded"`` the '
        "surface is unfolded, too, where it bends more sharply than a stencil is wide: further unknowns, for coarse "
        "spacings. False is the plain method, for comparisons: where sheets share a band it mixes them, and the "
        "solution is wrong there.",
        _check_sheets,
        methods={"plain": False, "unfolded": "unfolded"},
    )
    balance: int = option(
        0,
        "Where nothing flows out, on closed surfaces and between walls, u is put right by polynomials in the "
        "coordinates up to this degree, at most 8, so that fluxes balance against all of them: 5 leaves a twentieth "
        "to a half of the error, for little work. 0 puts the mean alone right.",
        partial(whole, most=HIGHEST_POLYNOMIAL_DEGREE),
        methods={"balanced": 5},
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.order == 4 and self.degree < 4:
            raise InputError(
                f"order=4 needs degree 4 or 5, got degree={self.degree}; interpolation would keep it at order 2."
            )
        if self.order == 4 and self.sheets == "unfolded":
            raise InputError("order=4 unfolds nothing: it needs a tube in which no surface bends sharply; use order=2.")
