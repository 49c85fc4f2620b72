"""The degree of a map between closed surfaces."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpmkit.errors import InputError, ResolutionError
from cpmkit.plugin import vertex_normals
from cpmkit.protocols import ClosestPointSource, Floats, HasMesh, Ints

#: A degree that is farther from a whole number is none.
WHOLE_TOLERANCE = 0.3


def degree_of_map(
    surface: ClosestPointSource, target: ClosestPointSource, images: Callable[[Floats], Floats], spacing: float
) -> int:
    """Return the signed area of the images of a surface's triangles over the area of the target.

    Raises
    ------
    InputError
        If one of both has no mesh that is closed and oriented.
    ResolutionError
        If the quotient is no whole number.
    """
    return _degree_and_area(surface, target, images, spacing)[0]


def covered_area(
    surface: ClosestPointSource, target: ClosestPointSource, images: Callable[[Floats], Floats], spacing: float
) -> float:
    """Return the area of the target times the degree's size; arguments and errors as of :func:`degree_of_map`."""
    degree, area = _degree_and_area(surface, target, images, spacing)
    return abs(degree) * area


def _degree_and_area(
    surface: ClosestPointSource, target: ClosestPointSource, images: Callable[[Floats], Floats], spacing: float
) -> tuple[int, float]:
    from scipy.spatial import cKDTree

    vertices, faces = _closed_mesh(surface, 0.5 * spacing)
    goals, cells = _closed_mesh(target, 0.5 * spacing)
    found_at = images(vertices)
    across = _areas(found_at, faces)
    middles = target.closest_point(found_at[faces].mean(axis=1)).points
    normals = vertex_normals(goals, cells)[cKDTree(goals).query(middles)[1]]
    area = float(np.linalg.norm(_areas(goals, cells), axis=1).sum())
    found = float(np.einsum("fd,fd->", across, normals) / area)
    if abs(found - round(found)) > WHOLE_TOLERANCE:
        raise ResolutionError(f"the map covers {found:.2f} of the target, no whole number; use a smaller spacing.")
    return round(found), area


def _areas(vertices: Floats, faces: Ints) -> Floats:
    """Return (f, 3) the triangles' normals, as long as their areas."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.asarray(0.5 * np.cross(b - a, c - a))


def _closed_mesh(surface: ClosestPointSource, spacing: float) -> tuple[Floats, Ints]:
    """Return a mesh of a closed surface, its triangles turned so that their normals point outwards."""
    if not isinstance(surface, HasMesh) or surface.manifold_dim != 2 or surface.dim != 3:
        raise InputError(f"a degree is that of a map between surfaces with meshes; {type(surface).__name__} has none.")
    vertices, faces = surface.mesh(spacing)
    edges = np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)]) if faces.shape[1] == 3 else np.zeros((1, 2))
    ahead, back = ({*map(tuple, one.tolist())} for one in (edges, edges[:, ::-1]))
    if len(ahead) < len(edges) or ahead != back:
        raise InputError(
            f"a degree is that of a map between closed oriented surfaces; {type(surface).__name__} is none."
        )
    corners = vertices[faces]
    volume = np.einsum("fd,fd->", np.cross(corners[:, 0], corners[:, 1]), corners[:, 2])
    return vertices, faces if volume > 0 else faces[:, ::-1]
