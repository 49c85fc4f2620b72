"""The rim of an open surface or the ends of an open curve: where nodes past the edge read.

King et al. (2024), eq. 5 (nodes past the edge), eq. 7 (their mirror points), eq. 8 (Dirichlet values).

A node whose foot lies on the edge reads the manifold at a mirror point inside, by the same formula as
a ghost, with z = y the foot, ``t = (x - y) . b`` and ``s = 2 (x - y) . b``. Zero Neumann, the default,
needs no conormal b: at order 2 the mirror ``cp_S(2 y - x)``, at order 1 the foot itself.

Where a boundary lies between the rim and the mirror point, the node is on the rim's side of it all the same: it
continues the strip between the two, at first order, for no mirror point has room there. A ghost past the edge continues
what lies behind a boundary that runs alongside, by the boundary's condition and not by the edge's; where one ends on
the edge, both conditions hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cpmkit.forms.collocation.ghosts.ghost_geometry import (
    ALONGSIDE_COSINE,
    coefficient_and_factor,
    mirror_distance,
)
from cpmkit.forms.collocation.ghosts.rim_corners import RimCorners, rim_corners
from cpmkit.forms.collocation.row_formula import BoundaryData, RowFormula
from cpmkit.forms.collocation.side_view import BoundaryOnLattice, SideView
from cpmkit.grid.band import Band
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.tangent_space import outward_conormals
from cpmkit.manifold.walking import nearest_on_sheet
from cpmkit.scene.edge_conditions import EdgeConditions, conditions_of_edge, edge_condition
from cpmkit.scene.laws import Flux, Mixed, OneSided, beta_at, is_zero_neumann
from cpmkit.types import Bools, Floats, Ints

#: Nodes nearer to their foot than this share of the spacing do not define the direction of the conormal.
UNDIRECTED_EDGE_SPACINGS = 1e-6
#: Feet nearer to a boundary than this many spacings do not define the direction to it.
UNDIRECTED_FOOT_SPACINGS = 0.1
#: Name of an edge in errors.
EDGE_CONDITION = "the edge's condition"


def read_past_edge(
    surface: LocalSource,
    band: Band,
    lattice: Lattice,
    edge: EdgeConditions,
    order: int,
    rows: Ints | None = None,
    most: int = 2,
) -> RowFormula:
    """Return what each node of the band reads, one point each, the edge's conditions applied to those past it.

    They are applied to the nodes ``rows`` alone, if given, and at the order ``most`` at most.
    """
    points, coefficient = band.feet.points.copy(), np.ones(len(band.nodes))
    feet = None if band.sheets is None else band.feet
    data: list[BoundaryData] = []
    for past, law, own_order in _loops(band, edge, rows):
        formula = _mirror(surface, band, lattice, edge, law, min(own_order or order, most), past)
        points[past], coefficient[past] = formula.points, formula.coefficient
        feet = None if feet is None or formula.feet is None else feet.replace_rows(past, formula.feet)
        data += [datum.renumber(past) for datum in formula.data]
    return RowFormula(points, coefficient, data, feet=feet)


def read_at_feet(
    surface: LocalSource, band: Band, lattice: Lattice, edge: EdgeConditions, past: RowFormula, rows: Ints
) -> RowFormula:
    """Return ``past`` with the nodes ``rows`` past the edge of first order: they read their feet."""
    if not len(rows):
        return past
    at_feet = read_past_edge(surface, band, lattice, edge, 1, rows, most=1)
    points, coefficient = past.points.copy(), past.coefficient.copy()
    points[rows], coefficient[rows] = at_feet.points[rows], at_feet.coefficient[rows]
    numbers, chosen = np.arange(len(past)), np.isin(np.arange(len(past)), rows)
    data = [datum.renumber(np.where(chosen, -1, numbers)) for datum in past.data]
    data += [datum.renumber(np.where(chosen, numbers, -1)) for datum in at_feet.data]
    feet = past.feet
    if feet is not None and at_feet.feet is not None:
        feet = feet.replace_rows(rows, at_feet.feet.take(rows))
    return RowFormula(points, coefficient, data, feet=feet)


def _loops(band: Band, edge: EdgeConditions, rows: Ints | None) -> list[tuple[Ints, OneSided, int | None]]:
    """Return the nodes past each loop of the edge, of ``rows`` or all, its law, and its condition's own order."""
    rows = np.arange(len(band.nodes)) if rows is None else rows
    loop_of, loops = band.feet.edge[rows], []
    for loop in np.unique(loop_of[loop_of >= 0]):
        condition = edge_condition(edge, int(loop))
        loops.append((rows[loop_of == loop], condition.one_sided, condition.order))
    return loops


def _mirror(
    surface: LocalSource, band: Band, lattice: Lattice, edge: EdgeConditions, law: OneSided, order: int, rows: Ints
) -> RowFormula:
    """Return what nodes past one loop read at order 1 or 2."""
    foot, beyond = band.feet.points[rows], band.positions[rows] - band.feet.points[rows]
    feet, start = band.feet.take(rows), None if band.sheets is None else band.feet.take(rows)
    if is_zero_neumann(law) and not _has_flux(edge):
        on = feet if order == 1 else nearest_on_sheet(surface, start, foot - beyond, band.spacing)
        return RowFormula(on.points, np.ones(len(rows)), feet=on)
    conormals = outward_conormals(surface, feet, 0.5 * band.spacing)
    outward = _straight(surface, feet, conormals, beyond, band.spacing)
    t = np.maximum(np.sum(beyond * outward, axis=1), 0.0)
    mirror = foot - beyond - (mirror_distance(law, t, band.spacing) - t)[:, None] * outward
    on = feet if order == 1 else nearest_on_sheet(surface, start, mirror, band.spacing)
    where = lattice.to_scene(foot)
    corners = []
    if isinstance(law, Flux | Mixed):
        corners = _corners_of_fluxes(rim_corners(surface, feet, beyond, conormals, band.spacing), edge, law)
    for corner in corners:
        t[corner.rows] = corner.beyond.sum(axis=1)
    first_order, beta = np.full(len(rows), order == 1), beta_at(law, where, EDGE_CONDITION)
    coefficient, factor = coefficient_and_factor(law, beta, t, 2 * t, first_order, band.spacing)
    datum = BoundaryData(np.arange(len(rows)), factor, where, law.datum, EDGE_CONDITION, law)
    return RowFormula(on.points, coefficient, _data_beside_corners(datum, corners, edge, t, lattice), feet=on)


def _has_flux(edge: EdgeConditions) -> bool:
    """Return whether a flux other than zero is given anywhere on the edge."""
    laws = [condition.one_sided for condition in conditions_of_edge(edge)]
    return any(isinstance(law, Flux | Mixed) and not is_zero_neumann(law) for law in laws)


def _corners_of_fluxes(corners: Sequence[RimCorners], edge: EdgeConditions, law: OneSided) -> list[RimCorners]:
    """Return the corners all of whose sides have the law of the node's own loop, or all a flux alone."""
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


def _data_beside_corners(
    datum: BoundaryData, corners: Sequence[RimCorners], edge: EdgeConditions, t: Floats, lattice: Lattice
) -> list[BoundaryData]:
    """Return a flux with that of nodes at corners read on the sides of these, by how far they lie beyond each."""
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


def _straight(surface: LocalSource, edge: ClosestPoints, conormals: Floats, beyond: Floats, spacing: float) -> Floats:
    """Return conormals, of solids to rounding: a node outside a solid lies straight above its foot."""
    straight = surface.dimensions_at(edge) == surface.dim
    straight &= np.linalg.norm(beyond, axis=1) > UNDIRECTED_EDGE_SPACINGS * spacing
    outward = conormals.copy()
    outward[straight] = beyond[straight] / np.linalg.norm(beyond[straight], axis=1, keepdims=True)
    return outward


# Boundaries that run beside a rim, nearer to it than the nodes past it


def separated_from_mirrors(
    boundaries: Sequence[BoundaryOnLattice], band: Band, past: RowFormula, radius: float
) -> Ints:
    """Return the nodes (k,) past an edge whose mirror points lie beyond a boundary, as seen from their feet."""
    nodes = np.flatnonzero((band.feet.edge >= 0) & (past.points != band.feet.points).any(axis=1))
    separated = np.zeros(len(nodes), dtype=bool)
    for boundary in boundaries:
        if boundary.has_sides and len(nodes):
            at_feet = boundary.side_view(band.feet.points[nodes], radius, band.spacing)
            at_mirror = boundary.side_view(past.points[nodes[at_feet.rows]], radius, band.spacing)
            at_feet = at_feet.take(at_mirror.rows)
            opposite = (np.sum(at_mirror.director * at_feet.director, axis=1) < 0) & ~at_mirror.end & ~at_feet.end
            separated[at_feet.rows[opposite]] = True
    return nodes[separated]


def straight_ahead(
    boundary: BoundaryOnLattice, band: Band, side_view: SideView, behind: Ints
) -> tuple[SideView, Floats, Bools]:
    """Return how a boundary sees nodes past an edge that it separates from the manifold, at the places of the nodes.

    These are the nodes ``behind`` and others to whose feet the boundary runs parallel inside. They are taken to lie in
    the tangent plane of the edge.

    Returns
    -------
    side_view : SideView
        With their feet on the boundary and distances; the entries of all other nodes stay as they are.
    places : (g, d) float64
        Where they are; zero for all others.
    separated : (g,) bool
        Which nodes they are.
    """
    places, separated = np.zeros((len(side_view.rows), band.dim)), np.zeros(len(side_view.rows), dtype=bool)
    past = np.flatnonzero(band.feet.edge[side_view.rows] >= 0)
    nodes = side_view.rows[past]
    feet = band.feet.take(nodes)
    outward = outward_conormals(boundary.surface, feet, 0.5 * band.spacing)
    separated[past] = np.isin(nodes, behind) | _parallel(side_view.take(past), feet.points, outward, band.spacing)
    beyond = np.maximum(np.sum((band.positions[nodes] - feet.points) * outward, axis=1, keepdims=True), 0.0)
    places[past] = feet.points + beyond * outward
    on = boundary.surface.closest_point(boundary.source.closest_point(places[separated]).points).points
    foot, distance = side_view.foot.copy(), side_view.distance.copy()
    foot[separated], distance[separated] = on, np.linalg.norm(places[separated] - on, axis=1)
    return replace(side_view, foot=foot, distance=distance), places, separated


def _parallel(side_view: SideView, feet: Floats, outward: Floats, spacing: float) -> Bools:
    """Return at which feet on an edge the boundary runs alongside it, on the inner side."""
    offset = feet - side_view.foot
    inwards, length = np.sum(offset * outward, axis=1), np.linalg.norm(offset, axis=1)
    across = np.abs(np.sum(side_view.conormal * outward, axis=1)) > ALONGSIDE_COSINE
    return np.asarray(across & ((length < UNDIRECTED_FOOT_SPACINGS * spacing) | (inwards > ALONGSIDE_COSINE * length)))
