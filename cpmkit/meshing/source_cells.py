"""The cells of sources that are meshes, or that provide a mesh of themselves that is good enough for quadrature."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cpmkit.manifold.abilities import HasMesh, HasValues, advice_of
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import dots, norms
from cpmkit.mesh.adjacency import box_size, repair, rim_of_edges
from cpmkit.mesh.mesh import CellGeometry, Mesh
from cpmkit.meshing.curved_from_normals import refine_smooth_triangles
from cpmkit.meshing.meeting_curves import join_curves
from cpmkit.meshing.mesh_cache import mesh_cache_of, repair_source_mesh, untranslated_source

#: Most triangles of a mesh per square of its edge length: more would cost too many samples. Equilateral triangles are
#: 2.3, those of the parameters of a sphere 3, of a Klein bottle 5, of marching tetrahedra 8 and more.
MOST_TRIANGLES_PER_SQUARE = 7.0


@dataclass(frozen=True, eq=False)
class SourceCells:
    """The cells of a source that serve for quadrature."""

    mesh: Mesh  #: Flat cells with vertices on the manifold.
    #: "flat", "closest_point" or "normals": how the manifold runs between the vertices, see
    #: :data:`~cpmkit.mesh.mesh.CellGeometry`.
    geometry: CellGeometry
    split: bool = False  #: Whether the cells are parts of repaired cells.


def source_cells(source: LocalSource, length: float, shortest: float | None = None) -> SourceCells | None:
    """Return the cells of a curve or of a surface in space; None where they must be contoured from closest points.

    A mesh or polyline has its own cells, curved where it is read as smooth; an analytic or parametric shape has a mesh
    of itself. Meshes of level sets in space have too many triangles, of bad shape. Members of a union have separate
    cells; curves are split where they meet, and where surfaces meet, only closest points reveal the junction.

    ``length``: longest edge of the cells of a curved manifold; flat cells stay as they are. ``shortest``: edge length
    of a second attempt, where cells of ``length`` do not follow the manifold or have a bad shape; None for no attempt.
    """
    if source.members[0] is not source:
        return _cells_of_union(source, length, shortest)
    m = source.manifold_dim or 0
    if not 0 < m < source.dim or not isinstance(source.source, HasMesh):
        return None
    if not advice_of(source.source, length).mesh_for_samples:
        return None
    mesh = _own_mesh(source, length)
    if mesh is None:
        return None
    cache = mesh_cache_of(source, mesh.cells)
    if cache is None:
        height = _largest_centre_distance(source, mesh)
    else:
        height = cache.value("height", lambda: _largest_centre_distance(untranslated_source(source), cache.original))
    if height <= 1e-9 * box_size(mesh.vertices):
        if source.source.exact or m == 1 or not source.has_normals:
            return SourceCells(mesh, "flat")
        smooth = refine_smooth_triangles(repair_source_mesh(source, mesh)[0], source, length)
        return SourceCells(smooth, "normals", split=True)
    shortest = length if shortest is None else shortest
    if height <= 0.06 * length or length == shortest:
        mesh = repair(mesh)[0]
        if suits_quadrature(source, mesh, length):
            return SourceCells(mesh, "closest_point")
    finer = _own_mesh(source, shortest) if length > shortest else None
    if finer is None:
        return None
    finer = repair(finer)[0]
    return SourceCells(finer, "closest_point") if suits_quadrature(source, finer, shortest) else None


def suits_quadrature(source: LocalSource, mesh: Mesh, length: float) -> bool:
    """Return whether a mesh suits quadrature: it ends on rims alone, has few blunt triangles, and not too many.

    Triangles that do not share edges end inside the manifold; triangles with an angle near 180 degrees turn over when
    they are curved. Narrow triangles with a short edge, as towards a pole, do no harm. The number is limited for
    a given area and edge ``length``. Meshes of curves are suitable.
    """
    if mesh.manifold_dim == 1:
        return True
    corners = mesh.vertices[mesh.cells]
    after, before = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    cosine = dots(after, before) / (norms(after) * norms(before))
    if (cosine.min(axis=1) < -0.9).mean() > 0.01:
        return False
    area = 0.5 * float(norms(np.cross(after[:, 0], before[:, 0])).sum())
    if len(mesh.cells) * length**2 > MOST_TRIANGLES_PER_SQUARE * area:
        return False
    rim = rim_of_edges(mesh)
    if not len(rim.rows):
        return True
    middle = mesh.vertices[mesh.edges.ends[rim.rows]].mean(axis=1)
    beyond = source.closest_point(np.ascontiguousarray(middle + 0.5 * rim.outward))
    return bool((beyond.edge >= 0).all())


def _own_mesh(source: LocalSource, length: float) -> Mesh | None:
    """Return the source's own mesh for the edge ``length``, relative to the origin; None without cells of its kind."""
    assert isinstance(source.source, HasMesh)
    vertices, cells = source.source.mesh(length)
    if cells.shape[1] != (source.manifold_dim or 0) + 1 or not len(cells):
        return None
    return Mesh.of(np.ascontiguousarray(vertices - source.shift), np.ascontiguousarray(cells, dtype=np.int64))


def _largest_centre_distance(source: LocalSource, mesh: Mesh) -> float:
    """Return the largest distance of the centres of some 1000 cells from the manifold: zero for a faceted mesh.

    A source with exact closest points, values at its vertices, and the same cells at another spacing consists of these
    cells: then no query is needed, and no search tree.
    """
    drawing = source.source
    assert isinstance(drawing, HasMesh)
    has_own_cells = drawing.exact and isinstance(drawing, HasValues)
    if has_own_cells and np.array_equal(drawing.mesh(box_size(mesh.vertices))[1], mesh.cells):
        return 0.0
    step = max(len(mesh.cells) // 1024, 1)
    centres = mesh.vertices[mesh.cells[::step]].mean(axis=1)
    return float(norms(source.closest_point(centres).points - centres).max())


def _cells_of_union(source: LocalSource, length: float, shortest: float | None) -> SourceCells | None:
    """Return the cells of all members of a union; None where members meet, differ in dimension or have no cells."""
    if source.manifold_dim is None:
        return None
    parts: list[SourceCells] = []
    for member in source.members:
        part = source_cells(member, length, shortest)
        if part is None:
            return None
        parts.append(part)
    meshes = [part.mesh for part in parts]
    geometries = {part.geometry for part in parts}
    geometry = geometries.pop() if len(geometries) == 1 else "closest_point"
    if source.manifold_dim == 1:
        curves = [(member, repair(mesh)[0]) for member, mesh in zip(source.members, meshes, strict=True)]
        joined = join_curves(curves, length)
        return None if joined is None else SourceCells(joined, geometry)
    if any(_have_common_points(*a, *b) for a, b in combinations(zip(source.members, meshes, strict=True), 2)):
        return None
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    cells = np.concatenate([mesh.cells + start for mesh, start in zip(meshes, starts, strict=True)])
    return SourceCells(Mesh.of(vertices, cells), geometry)


def _have_common_points(first: LocalSource, first_mesh: Mesh, second: LocalSource, second_mesh: Mesh) -> bool:
    """Return whether two members come within 1e-6 of their larger size, by alternating projections of near vertices."""
    size = max(box_size(first_mesh.vertices), box_size(second_mesh.vertices))
    x = first_mesh.vertices
    x = x[np.argsort(norms(second.closest_point(x).points - x))[:256]]
    for _ in range(50):
        y = second.closest_point(x).points
        if norms(y - x).min() <= 1e-6 * size:
            return True
        x = first.closest_point(y).points
    return False
