"""Meshes and polylines on which ``cpmkit.testing`` checks the laws."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.protocols import Floats, Ints
from cpmkit_mesh.polyline import Polyline, polyline
from cpmkit_mesh.triangles import TriangleMesh, triangles

if TYPE_CHECKING:
    from cpmkit.testing import ConformanceCase

Mesh = tuple[Floats, Ints]


def cases() -> list[ConformanceCase]:
    """Return a case for each sort of mesh and polyline that this distribution answers for."""
    from cpmkit.testing import ConformanceCase

    meshes = {"closed": _torus(), "open": _cone(), "two components": _two_tori()}
    found = []
    for name, (points, faces) in meshes.items():
        turn = turning_angle(triangles(vertices=points, faces=faces))
        for closest in ("faceted", "smooth"):
            make = _bound(triangles, vertices=points, faces=faces, closest=closest)
            samples = _on_triangles(points, faces)
            found.append(ConformanceCase("mesh.triangles", f"{name}, {closest}", make, samples, 0.15, turn))
    helix = _helix()
    curves = {"open in space": helix, "closed in space": _knot(), "open in the plane": helix[:, :2] * [1.0, 0.5]}
    for name, points in curves.items():
        make = _bound(polyline, points=points)
        found.append(ConformanceCase("mesh.polyline", name, make, _on_segments(points), None, 0.0))
    return found


def turning_angle(mesh: TriangleMesh) -> float:
    """Return the largest angle in radians between the normals at the ends of an edge, or of neighbouring rim edges."""
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


def _bound(factory: Callable[..., TriangleMesh | Polyline], **keys: object) -> Callable[[], TriangleMesh | Polyline]:
    return lambda: factory(**keys)


def _grid(columns: int, rows: int, wrap: bool) -> Ints:
    """Return the triangles of a strip of ``rows`` rings of ``columns`` vertices, wound outwards."""
    i, j = np.divmod(np.arange((rows if wrap else rows - 1) * columns), columns)
    a, b = i * columns + j, i * columns + (j + 1) % columns
    above = (i + 1) % rows * columns
    c, d = above + (j + 1) % columns, above + j
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def _torus(columns: int = 48, rows: int = 24) -> Mesh:
    v, u = np.divmod(np.arange(columns * rows), columns)
    u, v = 2 * np.pi * u / columns, 2 * np.pi * v / rows
    points = np.stack([(1 + 0.4 * np.cos(v)) * np.cos(u), (1 + 0.4 * np.cos(v)) * np.sin(u), 0.4 * np.sin(v)], axis=1)
    return points, _grid(columns, rows, wrap=True)


def _cone(columns: int = 48, rows: int = 9) -> Mesh:
    """Return the side of a cone, whose two rims differ in length."""
    z, u = np.divmod(np.arange(columns * rows), columns)
    u, z = 2 * np.pi * u / columns, z / (rows - 1)
    radius = 1.0 - 0.2 * z
    return np.stack([radius * np.cos(u), radius * np.sin(u), z], axis=1), _grid(columns, rows, wrap=False)


def _two_tori() -> Mesh:
    points, faces = _torus(32, 16)
    return np.concatenate([points, points[:, [2, 0, 1]] + [3.0, 0, 0]]), np.concatenate([faces, faces + len(points)])


def _helix() -> Floats:
    t = np.linspace(0.0, 7.0, 41)
    return np.stack([np.cos(t), np.sin(1.3 * t), 0.2 * t], axis=1)


def _knot() -> Floats:
    t = np.linspace(0.0, 2 * np.pi, 121)
    t[-1] = 0.0
    radius = 1.0 + 0.3 * np.cos(3 * t)
    return np.stack([radius * np.cos(2 * t), radius * np.sin(2 * t), 0.3 * np.sin(3 * t)], axis=1)


def _on_triangles(points: Floats, faces: Ints) -> Callable[[np.random.Generator, int], Floats]:
    def samples(rng: np.random.Generator, n: int) -> Floats:
        weights = rng.dirichlet(np.ones(3), n)
        return np.einsum("nc,nck->nk", weights, points[faces[rng.integers(0, len(faces), n)]])

    return samples


def _on_segments(points: Floats) -> Callable[[np.random.Generator, int], Floats]:
    def samples(rng: np.random.Generator, n: int) -> Floats:
        start, t = rng.integers(0, len(points) - 1, n), rng.uniform(size=(n, 1))
        return (1.0 - t) * points[start] + t * points[start + 1]

    return samples
