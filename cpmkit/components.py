"""Pieces of a manifold that its boundaries cut apart, and whether anything fixes the solution on each."""

from __future__ import annotations

import numpy as np

from cpmkit.boundary.edge import edge_condition
from cpmkit.discretization import Discretization
from cpmkit.errors import SceneError
from cpmkit.problems import Problem
from cpmkit.protocols import Bools, Ints
from cpmkit.scene import Scene

#: A weight below this reads nothing.
ROUNDING = 1e-12


def components(tables: Discretization) -> tuple[int, Ints]:
    """Return the number of pieces and the piece (unknowns,) of each unknown.

    A flood fill over sides: a difference stencil joins its unknown to the neighbours that it reads, and
    reads none across a boundary.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    unknown_of_row = np.full(tables.extension.shape[0], -1)
    rows = tables.unknown_rows
    unknown_of_row[rows] = np.arange(len(rows))
    read = unknown_of_row[tables.neighbours.indices]
    reader = np.repeat(np.arange(len(rows)), np.diff(tables.neighbours.indptr))[read >= 0]
    graph = csr_array((np.ones(len(reader), dtype=np.int8), (reader, read[read >= 0])), shape=(len(rows), len(rows)))
    count, label = connected_components(graph, directed=False)
    return int(count), np.asarray(label, dtype=np.int64)


def check_pinned(tables: Discretization, scene: Scene, problem: Problem) -> None:
    """Refuse a problem whose solution is fixed only up to a constant on some piece.

    Raises
    ------
    SceneError
        Naming the piece by the boundaries that bound it and a point in it.
    """
    if problem.c > 0:
        return
    count, label = components(tables)
    pinned = np.zeros(count, dtype=bool)
    pinned[label[_pinning(tables, scene)]] = True
    pinned = _spread(tables, label, pinned)
    loose = [int(piece) for piece in np.flatnonzero(~pinned) if _has_nodes(tables, label == piece)]
    if loose:
        raise SceneError(_describe(tables, scene, label, loose))


def _spread(tables: Discretization, label: Ints, pinned: Bools) -> Bools:
    """Return which pieces are pinned, or read one that is: single nodes may hang together by interpolation alone."""
    rows = tables.unknown_rows
    while not pinned.all():
        members = np.flatnonzero(~pinned[label])
        reads = tables.extension[rows[members]]
        reader = np.repeat(label[members], np.diff(reads.indptr))
        counts = (np.abs(reads.data) > ROUNDING) & pinned[label[reads.indices]]
        if not counts.any():
            break
        pinned = pinned.copy()
        pinned[reader[counts]] = True
    return pinned


def _has_nodes(tables: Discretization, members: Bools) -> bool:
    """Tell whether a piece holds nodes of its own, not only stray ghosts past an open end."""
    return bool(members[: tables.layout.band.inner].any())


def _pinning(tables: Discretization, scene: Scene) -> Ints:
    """Return the unknowns whose extension involves the value itself: Dirichlet or Robin ghosts and edge nodes."""
    found = []
    first = tables.layout.band.inner
    for boundary, ghosts in zip(scene.boundaries, tables.layout.ghosts, strict=True):
        left = ghosts.carries_left[: ghosts.unknowns]
        fixes = np.where(left, boundary.condition("left").beta != 0, boundary.condition("right").beta != 0)
        found.append(first + np.flatnonzero(fixes))
        first += ghosts.unknowns
    edge = tables.layout.band.feet.edge[: tables.layout.band.inner]
    for loop in np.unique(edge[edge >= 0]):
        if edge_condition(scene.edge, int(loop)).beta != 0:
            found.append(np.flatnonzero(edge == loop))
    return np.concatenate(found) if found else np.zeros(0, dtype=np.int64)


def _describe(tables: Discretization, scene: Scene, label: Ints, loose: list[int]) -> str:
    inner = tables.layout.band.inner
    members = label == loose[0]
    nodes = np.flatnonzero(members[:inner])
    share = len(nodes) / inner
    near = tables.layout.lattice.to_scene(tables.layout.band.feet.points[nodes[:1]])[0]
    walls, first = [], inner
    for boundary, ghosts in zip(scene.boundaries, tables.layout.ghosts, strict=True):
        carried = members[first : first + ghosts.unknowns]
        walls += [
            f"{boundary.name!r} ({side})"
            for side, left in (("left", True), ("right", False))
            if np.any(carried & (ghosts.carries_left[: ghosts.unknowns] == left))
        ]
        first += ghosts.unknowns
    bounded = f", bounded by {', '.join(walls)}," if walls else ""
    count = f"{len(loose)} pieces" if len(loose) > 1 else "a piece"
    return (
        f"Nothing fixes the solution on {count} of the manifold: the one near ({', '.join(f'{x:.4g}' for x in near)}), "
        f"{share:.0%} of the band{bounded} has only Neumann conditions, so that any constant may be added; "
        "give a Dirichlet condition there, or solve the screened problem."
    )
