"""Problems fixed up to a constant: on which pieces of a manifold one is free, and what of the data has no solution.

On a closed surface, or a piece of one with Neumann conditions all around, u + constant solves what u solves, and
the data must balance: what f brings in has to flow out. There the solution of mean zero is taken; what does not
balance, a constant on each piece, is left out of f and told.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol
from weakref import WeakKeyDictionary

import numpy as np

from cpmkit.forms.imbalance import Imbalance
from cpmkit.linear.operators import Border, Bordered
from cpmkit.protocols import Floats, Operator

#: A defect above this share of the data is reported on any lattice.
GROSS_DEFECT_SHARE = 0.5
#: A defect above this multiple of ``(spacing / size)^2`` times the data is reported (at first order of ``spacing /
#: size``). Smooth data that balance leave about 1 or less on spheres, caps, circles and arcs, and less than 8 where f
#: is a bump of a fifth of the size, on tori and ellipses that the band resolves.
EXPLAINED_DEFECT_FACTOR = 10.0
#: A piece is free where A times its indicator is below this share of the diagonal.
ROUNDING = 1e-10
#: A point is on a piece where the piece's indicator is above this.
MOSTLY = 0.5


def free_pieces(
    stiffness: Operator, mass_of: Callable[[], Operator | None], summing: int | None = None
) -> Border | None:
    """Return the pieces on which A has no say about a constant, from A and M alone; None where there is none.

    M is asked for where there is one.
    Unknowns that A couples make a piece; on a free one A times the piece's indicator vanishes. The constant 1 is 1 at
    the first ``summing`` unknowns, at all unless given, and zero at others.
    """
    from scipy.sparse import csr_array

    matrix = stiffness.to_csr()
    piece = stiffness.pieces()[1][:summing]
    count = int(piece.max(initial=-1)) + 1
    starts = np.minimum(np.arange(matrix.shape[0] + 1), len(piece))  # no piece has what is not summed
    indicator = csr_array((np.ones(len(piece)), piece, starts), shape=(matrix.shape[0], count))
    pulled = matrix @ indicator
    drift = np.zeros(count)
    np.maximum.at(drift, pulled.indices, np.abs(pulled.data))
    free = np.flatnonzero(drift <= ROUNDING * float(np.abs(matrix.diagonal()).max()))
    if not len(free):
        return None
    indicator = indicator[:, free].tocsr()
    dense = indicator.toarray()
    mass = mass_of()
    weights = dense if mass is None else mass.apply(dense)
    mean = csr_array((weights / (dense * weights).sum(axis=0)).T)
    members = np.diff(indicator.tocsc().indptr)  # a load of mean one, as the indicator is, keeps the shift's size
    return Border(indicator, mean, None if mass is None else csr_array(mean.T * members))


class KnowsPoints(Protocol):
    """What is asked of a form to tell of pieces."""

    @property
    def mass(self) -> Operator | None:
        """M; None where it is the identity."""

    @property
    def points(self) -> Floats:
        """(p, d) at which it knows values."""

    def at_points(self, u: Floats) -> Floats:
        """Return the values (p, channels) there of u (n, channels)."""


class _Told(NamedTuple):
    """What is told of a piece: the defect that its points explain, one of them, and its share of all."""

    explained: float
    near: tuple[float, ...]
    share: float


#: Of the pieces of borders in use: it takes as long as a solve with factors that are there.
_KNOWN: WeakKeyDictionary[Border, list[_Told]] = WeakKeyDictionary()


def defects_of(operator: Bordered, b: Floats, u: Floats, form: KnowsPoints) -> tuple[Floats, tuple[Imbalance, ...]]:
    """Return u (n, channels) with mean zero on each free piece, and what of b has no solution there."""
    u, means = operator.border.centred(u)
    indicator, carried = operator.border.indicator.toarray(), operator.border.carried
    measure = (indicator * (indicator if form.mass is None else form.mass.apply(indicator))).sum(axis=0)
    values = operator.shift * (means.T * ((indicator * carried.toarray()).sum(axis=0) / measure)).T
    if operator.border not in _KNOWN:
        _KNOWN[operator.border] = _pieces(form, indicator)
    return u, tuple(
        Imbalance(
            "data",
            value=tuple(values[k].tolist()),
            size=tuple((indicator[:, k] @ np.abs(b) / measure[k]).tolist()),
            explained=piece.explained,
            near=piece.near,
            share=piece.share,
        )
        for k, piece in enumerate(_KNOWN[operator.border])
    )


def _pieces(form: KnowsPoints, indicator: Floats) -> list[_Told]:
    """Return what is told of the pieces with these indicators (n, k)."""
    found, points = [], form.points
    for on in (form.at_points(indicator) > MOSTLY).T:
        members = np.flatnonzero(on)
        extent = float(np.ptp(points[members], axis=0).max()) if len(members) else 0.0
        steps = max(len(members) ** 0.5, 1.0) if extent else 1.0
        explained = min(EXPLAINED_DEFECT_FACTOR / steps**2, GROSS_DEFECT_SHARE)
        near = tuple(points[members[len(members) // 2]].tolist()) if len(members) else ()
        found.append(_Told(explained, near, len(members) / max(len(points), 1)))
    return found
