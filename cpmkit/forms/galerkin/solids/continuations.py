"""Surfaces inside a solid with continuations past their rims, in the order in which they are tried."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.forms.galerkin.solids.boundaries_inside import OUTSIDE
from cpmkit.forms.galerkin.solids.owned_mesh import ON_SPACINGS, OwnedMesh
from cpmkit.forms.galerkin.solids.skin import FlatPart, straight_midpoints
from cpmkit.forms.galerkin.solids.tip_extensions import EXTENDED_SPACINGS, with_extended_rims
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.mesh.mesh import Mesh
from cpmkit.meshing.quadratic_surface import split_edges

#: A surface is continued past a rim up to this share of the distance to another of its rims.
RIM_SHARE = 0.45
#: It is continued by the first of these shares of ``EXTENDED_SPACINGS`` that fits.
EXTENSION_SHARES = (1.0, 0.8, 0.6, 1 / 3, 0.0)
#: Longest edges of continuations, in spacings.
LONGEST_EXTENSION = 1.5


def quadratic(mesh: Mesh) -> Mesh:
    """Return a mesh of triangles with midpoints; if it has none, those of straight edges."""
    return mesh if mesh.midpoints is not None else mesh.with_same_cells(midpoints=straight_midpoints(mesh))


def _near_solid(own: OwnedMesh, solid: LocalSource, name: str) -> OwnedMesh:
    """Return the triangles of a surface without those far outside of the ``solid``."""
    mesh = own.mesh
    feet = solid.closest_point(mesh.vertices)
    far = (feet.edge >= 0) & (feet.distance > 2 * mesh.edge_lengths.max())
    near = ~far[mesh.cells].all(axis=1)
    if not near.any():
        raise SceneError(OUTSIDE.format(name))
    used, cells = np.unique(mesh.cells[near], return_inverse=True)
    assert mesh.midpoints is not None
    part = Mesh.of(mesh.vertices[used], cells.reshape(-1, 3), mesh.midpoints[near])
    return OwnedMesh(part, own.owner[near], own.beyond[near])


def continuations(part: FlatPart, number: int, name: str, solid: LocalSource, lattice: Lattice) -> Iterator[OwnedMesh]:
    """Yield versions of surface ``number`` with its rims continued less and less, in the order in which to try them."""
    mesh = quadratic(part.curved(lattice, divided=True))
    for extension in EXTENSION_SHARES:
        length = extension * EXTENDED_SPACINGS * lattice.spacing
        wide, beyond = mesh, np.zeros(len(mesh.cells), dtype=bool)
        if length > 0:
            wide, beyond = with_extended_rims(mesh, length)
            if not beyond.any() or _meets_itself(wide, len(mesh.vertices), part, length, lattice):
                continue
        own = _with_short_continuations(OwnedMesh(wide, np.full(len(wide.cells), number), beyond), lattice)
        own = _near_solid(own, solid, name)
        yield own
        if not own.beyond.any():
            return


def _with_short_continuations(own: OwnedMesh, lattice: Lattice) -> OwnedMesh:
    """Return the triangles with those of continuations halved until no edge exceeds `LONGEST_EXTENSION` spacings."""
    while True:
        edges = own.mesh.edges
        on_strip = np.zeros(len(edges.ends), dtype=bool)
        on_strip[edges.of_cells[own.beyond]] = True
        long = np.flatnonzero(on_strip & (own.mesh.edge_lengths > LONGEST_EXTENSION * lattice.spacing))
        if not len(long):
            return own
        halves, parent = split_edges(own.mesh, edges.ends[long], np.full(len(long), 0.5))
        own = own.take(parent, halves)


def _meets_itself(wide: Mesh, count: int, part: FlatPart, length: float, lattice: Lattice) -> bool:
    """Return whether a surface comes near its continuation by ``length``, the vertices of ``wide`` from ``count``."""
    edges = wide.edges.ends
    spokes = edges[(edges.min(axis=1) < count) & (edges.max(axis=1) >= count)]
    start, end = (wide.vertices[each(spokes, axis=1)] for each in (np.min, np.max))
    for share in (1 / 3, 2 / 3, 1.0):
        points = start + share * (end - start)
        off = part.source.closest_point(points).points - points
        distance, along = norms(off), dots(off, unit(end - start))
        ahead = (distance <= RIM_SHARE * length) & (along >= 0.5 * distance)
        if (ahead | (distance < ON_SPACINGS * lattice.spacing)).any():
            return True
    return False
