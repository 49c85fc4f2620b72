"""Points made vertices: of a curve, which they cut, or of a surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, norms
from cpmkit.mesh.mesh import Mesh
from cpmkit.protocols import Floats, HasMesh, Ints

#: Nearer than this, in lengths of its segment, to a vertex a point is there.
AT_SHARE = 1e-3
#: Vertices of the manifold from which points that do not draw themselves are asked for.
ASKED_VERTICES = 1000


def positions(source: LocalSource, vertices: Floats) -> Floats:
    """Return the points (k, d) of a source of points; where it does not draw itself those nearest to ``vertices``."""
    if isinstance(source.source, HasMesh):
        drawn, cells = source.source.mesh(1.0)
        return np.asarray(drawn, dtype=np.float64)[cells[:, 0]] - source.shift
    target = vertices[:: max(1, len(vertices) // ASKED_VERTICES)]
    return np.unique(source.closest_point(target).points, axis=0)


def cut_at_points(mesh: Mesh, boundaries: Sequence[LocalSource]) -> tuple[Mesh, tuple[int, ...], dict[int, float]]:
    """Return segments cut at the feet of points on boundaries, the boundaries that left none, and how far off they lie.

    The last are the largest distances of a boundary's points from the segments.
    """
    members = [(n, part) for n, one in enumerate(boundaries) for part in one.members if part.manifold_dim == 0]
    vertices, cells, cut, gaps = mesh.vertices, mesh.cells, dict[int, int](), dict[int, float]()
    for number, member in members:
        for point in positions(member, mesh.vertices):
            vertices, cells, vertex = _with_foot(vertices, cells, point)
            cut.setdefault(vertex, number)
            gaps[number] = max(gaps.get(number, 0.0), float(norms((vertices[vertex] - point)[None])[0]))
    owner = np.array(list(cut.values()), dtype=np.int64)
    facets = np.array(list(cut), dtype=np.int64).reshape(-1, 1)
    empty = tuple(number for number in range(len(boundaries)) if number not in owner)
    return Mesh(vertices, cells, None, facets, owner, np.zeros(len(owner), dtype=bool)), empty, gaps


def _with_foot(vertices: Floats, cells: Ints, point: Floats) -> tuple[Floats, Ints, int]:
    """Return the segments with a vertex at the foot of a point, and that vertex."""
    start, way = vertices[cells[:, 0]], vertices[cells[:, 1]] - vertices[cells[:, 0]]
    share = np.clip(dots(point - start, way) / dots(way, way), 0.0, 1.0)
    row = int(np.argmin(norms(start + share[:, None] * way - point)))
    t = share[row]
    if min(t, 1 - t) < AT_SHARE:
        return vertices, cells, int(cells[row, int(t > 0.5)])
    new, first = len(vertices), cells.copy()
    first[row, 1] = new
    second = np.array([[new, cells[row, 1]]], dtype=np.int64)
    place = start[row] + t * way[row]
    return np.concatenate([vertices, place[None]]), np.concatenate([first, second]), new
