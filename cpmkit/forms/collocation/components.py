"""Connected components of a manifold that boundaries cut apart: which are free of conditions, which closed to fluxes.

They are found by flood fill over sides: a difference stencil joins its unknown to the neighbours that it reads, and
reads none across a boundary.
"""

from __future__ import annotations

import numpy as np

from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.scene.edge_conditions import edge_condition
from cpmkit.scene.laws import fixes_constant, is_zero_neumann
from cpmkit.scene.scene import Scene
from cpmkit.types import Bools, Ints

#: Weights below this are rounding and connect nothing.
LEAST_CONNECTING_WEIGHT = 1e-12
#: Rows of E that are scanned at a time.
COMPONENT_CHUNK_ROWS = 1 << 17


def singular_components(tables: Discretization, scene: Scene) -> tuple[int, Ints]:
    """Return how many components leave the constant free, and the component (n,) of each unknown, -1 for none of them.

    A factor c of u fixes the constant of components on which it is not zero, a law that involves the value that of the
    component that it bounds.
    """
    c = scene.problem.terms().c
    if not callable(c) and c != 0:
        return 0, np.full(tables.unknowns.count, -1)
    count, label = components(tables)
    free = np.zeros(count, dtype=bool)
    free[label[: tables.layout.band.inner]] = True  # a ghost without nodes around it lies past an open end
    fixed = np.zeros(tables.numbering.rows, dtype=bool)
    for datum in tables.data:
        fixed[datum.rows[fixes_constant(datum.law, datum.points, datum.name)]] = True
    free[label[np.flatnonzero(fixed[tables.numbering.row_of_unknown])]] = False
    if callable(c):
        free[label[tables.read_at_rows(c, "the factor c")[tables.numbering.row_of_unknown, 0] != 0]] = False
    return _chosen_components(free, label)


def components_without_flux(tables: Discretization, scene: Scene) -> tuple[int, Ints]:
    """Return how many components nothing flows out of, and the one of each unknown (n,), -1 for none of them.

    No boundary touches them, and their edges, if they have any, are walls.
    """
    if any(tables.numbering.unknown_ghosts):
        return 0, np.full(tables.unknowns.count, -1)
    count, label = components(tables)
    closed = np.ones(count, dtype=bool)
    inner = tables.layout.band.inner
    edge = tables.layout.band.feet.edge[:inner]
    for loop in np.unique(edge[edge >= 0]):
        if not is_zero_neumann(edge_condition(scene.edge, int(loop)).law):
            closed[label[:inner][edge == loop]] = False
    return _chosen_components(closed, label)


def _chosen_components(chosen: Bools, label: Ints) -> tuple[int, Ints]:
    """Return the number of chosen components, and their new number for each unknown, -1 where it is not chosen."""
    number = np.where(chosen, np.cumsum(chosen) - 1, -1)
    return int(chosen.sum()), number[label]


def components(tables: Discretization) -> tuple[int, Ints]:
    """Return the number of components and the component (n,) of each unknown.

    Components of which one reads the other by interpolation count as one: nodes in a narrow wedge, the two sides of a
    transmission, and components that meet where boundaries cross, because stencils there read a little of each.
    """
    count, label = _joined_by_differences(tables, tables.unknowns.count)
    if count == 1:
        return count, label
    count, merged = _graph_components(_reads_between(tables, count, label), count)
    return count, merged[label]


def parts_of_nodes(tables: Discretization) -> Ints:
    """Return the part (inner,) of each inner node, as boundaries cut the manifold that ghosts do not bridge.

    A transmission cuts nothing apart: what flows out of one side of it flows into the other.
    """
    count, label = _joined_by_differences(tables, tables.layout.band.inner)
    pairs = _across_transmissions(tables)
    return label if not pairs.size else _graph_components(label[pairs], count)[1][label]


def _across_transmissions(tables: Discretization) -> Ints:
    """Return the pairs (2, k) of neighbouring inner nodes with a transmission, and no other boundary, between them."""
    layout = tables.layout
    sides = np.zeros((len(layout.ghosts), len(layout.band.nodes)))
    for index, (view, ghosts) in enumerate(zip(layout.boundaries.side_views, layout.ghosts, strict=True)):
        sides[index, view.rows] = np.nan_to_num(np.sign(view.signed)) * (ghosts.numbers[view.rows] >= 0)
    coupled = np.array([boundary.condition("left").couples for boundary in layout.boundaries.definitions], dtype=bool)
    if not coupled.any():
        return np.zeros((2, 0), dtype=np.int64)
    first, second = layout.band.neighbours()
    crossed = sides[:, first] * sides[:, second] < 0
    chosen = crossed[coupled].any(axis=0) & ~crossed[~coupled].any(axis=0)
    return np.stack([first[chosen], second[chosen]])


def _joined_by_differences(tables: Discretization, count: int) -> tuple[int, Ints]:
    """Return the components of the first ``count`` unknowns that difference stencils join."""
    read = tables.numbering.unknown_of_row[tables.neighbours[:count]].ravel()
    reader = np.repeat(np.arange(count), tables.neighbours.shape[1])
    within = (read >= 0) & (read < count)
    return _graph_components(np.stack([reader, read])[:, within], count)


def _graph_components(pairs: Ints, count: int) -> tuple[int, Ints]:
    """Return how many components a graph of ``count`` nodes with edges ``pairs`` (2, k) has, and all labels."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    graph = csr_array((np.ones(pairs.shape[1], dtype=np.int8), (pairs[0], pairs[1])), shape=(count, count))
    number, label = connected_components(graph, directed=False)
    return int(number), np.asarray(label, dtype=np.int64)


def _reads_between(tables: Discretization, count: int, label: Ints) -> Ints:
    """Return the pairs (2, k) of components of which one reads the other, through its neighbours' rows of E."""
    from scipy.sparse import csr_array, vstack

    indicator = csr_array((np.ones(len(label)), (np.arange(len(label)), label)), shape=(len(label), count))
    parts = []
    for start in range(0, tables.extension.shape[0], COMPONENT_CHUNK_ROWS):
        rows = abs(tables.extension[start : start + COMPONENT_CHUNK_ROWS].copy())
        rows.data[rows.data <= LEAST_CONNECTING_WEIGHT] = 0.0
        parts.append(rows @ indicator)
    read = tables.weighted_differences(np.ones(tables.neighbours.shape)) @ vstack(parts).tocsr()
    read.eliminate_zeros()
    pairs = np.stack([np.repeat(label, np.diff(read.indptr)), read.indices])
    return np.unique(pairs[:, pairs[0] != pairs[1]], axis=1)
