"""Problems fixed up to a constant: on which pieces of a manifold one is free, and what of the data has no solution.

On a closed surface, or a piece of one with Neumann conditions all around, u + constant solves what u solves, and
the data must balance: what f brings in has to flow out. There the solution of mean zero is taken; what does not
balance, a constant on each piece, is left out of f and told.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cpmkit.errors import place
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


@dataclass(frozen=True)
class UnbalancedData:
    """The part of the data that has no solution on a piece of the manifold where the solution is fixed by its mean.

    Attributes
    ----------
    near : tuple of float
        A point of the piece.
    share : float
        Its share of the nodes.
    bounded_by : tuple of str
        Names and sides of the boundaries around it.
    parts : int
        More than 1 where boundaries cross: into so many parts they cut the piece, which hang together there.
    value : tuple of float
        What was subtracted from f, for each channel.
    data_size : tuple of float
        The mean size of f and fluxes, to which the defect compares, for each channel.
    explained : float
        The relative defect that the spacing alone may leave.
    """

    near: tuple[float, ...]
    share: float
    bounded_by: tuple[str, ...]
    parts: int
    value: tuple[float, ...]
    data_size: tuple[float, ...]
    explained: float

    @property
    def relative(self) -> float:
        """The largest defect of a channel over the size of its data; at order 2 at most about 1."""
        return max(self._shares)

    @property
    def _shares(self) -> list[float]:
        pairs = zip(self.value, self.data_size, strict=True)
        return [abs(value) / size if size > 0 else 0.0 for value, size in pairs]

    def as_dict(self) -> dict[str, Any]:
        """Return the defect as plain values."""
        return asdict(self)

    @property
    def warnings(self) -> list[str]:
        """What a reader of the solution should know, in sentences."""
        walls = f", bounded by {', '.join(self.bounded_by)}" if self.bounded_by else ""
        where = f"near {place(self.near)}, {self.share:.0%} of the nodes{walls}"
        sentences = []
        if self.relative > self.explained:
            worst = self.value[self._shares.index(self.relative)]
            sentences.append(
                f"The data do not balance on the piece of the manifold {where}: f brings in {worst:.4g} a unit of "
                f"measure more than flows out, {self.relative:.2g} of the data's mean size where the spacing explains "
                f"{self.explained:.2g}; f less that was solved, check f and the fluxes."
            )
        if self.parts > 1:
            sentences.append(
                f"Boundaries that cross cut the piece of the manifold {where}, into {self.parts} parts, which hang "
                "together at the crossings: one constant is free for all of them, and data that do not balance on "
                "each part flow through the crossings."
            )
        return sentences


def free_pieces(stiffness: Operator, mass: Operator | None) -> Border | None:
    """Return the pieces on which A has no say about a constant, from A and M alone; None where there is none.

    Unknowns that A couples make a piece; on a free one A times the piece's indicator vanishes.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    matrix = stiffness.to_csr()
    count, piece = connected_components(matrix, directed=False)
    indicator = csr_array((np.ones(len(piece)), (np.arange(len(piece)), piece)), shape=(len(piece), count))
    drift = abs(matrix @ indicator).max(axis=0).toarray().ravel()
    free = np.flatnonzero(drift <= ROUNDING * float(np.abs(matrix.diagonal()).max()))
    if not len(free):
        return None
    indicator = indicator[:, free].tocsr()
    weights = indicator.toarray() if mass is None else mass.apply(indicator.toarray())
    mean = csr_array((weights / weights.sum(axis=0)).T)
    members = np.diff(indicator.tocsc().indptr)  # a load of mean one, as the indicator is, keeps the shift's size
    return Border(indicator, mean, None if mass is None else csr_array(mean.T * members))


def defects_of(
    operator: Bordered,
    b: Floats,
    u: Floats,
    mass: Operator | None,
    at_points: Callable[[Floats], Floats],
    points: Floats,
) -> tuple[Floats, tuple[UnbalancedData, ...]]:
    """Return u (n, channels) with mean zero on each free piece, and what of b has no solution there."""
    u, means = operator.border.centred(u)
    indicator, carried = operator.border.indicator.toarray(), operator.border.carried
    measure = (indicator if mass is None else mass.apply(indicator)).sum(axis=0)
    values = operator.shift * (means.T * (carried.sum(axis=0) / measure)).T
    found = []
    for k, on in enumerate((at_points(indicator) > MOSTLY).T):
        members = np.flatnonzero(on)
        extent = float(np.ptp(points[members], axis=0).max()) if len(members) else 0.0
        steps = max(len(members) ** 0.5, 1.0) if extent else 1.0
        found.append(
            UnbalancedData(
                near=tuple(points[members[len(members) // 2]].tolist()) if len(members) else (),
                share=len(members) / max(len(points), 1),
                bounded_by=(),
                parts=1,
                value=tuple(values[k].tolist()),
                data_size=tuple((indicator[:, k] @ np.abs(b) / measure[k]).tolist()),
                explained=min(EXPLAINED_DEFECT_FACTOR / steps**2, GROSS_DEFECT_SHARE),
            )
        )
    return u, tuple(found)
