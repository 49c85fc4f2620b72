"""A mesh of a solid: its closed boundary, filled with tetrahedra in space or triangles in the plane."""

from __future__ import annotations

from itertools import permutations
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import (
    Bools,
    ClosestPointSource,
    Floats,
    HasMesh,
    HasSkin,
    InputError,
    Ints,
    ResolutionError,
    SceneError,
    members_of,
    place,
)
from cpmkit_fem.cell_mesh import CellMesh
from cpmkit_fem.plane_filling import fill_polygons
from cpmkit_fem.rim import rim_facets
from cpmkit_fem.space_filling import fill_surface
from cpmkit_fem.triangulation import check_kind_of_cells, own_mesh, weld

if TYPE_CHECKING:
    from collections.abc import Sequence

#: The boundary of the cells is that of the solid if their lengths or areas differ by less than this share.
BOUNDARY_SHARE = 1e-6
#: The area of a curved boundary's cells times the distances of their centres from it is at most this share of the
#: volume inside.
LARGEST_DOUBT = 0.2
#: Members of a union meet where they come nearer than this share of an edge.
MEETING_SHARE = 0.01
#: Rounds of projections from one member of a union to another.
ROUNDS = 12
#: So many of the largest cells of a region decide whether it is inside.
DECIDING = 25


def is_solid(source: ClosestPointSource) -> bool:
    """Return whether ``source`` has as many dimensions as the space."""
    return source.manifold_dim == source.dim


def fills_own_mesh(source: ClosestPointSource) -> bool:
    """Return whether the boundary of a solid is itself a mesh, the same at all spacings."""
    return all(own_mesh(_boundary_of(member)) is not None for member in members_of(source))


def solid_mesh(solid: ClosestPointSource, spacing: float) -> CellMesh:
    """Return cells with edges of about ``spacing`` that fill a ``solid``, each member of a union by itself.

    Raise InputError if it has no closed boundary of triangles or segments, or the members of a union meet.
    """
    parts = [_fill_member(member, spacing) for member in members_of(solid)]
    _check_apart(members_of(solid), parts)
    starts = np.cumsum([0, *(len(part.nodes) for part in parts)])
    cells = np.concatenate([part.cells + start for part, start in zip(parts, starts[:-1], strict=True)])
    return CellMesh(np.concatenate([part.nodes for part in parts]), cells, solid.dim)


def _boundary_of(solid: ClosestPointSource) -> ClosestPointSource:
    """Return the boundary of a solid, or the solid, whose mesh in space is one of its boundary."""
    return solid.skin if isinstance(solid, HasSkin) else solid


def _fill_member(solid: ClosestPointSource, spacing: float) -> CellMesh:
    """Return cells that fill a ``solid`` that is no union."""
    boundary, dim = _boundary_of(solid), solid.dim
    if not isinstance(boundary, HasMesh):
        raise InputError(
            f"backend='fem' needs a mesh of the boundary of a solid, and {type(boundary).__name__} has none; "
            "use backend='cpm'."
        )
    own = own_mesh(boundary)
    found = weld(*(own or boundary.mesh(spacing)))
    if boundary is solid and dim == 2:  # a box: triangles that fill it
        check_kind_of_cells(solid, found.cells, 3)
        return found
    check_kind_of_cells(boundary, found.cells, dim)
    _check_closed(found)
    if dim == 3:
        points, cells, region = fill_surface(found.nodes, found.cells, spacing, keep=own is None)
        edge = found
    else:

        def project(x: Floats) -> Floats:
            return x if own else boundary.closest_point(x).points

        polygons = found.nodes, found.cells
        points, cells, region, sides = fill_polygons(*polygons, spacing, project, lambda x: _inside(solid, x))
        edge = CellMesh(points, sides, 1)
    filled = CellMesh(points, cells[_in_regions_inside(solid, points[cells], region)], dim)
    if not len(filled.cells):
        raise InputError("backend='fem' found no cells inside the solid at this spacing; use a smaller one.")
    _check_boundary(filled, edge)
    if own is None:
        _check_resolved(filled, edge, boundary, spacing)
    return weld(points, filled.cells)


def _inside(solid: ClosestPointSource, points: Floats) -> Bools:
    """Return (n,) which ``points`` (n, d) lie inside a solid."""
    return np.asarray(solid.closest_point(np.ascontiguousarray(points)).edge < 0)


def _in_regions_inside(solid: ClosestPointSource, corners: Floats, region: Ints) -> Bools:
    """Return (m,) which cells, with ``corners`` (m, k, d), are of regions inside the solid, by their largest cells.

    Of curved boundaries the small cells beside them may lie on the other side.
    """
    size = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    kept = np.zeros(len(corners), dtype=bool)
    for number in np.unique(region):
        cells = np.flatnonzero(region == number)
        largest = cells[np.argsort(-size[cells], kind="stable")[:DECIDING]]
        kept[cells] = np.average(_inside(solid, corners[largest].mean(axis=1)), weights=size[largest]) > 0.5
    return kept


def _check_closed(boundary: CellMesh) -> None:
    """Raise SceneError unless each end or edge of the boundary's cells has two of them."""
    facets, count, _ = boundary.facets
    if np.any(count != 2):
        at = place(boundary.nodes[facets[np.argmax(count != 2)]].mean(axis=0))
        raise SceneError(
            f"the boundary of the solid is not closed, or meets itself, near {at}; close it there, separate the parts, "
            "or use backend='cpm'."
        )


def _check_boundary(filled: CellMesh, boundary: CellMesh) -> None:
    """Raise SceneError unless the cells are bounded by the whole of the ``boundary``."""
    rim = rim_facets(filled, np.zeros((0, filled.manifold_dim), dtype=np.int64))[0]
    found = CellMesh(filled.nodes, rim, filled.manifold_dim - 1).measures.sum()
    wanted = boundary.measures.sum()
    if abs(found - wanted) > BOUNDARY_SHARE * wanted:
        raise SceneError(
            f"the cells inside the solid are bounded by {found / wanted:.4g} times its boundary: parts of it cross or "
            "lie inside others; separate them, use a smaller spacing, or use backend='cpm'."
        )


def _check_resolved(filled: CellMesh, edge: CellMesh, boundary: ClosestPointSource, spacing: float) -> None:
    """Raise ResolutionError if cells of the ``edge`` are so far from the ``boundary`` that its inside is unknown."""
    k = filled.manifold_dim
    off = boundary.closest_point(edge.nodes[edge.cells].mean(axis=1)).distance
    if k * np.sum(off * edge.measures) > LARGEST_DOUBT * filled.measures.sum():  # (k-1)! and k! times the sizes
        at = place(edge.nodes[edge.cells[np.argmax(off)]].mean(axis=0))
        raise ResolutionError(
            f"spacing={spacing:g} is too coarse for the boundary of the solid near {at}, which is curved more sharply; "
            f"use spacing={0.5 * spacing:g} or less."
        )


def _check_apart(members: Sequence[ClosestPointSource], parts: Sequence[CellMesh]) -> None:
    """Raise SceneError if members of a union meet, by the nodes of their ``parts``."""
    for i, j in permutations(range(len(parts)), 2):
        x, edge = parts[j].nodes, parts[j].mean_edge
        for _ in range(ROUNDS):
            feet = members[i].closest_point(x)
            x = members[j].closest_point(feet.points[feet.distance <= edge]).points
        feet = members[i].closest_point(x)
        near = np.flatnonzero(feet.distance <= MEETING_SHARE * edge)
        if len(near):
            raise SceneError(
                f"members {i} and {j} of the union meet near {place(feet.points[near[0]])}, where backend='fem' would "
                "separate them; enclose both by one boundary, or use backend='cpm'."
            )
