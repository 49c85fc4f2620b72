"""A triangulation of a scene's surface: the source's own mesh, welded, without triangles that have no area."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cpmkit.plugin import ClosestPointSource, Floats, HasMesh, InputError, Ints, Scene, needed_spacing

#: Vertices nearer than this share of the size are one: seams of parametrisations are closed.
WELDED_SIZE_SHARE = 1e-12
#: A triangle whose doubled area is below this share of its longest edge squared has no gradient in float64.
FLAT_TRIANGLE_SHARE = 1e-12


@dataclass(frozen=True, eq=False)
class Triangulation:
    """Vertices (v, d) and triangles (m, 3), each vertex in use."""

    vertices: Floats
    faces: Ints

    @cached_property
    def edges(self) -> tuple[Ints, Ints, Ints]:
        """Each edge once, as (e, 2) vertices; how many triangles it has; the vertex opposite in one of them."""
        pairs = np.concatenate([self.faces[:, [k, (k + 1) % 3]] for k in range(3)])
        opposite = np.concatenate([self.faces[:, (k + 2) % 3] for k in range(3)])
        edges, first, count = np.unique(np.sort(pairs, axis=1), axis=0, return_index=True, return_counts=True)
        return edges, count, opposite[first]

    @property
    def mean_edge(self) -> float:
        """The mean length of an edge."""
        return float(np.mean(_lengths(self.vertices, self.edges[0])))

    @cached_property
    def longest_edges(self) -> Floats:
        """(m,) the longest edge of each triangle."""
        sides = [_lengths(self.vertices, self.faces[:, [k, (k + 1) % 3]]) for k in range(3)]
        longest: Floats = np.max(sides, axis=0)
        return longest


def triangulate(scene: Scene, spacing: float | None) -> Triangulation:
    """Return the mesh of the scene's surface.

    Parameters
    ----------
    scene : Scene
    spacing : float or None
        About the length of an edge. A source that is itself a mesh gives that one, whatever the spacing, and
        needs none.

    Raises
    ------
    InputError
        If the surface is no surface or has no mesh, the spacing is needed and absent, or a triangle has no area.
    """
    surface = scene.surface
    if surface.manifold_dim != 2 or not isinstance(surface, HasMesh):
        raise InputError(
            f"backend='fem' triangulates surfaces that have a method mesh(spacing), and {type(surface).__name__} "
            f"of manifold_dim {surface.manifold_dim} gives no triangles; use backend='cpm'."
        )
    own = own_mesh(surface) if spacing is None else None
    vertices, faces = own or surface.mesh(needed_spacing(surface, spacing))
    if faces.shape[1] != 3:
        raise InputError(
            f"backend='fem' needs triangles, and {type(surface).__name__} gives only points; use backend='cpm'."
        )
    return _welded(np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64))


def own_mesh(surface: ClosestPointSource) -> tuple[Floats, Ints] | None:
    """Return the mesh that the surface itself is; None if it answers each spacing with another one."""
    assert isinstance(surface, HasMesh)
    size = float(np.ptp(surface.bounds, axis=0).max())
    (vertices, faces), (finer, _) = surface.mesh(size / 4), surface.mesh(size / 8)
    return (vertices, faces) if np.array_equal(vertices, finer) else None


def _welded(vertices: Floats, faces: Ints) -> Triangulation:
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    rounding = 4 * np.finfo(float).eps * np.abs(vertices).max()
    pairs = cKDTree(vertices).query_pairs(
        max(WELDED_SIZE_SHARE * np.ptp(vertices, axis=0).max(), rounding), output_type="ndarray"
    )
    if len(pairs):
        n = len(vertices)
        graph = csr_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
        _, place = connected_components(graph, directed=False)
        _, first = np.unique(place, return_index=True)
        faces = first[place[faces]]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    used, compact = np.unique(faces, return_inverse=True)
    mesh = Triangulation(vertices[used], compact.reshape(-1, 3))
    _refuse_flat(mesh)
    return mesh


def _refuse_flat(mesh: Triangulation) -> None:
    if not len(mesh.faces):
        raise InputError("backend='fem' needs triangles with three different corners, got none.")
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    first, second = b - a, c - a
    shear = np.sum(first * second, axis=1) / np.sum(first**2, axis=1)
    twice_area = np.linalg.norm(first, axis=1) * np.linalg.norm(second - shear[:, None] * first, axis=1)
    flat = np.flatnonzero(~(twice_area > FLAT_TRIANGLE_SHARE * mesh.longest_edges**2))
    if len(flat):
        raise InputError(
            f"backend='fem' needs triangles with an area, got {len(flat)} of {len(mesh.faces)} without, the first at "
            f"{a[flat[0]].tolist()}; repair the mesh, or use backend='cpm'."
        )


def _lengths(vertices: Floats, pairs: Ints) -> Floats:
    lengths: Floats = np.linalg.norm(vertices[pairs[:, 1]] - vertices[pairs[:, 0]], axis=1)
    return lengths
