"""The mesh of a source that is the same at any spacing, and quantities that no lattice changes: computed once.

Repaired cells, edges, normals at the vertices and heights of the smooth surface above the edges are the same on every
lattice, and on coarse lattices take longer than all the rest. They are computed in coordinates of the scene, so that
they do not depend on the first lattice that was used, and are released with the source.
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
from cpmkit.mesh.adjacency import RepairReport, repair, repaired_cells
from cpmkit.mesh.mesh import Mesh
from cpmkit.types import Ints

Value = TypeVar("Value")


@dataclass(frozen=True, eq=False)
class RepairedMesh:
    """A repair that can be applied to any translated copy of a mesh."""

    vertex_of: Ints  #: (v,): the vertex of the original mesh that each vertex of the repaired mesh copies.
    mesh: Mesh  #: The repaired mesh where the source stands in the scene.
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
    def repaired(self) -> RepairedMesh:
        """The repair of the original mesh."""
        vertex_of, cells, report = repaired_cells(self.original)
        return RepairedMesh(vertex_of, Mesh.of(self.original.vertices[vertex_of], cells), report)

    @property
    def mesh(self) -> Mesh:
        """The repaired mesh in the scene's coordinates."""
        return self.repaired.mesh

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
        cells, an existing cache is returned, else None. It is None, too, for a source that cannot be a weak key.
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


def repair_source_mesh(source: LocalSource, mesh: Mesh) -> tuple[Mesh, RepairReport]:
    """Return a repaired flat mesh of a source without boundaries, and the report of :func:`repair`.

    Both come from the source's cache if ``mesh`` is a translated copy of the source's own mesh.
    """
    cache = mesh_cache_of(source)
    if cache is not None and mesh.cells is cache.original.cells:
        return cache.repaired.repair_copy(mesh), cache.repaired.report
    return repair(mesh)
