"""What of a source's own cells no lattice changes: made once for each source, and let go with it.

A mesh has its own cells at any spacing. That they are welded, where they are flat, the normals at their vertices and
how far the smooth surface stands above the middles of their edges are the same on every lattice, and on coarse ones
take longer than all else. All is made where the source stands in the scene, so that it does not depend on which lattice
came first.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.mesh.adjacency import winding_of
from cpmkit.mesh.mesh import Edges, Mesh, edges_of
from cpmkit.mesh.welding import RepairReport, has_distinct_vertices, repair, repaired_cells
from cpmkit.protocols import Floats, HasGivenMesh, HasMesh, Ints


@dataclass(frozen=True, eq=False)
class RepairedMesh:
    """Sound cells of a mesh: the vertex (v,) of the mesh that each of theirs is, the cells (m, k), what changed."""

    at: Ints
    cells: Ints
    mended: RepairReport

    def placed(self, mesh: Mesh) -> Mesh:
        """Return the sound mesh of a mesh of the same cells, wherever it was moved."""
        return Mesh.of(mesh.vertices[self.at], self.cells)


@dataclass(frozen=True, eq=False)
class MeshCache:
    """A source's own cells, and what was found out about them.

    Attributes
    ----------
    vertices : (v, d) float64
        As the source has them in the scene.
    cells : (m, k) int64
        The array that the source gives at any spacing.
    found : dict
        By names.
    """

    vertices: Floats
    cells: Ints
    found: dict[str, Any] = field(default_factory=dict)

    def sound(self, cells: Ints) -> RepairedMesh | None:
        """Return the sound cells of the source's own ``cells``, or of what that gave; None for others."""
        if cells is self.cells:
            return self._once
        return self._twice if cells is self._once.cells else None

    @property
    def final(self) -> Mesh:
        """The mesh of sound cells, where the source stands."""
        return self._twice.placed(self._once.placed(self._drawn))

    def is_final(self, mesh: Mesh) -> bool:
        """Whether a mesh is of the sound cells, no boundary in it, none split."""
        return not len(mesh.cut) and mesh.cells is self._twice.cells

    @property
    def _drawn(self) -> Mesh:
        return Mesh.of(self.vertices, self.cells)

    @property
    def _once(self) -> RepairedMesh:
        if "once" not in self.found:
            at, cells, _, mended = repaired_cells(self._drawn)
            self.found["once"] = RepairedMesh(at, cells, mended)
        made: RepairedMesh = self.found["once"]
        return made

    @property
    def _twice(self) -> RepairedMesh:
        if "twice" not in self.found:
            once = self._once
            at, cells, _, mended = repaired_cells(once.placed(self._drawn))
            self.found["twice"] = RepairedMesh(at, once.cells if np.array_equal(cells, once.cells) else cells, mended)
        made: RepairedMesh = self.found["twice"]
        return made


KEPT: WeakKeyDictionary[Any, MeshCache] = WeakKeyDictionary()


def mesh_cache_of(source: LocalSource, cells: Ints | None = None) -> MeshCache | None:
    """Return what is kept of a source's own cells; None where they are drawn anew for each lattice.

    ``cells`` are what it gave just now; left out, nothing is begun.
    """
    of: Any = source.of
    try:
        kept = KEPT.get(of)
    except TypeError:  # a source that cannot be a key
        return None
    if cells is None or (kept is not None and kept.cells is cells):
        return kept
    if not isinstance(of, HasGivenMesh) or not isinstance(of, HasMesh):
        return None
    vertices, own = of.mesh(float(np.ptp(source.bounds, axis=0).max()))
    if own is not cells:
        return None
    KEPT[of] = kept = MeshCache(vertices, own)
    return kept


def in_scene_coordinates(source: LocalSource) -> LocalSource:
    """Return a source as it stands in the scene, queries counted with those of its copy."""
    assert source.of is not None
    return LocalSource(source.of, np.zeros(source.dim), source.queries)


def repair_source_mesh(source: LocalSource, mesh: Mesh, split: bool = False) -> tuple[Mesh, RepairReport]:
    """Return :func:`repair` of a mesh of a source's cells; ``split``: these are parts of sound ones."""
    own = mesh_cache_of(source)
    kept = None if own is None or mesh.midpoints is not None or len(mesh.cut) else own.sound(mesh.cells)
    if kept is None and split and has_distinct_vertices(mesh):
        return mesh, RepairReport(0, 0, 0)
    return repair(mesh) if kept is None else (kept.placed(mesh), kept.mended)


def edges_with(source: LocalSource, mesh: Mesh) -> Edges | None:
    """Return the edges of a mesh if they are kept, as those of a source's sound cells are."""
    own = mesh_cache_of(source)
    if own is None or mesh.manifold_dim == 1 or not own.is_final(mesh):
        return None
    if "edges" not in own.found:
        own.found["edges"] = edges_of(mesh)
    found: Edges = own.found["edges"]
    return found


def own_winding(source: LocalSource, mesh: Mesh, edges: Edges | None = None) -> Any:
    """Return :func:`winding_of` a mesh of a source's cells."""
    own = mesh_cache_of(source)
    if own is None or not own.is_final(mesh):
        return winding_of(mesh, edges)
    if "winding" not in own.found:
        own.found["winding"] = winding_of(mesh, edges)
    return own.found["winding"]
