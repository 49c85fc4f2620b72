"""Junctions of the curves of a union: u is continuous there only if their meshes have a common vertex."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from cpmkit.plugin import ClosestPointSource, Floats, HasMembers, InputError, Ints, place
from cpmkit_fem.cell_mesh import CellMesh, edge_lengths

#: Curves meet where they come nearer than this share of an edge.
MEETING_EDGE_SHARE = 0.1
#: Rounds of projections from one curve to the other.
ROUNDS = 12


def check_junctions(surface: ClosestPointSource, mesh: CellMesh) -> None:
    """Raise InputError, with the place, if curves of a union meet farther than a segment from all common vertices."""
    if mesh.manifold_dim != 1 or not isinstance(surface, HasMembers) or len(surface.members) < 2:
        return
    member = surface.closest_point(mesh.nodes[mesh.corners].mean(axis=1)).element
    assert member is not None
    for first, other in permutations(range(len(surface.members)), 2):
        cells = mesh.corners[member == first]
        shared = np.intersect1d(cells, mesh.corners[member == other])
        for point, reach in zip(*_meetings(mesh.nodes, cells, surface.members[other]), strict=True):
            if not np.any(np.linalg.norm(mesh.nodes[shared] - point, axis=1) <= reach):
                raise InputError(
                    f"members {first} and {other} of the union meet near {place(point)}, where their segments have no "
                    "common vertex, so backend='fem' would separate them; end the members there, or use backend='cpm'."
                )


def _meetings(nodes: Floats, cells: Ints, other: ClosestPointSource) -> tuple[Floats, Floats]:
    """Return points (k, d) of segments ``cells`` (m, 2) that the curve ``other`` meets, and the segments' lengths."""
    length = edge_lengths(nodes, cells)
    centres = nodes[cells].mean(axis=1)
    nearby = other.closest_point(centres).distance <= length if len(cells) else np.zeros(0, dtype=bool)
    start, way, length = nodes[cells[nearby, 0]], (nodes[cells[nearby, 1]] - nodes[cells[nearby, 0]]), length[nearby]
    points = centres[nearby]
    if not len(points):
        return points, length
    for _ in range(ROUNDS):
        feet = other.closest_point(points).points
        share = np.clip(np.sum((feet - start) * way, axis=1) / length**2, 0.0, 1.0)
        points = start + share[:, None] * way
    met = np.linalg.norm(points - feet, axis=1) <= MEETING_EDGE_SHARE * length
    return points[met], length[met]
