"""Connected components of a manifold cut by boundaries: those with a free constant, and those that no flux leaves.

Components are those of the graph of unknowns: a difference stencil joins its unknown to the neighbours that it reads,
and it reads no value from the other side of a boundary.
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
#: Number of rows of E that are scanned at a time.
COMPONENT_CHUNK_ROWS = 1 << 17


def singular_components(tables: Discretization, scene: Scene) -> tuple[int, Ints]:
    """Return the number of components with a free constant, and the component (n,) of each unknown, -1 on others.

    A component's constant is free if u + constant solves the same problem. A factor c of u that is not zero on the
    component fixes it, and so does a condition at its boundary that involves the value of u.
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
    """Return the number of components that no flux leaves, and the component (n,) of each unknown, -1 on others.

    If any boundary has ghosts there are none; otherwise they are the components whose edges all have zero flux, and
    those without edges.
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
    """Return the number of ``chosen`` components, and each unknown's component (n,) among them, -1 if not chosen."""
    number = np.where(chosen, np.cumsum(chosen) - 1, -1)
    return int(chosen.sum()), number[label]


def components(tables: Discretization) -> tuple[int, Ints]:
    """Return the number of components and the component (n,) of each unknown.

    Components are merged if one reads the other by interpolation: nodes in a narrow wedge, the two sides of a
    transmission, and components that meet where boundaries cross, because stencils there read a little of each.
    """
    count, label = _joined_by_differences(tables, tables.unknowns.count)
    if count == 1:
        return count, label
    count, merged = _graph_components(_reads_between(tables, count, label), count)
    return count, merged[label]


def parts_of_nodes(tables: Discretization) -> Ints:
    """Return the part (inner,) of the manifold that each inner node is in, as cut by all boundaries but transmissions.

    A transmission separates no parts: what flows out on one side of it flows in on the other.
    """
    count, label = _joined_by_differences(tables, tables.layout.band.inner)
    pairs = _across_transmissions(tables)
    return label if not pairs.size else _graph_components(label[pairs], count)[1][label]


def _across_transmissions(tables: Discretization) -> Ints:
    """Return the pairs (2, k) of neighbouring inner nodes that a transmission, and no other boundary, separates."""
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
    """Return how many components difference stencils form of the first ``count`` unknowns, and the labels (count,)."""
    read = tables.numbering.unknown_of_row[tables.neighbours[:count]].ravel()
    reader = np.repeat(np.arange(count), tables.neighbours.shape[1])
    within = (read >= 0) & (read < count)
    return _graph_components(np.stack([reader, read])[:, within], count)


def _graph_components(pairs: Ints, count: int) -> tuple[int, Ints]:
    """Return the number of components of a graph, and the label (count,) of each of its ``count`` nodes.

    Its edges are ``pairs`` (2, k) of nodes.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    graph = csr_array((np.ones(pairs.shape[1], dtype=np.int8), (pairs[0], pairs[1])), shape=(count, count))
    number, label = connected_components(graph, directed=False)
    return int(number), np.asarray(label, dtype=np.int64)


def _reads_between(tables: Discretization, count: int, label: Ints) -> Ints:
    """Return the pairs (2, k) of different components of which the first reads the second.

    It reads the values that E interpolates at its difference neighbours; ``label`` (n,) is each unknown's component.
    """
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
