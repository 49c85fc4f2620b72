"""Ghosts: second unknowns at the nodes near a boundary, which continue the solution of the boundary's other side.

King et al. (2024), eq. 9: its BC DOFs, here within the radius of interpolation alone, eq. 4 with q = 0.

A ghost belongs to a node on one side of the boundary, and continues the solution of the other side across the boundary:
its value is a coefficient times u at a point, plus a factor times data (:func:`coefficient_and_factor`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cpmkit.forms.collocation.ghosts.ghost_geometry import (
    SIDE_READING_SPACINGS,
    GhostGeometry,
    coefficient_and_factor,
    ghost_sources,
)
from cpmkit.forms.collocation.ghosts.nodes_past_edge import view_nodes_past_edge
from cpmkit.forms.collocation.ghosts.transmission_ghosts import CoupledGhosts, first_order_ghosts, second_order_ghosts
from cpmkit.forms.collocation.row_formula import BoundaryData, ExtraPoint, RowFormula
from cpmkit.forms.collocation.side_view import (
    ON_BOUNDARY_SPACINGS,
    BoundariesOnBand,
    BoundaryOnLattice,
    SideView,
    find_near_points,
)
from cpmkit.grid.band import Band, reading_radius
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.vector_algebra import norms
from cpmkit.scene.laws import Interface, checked_beta
from cpmkit.types import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class Ghosts:
    """The g ghosts of one boundary: first those that are unknowns, then those at which only E u is needed."""

    geometry: GhostGeometry  #: The nodes of the ghosts, and the directions across the boundary.
    unknowns: int  #: Number of ghosts that are unknowns.
    numbers: Ints  #: (band nodes,): for each node of the band its ghost, -1 for none.
    formula: RowFormula  #: The formulas of the ghosts' values.
    sources: RowFormula  #: The formulas by which ghosts read right-hand sides, on the side that they continue.
    side_views: Sequence[SideView]  #: For each boundary, the distances and sides of the points that ghosts read.
    orders: Ints  #: (g,): order of accuracy of each ghost.
    #: (g,): for a ghost that reads one point, its distance from the boundary over that of the points where right-hand
    #: sides are read; NaN for others.
    behind: Floats

    @property
    def nodes(self) -> Ints:
        """(g,) the numbers of the ghosts' nodes in the band."""
        return self.geometry.seen.rows

    @property
    def continues_left(self) -> Bools:
        """(g,) whether the ghost continues the solution of the left side."""
        return self.geometry.seen.signed < 0

    @cached_property
    def unknown_numbers(self) -> Ints:
        """(band nodes,) for each node of the band its ghost, -1 if there is none that is an unknown."""
        return np.where(self.numbers < self.unknowns, self.numbers, -1)


def build_ghosts(
    index: int, boundaries: BoundariesOnBand, band: Band, lattice: Lattice, mirrored: RowFormula, order: int
) -> Ghosts:
    """Return the ghosts of boundary ``index`` for conditions of this ``order``.

    A node has a ghost if it is within the reach of a stencil from the boundary, or a spacing farther (then it is no
    unknown), and the boundary's point nearest to its closest point is no open end. ``mirrored`` is the formula of the
    band's nodes, which read one point each. Raises InputError or ResolutionError as :func:`checked_beta`,
    :func:`coefficient_and_factor` and :func:`conductivities` do.
    """
    geometry, unknowns = _ghost_geometry(index, boundaries, band, lattice, mirrored)
    rows, own_terms, coupled, orders, at_one_point = ghost_formula(geometry, order)
    radius = 2 * reading_radius(band.dim, band.degree) * band.spacing
    terms = [geometry.with_side_views(term, radius) for term in rows.terms]
    terms += [geometry.with_side_views(term, radius, own_side=True) for term in own_terms]
    distance = norms(rows.points - geometry.seen.foot)
    numbers = np.full(len(band.nodes), -1)
    numbers[geometry.seen.rows] = np.arange(len(geometry))
    return Ghosts(
        geometry,
        unknowns,
        numbers,
        _with_edge_formula(replace(rows, terms=terms), mirrored, geometry),
        _with_extrapolated_sources(ghost_sources(geometry), coupled),
        geometry.side_views(np.arange(len(geometry)), rows.points, radius),
        orders,
        np.where(at_one_point, distance / (SIDE_READING_SPACINGS * band.spacing), np.nan),
    )


def _ghost_geometry(
    index: int, boundaries: BoundariesOnBand, band: Band, lattice: Lattice, mirrored: RowFormula
) -> tuple[GhostGeometry, int]:
    """Return the geometry of the ghosts of boundary ``index``, and how many of these, the first ones, are unknowns."""
    boundary = boundaries.on_lattice[index]
    seen, unknowns = _ghost_nodes(boundary, boundaries.side_views[index], band)
    foot_point, past_edge = mirrored.points[seen.rows], np.zeros(len(seen.rows), dtype=bool)
    coupled = boundaries.definitions[index].condition("left").couples  # such ghosts read their own side, too
    if boundary.has_sides and not coupled and (band.feet.edge[seen.rows] >= 0).any():
        seen, places, past_edge = view_nodes_past_edge(boundary, band, seen, boundaries.behind)
        foot_point = np.where(past_edge[:, None], places, foot_point)
    direction = _directions_across(seen, foot_point, band.spacing)
    feet = None if mirrored.feet is None else mirrored.feet.take(seen.rows)
    return GhostGeometry(index, boundaries, lattice, seen, foot_point, direction, past_edge, feet), unknowns


def _ghost_nodes(boundary: BoundaryOnLattice, side_view: SideView, band: Band) -> tuple[SideView, int]:
    """Return the side view of the nodes that have a ghost, unknowns first, and the number of unknowns."""
    reach = reading_radius(band.dim, band.degree) * band.spacing + boundary.gap
    positions = band.positions[side_view.rows]
    rows, feet = find_near_points(boundary.source, positions, reach + band.spacing, band.spacing)
    inside = ~side_view.end[rows]
    rows, distance = rows[inside], feet.distance[inside]
    unknown = (side_view.rows[rows] < band.inner) & (distance <= reach)
    return side_view.take(np.concatenate([rows[unknown], rows[~unknown]])), int(unknown.sum())


def _directions_across(side_view: SideView, foot_point: Floats, spacing: float) -> Floats:
    """Return unit vectors (g, d) from ``foot_point`` (g, d) towards the boundary; where it is on it, across it."""
    touching = side_view.distance < ON_BOUNDARY_SPACINGS * spacing
    length = np.where(touching, 1.0, side_view.distance)[:, None]
    across = -np.sign(np.nan_to_num(side_view.signed))[:, None] * side_view.conormal
    return np.where(touching[:, None], across, (side_view.foot - foot_point) / length)


def _with_edge_formula(ghosts: RowFormula, mirrored: RowFormula, geometry: GhostGeometry) -> RowFormula:
    """Return the formulas of the ``ghosts``, combined at nodes past an edge with their formulas as nodes, ``mirrored``.

    Ghosts that their boundary separates from the edge keep their own formula.
    """
    nodes, separated = geometry.seen.rows, geometry.past_edge
    coefficient = np.where(separated, 1.0, mirrored.coefficient[nodes])
    row_of_node = np.full(len(mirrored), -1)
    row_of_node[nodes] = np.where(separated, -1, np.arange(len(nodes)))
    data = [datum.scale(coefficient) for datum in ghosts.data]
    data += [datum.renumber(row_of_node) for datum in mirrored.data]
    terms = [replace(term, coefficient=term.coefficient * coefficient[term.rows]) for term in ghosts.terms]
    return RowFormula(ghosts.points, ghosts.coefficient * coefficient, data, terms, ghosts.feet)


def _with_extrapolated_sources(sources: RowFormula, parts: Sequence[CoupledGhosts]) -> RowFormula:
    """Return the formulas ``sources`` by which ghosts read right-hand sides, extrapolated for the ghosts of ``parts``.

    For these, values at the boundary and at two points beyond it are extrapolated to the node of the ghost.
    """
    factor, added = np.ones(len(sources)), list[ExtraPoint]()
    for part in parts:
        factor[part.rows] = part.source_factor
        added += part.source_terms
    terms = [replace(term, coefficient=term.coefficient * factor[term.rows]) for term in sources.terms]
    return RowFormula(sources.points, sources.coefficient * factor, (), terms + added)


def ghost_formula(
    geometry: GhostGeometry, order: int
) -> tuple[RowFormula, list[ExtraPoint], list[CoupledGhosts], Ints, Bools]:
    """Return the formulas of a boundary's g ghosts at this ``order``, or at that of their condition.

    Conditions of the edge are not included. A ghost whose mirror point is beyond another boundary is of order 1.

    Returned ``rows``: the formulas, a row for each ghost, with points on the side that the ghosts continue.
    Returned ``own_terms``: points that are read on the ghosts' own side.
    Returned ``coupled``: ghosts of a transmission that read several points.
    Returned ``orders`` (g,): order of each ghost, lower than the condition's where there is no room for it.
    Returned ``at_one_point`` (g,): whether the ghost reads a single point, besides its own node.
    """
    count, points, feet = len(geometry), geometry.seen.foot.copy(), geometry.start
    coefficient, orders, at_one_point = np.zeros(count), np.empty(count, dtype=np.int64), np.ones(count, dtype=bool)
    coupled: list[CoupledGhosts] = []
    data: list[BoundaryData] = []
    own_terms: list[ExtraPoint] = []
    for condition, side in geometry.sides():
        law, rows = condition.law, side
        orders[side] = condition.order or order
        if isinstance(law, Interface):
            part = second_order_ghosts(geometry, law, side) if (condition.order or order) == 2 else None
            if part is not None:
                coupled.append(part)
                at_one_point[part.rows] = False
            rows = side[at_one_point[side]]
            orders[rows] = 1
            mirrored = rows  # they read the mirror point at either order
        else:
            if (condition.order or order) == 2:
                orders[side[geometry.is_hidden[side]]] = 1
            mirrored = side[orders[side] == 2]
        if len(mirrored):
            points[mirrored] = geometry.mirror.points[mirrored]
            feet = None if feet is None else feet.replace_rows(mirrored, geometry.mirror.take(mirrored))
        if not isinstance(law, Interface):
            where, t = geometry.boundary_points(rows), geometry.seen.distance[rows]
            s = norms(geometry.foot_point[rows] - points[rows])
            beta, first_order = checked_beta(law, condition.kind, where, geometry.name), orders[rows] == 1
            coefficient[rows], factor = coefficient_and_factor(law, beta, t, s, first_order, geometry.spacing)
            data.append(BoundaryData(rows, factor, where, law.datum, geometry.name, law))
        elif len(rows):
            coefficient[rows], added, own = first_order_ghosts(geometry, law, rows)
            own_terms.append(own)
            data += added
    for part in coupled:
        data += part.data
        own_terms += part.own_terms
    terms = [term for part in coupled for term in part.terms_beyond]
    return RowFormula(points, coefficient, data, terms, feet), own_terms, coupled, orders, at_one_point
