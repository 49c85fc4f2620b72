"""Ghosts: a second unknown at the nodes near a boundary, that carries the solution of the other side.

King et al. (2024), eq. 9: its BC DOFs, here within the radius of interpolation alone, eq. 4 with q = 0.

A ghost stands where its node stands, on one side of the boundary, and continues the solution from
the other side across it, by the formula of the condition that holds there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cpmkit.forms.collocation.boundary.on_band import BoundariesOnBand
from cpmkit.forms.collocation.boundary.row_formula import RowFormula
from cpmkit.forms.collocation.boundary.side_view import BoundaryOnLattice, SideView, near
from cpmkit.forms.collocation.ghosts.continuation import continued_sources
from cpmkit.forms.collocation.ghosts.formulas import ghost_formula
from cpmkit.forms.collocation.ghosts.geometry import GhostGeometry
from cpmkit.forms.collocation.ghosts.past_rim import straight_ahead
from cpmkit.forms.collocation.ghosts.side_readings import SIDE_READING_SPACINGS, read_within
from cpmkit.grid.band import Band
from cpmkit.grid.lattice import Lattice
from cpmkit.grid.stencils import difference_reach, reading_radius
from cpmkit.protocols import Bools, Floats, Ints

#: Below this share of the spacing, the direction from a ghost to the boundary is taken from the conormal.
UNDIRECTED_GHOST_SPACINGS = 1e-3


@dataclass(frozen=True, eq=False)
class Ghosts:
    """The ghosts of one boundary, unknowns first; after them nodes at which only E u is needed.

    Attributes
    ----------
    geometry : GhostGeometry
        Where they stand, and which way leads across.
    unknowns : int
        How many of the ghosts are unknowns.
    numbers : (band nodes,) int64
        For each node of the band its ghost, -1 where it has none.
    formula : RowFormula
        What the ghosts read.
    sources : RowFormula
        Where right-hand sides are read: just inside the side that each ghost carries, and, at order 3 and 4, behind.
    side_views : sequence of SideView
        How the ghosts' stencils see each boundary.
    orders : (g,) int64
        Order of each ghost.
    behind : (g,) float64
        How far behind the boundary those read that read at one point, over where their right-hand sides are; NaN else.
    """

    geometry: GhostGeometry
    unknowns: int
    numbers: Ints
    formula: RowFormula
    sources: RowFormula
    side_views: Sequence[SideView]
    orders: Ints
    behind: Floats

    @property
    def nodes(self) -> Ints:
        """(g,) numbers of the nodes in the band."""
        return self.geometry.seen.rows

    @property
    def director(self) -> Floats:
        """(g, d) D of the nodes; the ghosts themselves see the boundary from -D."""
        return self.geometry.seen.director

    @property
    def carries_left(self) -> Bools:
        """(g,) whether the ghost carries the left side's solution."""
        return self.geometry.seen.signed < 0

    @cached_property
    def unknown_numbers(self) -> Ints:
        """(band nodes,) ``numbers`` of those ghosts that are unknowns, -1 elsewhere."""
        return np.where(self.numbers < self.unknowns, self.numbers, -1)


def build_ghosts(
    index: int, boundaries: BoundariesOnBand, band: Band, lattice: Lattice, mirrored: RowFormula, order: int
) -> Ghosts:
    """Return the ghosts of boundary ``index``.

    A node has a ghost if it is within the reach of a stencil from the boundary, and the boundary's
    point nearest to its foot is no open end. ``mirrored`` is what the band's nodes read, one point each.
    """
    geometry, unknowns = _geometry(index, boundaries, band, lattice, mirrored, difference_reach(order))
    made, seen, radius = ghost_formula(geometry, order), geometry.seen, 2 * reading_radius(band.dim, band.degree)
    radius *= band.spacing
    terms = [geometry.located(term, radius) for term in made.rows.terms]
    terms += [geometry.located(term, radius, own_side=True) for term in made.own_points]
    sources = read_within(geometry, order)
    behind = np.linalg.norm(made.rows.points - seen.foot, axis=1) / (SIDE_READING_SPACINGS * band.spacing)
    numbers = np.full(len(band.nodes), -1)
    numbers[seen.rows] = np.arange(len(geometry))
    return Ghosts(
        geometry,
        unknowns,
        numbers,
        _past_edge(replace(made.rows, terms=terms), mirrored, seen.rows, geometry.apart),
        continued_sources(sources, made.parts) if made.parts else sources,
        geometry.side_views(np.arange(len(geometry)), made.rows.points, radius),
        made.orders,
        np.where(made.alone, behind, np.nan),
    )


def _geometry(
    index: int, boundaries: BoundariesOnBand, band: Band, lattice: Lattice, mirrored: RowFormula, differences: int
) -> tuple[GhostGeometry, int]:
    """Return where the ghosts of a boundary stand, and how many of them are unknowns."""
    own = boundaries.on_lattice[index]
    seen, unknowns = _ghost_nodes(own, boundaries.side_views[index], band, differences)
    foot_point, apart = mirrored.points[seen.rows], np.zeros(len(seen.rows), dtype=bool)
    coupled = boundaries.given[index].condition("left").couples  # those read where they stand, too
    if own.has_sides and not coupled and (band.feet.edge[seen.rows] >= 0).any():
        seen, places, apart = straight_ahead(own, band, seen, boundaries.behind)
        foot_point = np.where(apart[:, None], places, foot_point)
    direction = _direction(seen, foot_point, band.spacing)
    feet = None if mirrored.feet is None else mirrored.feet.take(seen.rows)
    return GhostGeometry(index, boundaries, lattice, seen, foot_point, direction, apart, feet), unknowns


def _past_edge(reading: RowFormula, mirrored: RowFormula, nodes: Ints, apart: Bools) -> RowFormula:
    """Return the ghosts' reading where their nodes stand past an edge: the edge's formula of the ghost's.

    Not of those that continue what lies behind their boundary, ``apart`` from the edge.
    """
    coefficient = np.where(apart, 1.0, mirrored.coefficient[nodes])
    place = np.full(len(mirrored), -1)
    place[nodes] = np.where(apart, -1, np.arange(len(nodes)))
    data = [datum.scaled(coefficient) for datum in reading.data]
    data += [datum.renumbered(place) for datum in mirrored.data]
    terms = [replace(term, coefficient=term.coefficient * coefficient[term.rows]) for term in reading.terms]
    return RowFormula(reading.points, reading.coefficient * coefficient, data, terms, reading.feet)


def _ghost_nodes(
    on_lattice: BoundaryOnLattice, side_view: SideView, band: Band, differences: int
) -> tuple[SideView, int]:
    """Return the view of the nodes that have a ghost, unknowns first, and the number of unknowns."""
    reach = reading_radius(band.dim, band.degree) * band.spacing
    reach += on_lattice.gap
    positions = band.positions[side_view.rows]
    close, feet = near(on_lattice.source, positions, reach + differences * band.spacing, band.spacing)
    kept = ~side_view.end[close]
    close, distance = close[kept], feet.distance[kept]
    unknown = (side_view.rows[close] < band.inner) & (distance <= reach)
    order = np.concatenate([close[unknown], close[~unknown]])
    return side_view.take(order), int(unknown.sum())


def _direction(side_view: SideView, foot_point: Floats, spacing: float) -> Floats:
    """Return unit vectors (g, d) from the nodes' feet towards the boundary and on into the side that is carried."""
    towards = side_view.foot - foot_point
    touching = side_view.distance < UNDIRECTED_GHOST_SPACINGS * spacing
    length = np.where(touching, 1.0, side_view.distance)[:, None]
    across = -np.sign(np.nan_to_num(side_view.signed))[:, None] * side_view.conormal
    return np.where(touching[:, None], across, towards / length)
