"""The cells of sources that are cells, or draw themselves well enough for samples to be taken from the drawing."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import norms
from cpmkit.mesh.mesh import Bend, SampleMesh
from cpmkit.mesh.repair import largest_side, sound
from cpmkit.meshing.curved_from_normals import lifted
from cpmkit.meshing.drawings import is_fit
from cpmkit.meshing.mesh_cache import in_scene, made_sound, own_cells
from cpmkit.protocols import HasMesh, HasMeshUse, HasValues

#: Cells whose centres are looked at to tell whether cells are flat, and how near they are to it then, of their size.
FLAT_PROBES, FLAT_SIZE_SHARE = 1024, 1e-9
#: Where the manifold is higher than this above a drawing, in edges of the drawing, it is drawn with the short edges.
BENT_EDGE_SHARE = 0.06
#: Members of a union that come nearer than this share of its size meet; so many places are followed, for so many steps.
MEETING_SIZE_SHARE, MEETING_PLACES, MEETING_STEPS = 1e-6, 256, 50


@dataclass(frozen=True, eq=False)
class Drawn:
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

    mesh: SampleMesh
    bend: Bend
    split: bool = False


def cells_of(source: LocalSource, length: float, shortest: float | None = None) -> Drawn | None:
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
            return Drawn(mesh, "flat")
        return Drawn(lifted(made_sound(source, mesh)[0], source, length), "normals", split=True)
    if height <= BENT_EDGE_SHARE * length or length == short:
        mesh = sound(mesh)[0]
        if is_fit(source, mesh, length):
            return Drawn(mesh, "feet")
    again = _drawn(source, short) if length > short else None
    if again is None:
        return None
    again = sound(again)[0]
    return Drawn(again, "feet") if is_fit(source, again, short) else None


def _drawn(source: LocalSource, length: float) -> SampleMesh | None:
    """Return what a source draws with edges of ``length``; None where that is not cells of its dimension."""
    assert isinstance(source.source, HasMesh)
    vertices, cells = source.source.mesh(length)
    if cells.shape[1] != (source.manifold_dim or 0) + 1 or not len(cells):
        return None
    return SampleMesh.of(np.ascontiguousarray(vertices - source.shift), np.ascontiguousarray(cells, dtype=np.int64))


def _kept_height(source: LocalSource, mesh: SampleMesh) -> float:
    own = own_cells(source, mesh.cells)
    if own is None:
        return _height(source, mesh)
    if "height" not in own.found:
        own.found["height"] = _height(in_scene(source), SampleMesh.of(own.vertices, own.cells))
    found: float = own.found["height"]
    return found


def _height(source: LocalSource, mesh: SampleMesh) -> float:
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


def _size(mesh: SampleMesh) -> float:
    return largest_side(mesh.vertices)


def _side_by_side(source: LocalSource, length: float, shortest: float | None) -> Drawn | None:
    """Return the cells of a union of members of one dimension that do not meet."""
    if source.manifold_dim is None:
        return None
    drawn = []
    for member in source.members:
        one = cells_of(member, length, shortest)
        if one is None:
            return None
        drawn.append(one)
    parts = list(zip(source.members, [one.mesh for one in drawn], strict=True))
    if any(_meet(first, second) for first, second in combinations(parts, 2)):
        return None
    bends = {one.bend for one in drawn}
    starts = np.cumsum([0] + [len(mesh.vertices) for _, mesh in parts])
    vertices = np.concatenate([mesh.vertices for _, mesh in parts])
    cells = np.concatenate([mesh.cells + start for (_, mesh), start in zip(parts, starts, strict=False)])
    return Drawn(SampleMesh.of(vertices, cells), bends.pop() if len(bends) == 1 else "feet")


def _meet(first: tuple[LocalSource, SampleMesh], second: tuple[LocalSource, SampleMesh]) -> bool:
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
