"""The formulas of nodes past the edge: past the rim of an open surface or the ends of an open curve.

King et al. (2024), eq. 5 (nodes past the edge), eq. 7 (their mirror points), eq. 8 (Dirichlet values).

A node whose closest point y is on the edge reads the manifold at a mirror point inside, by the same formula as
a ghost, with z = y, ``t = (x - y) . b`` and ``s = 2 (x - y) . b``. Zero Neumann, the default,
needs no conormal b: at order 2 the mirror is ``cp_S(2 y - x)``, at order 1 it is y itself.

If a boundary separates the rim from the mirror point, the node belongs to the rim's side of that boundary: it continues
the strip between rim and boundary, at first order, because there is no room for a mirror point. A ghost past the edge
continues the part behind a boundary parallel to the rim by the boundary's condition and not by the edge's; where a
boundary ends on the edge, both conditions apply.

At a corner of a rim b jumps, and a flux that is given at y alone is that of one side. With b_j the conormals beside the
corner and ``x - y = sum t_j b_j`` in the tangent space, ``2 (x - y) . b du/db`` becomes ``2 sum t_j du/db_j``, each
flux read on its own side. Differs from King et al. (2024), who have no flux at a rim with corners.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cpmkit.forms.collocation.ghosts.ghost_geometry import coefficient_and_factor, mirror_distance
from cpmkit.forms.collocation.row_formula import BoundaryData, RowFormula
from cpmkit.forms.collocation.side_view import ALONGSIDE_COSINE, ON_BOUNDARY_SPACINGS, BoundaryOnLattice, SideView
from cpmkit.grid.band import Band
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.source import ClosestPoints, Rows
from cpmkit.manifold.tangent_space import nearest_points_on_sheet, outward_conormals, unit_normals
from cpmkit.manifold.vector_algebra import dots, norms
from cpmkit.scene.edge_conditions import EdgeConditions, conditions_of_edge, edge_condition
from cpmkit.scene.laws import Flux, Mixed, OneSided, beta_at, checked_beta
from cpmkit.types import Bools, Floats, Ints

#: Points on the sides of a corner are found from points this many spacings from it, in either direction along the rim.
BESIDE_SPACINGS = 0.6
#: These points are moved past the rim by this share of the distance, since the closest point of a point on the rim may
#: count as inside. Fluxes are read nearer to the corner by this factor, on its sides, with almost the corner's values.
NEAR_CORNER_SHARE = 0.05
#: Two points of a rim farther apart than this share of the largest possible distance have no corner between them.
STRAIGHT_SHARE = 0.97
#: Conormals are differences over this many spacings; a corner nearer than that makes them wrong.
CONORMAL_SPACINGS = 0.05
#: Singular values of conormals below this share of the largest come from bends and rounding, and count as zero.
LEAST_SINGULAR_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class RimCorners(Rows):
    """Nodes whose closest points are corners of a rim."""

    rows: Ints  #: (k,): numbers of the nodes.
    points: Floats  #: (k, s, d): for each of the s sides of the corner, a point of the rim on it.
    loops: Ints  #: (k, s): the loops of the edge that these points are on.
    #: (k, s): how far the node is beyond each side: the sum of these times the conormals is its offset from the corner.
    beyond: Floats


def rim_corners(
    surface: LocalSource, feet: ClosestPoints, beyond: Floats, outward: Floats, spacing: float
) -> list[RimCorners]:
    """Return the nodes whose ``feet`` are corners of rims, for each dimension of the rims' parts; curves have none.

    ``surface``: the manifold.
    ``feet``: closest points of n nodes, on rims.
    ``beyond``, ``outward`` (n, d): the offsets of the nodes from the feet, and the outward conormals at the feet.
    ``spacing``: spacing of the lattice.
    """
    dimension = surface.dimensions_at(feet)
    corners = []
    for m in range(2, surface.dim + 1):
        rows = np.flatnonzero(dimension == m)
        if len(rows):
            corners.append(
                _corners_of_one_dimension(surface, feet.take(rows), beyond[rows], outward[rows], spacing, rows)
            )
    return [part for part in corners if len(part.rows)]


def _corners_of_one_dimension(
    surface: LocalSource, feet: ClosestPoints, beyond: Floats, outward: Floats, spacing: float, rows: Ints
) -> RimCorners:
    """Return the corners among the k ``feet`` of the nodes ``rows`` (k,), as :func:`rim_corners`, of one dimension."""
    reach = BESIDE_SPACINGS * spacing
    directions = _rim_tangents(surface, feet, outward, spacing)
    places = feet.points[:, None] + reach * (directions + NEAR_CORNER_SHARE * outward[:, None])
    sides = surface.closest_point(places.reshape(-1, surface.dim))
    points, loops = sides.points.reshape(places.shape), sides.edge.reshape(len(rows), -1)
    count = places.shape[1]
    half = count // 2
    is_corner = norms(points[:, :half] - points[:, half:]) < 2 * STRAIGHT_SHARE * reach
    chosen = np.flatnonzero(is_corner.any(axis=1) & (loops >= 0).all(axis=1))
    entries = (chosen[:, None] * count + np.arange(count)).ravel()
    conormals = outward_conormals(surface, sides.take(entries), CONORMAL_SPACINGS * spacing)
    conormals = conormals.reshape(len(chosen), *places.shape[1:]) * np.tile(is_corner[chosen], (1, 2))[:, :, None]
    inverse = np.linalg.pinv(conormals.transpose(0, 2, 1), rcond=LEAST_SINGULAR_SHARE)
    shares = np.maximum(np.einsum("nsd,nd->ns", inverse, beyond[chosen]), 0.0)
    offsets = points[chosen] - feet.points[chosen, None] + NEAR_CORNER_SHARE * reach * conormals
    readings = surface.closest_point((feet.points[chosen, None] + NEAR_CORNER_SHARE * offsets).reshape(-1, surface.dim))
    return RimCorners(rows[chosen], readings.points.reshape(offsets.shape), loops[chosen], shares)


def _rim_tangents(surface: LocalSource, feet: ClosestPoints, outward: Floats, spacing: float) -> Floats:
    """Return unit tangents (n, s, d) of rims at ``feet``, perpendicular to ``outward`` (n, d): s / 2, then opposites.

    On a solid there are three directions, 120 degrees apart, because a single one might run along an edge.
    """
    others = outward[:, None]
    if (surface.dimensions_at(feet) < surface.dim).all():
        others = np.stack([outward, unit_normals(surface, feet, 0.5 * spacing)], axis=1)
    basis = np.linalg.svd(others)[2][:, others.shape[1] :]
    angles = np.arange(3) * 2 * np.pi / 3
    turns = np.eye(1) if basis.shape[1] == 1 else np.stack([np.cos(angles), np.sin(angles)], axis=1)
    directions = np.einsum("sk,nkd->nsd", turns, basis)
    return np.asarray(np.concatenate([directions, -directions], axis=1))


EDGE_CONDITION = "the edge's condition"  #: Name of an edge in errors.


def node_formulas(
    surface: LocalSource,
    band: Band,
    lattice: Lattice,
    edge: EdgeConditions,
    order: int,
    at_feet: Ints | Sequence[int] = (),
) -> RowFormula:
    """Return the formulas of all nodes of the band: each reads its closest point, or past an edge a mirror point.

    ``order`` is that of conditions without an order of their own. At order 1 nodes past the edge read their closest
    points; so do the nodes ``at_feet`` at any order. ``edge`` are the edge's conditions. Raises InputError if beta of a
    Robin condition is zero, or ResolutionError if the spacing is too coarse for beta.
    """
    points, coefficient = band.feet.points.copy(), np.ones(len(band.nodes))
    feet = None if band.sheets is None else band.feet
    data: list[BoundaryData] = []
    loops = np.unique(band.feet.edge[band.feet.edge >= 0]).tolist()
    conditions = [edge_condition(edge, loop) for loop in loops]
    for condition in {id(one): one for one in conditions}.values():
        shared = [loop for loop, other in zip(loops, conditions, strict=True) if other is condition]
        points_of_loops = lattice.to_scene(band.feet.points[np.isin(band.feet.edge, shared)])
        checked_beta(condition.one_sided, condition.kind, points_of_loops, EDGE_CONDITION)
    for loop, condition in zip(loops, conditions, strict=True):
        past = np.flatnonzero(band.feet.edge == loop)
        first_order = np.isin(past, at_feet) if (condition.order or order) == 2 else np.ones(len(past), dtype=bool)
        formula = _edge_formula(surface, band, lattice, edge, condition.one_sided, first_order, past)
        points[past], coefficient[past] = formula.points, formula.coefficient
        feet = None if feet is None or formula.feet is None else feet.replace_rows(past, formula.feet)
        data += [datum.renumber(past) for datum in formula.data]
    return RowFormula(points, coefficient, data, feet=feet)


def _edge_formula(
    surface: LocalSource,
    band: Band,
    lattice: Lattice,
    edge: EdgeConditions,
    law: OneSided,
    first_order: Bools,
    rows: Ints,
) -> RowFormula:
    """Return the formulas of the nodes ``rows`` (k,) past a loop of the edge with the condition's ``law``.

    ``edge`` are the conditions of all loops; ``first_order`` (k,) marks nodes that read their closest points.
    """
    foot, beyond = band.feet.points[rows], band.positions[rows] - band.feet.points[rows]
    feet, mirrored = band.feet.take(rows), np.flatnonzero(~first_order)

    def mirror(goal: Floats) -> ClosestPoints:
        """Return the k points that nodes read: those nearest to ``goal`` (k, d), at order 1 their closest points."""
        if not len(mirrored):
            return feet
        start = None if band.sheets is None else feet.take(mirrored)
        return feet.replace_rows(mirrored, nearest_points_on_sheet(surface, start, goal[mirrored], band.spacing))

    laws = [condition.one_sided for condition in conditions_of_edge(edge)]
    has_flux = any(isinstance(other, Flux | Mixed) and not other.is_zero_flux for other in laws)
    if law.is_zero_flux and not has_flux:
        on = mirror(foot - beyond)
        return RowFormula(on.points, np.ones(len(rows)), feet=on)
    conormals = outward_conormals(surface, feet, 0.5 * band.spacing)
    length = np.linalg.norm(beyond, axis=1, keepdims=True)  # on solids offsets have the direction of the conormals
    straight = (surface.dimensions_at(feet) == surface.dim)[:, None] & (length > ON_BOUNDARY_SPACINGS * band.spacing)
    outward = np.where(straight, beyond / np.where(straight, length, 1.0), conormals)
    t = np.maximum(dots(beyond, outward), 0.0)
    on = mirror(foot - beyond - (mirror_distance(law, t, band.spacing) - t)[:, None] * outward)
    where = lattice.to_scene(foot)
    corners = []
    if isinstance(law, Flux | Mixed):
        corners = _flux_corners(rim_corners(surface, feet, beyond, conormals, band.spacing), edge, law)
    for corner in corners:
        t[corner.rows] = corner.beyond.sum(axis=1)
    beta = beta_at(law, where, EDGE_CONDITION)
    coefficient, factor = coefficient_and_factor(law, beta, t, 2 * t, first_order, band.spacing)
    datum = BoundaryData(np.arange(len(rows)), factor, where, law.datum, EDGE_CONDITION, law)
    return RowFormula(on.points, coefficient, _corner_data(datum, corners, edge, t, lattice), feet=on)


def _flux_corners(corners: Sequence[RimCorners], edge: EdgeConditions, law: OneSided) -> list[RimCorners]:
    """Return the corners at which all sides that the node is beyond have the ``law`` of its loop, or all a flux."""
    chosen = []
    for corner in corners:
        accepted = np.ones(len(corner.rows), dtype=bool)
        for loop in np.unique(corner.loops):
            other = edge_condition(edge, int(loop)).one_sided
            if other is not law and not (isinstance(law, Flux) and isinstance(other, Flux)):
                accepted &= ((corner.loops != loop) | (corner.beyond == 0)).all(axis=1)
        if accepted.any():
            chosen.append(corner.take(accepted))
    return chosen


def _corner_data(
    datum: BoundaryData, corners: Sequence[RimCorners], edge: EdgeConditions, t: Floats, lattice: Lattice
) -> list[BoundaryData]:
    """Return the boundary data for a flux ``datum``; nodes at corners read it on each side, by their distance past it.

    ``t`` (n,) is the distance of each node past the edge.
    """
    away_from_corners, data = np.arange(len(t)), []
    for corner in corners:
        away_from_corners[corner.rows] = -1
        shares = (datum.factor / np.where(t > 0, t, 1.0))[corner.rows, None] * corner.beyond
        for loop in np.unique(corner.loops):
            k, side = np.nonzero((corner.loops == loop) & (shares > 0))
            law = edge_condition(edge, int(loop)).one_sided
            rows, where = corner.rows[k], lattice.to_scene(corner.points[k, side])
            data.append(BoundaryData(rows, shares[k, side], where, law.datum, datum.label, law, at_corners=True))
    return [datum.renumber(away_from_corners), *data]


def nodes_behind_boundaries(
    boundaries: Sequence[BoundaryOnLattice], band: Band, past: RowFormula, radius: float
) -> Ints:
    """Return the nodes (k,) past an edge that a boundary separates from their mirror points, the points of ``past``.

    ``past`` is the formula of all band nodes; boundaries farther than ``radius`` (a length) from a point do not count.
    """
    nodes = np.flatnonzero((band.feet.edge >= 0) & (past.points != band.feet.points).any(axis=1))
    separated = np.zeros(len(nodes), dtype=bool)
    for boundary in boundaries:
        if boundary.has_sides and len(nodes):
            at_feet = boundary.side_view(band.feet.points[nodes], radius, band.spacing)
            at_mirror = boundary.side_view(past.points[nodes[at_feet.rows]], radius, band.spacing)
            at_feet = at_feet.take(at_mirror.rows)
            opposite = (dots(at_mirror.director, at_feet.director) < 0) & ~at_mirror.end & ~at_feet.end
            separated[at_feet.rows[opposite]] = True
    return nodes[separated]


def view_nodes_past_edge(
    boundary: BoundaryOnLattice, band: Band, side_view: SideView, behind: Ints
) -> tuple[SideView, Floats, Bools]:
    """Return the side view of nodes past an edge that a boundary separates from the manifold, at the nodes' own places.

    Such nodes are the nodes ``behind``, and others near which the boundary is parallel to the edge inside the manifold.
    The places of nodes are in the tangent plane of the edge.

    Returned ``side_view``: ``side_view`` with the feet on the boundary and distances of these nodes replaced.
    Returned ``places`` (g, d): the nodes' places in the tangent plane of the edge; zero for nodes that are not past it.
    Returned ``separated`` (g,): whether the boundary separates the node from the manifold.
    """
    places, separated = np.zeros((len(side_view.rows), band.dim)), np.zeros(len(side_view.rows), dtype=bool)
    past = np.flatnonzero(band.feet.edge[side_view.rows] >= 0)
    nodes = side_view.rows[past]
    feet = band.feet.take(nodes)
    outward = outward_conormals(boundary.surface, feet, 0.5 * band.spacing)
    offset = feet.points - side_view.foot[past]
    inwards, length = dots(offset, outward), norms(offset)
    parallel = np.abs(dots(side_view.conormal[past], outward)) > ALONGSIDE_COSINE
    parallel &= inwards >= ALONGSIDE_COSINE * length
    separated[past] = np.isin(nodes, behind) | parallel
    beyond = np.maximum(np.sum((band.positions[nodes] - feet.points) * outward, axis=1, keepdims=True), 0.0)
    places[past] = feet.points + beyond * outward
    on = boundary.surface.closest_point(boundary.source.closest_point(places[separated]).points).points
    foot, distance = side_view.foot.copy(), side_view.distance.copy()
    foot[separated], distance[separated] = on, norms(places[separated] - on)
    return replace(side_view, foot=foot, distance=distance), places, separated
