"""The skin of a solid: its boundary as a closed mesh, oriented so that normals point out of the solid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cpmkit.errors import ResolutionError, SceneError, place
from cpmkit.forms.galerkin.mesh_of_manifold import mesh_of_manifold
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.abilities import HasMesh, HasSkin
from cpmkit.manifold.local_source import LocalSource, localize
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.mesh.adjacency import facets_of_two_cells, repair, rim_of_edges
from cpmkit.mesh.cell_quadrature import PLAIN_EDGE_SPACINGS
from cpmkit.mesh.mesh import CellGeometry, Mesh
from cpmkit.mesh.part_borders import PartAt, split_at_parts
from cpmkit.mesh.subdivision import subdivide
from cpmkit.meshing.curved_from_normals import curve_cells
from cpmkit.meshing.quadratic_surface import quartered
from cpmkit.runtime.index_sets import connected_components
from cpmkit.types import Bools, Floats, Ints

#: Longest edges of a curved skin, in spacings, by the dimension of the space. In space 1.0 has the errors of .7, to 3
#: percent, with two thirds of the samples; with 1.4 errors are half as large again.
LONGEST_EDGES = {2: PLAIN_EDGE_SPACINGS, 3: 1.0}
#: The area of curved cells times the distances of their centres from the boundary is at most this share of the volume
#: that a component of the skin encloses.
LARGEST_DOUBT = 0.1
#: Flat cells of a skin that turn by more than this towards each other enclose a reentrant angle.
REENTRANT_DEGREES = 20.0
#: Edges whose midpoints lie nearer to straight ones than this share of their length are straight.
STRAIGHT_SHARE = 1e-12
#: Normals of a component of the skin are compared with the solid at so many of its cells, at most.
PROBES = 32
#: The solid is probed at this distance from its skin, as a share of the longest edge of a cell or the spacing.
PROBE_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class FlatPart:
    """A part of the skin, or a boundary inside, as flat cells that are neither subdivided nor curved."""

    source: LocalSource  #: The source of the closest points by which cells are curved.
    mesh: Mesh
    geometry: CellGeometry  #: How the part runs between the vertices.
    warnings: tuple[str, ...]  #: Warnings of the mesh.
    boundary: LocalSource | None  #: The part itself; None if it is known by its cells alone.

    @classmethod
    def of(cls, boundary: LocalSource, lattice: Lattice) -> FlatPart:
        """Return the cells of a curve or surface that is known by closest points."""
        source, mesh, geometry, warnings = mesh_of_manifold(boundary, lattice.spacing, LONGEST_EDGES[boundary.dim])
        return cls(source, mesh, geometry, warnings, source)

    def curved(self, lattice: Lattice, part_at: PartAt | None = None, divided: bool = False) -> Mesh:
        """Return the cells to sample: subdivided, curved, and split where segments cross the lattice's knot planes.

        Flat triangles are subdivided only with ``part_at`` (see :func:`skin_of`) or if ``divided``.
        """
        mesh, spacing = self.mesh, lattice.spacing
        if self.geometry != "flat" or mesh.manifold_dim == 1 or part_at is not None or divided:
            mesh = subdivide(mesh, LONGEST_EDGES[mesh.dim] * spacing)
        if part_at is not None:
            mesh = split_at_parts(mesh, np.arange(len(mesh.edges.ends)), part_at, self.geometry, self.source)
        return curve_cells(mesh, self.geometry, self.source, (), spacing)


@dataclass(frozen=True, eq=False)
class Skin:
    """The boundary of a solid as a closed oriented mesh, whose cells' normals point out of the solid.

    Boundaries inside the solid have two cells at each place, with opposite normals: one bounds each side.
    """

    mesh: Mesh  #: Segments that end on knot planes, or triangles; quadratic where the boundary is curved.
    geometry: CellGeometry  #: How the boundary runs between the vertices.
    warnings: tuple[str, ...]  #: Warnings of the mesh.
    owner: Ints  #: (m,): the number of the boundary inside that each cell lies on, -1 on the boundary of the solid.
    left: Bools  #: (m,): whether a cell of a boundary inside bounds its left side.
    beyond_tip: Bools  #: (m,): whether a cell continues a boundary inside past its tip, where u is continuous.
    twin: Ints  #: (m,): the cell on the other side of a boundary inside, -1 on the boundary of the solid.

    @cached_property
    def is_flat(self) -> Bools:
        """(m,) whether each cell has straight edges, to rounding."""
        mesh = self.mesh
        if mesh.midpoints is None:
            return np.ones(len(mesh.cells), dtype=bool)
        bulge = np.linalg.norm(mesh.midpoints - straight_midpoints(mesh), axis=2).max(axis=1)
        return np.asarray(bulge <= STRAIGHT_SHARE * mesh.lengths_of_cells.max(axis=1))

    @property
    def facets(self) -> tuple[Mesh, Mesh | None]:
        """The cells whose moments are those of the solid, and further flat ones for Richardson's extrapolation.

        In space quadratic triangles bulge over knot planes and would not close the cells: each is divided into four
        flat ones, and the triangles of its corners are the further ones. All other cells serve as they are.
        """
        mesh = self.mesh
        if mesh.dim == 2 or mesh.midpoints is None:
            return mesh, None
        return quartered(mesh), replace(mesh, midpoints=None)

    @property
    def count(self) -> int:
        """Number of cells on the boundary of the solid, which come first."""
        return int((self.owner < 0).sum())


def has_reentrant_edges(mesh: Mesh) -> bool:
    """Return whether two cells of a ``mesh`` with outward normals enclose a reentrant angle of the solid."""
    first, second = (facets_of_two_cells(mesh)[1] // mesh.cells.shape[1]).T
    normals, centres = normals_of(mesh), mesh.vertices[mesh.cells].mean(axis=1)
    turns = dots(normals[first], normals[second]) < np.cos(np.radians(REENTRANT_DEGREES))
    return bool(np.any(turns & (dots(centres[second] - centres[first], normals[first]) > 0)))


def flat_parts(solid: LocalSource, lattice: Lattice) -> list[list[FlatPart]]:
    """Return the parts of the boundary of a solid, of each member of a union by itself.

    Raises SceneError if the boundary is not known.
    """
    return [_parts_of_member(member, lattice) for member in solid.members]


def _parts_of_member(solid: LocalSource, lattice: Lattice) -> list[FlatPart]:
    """Return the parts of the boundary of a ``solid`` that is no union."""
    boundary = _boundary_source(solid)
    if boundary is None:
        return [FlatPart(solid, _own_boundary(solid, lattice.spacing), "flat", (), None)]
    # Each part is meshed by its own closest points: those of a thin shell may lie on its other side.
    return [FlatPart.of(part, lattice) for part in boundary.members]


def skin_of(
    solid: LocalSource,
    parts: Sequence[Sequence[FlatPart]],
    lattice: Lattice,
    part_at: PartAt | None = None,
    divided: bool = False,
) -> Skin:
    """Return the skin of a solid from its :func:`flat_parts`.

    ``part_at`` gives the part of the edge at a point, if conditions differ by parts: cells are split where parts meet.
    Flat cells are subdivided as well if ``divided``. Raises SceneError if the skin is not closed, or inside and outside
    cannot be distinguished, and ResolutionError if the spacing is too coarse for a curved boundary.
    """
    skins = []
    for member, own in zip(solid.members, parts, strict=True):
        skin = joined([_closed_boundary(part, lattice, part_at, divided) for part in own])
        skins.append(replace(skin, mesh=_oriented(skin.mesh, member, _boundary_source(member), lattice)))
    return joined(skins)


def joined(parts: Sequence[Skin]) -> Skin:
    """Return several skins as one; if some are curved, flat skins get the midpoints of their straight edges."""
    geometry: CellGeometry = next((part.geometry for part in parts if part.geometry != "flat"), "flat")
    starts = np.cumsum([0] + [len(part.mesh.vertices) for part in parts[:-1]])
    vertices = np.concatenate([part.mesh.vertices for part in parts])
    cells = np.concatenate([part.mesh.cells + start for part, start in zip(parts, starts, strict=True)])
    midpoints = None
    if any(part.mesh.midpoints is not None for part in parts):
        midpoints = np.concatenate([_midpoints(part.mesh) for part in parts])
    owner, left, beyond = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("owner", "left", "beyond_tip")
    )
    starts = np.cumsum([0] + [len(part.twin) for part in parts[:-1]])
    twin = np.concatenate([part.twin + (part.twin >= 0) * k for part, k in zip(parts, starts, strict=True)])
    warnings: tuple[str, ...] = sum((part.warnings for part in parts), ())
    return Skin(Mesh.of(vertices, cells, midpoints), geometry, warnings, owner, left, beyond, twin)


def _midpoints(mesh: Mesh) -> Floats:
    """Return the midpoints (m, e, d) of the edges of each cell, of straight edges where the mesh has none."""
    return straight_midpoints(mesh) if mesh.midpoints is None else mesh.midpoints


def straight_midpoints(mesh: Mesh) -> Floats:
    """Return the midpoints (m, e, d) of the straight edges of each cell; those of triangles opposite their corners."""
    corners = mesh.vertices[mesh.cells]
    return np.asarray(0.5 * (corners.sum(axis=1, keepdims=True) - (corners if mesh.manifold_dim == 2 else 0.0)))


def _closed_boundary(part: FlatPart, lattice: Lattice, part_at: PartAt | None, divided: bool) -> Skin:
    """Return a closed ``part`` of the boundary of a solid, not yet oriented."""
    _check_closed(part.mesh, lattice)
    mesh = part.curved(lattice, part_at, divided)
    if part.geometry == "closest_point":
        _check_resolved(mesh, part.source, lattice)
    no, none = np.zeros(len(mesh.cells), dtype=bool), np.full(len(mesh.cells), -1)
    return Skin(mesh, part.geometry, part.warnings, none, no, no, none)


def _boundary_source(solid: LocalSource) -> LocalSource | None:
    """Return the closed hypersurface around a solid, relative to the same origin; None if the solid has none."""
    if not isinstance(solid.source, HasSkin):
        return None
    of = solid.of.skin if isinstance(solid.of, HasSkin) else None
    return replace(solid, source=solid.source.skin, of=of)


def has_known_boundary(solid: ClosestPointSource) -> bool:
    """Return whether the boundary of a ``solid``, no union, is a source or consists of flat cells of its mesh."""
    if isinstance(solid, HasSkin):
        return True
    try:
        _own_boundary(localize(solid, np.zeros(solid.dim)), float(np.ptp(solid.bounds, axis=0).max()))
    except SceneError:
        return False
    return True


def _own_boundary(solid: LocalSource, spacing: float) -> Mesh:
    """Return the boundary of the cells of a solid's own mesh, which must have flat faces."""
    if not isinstance(solid.source, HasMesh):
        raise SceneError(
            f"the form 'galerkin' needs the boundary of a solid, and {type(solid.source).__name__} has neither a skin "
            "nor a mesh; make it by solid(of=...), or use form='collocation'."
        )
    vertices, cells = solid.source.mesh(float(np.ptp(solid.bounds, axis=0).max()))
    mesh = repair(Mesh.of(np.ascontiguousarray(vertices - solid.shift), np.asarray(cells, dtype=np.int64)))[0]
    if solid.dim == 2:
        mesh = Mesh.of(mesh.vertices, mesh.edges.ends[rim_of_edges(mesh).rows])
        used, ends = np.unique(mesh.cells, return_inverse=True)
        mesh = Mesh.of(mesh.vertices[used], ends.reshape(-1, 2))
    centres = mesh.centres
    step = PROBE_SHARE * spacing * normals_of(mesh)
    outside = np.max([solid.closest_point(centres + sign * step).distance for sign in (1.0, -1.0)], axis=0)
    if not len(outside) or np.abs(outside - PROBE_SHARE * spacing).max() > 1e-6 * spacing:
        raise SceneError(
            f"the form 'galerkin' needs the boundary of a solid, and {type(solid.source).__name__} has a curved one "
            "without a source of its own; make it by solid(of=...), or use form='collocation'."
        )
    return mesh


def _check_closed(mesh: Mesh, lattice: Lattice) -> None:
    """Raise SceneError, with a place, unless each facet of the mesh has two cells that agree on the orientation."""
    numbers = mesh.connectivity.facet_numbers
    open_ = np.bincount(numbers.ravel(), minlength=mesh.connectivity.facet_count)[numbers] != 2
    cells = np.flatnonzero(open_.any(axis=1) | (mesh.winding == 0))
    if len(cells):
        at = place(lattice.to_scene(mesh.vertices[mesh.cells[cells[0]]].mean(axis=0)))
        raise SceneError(
            f"the boundary of the solid is not closed, or meets itself, near {at}; close it there, separate the parts, "
            "or use form='collocation'."
        )


def _check_resolved(mesh: Mesh, boundary: LocalSource, lattice: Lattice) -> None:
    """Raise ResolutionError if curved cells lie so far from the ``boundary`` that their volume is in doubt."""
    corners = mesh.vertices[mesh.cells]
    (count, part), centres = cell_components(mesh), mesh.centres
    inside = mesh.winding * np.linalg.det(corners - corners.mean(axis=(0, 1))) / (2 if mesh.dim == 2 else 6)
    sizes = norms(areas_of(mesh)) * boundary.closest_point(centres).distance
    off, volume = np.bincount(part, sizes, count), np.abs(np.bincount(part, inside, count))
    share = np.divide(off, volume, out=np.zeros(count), where=off > 0)
    if share.max() > LARGEST_DOUBT:
        worst = np.argmax(sizes * (part == np.argmax(share)))
        raise ResolutionError(
            f"spacing={lattice.spacing:g} is too coarse for the boundary of the solid near "
            f"{place(lattice.to_scene(centres[worst]))}, which is curved more sharply; use "
            f"spacing={0.5 * lattice.spacing:g} or less."
        )


def cell_components(mesh: Mesh) -> tuple[int, Ints]:
    """Return the number of connected components of a mesh, and the component (m,) of each cell."""
    count, label = connected_components(len(mesh.vertices), mesh.edges.ends)
    return count, label[mesh.cells[:, 0]]


def areas_of(mesh: Mesh) -> Floats:
    """Return normals (m, d) of flat cells whose lengths are the areas; those of segments point to their right."""
    corners = mesh.vertices[mesh.cells]
    along = corners[:, 1] - corners[:, 0]
    if mesh.dim == 2:
        return np.stack([along[:, 1], -along[:, 0]], axis=1)
    return 0.5 * np.cross(along, corners[:, 2] - corners[:, 0])


def normals_of(mesh: Mesh) -> Floats:
    """Return a unit normal (m, d) of each flat cell; that of a segment points to its right."""
    return unit(areas_of(mesh))


def _oriented(mesh: Mesh, solid: LocalSource, boundary: LocalSource | None, lattice: Lattice) -> Mesh:
    """Return the mesh with the cells of each component turned so that their normals point out of the ``solid``.

    The solid is probed on both sides of the cells' centres, or of their closest points on the ``boundary``, if given.
    """
    count, part = cell_components(mesh)
    rank, members = np.empty(len(part), dtype=np.int64), np.bincount(part, minlength=count)
    order = np.argsort(part, kind="stable")
    rank[order] = np.arange(len(part)) - np.repeat(np.cumsum(members) - members, members)
    chosen = np.flatnonzero(rank % -(-members // PROBES)[part] == 0)
    out = normals_of(mesh)[chosen] * mesh.winding[chosen, None]
    step = PROBE_SHARE * mesh.lengths_of_cells[chosen].max(axis=1)[:, None] * out
    at = mesh.centres[chosen]
    at = at if boundary is None else boundary.closest_point(at).points
    inside = [solid.closest_point(np.ascontiguousarray(x)).edge < 0 for x in (at - step, at + step)]
    votes = np.bincount(part[chosen], inside[0].astype(float) - inside[1], count)
    if np.any(votes[members > 0] == 0):
        doubtful = np.flatnonzero(votes[part[chosen]] == 0)[0]
        raise SceneError(
            f"near {place(lattice.to_scene(at[doubtful]))} the solid or a gap in it is thinner than "
            f"{float(norms(step)[doubtful]):.1g}, or two parts of its boundary lie upon each other, so that inside and "
            "outside cannot be distinguished; move the parts apart, or leave one of them out."
        )
    turned = np.flatnonzero(np.sign(votes)[part] * mesh.winding < 0)
    return with_turned(mesh, turned)


def with_turned(mesh: Mesh, turned: Ints) -> Mesh:
    """Return the mesh with the orientation of the cells ``turned`` (k,) reversed."""
    cells, midpoints = mesh.cells.copy(), mesh.midpoints
    cells[turned] = _swap(cells, turned)
    if midpoints is not None and mesh.manifold_dim == 2:
        midpoints = midpoints.copy()
        midpoints[turned] = _swap(midpoints, turned)
    return Mesh.of(mesh.vertices, cells, midpoints)


def _swap(rows: Floats | Ints, turned: Ints) -> Floats | Ints:
    """Return the ``turned`` rows (n, k, ...) with the last two entries exchanged."""
    return np.concatenate([rows[turned, :-2], rows[turned, -1:], rows[turned, -2:-1]], axis=1)
