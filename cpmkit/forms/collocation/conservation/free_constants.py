"""Problems whose solution is fixed up to a constant on some pieces, and the part of the data that has no solution.

On a closed surface, or a piece of one with Neumann conditions all around, u + constant solves what u solves, and
the data must balance: what f brings in has to flow out. There the solution of mean zero is taken; what does not
balance, a constant on each piece, is left out of f and told.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.forms.collocation.conservation.components import node_pieces, singular_components
from cpmkit.forms.collocation.conservation.mean_weights import end_weights, mean_weights
from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.forms.collocation.layout import Layout
from cpmkit.forms.collocation.operator import ExtensionOperator
from cpmkit.forms.free_constants import EXPLAINED_DEFECT_FACTOR, GROSS_DEFECT_SHARE, Imbalance
from cpmkit.linear.operators import Border, Bordered
from cpmkit.protocols import Floats, Ints
from cpmkit.scene.scene import Scene

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Nodes past an end may reduce the total weight of a piece to this share; below it, on a piece hardly wider than their
#: reach, the mean is taken over the piece's own nodes alone.
PAST_END_WEIGHT_SHARE = 0.5


def find_border(tables: Discretization, scene: Scene) -> Border | None:
    """Return the border that fixes free constants: indicators and means of pieces where no condition does."""
    from scipy.sparse import csr_array

    count, piece = singular_components(tables, scene)
    if not count:
        return None
    mean, members, piece = means_over(tables, count, piece)
    indicator = csr_array((np.ones(len(members)), (members, piece)), shape=(tables.unknowns.count, count))
    return Border(indicator, mean)


def means_over(tables: Discretization, count: int, piece: Ints) -> tuple[csr_array, Ints, Ints]:
    """Return the means (count, n) over pieces, the unknowns on them, and their pieces; -1 is no ``piece`` (n,)."""
    from scipy.sparse import csr_array

    members = np.flatnonzero(piece >= 0)
    piece = piece[members]
    weights = _weights(tables, count, members, piece)
    return csr_array((weights, (piece, members)), shape=(count, tables.unknowns.count)), members, piece


def _weights(tables: Discretization, count: int, members: Ints, piece: Ints) -> Floats:
    """Return the weights of some unknowns in the mean over their ``piece``, which sum to 1 on each."""
    smooth, node = mean_weights(tables)[members], members < tables.layout.band.inner

    def total(values: Floats) -> Floats:
        return np.bincount(piece, values, count).astype(np.float64)

    wide = total(smooth) > PAST_END_WEIGHT_SHARE * total(np.where(node, np.maximum(smooth, 0.0), 0.0))
    weights = np.where(wide[piece], smooth, node)
    return np.asarray(weights / total(weights)[piece])


def remove_constants(
    tables: Discretization, scene: Scene, operator: Bordered, u: Floats
) -> tuple[Floats, tuple[Imbalance, ...]]:
    """Return a solution (n, channels) of the lifted system with mean zero on each piece, and what does not balance."""
    u, means = operator.border.remove_means(u)
    sizes = _data_sizes(tables, scene, operator)
    pieces = [
        _defect(tables, scene, operator.border, piece, value, size)
        for piece, (value, size) in enumerate(zip(operator.shift * means, sizes, strict=True))
    ]
    return u, tuple(pieces)


def _data_sizes(tables: Discretization, scene: Scene, operator: Bordered) -> Floats:
    """Return the mean size (pieces, channels) of f, and of the fluxes through the ends, on each piece."""
    border, bare = operator.border, operator.operator
    assert isinstance(bare, ExtensionOperator)
    f = np.abs(tables.read_sources(scene.problem.terms().f, "the right-hand side f"))
    fluxes = np.abs(tables.datum()[tables.numbering.row_of_unknown])
    conductivity = bare.scale * float(np.abs(bare.differences.data).max())
    total = np.maximum(border.indicator.T @ np.maximum(mean_weights(tables), 0.0), np.finfo(float).tiny)[:, None]
    nodes = (np.arange(len(f)) < tables.layout.band.inner) * 1.0
    mean_f = (border.indicator.T @ (nodes[:, None] * f)) / (border.indicator.T @ nodes)[:, None]
    flux = border.indicator.T @ (end_weights(tables)[:, None] * fluxes) * conductivity / total
    return np.asarray(mean_f + flux)


def _defect(tables: Discretization, scene: Scene, border: Border, piece: int, value: Floats, size: Floats) -> Imbalance:
    layout = tables.layout
    members = border.indicator.tocsc()[:, [piece]].indices.astype(np.int64)
    nodes = members[members < layout.band.inner]
    spacings = max(float(np.ptp(layout.band.feet.points[nodes], axis=0).max()) / layout.lattice.spacing, 1.0)
    return Imbalance(
        "data",
        value=tuple(value.tolist()),
        size=tuple(size.tolist()),
        explained=min(EXPLAINED_DEFECT_FACTOR / spacings ** _order(layout, scene), GROSS_DEFECT_SHARE),
        **place_of(tables, scene, members),
        parts=_count_parts(tables, nodes),
    )


def place_of(tables: Discretization, scene: Scene, members: Ints) -> dict[str, Any]:
    """Return where a piece is, the sorted unknowns ``members``: a point of it, its share, the boundaries around it."""
    layout = tables.layout
    nodes = members[: np.searchsorted(members, layout.band.inner)]
    middle = layout.band.feet.points[nodes[[len(nodes) // 2]]]
    return {
        "near": tuple(layout.lattice.to_scene(middle)[0].tolist()),
        "share": len(nodes) / layout.band.inner,
        "bounded_by": _walls(tables, scene, members),
    }


def _count_parts(tables: Discretization, nodes: Ints) -> int:
    """Return into how many parts, larger than a stencil, boundaries that cross cut a piece."""
    if len(tables.layout.ghosts) < 2:
        return 1
    band = tables.layout.band
    sizes = np.bincount(node_pieces(tables)[nodes])
    return max(int(np.count_nonzero(sizes > (band.degree + 1) ** band.dim)), 1)


def _order(layout: Layout, scene: Scene) -> int:
    """Return the order of the error that the conditions leave, 1 or 2."""
    return min([2, layout.order, *(condition.order for condition in scene.conditions if condition.order)])


def _walls(tables: Discretization, scene: Scene, members: Ints) -> tuple[str, ...]:
    """Return the names and sides of the boundaries around a piece."""
    inside = np.zeros(tables.unknowns.count, dtype=bool)
    inside[members] = True
    walls = []
    for index, (boundary, ghosts) in enumerate(zip(scene.boundaries, tables.layout.ghosts, strict=True)):
        carried = inside[tables.numbering.unknowns_of(index)]
        on_left = ghosts.carries_left[: ghosts.unknowns]
        walls += [
            f"{boundary.name!r} ({side})"
            for side, on in (("left", on_left), ("right", ~on_left))
            if np.any(carried & on)
        ]
    return tuple(walls)
