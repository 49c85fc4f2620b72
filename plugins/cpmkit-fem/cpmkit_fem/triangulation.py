"""A mesh of a scene's surface or curve: the source's own, welded, without cells that have no area or length."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import ClosestPointSource, Floats, HasMesh, InputError, Ints, needed_spacing
from cpmkit_fem.cell_mesh import CellMesh
from cpmkit_fem.junctions import check_junctions

#: Vertices nearer than this share of the size are one: seams of parametrisations are closed.
WELDED_SIZE_SHARE = 1e-12
#: Edges along the largest extent at which it is found whether a source has one mesh alone: some have a coarsest one.
FEWEST_EDGES = (4, 8, 32)


def triangulation(surface: ClosestPointSource, spacing: float | None) -> CellMesh:
    """Return the mesh, welded, of a surface or curve, with edges of about ``spacing``, a length.

    A source that is itself a mesh gives that one, whatever the spacing, and needs none. Raise InputError if the
    manifold is neither a surface nor a curve, or has no mesh, the spacing is needed and absent, or not above zero, or
    curves meet where their meshes have no common vertex.
    """
    dim = surface.manifold_dim
    if dim not in (1, 2) or not isinstance(surface, HasMesh):
        raise InputError(
            "backend='fem' takes surfaces and curves that have a method mesh(spacing), and "
            f"{type(surface).__name__} of manifold_dim {dim} gives neither triangles nor segments; use backend='cpm'."
        )
    own = own_mesh(surface) if spacing is None else None
    vertices, faces = own or surface.mesh(needed_spacing(surface, spacing))
    check_kind_of_cells(surface, faces, dim + 1)
    mesh = weld(vertices, faces)
    check_junctions(surface, mesh)
    return mesh


def check_kind_of_cells(source: ClosestPointSource, cells: Ints, corners: int) -> None:
    """Raise InputError unless ``cells`` (m, k) of a source have 2 or 3 ``corners``."""
    if cells.shape[1] != corners:
        label = "triangles" if corners == 3 else "segments"
        raise InputError(
            f"backend='fem' needs {label}, and {type(source).__name__} gives only points; use backend='cpm'."
        )


def own_mesh(surface: ClosestPointSource) -> tuple[Floats, Ints] | None:
    """Return vertices (v, d), cells (m, k) of a source that is itself a mesh; None if they depend on the spacing.

    The vertices are compared at three spacings: a quarter, an eighth and a 32nd of the largest side of the bounds.
    """
    assert isinstance(surface, HasMesh)
    size = float(np.ptp(surface.bounds, axis=0).max())
    vertices, faces = surface.mesh(size / FEWEST_EDGES[0])
    same = all(np.array_equal(vertices, surface.mesh(size / edges)[0]) for edges in FEWEST_EDGES[1:])
    return (vertices, faces) if same else None


def weld(vertices: Floats, faces: Ints) -> CellMesh:
    """Return the mesh of ``faces`` (m, k) with vertices nearer than WELDED_SIZE_SHARE of the size, or rounding, merged.

    Unused vertices, and cells that repeat a vertex, are left out.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    vertices, faces = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
    if not len(faces):
        return CellMesh(vertices[:0], faces, faces.shape[1] - 1)
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
    return CellMesh(vertices[used], compact.reshape(faces.shape), faces.shape[1] - 1)
