"""The cells of sources that are cells, or draw themselves well enough for samples to be taken from the drawing."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, norms
from cpmkit.mesh.adjacency import rim_of_edges
from cpmkit.mesh.mesh import CellGeometry, Mesh, edges_of
from cpmkit.mesh.welding import box_size, repair
from cpmkit.meshing.curved_from_normals import refine_smooth
from cpmkit.meshing.mesh_cache import in_scene_coordinates, mesh_cache_of, repair_source_mesh
from cpmkit.protocols import HasMesh, HasMeshUse, HasValues

#: Triangles with an angle whose cosine is below this have a bad shape; of a drawing that is fit, fewer than this share.
BLUNT_COSINE, MOST_BLUNT_SHARE = -0.9, 0.01
#: A drawing with more triangles than this on a square of its edge length costs more samples than it is worth: equal
#: sides make 2.3, parameters of a sphere 3, of a figure eight bent to a Klein bottle 5, marching tetrahedra 8 and more.
MOST_TRIANGLES_A_SQUARE = 7.0
#: Beyond the middle of an edge of one triangle, by this share of its length, the rim of the manifold is found.
BEYOND_RIM_EDGE_SHARE = 0.5


def is_suitable(source: LocalSource, mesh: Mesh, length: float) -> bool:
    """Whether the drawing ends on the rim alone, with few blunt triangles, and not too many for edges of ``length``.

    Triangles that do not share edges end inside the manifold; those with an angle near 180 degrees turn their backs to
    it once they are curved. Narrow ones with a short edge, as towards a pole, do no harm. Drawings of curves are fit.
    """
    if mesh.manifold_dim == 1:
        return True
    corners = mesh.vertices[mesh.cells]
    after, before = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    cosine = dots(after, before) / (norms(after) * norms(before))
    if (cosine.min(axis=1) < BLUNT_COSINE).mean() > MOST_BLUNT_SHARE:
        return False
    area = 0.5 * float(norms(np.cross(after[:, 0], before[:, 0])).sum())
    if len(mesh.cells) * length**2 > MOST_TRIANGLES_A_SQUARE * area:
        return False
    edges = edges_of(mesh)
    rim = rim_of_edges(mesh, edges)
    if not len(rim.rows):
        return True
    middle = mesh.vertices[edges.ends[rim.rows]].mean(axis=1)
    beyond = source.closest_point(np.ascontiguousarray(middle + BEYOND_RIM_EDGE_SHARE * rim.outward))
    return bool((beyond.edge >= 0).all())


#: Cells whose centres are looked at to tell whether cells are flat, and how near they are to it then, of their size.
FLAT_PROBES, FLAT_SIZE_SHARE = 1024, 1e-9
#: Where the manifold is higher than this above a drawing, in edges of the drawing, it is drawn with the short edges.
BENT_EDGE_SHARE = 0.06
#: Members of a union that come nearer than this share of its size meet; so many places are followed, for so many steps.
MEETING_SIZE_SHARE, MEETING_PLACES, MEETING_STEPS = 1e-6, 256, 50


@dataclass(frozen=True, eq=False)
class SourceCells:
    """A source's cells.

    Attributes
    ----------
    mesh : SampleMesh
        Flat cells with vertices on the manifold.
    bend : "flat", "feet" or "normals"
        What the manifold does between them, see :func:`bent`.
    split : bool
        Whether the cells are parts of sound ones.
    """

    mesh: Mesh
    geometry: CellGeometry
    split: bool = False


def source_cells(source: LocalSource, length: float, shortest: float | None = None) -> SourceCells | None:
    """Return the cells of a source; None where they are to be found by closest points.

    A mesh or polyline gives its own cells, bent where it is read as smooth; an analytic or parametric shape those of
    its drawing; drawings of level sets in space have too many triangles, and of bad shape. Members of a union stand
    side by side. Where they meet, but for vertices that they share, only closest points know the junction.

    Parameters
    ----------
    source : LocalSource
    length : float
        Longest edge of the cells of a curved manifold; those of flat cells are left as they are.
    shortest : float, optional
        Edge length of the second attempt, where cells of ``length`` do not follow the manifold or have a bad shape.
    """
    if source.members[0] is not source:
        return _side_by_side(source, length, shortest)
    m = source.manifold_dim or 0
    if not 0 < m < source.dim or not isinstance(source.source, HasMesh):
        return None
    if isinstance(source.source, HasMeshUse) and not source.source.mesh_for_samples:
        return None
    short = length if shortest is None else shortest
    mesh = _drawn(source, length)
    if mesh is None:
        return None
    height = _kept_height(source, mesh)
    if height <= FLAT_SIZE_SHARE * _size(mesh):
        if source.source.exact or m == 1 or not source.has_normals:
            return SourceCells(mesh, "flat")
        return SourceCells(refine_smooth(repair_source_mesh(source, mesh)[0], source, length), "normals", split=True)
    if height <= BENT_EDGE_SHARE * length or length == short:
        mesh = repair(mesh)[0]
        if is_suitable(source, mesh, length):
            return SourceCells(mesh, "feet")
    again = _drawn(source, short) if length > short else None
    if again is None:
        return None
    again = repair(again)[0]
    return SourceCells(again, "feet") if is_suitable(source, again, short) else None


def _drawn(source: LocalSource, length: float) -> Mesh | None:
    """Return what a source draws with edges of ``length``; None where that is not cells of its dimension."""
    assert isinstance(source.source, HasMesh)
    vertices, cells = source.source.mesh(length)
    if cells.shape[1] != (source.manifold_dim or 0) + 1 or not len(cells):
        return None
    return Mesh.of(np.ascontiguousarray(vertices - source.shift), np.ascontiguousarray(cells, dtype=np.int64))


def _kept_height(source: LocalSource, mesh: Mesh) -> float:
    own = mesh_cache_of(source, mesh.cells)
    if own is None:
        return _height(source, mesh)
    if "height" not in own.found:
        own.found["height"] = _height(in_scene_coordinates(source), Mesh.of(own.vertices, own.cells))
    found: float = own.found["height"]
    return found


def _height(source: LocalSource, mesh: Mesh) -> float:
    """Return how far centres of cells are from the manifold at most: not at all in a faceted mesh.

    No query is needed, and no tree for it, where the source answers true nearest points, carries values at vertices of
    its own and has no other cells at another spacing: it is these cells.
    """
    drawing = source.source
    assert isinstance(drawing, HasMesh)
    own = drawing.exact and isinstance(drawing, HasValues)
    if own and np.array_equal(drawing.mesh(_size(mesh))[1], mesh.cells):
        return 0.0
    step = max(len(mesh.cells) // FLAT_PROBES, 1)
    centres = mesh.vertices[mesh.cells[::step]].mean(axis=1)
    return float(norms(source.closest_point(centres).points - centres).max())


def _size(mesh: Mesh) -> float:
    return box_size(mesh.vertices)


def _side_by_side(source: LocalSource, length: float, shortest: float | None) -> SourceCells | None:
    """Return the cells of a union of members of one dimension that do not meet."""
    if source.manifold_dim is None:
        return None
    drawn = []
    for member in source.members:
        one = source_cells(member, length, shortest)
        if one is None:
            return None
        drawn.append(one)
    parts = list(zip(source.members, [one.mesh for one in drawn], strict=True))
    if any(_meet(first, second) for first, second in combinations(parts, 2)):
        return None
    bends = {one.geometry for one in drawn}
    starts = np.cumsum([0] + [len(mesh.vertices) for _, mesh in parts])
    vertices = np.concatenate([mesh.vertices for _, mesh in parts])
    cells = np.concatenate([mesh.cells + start for (_, mesh), start in zip(parts, starts, strict=False)])
    return SourceCells(Mesh.of(vertices, cells), bends.pop() if len(bends) == 1 else "feet")


def _meet(first: tuple[LocalSource, Mesh], second: tuple[LocalSource, Mesh]) -> bool:
    """Whether two members of a union have points in common, followed from one's foot to the other's and back."""
    (one, mesh), (other, other_mesh) = first, second
    size = max(_size(mesh), _size(other_mesh))
    x = mesh.vertices
    x = x[np.argsort(norms(other.closest_point(x).points - x))[:MEETING_PLACES]]
    for _ in range(MEETING_STEPS):
        y = other.closest_point(x).points
        if norms(y - x).min() <= MEETING_SIZE_SHARE * size:
            return True
        x = one.closest_point(y).points
    return False
