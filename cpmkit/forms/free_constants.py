"""Constants that are free on pieces of the manifold, and data that do not balance there.

A constant is free on a piece of the manifold (a closed surface, or a part with Neumann conditions all around) if
u + constant solves the equation whenever u does. The data must balance there: the integral of f must equal the flux out
of the piece. The solution with mean zero is taken; the imbalance, a constant on each piece, is subtracted from f.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal
from weakref import WeakKeyDictionary

import numpy as np

from cpmkit.errors import place
from cpmkit.linear.operators import Border, Bordered
from cpmkit.linear.protocols import Operator
from cpmkit.types import Bools, Floats

if TYPE_CHECKING:
    from cpmkit.forms.contract import Discretized

#: A relative imbalance above this is reported on any lattice.
GROSS_DEFECT_SHARE = 0.5
#: A relative imbalance above this times ``(spacing / size)^2`` is reported (at first order times ``spacing / size``).
#: Smooth data that balance leave about 1 or less on spheres, caps, circles and arcs, and less than 8 where f is a bump
#: of a fifth of the size, on tori and ellipses that the band resolves.
EXPLAINED_DEFECT_FACTOR = 10.0
#: A constant is free on a piece where A times its indicator is below this share of the diagonal: rounding.
ROUNDING = 1e-10


@dataclass(frozen=True)
class Imbalance:
    """Data that do not balance on a piece of the manifold, or on several together, and the correction."""

    #: "data": u + constant is a solution on the piece if u is, and the integral of f is not the flux out; ``value`` was
    #: subtracted from f. "mean": c times the mean of u differs from the mean of f where nothing flows out; u was
    #: shifted. "fluxes", in files of earlier versions: a combination of polynomials was added to u so that fluxes
    #: balance.
    of: Literal["data", "mean", "fluxes"]
    #: The imbalance of each channel: "data", f less the flux out, per unit of measure; "mean", ``c mean(u) - mean(f)``;
    #: "fluxes", the root mean square of the correction of u.
    value: tuple[float, ...]
    #: The size that ``value`` is relative to, for each channel: "data", the mean size of f and fluxes; "mean", c times
    #: the range of u; "fluxes", the range of u.
    size: tuple[float, ...]
    explained: float  #: The relative imbalance that the spacing alone may cause.
    near: tuple[float, ...] = ()  #: A point of the piece; empty for several pieces together.
    share: float = 1.0  #: Share of the nodes that are on the piece.
    bounded_by: tuple[str, ...] = ()  #: Names and sides of the boundaries around the piece.
    shift: tuple[float, ...] = ()  #: Only of "mean": the constant that was added to u on the piece, for each channel.

    @property
    def relative(self) -> float:
        """The largest relative imbalance of all channels."""
        return max(self.shares)

    @property
    def shares(self) -> list[float]:
        """The relative imbalance of each channel, ``|value| / size``; 0 where the size is 0."""
        pairs = zip(self.value, self.size, strict=True)
        return [abs(value) / size if size > 0 else 0.0 for value, size in pairs]

    def as_dict(self) -> dict[str, Any]:
        """Return the fields by name, as text, numbers and tuples."""
        return asdict(self)

    @property
    def where(self) -> str:
        """The place of the piece, as part of a sentence: a point, the share of the nodes, and the boundaries."""
        walls = f", bounded by {', '.join(self.bounded_by)}" if self.bounded_by else ""
        return f"near {place(self.near)}, {self.share:.0%} of the nodes{walls}"

    @property
    def warnings(self) -> list[str]:
        """A list with one warning if the relative imbalance exceeds ``explained``; otherwise empty."""
        if self.relative <= self.explained:
            return []
        worst = self.value[self.shares.index(self.relative)]
        if self.of == "data":
            return [
                f"The data do not balance on the piece of the manifold {self.where}: the integral of f must equal the "
                f"flux out of the piece. f exceeds it by {worst:.4g} per unit of measure, {self.relative:.2g} of the "
                f"data's mean size (the spacing explains {self.explained:.2g}); this was subtracted from f. Check f "
                "and the fluxes."
            ]
        return [
            "The solution leaks at creases or thin parts that the spacing does not resolve; use a smaller one. On a "
            f"piece that nothing flows out of, c times the mean of u differed from the mean of f by {worst:.3g}. The "
            f"mean was corrected; the rest of the solution may be off by up to {self.relative:.1%} of its range."
        ]

    @property
    def nothing_given(self) -> list[str]:
        """A list with the warning that u is zero on the piece because no data are given; empty if data are given."""
        if self.of != "data" or any(self.size):
            return []
        return [
            f"Nothing is given on the piece of the manifold {self.where}: no condition gives a value there, and no "
            "right-hand side or flux acts, so that any constant is a solution; zero was taken. Give a side of a "
            "boundary there a Dirichlet condition."
        ]


def free_pieces(
    stiffness: Operator, make_mass: Callable[[], Operator | None], constant_unknowns: int | None = None
) -> Border | None:
    """Return the border of the pieces of the manifold on which u + constant solves ``A u = b`` if u does; else None.

    Unknowns that A couples belong to the same piece; a constant is free on a piece if A times its indicator vanishes.

    ``stiffness``: the operator A.
    ``make_mass``: returns the mass matrix M, or None if it is the identity; called only if a constant is free.
    ``constant_unknowns``: the function 1 has the coefficient 1 at the first so many unknowns and zero at the others; by
        default 1 at all.
    """
    from scipy.sparse import csr_array

    constant = np.zeros(stiffness.size)
    constant[:constant_unknowns] = 1.0
    residual = np.abs(stiffness.apply(constant))
    rounding = ROUNDING * float(np.abs(stiffness.diagonal).max())
    if residual.min(initial=np.inf) > rounding:
        return None
    all_pieces = stiffness.pieces()[1]
    piece = all_pieces[:constant_unknowns]
    count = int(piece.max(initial=-1)) + 1
    starts = np.minimum(np.arange(stiffness.size + 1), len(piece))  # other unknowns are on no piece
    indicator = csr_array((np.ones(len(piece)), piece, starts), shape=(stiffness.size, count))
    largest = np.zeros(int(all_pieces.max(initial=-1)) + 1)
    np.maximum.at(largest, all_pieces, residual)
    free = np.flatnonzero(largest[:count] <= rounding)
    if not len(free):
        return None
    indicator = indicator[:, free].tocsr()
    dense = indicator.toarray()
    mass = make_mass()
    weights = dense if mass is None else mass.apply(dense)
    mean = csr_array((weights / (dense * weights).sum(axis=0)).T)
    members = np.diff(indicator.tocsc().indptr)  # a load of mean one, as the indicator is, keeps the shift's size
    return Border(indicator, mean, None if mass is None else csr_array(mean.T * members))


#: The fields ``explained``, ``near`` and ``share`` of imbalances on the pieces of borders in use: finding them takes as
#: long as a solve with known factors.
_PIECES: WeakKeyDictionary[Border, list[dict[str, Any]]] = WeakKeyDictionary()


def balanced_solution(
    operator: Bordered, b: Floats, u: Floats, form: Discretized
) -> tuple[Floats, tuple[Imbalance, ...]]:
    """Return u (n, channels) less its mean on each piece of the border, and the imbalance of the load ``b`` there.

    ``u`` solves ``operator u = b``. The places of the pieces are stored for the next call with the same border.
    """
    u, means = operator.border.remove_means(u)
    indicator, load = operator.border.indicator.toarray(), operator.border.constant_load
    measure = (indicator * (indicator if form.mass is None else form.mass.apply(indicator))).sum(axis=0)
    values = operator.shift * (means.T * ((indicator * load.toarray()).sum(axis=0) / measure)).T
    sizes = indicator.T @ np.abs(b) / measure[:, None]
    if operator.border not in _PIECES:
        _PIECES[operator.border] = [_described_piece(form, on_piece) for on_piece in form.at_points(indicator).T > 0.5]
    pieces = zip(values.tolist(), sizes.tolist(), _PIECES[operator.border], strict=True)
    return u, tuple(Imbalance("data", value=tuple(value), size=tuple(size), **piece) for value, size, piece in pieces)


def _described_piece(form: Discretized, on_piece: Bools) -> dict[str, Any]:
    """Return the fields explained, near and share of an imbalance on the piece with the points ``on_piece`` (p,).

    A piece without points has no place: its ``near`` is empty and its ``share`` 0.
    """
    points, members = form.points, np.flatnonzero(on_piece)
    if not len(members):
        return {"explained": GROSS_DEFECT_SHARE, "near": (), "share": 0.0}
    extent = float(np.ptp(points[members], axis=0).max())
    steps = len(members) ** 0.5 if extent else 1.0
    return {
        "explained": min(EXPLAINED_DEFECT_FACTOR / steps**2, GROSS_DEFECT_SHARE),
        "near": tuple(points[members[len(members) // 2]].tolist()),
        "share": len(members) / len(points),
    }
