"""Meshes and polylines on which ``cpmkit.testing`` checks the laws."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.plugin import Floats, Ints
from cpmkit_mesh.factory import triangles
from cpmkit_mesh.geodesic_path import path
from cpmkit_mesh.mesh_curves import edge_loop, feature_edges
from cpmkit_mesh.polyline import Polyline, polyline
from cpmkit_mesh.triangles import TriangleMesh

if TYPE_CHECKING:
    from cpmkit.plugin import ConformanceCase

Mesh = tuple[Floats, Ints]


def cases() -> list[ConformanceCase]:
    """Return the conformance cases of meshes, faceted and smooth, of polylines, and of curves of a mesh."""
    from cpmkit.plugin import ConformanceCase

    meshes = {"closed": _torus_case_mesh(), "open": _cone(), "two components": _two_tori()}
    conformance = []
    for name, (points, faces) in meshes.items():
        turn = largest_turning_angle(triangles(vertices=points, faces=faces))
        for closest in ("faceted", "smooth"):
            make = _factory(triangles, vertices=points, faces=faces, closest=closest)
            samples = _triangle_sampler(points, faces)
            conformance.append(ConformanceCase("mesh.triangles", f"{name}, {closest}", make, samples, 0.15, turn))
    arc = _open_curve()
    curves = {"open in space": arc, "closed in space": _knot(), "open in the plane": arc[:, :2] * [1.0, 0.5]}
    for name, points in curves.items():
        make = _factory(polyline, points=points)
        segments = np.stack([points[:-1], points[1:]], axis=1)
        conformance.append(ConformanceCase("mesh.polyline", name, make, _segment_sampler(segments), None, 0.0))
    return [*conformance, *_mesh_curves()]


def _mesh_curves() -> list[ConformanceCase]:
    """Return cases of curves of a mesh: closed, open, and several that meet."""
    from cpmkit.plugin import ConformanceCase

    (cone, sides), (wedge, planes), (box, walls) = _cone(), _wedge(), _box()
    ring = np.stack([np.arange(48), (np.arange(48) + 1) % 48], axis=1)
    low, high = cone[ring], cone[ring + len(cone) - 48]
    corners = np.argwhere(np.triu(np.linalg.norm(box[:, None] - box, axis=2).round(9) == 1.0))
    both = np.concatenate([low, high])
    plane, cells = _plane()
    corners_passed = np.array([3, 27, 45])
    path_edges = np.stack([plane[corners_passed], plane[np.roll(corners_passed, -1)]], axis=1)
    keys_of_plane = {"vertices": plane, "faces": cells}
    curves = {
        "mesh.path": {  # straight where the mesh is flat
            "open, by numbers": (path, path_edges[:2], {**keys_of_plane, "through": corners_passed}),
            "closed, by points": (
                path,
                path_edges,
                {**keys_of_plane, "through": plane[corners_passed], "closed": True},
            ),
        },
        "mesh.edge_loop": {
            "two loops": (edge_loop, both, {"vertices": cone, "faces": sides}),
            "the shorter loop": (edge_loop, high, {"vertices": cone, "faces": sides, "loop": 1}),
        },
        "mesh.feature_edges": {
            "one that ends": (feature_edges, wedge[None, [0, 2]], {"vertices": wedge, "faces": planes}),
            "twelve that meet": (feature_edges, box[corners], {"vertices": box, "faces": walls}),
        },
    }
    return [
        ConformanceCase(kind, name, _factory(make, **keys), _segment_sampler(segments))
        for kind, shapes in curves.items()
        for name, (make, segments, keys) in shapes.items()
    ]


def largest_turning_angle(mesh: TriangleMesh) -> float:
    """Return the largest angle in radians between normals at both ends of an edge, or between adjacent rim edges."""
    corner = mesh.normals_at_corners
    cosine = np.einsum("fck,fck->fc", corner, np.roll(corner, 1, axis=1)).min()
    angles = [np.arccos(np.clip(cosine, -1.0, 1.0))]
    boundary = mesh.adjacency.boundary
    if len(boundary):
        direction = np.zeros_like(mesh.vertices)
        step = mesh.vertices[boundary[:, 1]] - mesh.vertices[boundary[:, 0]]
        direction[boundary[:, 0]] = step / np.linalg.norm(step, axis=1, keepdims=True)
        cosines = np.einsum("ek,ek->e", direction[boundary[:, 0]], direction[boundary[:, 1]])
        angles.append(np.arccos(np.clip(cosines.min(), -1.0, 1.0)))
    return float(max(angles))


def _factory(factory: Callable[..., TriangleMesh | Polyline], **keys: Any) -> Callable[[], TriangleMesh | Polyline]:
    return lambda: factory(**keys)


def _ring_triangles(columns: int, rows: int, wrap: bool) -> Ints:
    """Return (m, 3) triangles between ``rows`` rings of ``columns`` vertices; with ``wrap`` the last joins ring 0."""
    i, j = np.divmod(np.arange((rows if wrap else rows - 1) * columns), columns)
    a, b = i * columns + j, i * columns + (j + 1) % columns
    above = (i + 1) % rows * columns
    c, d = above + (j + 1) % columns, above + j
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def _torus_case_mesh(columns: int = 48, rows: int = 24) -> Mesh:
    """Return a torus of radii 1 and 0.4 about the z axis, wound outwards, of ``rows`` rings of ``columns`` vertices."""
    v, u = np.divmod(np.arange(columns * rows), columns)
    u, v = 2 * np.pi * u / columns, 2 * np.pi * v / rows
    points = np.stack([(1 + 0.4 * np.cos(v)) * np.cos(u), (1 + 0.4 * np.cos(v)) * np.sin(u), 0.4 * np.sin(v)], axis=1)
    return points, _ring_triangles(columns, rows, wrap=True)


def _cone(columns: int = 48, rows: int = 9) -> Mesh:
    """Return the side of a truncated cone about z, wound outwards, of ``rows`` rings of ``columns`` vertices."""
    z, u = np.divmod(np.arange(columns * rows), columns)
    u, z = 2 * np.pi * u / columns, z / (rows - 1)
    radius = 1.0 - 0.2 * z
    return np.stack([radius * np.cos(u), radius * np.sin(u), z], axis=1), _ring_triangles(columns, rows, wrap=False)


def _two_tori() -> Mesh:
    points, faces = _torus_case_mesh(32, 16)
    return np.concatenate([points, points[:, [2, 0, 1]] + [3.0, 0, 0]]), np.concatenate([faces, faces + len(points)])


def _plane() -> Mesh:
    """Return a tilted rectangle of 7 by 7 vertices."""
    x, y = np.divmod(np.arange(49), 7)
    a = np.flatnonzero((x < 6) & (y < 6))
    faces = np.concatenate([np.stack([a, a + 7, a + 8], axis=1), np.stack([a, a + 8, a + 1], axis=1)])
    return np.stack([x / 6, y / 6, 0.5 * x / 6], axis=1), faces


def _wedge() -> Mesh:
    """Return two rectangles that meet at a right angle along a crease of three vertices, the first three."""
    x = np.array([0.0, 0.7, 1.5])
    ridge, left, right = (np.stack([x, 0 * x + y, 0 * x + z], axis=1) for y, z in ((0, 0), (-1, -1), (1, -1)))
    lower = np.array([[0, 3, 4], [0, 4, 1], [1, 4, 5], [1, 5, 2]])
    return np.concatenate([ridge, left, right]), np.concatenate([lower, np.where(lower > 2, lower + 3, lower)[:, ::-1]])


def _box() -> Mesh:
    """Return the unit cube as twelve triangles wound outwards."""
    corners = np.array([[i, j, k] for i in (0.0, 1.0) for j in (0.0, 1.0) for k in (0.0, 1.0)])
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return corners, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def _open_curve() -> Floats:
    """Return points (41, 3) of an open curve in space, without crossings seen along z."""
    t = np.linspace(0.0, 7.0, 41)
    return np.stack([np.cos(t), np.sin(1.3 * t), 0.2 * t], axis=1)


def _knot() -> Floats:
    """Return points (121, 3) of a trefoil knot, the last of which is the first."""
    t = np.linspace(0.0, 2 * np.pi, 121)
    t[-1] = 0.0
    radius = 1.0 + 0.3 * np.cos(3 * t)
    return np.stack([radius * np.cos(2 * t), radius * np.sin(2 * t), 0.3 * np.sin(3 * t)], axis=1)


def _triangle_sampler(points: Floats, faces: Ints) -> Callable[[np.random.Generator, int], Floats]:
    """Return a function of a generator and n that draws random points (n, 3) on triangles ``faces`` of ``points``."""

    def samples(rng: np.random.Generator, n: int) -> Floats:
        weights = rng.dirichlet(np.ones(3), n)
        return np.einsum("nc,nck->nk", weights, points[faces[rng.integers(0, len(faces), n)]])

    return samples


def _segment_sampler(segments: Floats) -> Callable[[np.random.Generator, int], Floats]:
    """Return a function of a generator and n that draws random points (n, d) on ``segments`` (m, 2, d)."""

    def samples(rng: np.random.Generator, n: int) -> Floats:
        at, t = rng.integers(0, len(segments), n), rng.uniform(size=(n, 1))
        return (1.0 - t) * segments[at, 0] + t * segments[at, 1]

    return samples
