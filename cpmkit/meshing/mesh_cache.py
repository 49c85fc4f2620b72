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
from cpmkit.mesh.edges import Edges, edges_of
from cpmkit.mesh.mesh import SampleMesh
from cpmkit.mesh.repair import Mended, is_sound_split, sound, sound_corners
from cpmkit.mesh.winding import winding_of
from cpmkit.protocols import Floats, HasGivenMesh, HasMesh, Ints


@dataclass(frozen=True, eq=False)
class Sound:
    """Sound cells of a mesh: the vertex (v,) of the mesh that each of theirs is, the cells (m, k), what changed."""

    at: Ints
    cells: Ints
    mended: Mended

    def placed(self, mesh: SampleMesh) -> SampleMesh:
        """Return the sound mesh of a mesh of the same cells, wherever it was moved."""
        return SampleMesh.of(mesh.vertices[self.at], self.cells)


@dataclass(frozen=True, eq=False)
class OwnCells:
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

    def sound(self, cells: Ints) -> Sound | None:
        """Return the sound cells of the source's own ``cells``, or of what that gave; None for others."""
        if cells is self.cells:
            return self._once
        return self._twice if cells is self._once.cells else None

    @property
    def final(self) -> SampleMesh:
        """The mesh of sound cells, where the source stands."""
        return self._twice.placed(self._once.placed(self._drawn))

    def is_final(self, mesh: SampleMesh) -> bool:
        """Whether a mesh is of the sound cells, no boundary in it, none split."""
        return not len(mesh.cut) and mesh.cells is self._twice.cells

    @property
    def _drawn(self) -> SampleMesh:
        return SampleMesh.of(self.vertices, self.cells)

    @property
    def _once(self) -> Sound:
        if "once" not in self.found:
            at, cells, _, mended = sound_corners(self._drawn)
            self.found["once"] = Sound(at, cells, mended)
        made: Sound = self.found["once"]
        return made

    @property
    def _twice(self) -> Sound:
        if "twice" not in self.found:
            once = self._once
            at, cells, _, mended = sound_corners(once.placed(self._drawn))
            self.found["twice"] = Sound(at, once.cells if np.array_equal(cells, once.cells) else cells, mended)
        made: Sound = self.found["twice"]
        return made


KEPT: WeakKeyDictionary[Any, OwnCells] = WeakKeyDictionary()


def own_cells(source: LocalSource, cells: Ints | None = None) -> OwnCells | None:
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
    KEPT[of] = kept = OwnCells(vertices, own)
    return kept


def in_scene(source: LocalSource) -> LocalSource:
    """Return a source as it stands in the scene, queries counted with those of its copy."""
    assert source.of is not None
    return LocalSource(source.of, np.zeros(source.dim), source.queries)


def made_sound(source: LocalSource, mesh: SampleMesh, split: bool = False) -> tuple[SampleMesh, Mended]:
    """Return :func:`sound` of a mesh of a source's cells; ``split``: these are parts of sound ones."""
    own = own_cells(source)
    kept = None if own is None or mesh.midpoints is not None or len(mesh.cut) else own.sound(mesh.cells)
    if kept is None and split and is_sound_split(mesh):
        return mesh, Mended(0, 0, 0)
    return sound(mesh) if kept is None else (kept.placed(mesh), kept.mended)


def edges_with(source: LocalSource, mesh: SampleMesh) -> Edges | None:
    """Return the edges of a mesh if they are kept, as those of a source's sound cells are."""
    own = own_cells(source)
    if own is None or mesh.manifold_dim == 1 or not own.is_final(mesh):
        return None
    if "edges" not in own.found:
        own.found["edges"] = edges_of(mesh)
    found: Edges = own.found["edges"]
    return found


def own_winding(source: LocalSource, mesh: SampleMesh, edges: Edges | None = None) -> Any:
    """Return :func:`winding_of` a mesh of a source's cells."""
    own = own_cells(source)
    if own is None or not own.is_final(mesh):
        return winding_of(mesh, edges)
    if "winding" not in own.found:
        own.found["winding"] = winding_of(mesh, edges)
    return own.found["winding"]
