"""The cells of sources that are cells, or draw themselves well enough for samples to be taken from the drawing."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cpmkit.forms.galerkin.sample_mesh import SampleMesh
from cpmkit.forms.galerkin.samples.bending import Bend
from cpmkit.forms.galerkin.samples.drawings import is_fit
from cpmkit.forms.galerkin.samples.lifting import lifted
from cpmkit.forms.galerkin.samples.soundness import sound
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import norms
from cpmkit.protocols import HasMesh

#: Drawings have edges of this many spacings.
DRAWN_EDGE_SPACINGS = 0.5
#: Cells whose centres are looked at to tell whether cells are flat, and how near they are to it then, of their size.
FLAT_PROBES, FLAT_SIZE_SHARE = 1024, 1e-9
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
    """

    mesh: SampleMesh
    bend: Bend


def cells_of(source: LocalSource, spacing: float) -> Drawn | None:
    """Return the cells of a source; None where they are to be found by closest points.

    A mesh or polyline gives its own cells, bent where it is read as smooth; an analytic or parametric shape those of
    its drawing; drawings of level sets in space have too many triangles, and of bad shape. Members of a union stand
    side by side. Where they meet, but for vertices that they share, only closest points know the junction.

    Parameters
    ----------
    source : LocalSource
    spacing : float
        h: drawings, and the triangles of bent meshes, have edges of half of it.
    """
    if source.members[0] is not source:
        return _side_by_side(source, spacing)
    if not 0 < (source.manifold_dim or 0) < source.dim or not isinstance(source.source, HasMesh):
        return None
    length = DRAWN_EDGE_SPACINGS * spacing
    vertices, cells = source.source.mesh(length)
    if cells.shape[1] != (source.manifold_dim or 0) + 1 or not len(cells):
        return None
    mesh = SampleMesh.of(np.ascontiguousarray(vertices - source.shift), np.ascontiguousarray(cells, dtype=np.int64))
    if _is_flat(source, mesh):
        if source.source.exact or mesh.manifold_dim == 1 or not source.has_normals:
            return Drawn(mesh, "flat")
        return Drawn(lifted(sound(mesh)[0], source, length), "normals")
    mesh = sound(mesh)[0]
    return Drawn(mesh, "feet") if is_fit(source, mesh, length) else None


def _is_flat(source: LocalSource, mesh: SampleMesh) -> bool:
    """Whether the centres of cells lie on the manifold, as those of a faceted mesh do."""
    step = max(len(mesh.cells) // FLAT_PROBES, 1)
    centres = mesh.vertices[mesh.cells[::step]].mean(axis=1)
    off = norms(source.closest_point(centres).points - centres)
    return bool(off.max() <= FLAT_SIZE_SHARE * _size(mesh))


def _size(mesh: SampleMesh) -> float:
    return float(np.ptp(mesh.vertices, axis=0).max())


def _side_by_side(source: LocalSource, spacing: float) -> Drawn | None:
    """Return the cells of a union of members of one dimension that do not meet."""
    if source.manifold_dim is None:
        return None
    drawn = []
    for member in source.members:
        one = cells_of(member, spacing)
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
