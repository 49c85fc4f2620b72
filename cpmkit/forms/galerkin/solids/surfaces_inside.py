"""Surfaces inside a solid in space: trimmed at its skin, split where they meet it and each other, on both sides.

Surfaces are added to the mesh of the skin one after the other. Each is continued past its rims and trimmed to the part
in the solid; then the surface and the mesh are split where they meet, with common vertices and edges there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from cpmkit.errors import ResolutionError, SceneError, place
from cpmkit.forms.galerkin.solids.boundaries_inside import OUTSIDE
from cpmkit.forms.galerkin.solids.continuations import continuations, quadratic
from cpmkit.forms.galerkin.solids.owned_mesh import ON_SPACINGS, OwnedMesh, halved, halved_near, part_of
from cpmkit.forms.galerkin.solids.skin import FlatPart, Skin, with_turned
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import norms
from cpmkit.mesh.crossing_triangles import edges_through_triangles
from cpmkit.mesh.mesh import CellGeometry, Mesh
from cpmkit.mesh.sectors import crossed_vertices, sector_facets
from cpmkit.meshing.common_edges import match_chains
from cpmkit.meshing.meeting_surfaces import (
    SplitMesh,
    moved_onto,
    piercing_points,
    split_at_surface,
    turned_cells,
    with_points,
)
from cpmkit.meshing.quadratic_surface import QuadraticSurface, edge_numbers, quartered
from cpmkit.runtime.index_sets import connected_components
from cpmkit.types import Bools, Floats, Ints

#: A triangle of a surface inside with its corners on the skin is left out if its centre is nearer to the skin than this
#: share of its longest edge.
THIN_SHARE = 0.12
#: A triangle that turns over does no harm if one of its edges is shorter than this, in spacings.
LEAST_EDGE = 0.05
#: Triangles beside an edge where surfaces meet are halved where area elements are below this share of those when flat,
LEAST_AREA_SHARE = 0.15
#: at most so often.
HALVINGS = 3
#: Triangles near a place where surfaces cannot be joined are halved at most so often.
REFINEMENTS = 4


def with_surfaces_inside(
    skin: Skin,
    inside: Sequence[FlatPart],
    names: Sequence[str],
    solid: LocalSource,
    left_of: Callable[[int, Mesh], Bools],
    lattice: Lattice,
) -> Skin:
    """Return the ``skin`` with two cells at each place of the surfaces ``inside`` and of their continuations.

    ``left_of`` returns for the number and the cells (m,) of a surface whether its left is where their normals point.
    Raises SceneError if a surface lies outside of the solid or crosses itself, ResolutionError if it cannot be joined.
    """
    count = len(skin.mesh.cells)
    none = np.zeros(count, dtype=bool)
    whole = OwnedMesh(quadratic(skin.mesh), np.full(count, -1), none)
    outer, earlier = QuadraticSurface(whole.mesh), list[QuadraticSurface]()
    for number, part in enumerate(inside):
        _check_simple(part, names[number], lattice)
        for own in continuations(part, number, names[number], solid, lattice):
            joined = _with_surface(whole, own, outer, earlier, solid, names[number], lattice)
            if isinstance(joined, OwnedMesh):
                break
        if not isinstance(joined, OwnedMesh):
            raise ResolutionError(
                f"spacing={lattice.spacing:g} is too coarse for where boundary {names[number]!r} meets the boundary of "
                f"the solid, another boundary or itself, near {place(lattice.to_scene(joined[0]))}, or they are nearly "
                f"tangent there; use spacing={0.5 * lattice.spacing:g} or less, or form='collocation'."
            )
        whole = joined
        earlier.append(QuadraticSurface(own.mesh))
    whole = _without_loose_ends(whole)
    return _two_sided(skin, whole, inside, left_of)


def _with_surface(
    whole: OwnedMesh,
    own: OwnedMesh,
    outer: QuadraticSurface,
    earlier: Sequence[QuadraticSurface],
    solid: LocalSource,
    name: str,
    lattice: Lattice,
) -> OwnedMesh | Floats:
    """Return the mesh ``whole`` joined with the part in the ``solid`` of a further surface, ``own``.

    ``outer`` is the skin, and ``earlier`` are the surfaces that ``whole`` contains. Triangles are halved where this is
    needed. If the two cannot be joined, places (k, 3) where they meet are returned.
    """
    surface, turn = QuadraticSurface(own.mesh), 0
    while True:
        pierced = _pierced(whole, own, lattice), _pierced(own, whole, lattice)
        joined = _trimmed(pierced[1], outer, solid, name, lattice)
        if isinstance(joined, OwnedMesh):
            if len(places := _ends_inside(joined)):
                return places
            joined = _joined(pierced[0], _split_at_earlier(joined, earlier, lattice), surface, lattice)
        if isinstance(joined, OwnedMesh) or turn == REFINEMENTS:
            return joined
        whole, own, turn = halved_near(whole, joined), halved_near(own, joined), turn + 1


def _check_simple(part: FlatPart, name: str, lattice: Lattice) -> None:
    """Raise SceneError, with a place, if a surface crosses itself."""
    cell = edges_through_triangles(part.mesh)[1]
    if len(cell):
        at = place(lattice.to_scene(part.mesh.vertices[part.mesh.cells[cell[0]]].mean(axis=0)))
        raise SceneError(
            f"boundary {name!r} crosses itself near {at}; give its parts as boundaries of their own, which may cross, "
            "or use form='collocation'."
        )


def _pierced(one: OwnedMesh, other: OwnedMesh, lattice: Lattice) -> OwnedMesh:
    """Return the triangles of ``one`` with vertices where creases and rims of the ``other`` mesh meet ``one``."""
    surface, gap = QuadraticSurface(one.mesh), ON_SPACINGS * lattice.spacing
    mesh, parent = with_points(one.mesh, piercing_points(other.mesh, lambda x: surface.side(x, lattice.spacing), gap))
    return one.take(parent, mesh)


def _trimmed(
    own: OwnedMesh, outer: QuadraticSurface, solid: LocalSource, name: str, lattice: Lattice
) -> OwnedMesh | Floats:
    """Return the part of a surface in the ``solid``, with its edges on the skin (``outer``) in ``cut``.

    If the surface cannot be trimmed at some places (k, 3), these are returned.
    """

    def side(points: Floats) -> tuple[Floats, Floats]:
        """Return the distances (n,) of points from the skin, negative inside, and zeros."""
        distance = np.full(len(points), np.inf)
        rows = np.flatnonzero(outer.is_near(points, lattice.spacing))
        if len(rows):
            distance[rows] = norms(points[rows] - outer.nearest(points[rows]))
        return np.where(solid.closest_point(points).edge < 0, -distance, distance), np.zeros(len(points))

    split = split_at_surface(own.mesh, side, own.near_rims(lattice), exact=1e-3, thin=THIN_SHARE)
    divided = (split.sides == 0) & ~split.is_on[split.mesh.cells].all(axis=1)
    if divided.any():
        return _centres(split.mesh, divided)
    kept = own.take(split.parent, split.mesh).take(split.sides < 0)
    if kept.beyond.all():
        raise SceneError(OUTSIDE.format(name))
    rim = _rim(kept.mesh)
    return _with_cut(kept, rim[split.is_on[rim].all(axis=1)])


def _ends_inside(trimmed: OwnedMesh) -> Floats:
    """Return places (k, 3) where a surface ends inside the solid without a continuation; halving does not change it."""
    rim = trimmed.mesh.connectivity.on_rim.copy()
    rim[edge_numbers(trimmed.mesh, trimmed.mesh.cut)] = False
    midpoints = trimmed.mesh.vertices[trimmed.mesh.edges.ends[rim]].mean(axis=1)
    return np.asarray(midpoints[: 0 if trimmed.beyond.any() else None])


def _rim(mesh: Mesh) -> Ints:
    """Return the edges (k, 2) of the rim of a mesh."""
    return np.asarray(mesh.edges.ends[mesh.connectivity.on_rim])


def _with_cut(own: OwnedMesh, ends: Ints) -> OwnedMesh:
    """Return the triangles with further edges ``ends`` (k, 2) in ``cut``."""
    cut = np.unique(np.sort(np.concatenate([own.mesh.cut, ends]), axis=1), axis=0)
    none = np.zeros(len(cut), dtype=np.int64)
    return replace(own, mesh=own.mesh.with_same_cells(cut=cut, owner=none, beyond_tip=none.astype(bool)))


def _split_at_earlier(own: OwnedMesh, earlier: Sequence[QuadraticSurface], lattice: Lattice) -> OwnedMesh:
    """Return a surface split where it meets ``earlier`` surfaces, with its edges there in ``cut``."""
    for other in earlier:

        def split_at(own: OwnedMesh, other: QuadraticSurface = other) -> SplitMesh:
            """Return the triangles split at the other surface, and not beyond its rim."""
            near = own.near_rims(lattice)
            return split_at_surface(own.mesh, lambda x: other.side(x, lattice.spacing), near, beyond_rim=ON_SPACINGS)

        own, split = _split_along(own, split_at, other)
        rim = _rim(own.mesh)
        own = _with_cut(own, np.concatenate([split.chain, rim[split.is_on[rim].all(axis=1)]]))
    return own


def _joined(whole: OwnedMesh, own: OwnedMesh, surface: QuadraticSurface, lattice: Lattice) -> OwnedMesh | Floats:
    """Return the mesh ``whole`` with the triangles ``own`` of a further ``surface``, joined at the edges in ``cut``.

    If the two cannot be joined, places (k, 3) where they meet are returned.
    """
    number, chain = np.full(len(own.mesh.vertices), -1), own.mesh.cut
    if len(chain):
        whole, split = _split_along(
            whole, lambda base: split_at_surface(base.mesh, lambda x: surface.side(x, 3 * lattice.spacing)), surface
        )
        matched = match_chains(whole.mesh, split.chain, own.mesh, chain)
        if isinstance(matched, np.ndarray):
            return matched
        for mesh, edges in ((matched.base, matched.number[matched.chain]), (matched.other, matched.chain)):
            turned = turned_cells(mesh, edges, 0.0)
            large = turned[mesh.lengths_of_cells[turned].min(axis=1) > LEAST_EDGE * lattice.spacing]
            if len(large):
                return _centres(mesh, large)
        whole = whole.take(matched.parent, matched.base)
        own, number = own.take(matched.other_parent, matched.other), matched.number
    new = number < 0
    number[new] = len(whole.mesh.vertices) + np.arange(new.sum())
    mesh = Mesh.of(
        np.concatenate([whole.mesh.vertices, own.mesh.vertices[new]]),
        np.concatenate([whole.mesh.cells, number[own.mesh.cells]]),
        np.concatenate([whole.mesh.midpoints, own.mesh.midpoints]),
    )
    joined = OwnedMesh(mesh, np.concatenate([whole.owner, own.owner]), np.concatenate([whole.beyond, own.beyond]))
    return joined if (at := _unclosed(joined)) is None else at


def _unclosed(whole: OwnedMesh) -> Floats | None:
    """Return places (k, 3) where triangles cross, or do not enclose sectors on both sides of surfaces; None if none."""
    for mesh in (quartered(whole.mesh), whole.mesh):
        cell, crossed = edges_through_triangles(mesh)[1], crossed_vertices(mesh)
        if len(cell) or len(crossed):
            return np.concatenate([_centres(mesh, cell), mesh.vertices[crossed]])
    skin, inside = (part_of(whole.mesh, whole.owner < 0), _with_both_sides(part_of(whole.mesh, whole.owner >= 0)))
    curved = _joined_cells(whole.mesh.vertices, [skin, inside])
    for mesh in (quartered(curved), curved):
        is_open = np.flatnonzero(sector_facets(mesh)[1].any(axis=1))
        if len(is_open):
            return _centres(mesh, is_open)
    return None


def _centres(mesh: Mesh, cells: Ints | Bools) -> Floats:
    """Return the centres (k, 3) of triangles of a mesh."""
    return np.asarray(mesh.vertices[mesh.cells[cells]].mean(axis=1))


def _split_along(
    own: OwnedMesh, split_at: Callable[[OwnedMesh], SplitMesh], other: QuadraticSurface
) -> tuple[OwnedMesh, SplitMesh]:
    """Return triangles split by ``split_at`` where they meet an ``other`` surface, and the result of ``split_at``.

    Midpoints of the edges there are moved onto the other surface. Triangles whose parts would turn over, since an edge
    is curved more than they are thick, are halved before.
    """
    for turn in range(HALVINGS + 1):
        split = split_at(own)
        mesh = moved_onto(split.mesh, split.chain, other)
        turned = turned_cells(mesh, split.chain, LEAST_AREA_SHARE)
        if turn == HALVINGS or not len(turned):
            break
        own = halved(own, split.parent[turned])
    return own.take(split.parent, mesh), split


def _without_loose_ends(whole: OwnedMesh) -> OwnedMesh:
    """Return the triangles without those of continuations that are cut off from their own surface by another one."""
    cells, inner = whole.mesh.edges.of_cells, ~whole.seams
    count = len(cells)
    links = np.stack([np.repeat(np.arange(count), 3), count + cells.ravel()], axis=1)[inner[cells.ravel()]]
    _, label = connected_components(count + len(inner), links)
    used = np.zeros(count + len(inner), dtype=bool)
    used[label[:count][~whole.beyond]] = True
    return whole.take(used[label[:count]])


def _two_sided(skin: Skin, whole: OwnedMesh, inside: Sequence[FlatPart], left_of: Callable[[int, Mesh], Bools]) -> Skin:
    """Return the cells of the ``skin``, then those of each surface inside, first with its normals, then reversed."""
    meshes = [part_of(whole.mesh, whole.owner == number) for number in range(-1, len(inside))]
    owner = [np.full(len(meshes[0].cells), -1)]
    left, beyond, twin = [owner[0] >= 0], [owner[0] >= 0], [owner[0]]
    for number, mesh in enumerate(meshes[1:]):
        count, start, plus = len(mesh.cells), sum(map(len, owner)), left_of(number, mesh)
        meshes[number + 1] = _with_both_sides(mesh)
        owner.append(np.full(2 * count, number))
        left.append(np.concatenate([~plus, plus]))
        beyond.append(np.tile(whole.beyond[whole.owner == number], 2))
        twin.append(start + np.roll(np.arange(2 * count), count))
    geometries: list[CellGeometry] = [skin.geometry, *(part.geometry for part in inside)]
    geometry: CellGeometry = next((each for each in geometries if each != "flat"), "flat")
    warnings = sum((part.warnings for part in inside), skin.warnings)
    attributes = [np.concatenate(each) for each in (owner, left, beyond, twin)]
    made = Skin(_joined_cells(whole.mesh.vertices, meshes), geometry, warnings, *attributes)
    return replace(made, mesh=replace(made.mesh, midpoints=None)) if made.is_flat.all() else made


def _with_both_sides(mesh: Mesh) -> Mesh:
    """Return the triangles of a mesh, followed by the same triangles with opposite normals."""
    turned = with_turned(mesh, np.arange(len(mesh.cells)))
    return _joined_cells(mesh.vertices, [mesh, turned])


def _joined_cells(vertices: Floats, meshes: Sequence[Mesh]) -> Mesh:
    """Return one mesh of the quadratic triangles of several ``meshes``, which have the same ``vertices`` (v, 3)."""
    cells, midpoints = (np.concatenate([getattr(mesh, name) for mesh in meshes]) for name in ("cells", "midpoints"))
    return Mesh.of(vertices, cells, midpoints)
