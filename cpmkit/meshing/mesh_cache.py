"""A cache for the mesh of a source that is the same at any spacing, and for quantities that no lattice changes.

Repaired cells, edges, normals at the vertices and heights of the smooth surface above the edges are the same on every
lattice, and on coarse lattices take longer to compute than all the rest. They are computed in coordinates of the scene,
so that they do not depend on the lattice that was used first, and are released with the source.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from cpmkit.manifold.abilities import HasGivenMesh, HasMesh
from cpmkit.manifold.local_source import LocalSource
from cpmkit.mesh.adjacency import RepairReport, has_distinct_vertices, repair, repaired_cells
from cpmkit.mesh.mesh import Mesh
from cpmkit.types import Ints

Value = TypeVar("Value")


@dataclass(frozen=True, eq=False)
class RepairedMesh:
    """A repair that can be applied to any translated copy of a mesh."""

    vertex_of: Ints  #: (v,): the vertex of the original mesh that each vertex of the repaired mesh copies.
    mesh: Mesh  #: The repaired mesh, in the scene's coordinates.
    report: RepairReport

    def repair_copy(self, mesh: Mesh) -> Mesh:
        """Return the repaired mesh of a translated copy ``mesh`` of the original; connectivity is shared."""
        return self.mesh.with_same_cells(vertices=mesh.vertices[self.vertex_of])


@dataclass(frozen=True, eq=False)
class MeshCache:
    """The mesh of a source, its repair and further quantities that depend on the source alone."""

    #: The mesh as the source gives it, in the scene's coordinates; its array of cells is the source's own.
    original: Mesh
    values: dict[str, Any] = field(default_factory=dict)  #: Further quantities, by name.

    @cached_property
    def first_repair(self) -> RepairedMesh:
        """The repair of the original mesh."""
        return _repair_mesh(self.original)

    @cached_property
    def second_repair(self) -> RepairedMesh:
        """The repair of the repaired mesh, needed since welding may leave two vertices at one place."""
        repaired = _repair_mesh(self.first_repair.mesh)
        if not np.array_equal(repaired.mesh.cells, self.first_repair.mesh.cells):
            return repaired
        mesh = self.first_repair.mesh.with_same_cells(vertices=repaired.mesh.vertices)
        return RepairedMesh(repaired.vertex_of, mesh, repaired.report)

    @property
    def mesh(self) -> Mesh:
        """The repaired mesh in the scene's coordinates."""
        return self.second_repair.mesh

    def has_cells_of(self, mesh: Mesh) -> bool:
        """Return whether ``mesh`` is a translated copy of the repaired mesh, without boundaries among its facets."""
        return not len(mesh.cut) and mesh.cells is self.mesh.cells

    def value(self, name: str, compute: Callable[[], Value]) -> Value:
        """Return the quantity ``name``, computed by ``compute`` at the first call and stored in ``values``."""
        if name not in self.values:
            self.values[name] = compute()
        value: Value = self.values[name]
        return value


MESH_CACHES: WeakKeyDictionary[Any, MeshCache] = WeakKeyDictionary()


def mesh_cache_of(source: LocalSource, cells: Ints | None = None) -> MeshCache | None:
    """Return the cache of a source's mesh; None where the source has no mesh that is the same at any spacing.

    ``cells`` (m, k): the cells that the source has just returned: a cache is created and stored for them. Without
        cells, an existing cache is returned, or None. Sources that cannot be weak keys have no cache.
    """
    of: Any = source.of
    try:
        cache = MESH_CACHES.get(of)
    except TypeError:  # a source that cannot be a key
        return None
    if cells is None or (cache is not None and cache.original.cells is cells):
        return cache
    if not isinstance(of, HasGivenMesh) or not isinstance(of, HasMesh):
        return None
    vertices, given_cells = of.mesh(float(np.ptp(source.bounds, axis=0).max()))
    if given_cells is not cells:
        return None
    MESH_CACHES[of] = cache = MeshCache(Mesh.of(vertices, given_cells))
    return cache


def untranslated_source(source: LocalSource) -> LocalSource:
    """Return the source in the scene's coordinates; its queries are counted together with those of ``source``."""
    assert source.of is not None
    return LocalSource(source.of, np.zeros(source.dim), source.queries)


def repair_source_mesh(source: LocalSource, mesh: Mesh, split: bool = False) -> tuple[Mesh, RepairReport]:
    """Return a repaired mesh of a source, and the report of :func:`repair`.

    Both come from the source's cache if ``mesh`` is a translated copy of the source's own mesh or of its first repair;
    other meshes are repaired anew. ``split`` says that the cells are parts of repaired cells: such a mesh is returned
    unchanged if no two of its vertices coincide.
    """
    cache = mesh_cache_of(source)
    if cache is not None and mesh.midpoints is None and not len(mesh.cut):
        if mesh.cells is cache.original.cells:
            return cache.first_repair.repair_copy(mesh), cache.first_repair.report
        if mesh.cells is cache.first_repair.mesh.cells:
            return cache.second_repair.repair_copy(mesh), cache.second_repair.report
    if split and has_distinct_vertices(mesh):
        return mesh, RepairReport(0, 0, 0)
    return repair(mesh)


def _repair_mesh(mesh: Mesh) -> RepairedMesh:
    """Return the repair of a flat ``mesh`` without boundaries."""
    vertex_of, cells, report = repaired_cells(mesh)
    return RepairedMesh(vertex_of, Mesh.of(mesh.vertices[vertex_of], cells), report)
