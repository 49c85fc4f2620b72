"""Ghosts: a second unknown at the nodes near a boundary, that carries the solution of the other side.

A ghost stands where its node stands, on one side of the boundary, and continues the solution from
the other side across it, by the formula of the condition that holds there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cpmkit.forms.collocation.boundary.frame import Frame, Sighted, near
from cpmkit.forms.collocation.boundary.past_rim import straight_ahead
from cpmkit.forms.collocation.boundary.reading import Reading
from cpmkit.forms.collocation.ghosts.geometry import Crossing
from cpmkit.forms.collocation.ghosts.mirrored import ghost_reading
from cpmkit.grid.band import Band
from cpmkit.grid.lattice import Lattice
from cpmkit.grid.stencils import difference_reach, reading_radius
from cpmkit.protocols import Bools, BoundarySet, Floats, Ints
from cpmkit.scene.data import Data

#: Below this share of the spacing, the direction from a ghost to the boundary is taken from the conormal.
TOUCHING = 1e-3


@dataclass(frozen=True, eq=False)
class Ghosts:
    """The ghosts of one boundary, unknowns first; after them nodes at which only E u is needed.

    Attributes
    ----------
    nodes : (g,) int64
        Numbers of the nodes in the band.
    unknowns : int
        How many of the ghosts are unknowns.
    numbers : (band nodes,) int64
        For each node of the band its ghost, -1 where it has none.
    director : (g, d) float64
        D of the nodes; the ghosts themselves see the boundary from -D.
    reading : Reading
        What the ghosts read.
    sources : Reading
        Where right-hand sides are read: just inside the side that each ghost carries, and, at order 3 and 4, behind.
    frames : sequence of Frame
        How the ghosts' stencils see each boundary.
    carries_left : (g,) bool
        True where the ghost carries the left side's solution.
    orders : (g,) int64
        Order of each ghost.
    behind : (g,) float64
        How far behind the boundary those read that read at one point, over where their right-hand sides are; NaN else.
    """

    nodes: Ints
    unknowns: int
    numbers: Ints
    director: Floats
    reading: Reading
    sources: Reading
    frames: Sequence[Frame]
    carries_left: Bools
    orders: Ints
    behind: Floats

    @cached_property
    def unknown_numbers(self) -> Ints:
        """(band nodes,) ``numbers`` of those ghosts that are unknowns, -1 elsewhere."""
        return np.where(self.numbers < self.unknowns, self.numbers, -1)


@dataclass(frozen=True, eq=False)
class Sight:
    """All boundaries of a scene, and how the band's nodes see them.

    Attributes
    ----------
    boundaries : sequence of BoundarySet
        As the scene gives them.
    sighted : sequence of Sighted
        Their sources with signs.
    frames : sequence of Frame
        How the band's nodes see each boundary.
    behind : (k,) int64
        The nodes past an edge that read their feet, because their mirror points lie beyond a boundary.
    diffusivity : Data
        Of the problem.
    """

    boundaries: Sequence[BoundarySet]
    sighted: Sequence[Sighted]
    frames: Sequence[Frame]
    behind: Ints
    diffusivity: Data = 1.0


def build_ghosts(index: int, sight: Sight, band: Band, lattice: Lattice, mirrored: Reading, order: int) -> Ghosts:
    """Return the ghosts of boundary ``index``.

    A node has a ghost if it is within the reach of a stencil from the boundary, and the boundary's
    point nearest to its foot is no open end. ``mirrored`` is what the band's nodes read, one point each.
    """
    seen, unknowns = _ghost_nodes(sight.sighted[index], sight.frames[index], band, difference_reach(order))
    own = sight.sighted[index]
    coupled = sight.boundaries[index].condition("left").couples
    seen, places, apart = straight_ahead(own, band, seen, sight.behind, coupled)
    foot_point = np.where(apart[:, None], places, mirrored.points[seen.rows])
    direction = _direction(seen, foot_point, band.spacing)
    own_feet = None if mirrored.feet is None else mirrored.feet.take(seen.rows)
    crossing = Crossing(
        index, sight.boundaries, sight.sighted, seen, foot_point, direction, apart, sight.diffusivity, own_feet
    )
    made = ghost_reading(crossing, lattice, order, 2 * reading_radius(band.dim, band.degree) * band.spacing)
    numbers = np.full(len(band.nodes), -1)
    numbers[seen.rows] = np.arange(len(seen.rows))
    return Ghosts(
        seen.rows,
        unknowns,
        numbers,
        seen.director,
        _past_edge(made.reading, mirrored, seen.rows, apart),
        made.sources,
        made.frames,
        seen.signed < 0,
        made.orders,
        made.behind,
    )


def _past_edge(reading: Reading, mirrored: Reading, nodes: Ints, apart: Bools) -> Reading:
    """Return the ghosts' reading where their nodes stand past an edge: the edge's formula of the ghost's.

    Not of those that continue what lies behind their boundary, ``apart`` from the edge.
    """
    coefficient = np.where(apart, 1.0, mirrored.coefficient[nodes])
    place = np.full(len(mirrored), -1)
    place[nodes] = np.where(apart, -1, np.arange(len(nodes)))
    data = [datum.scaled(coefficient) for datum in reading.data]
    data += [datum.renumbered(place) for datum in mirrored.data]
    terms = [replace(term, coefficient=term.coefficient * coefficient[term.rows]) for term in reading.terms]
    return Reading(reading.points, reading.coefficient * coefficient, data, terms, reading.feet)


def _ghost_nodes(sighted: Sighted, seen: Frame, band: Band, differences: int) -> tuple[Frame, int]:
    """Return the frame of the nodes that have a ghost, unknowns first, and the number of unknowns."""
    reach = reading_radius(band.dim, band.degree) * band.spacing
    reach += sighted.gap
    positions = band.positions[seen.rows]
    close, feet = near(sighted.source, positions, reach + differences * band.spacing, band.spacing)
    kept = ~seen.end[close]
    close, distance = close[kept], feet.distance[kept]
    unknown = (seen.rows[close] < band.inner) & (distance <= reach)
    order = np.concatenate([close[unknown], close[~unknown]])
    return seen.take(order), int(unknown.sum())


def _direction(seen: Frame, foot_point: Floats, spacing: float) -> Floats:
    """Return unit vectors (g, d) from the nodes' feet towards the boundary and on into the side that is carried."""
    towards = seen.foot - foot_point
    touching = seen.distance < TOUCHING * spacing
    length = np.where(touching, 1.0, seen.distance)[:, None]
    across = -np.sign(np.nan_to_num(seen.signed))[:, None] * seen.left
    return np.where(touching[:, None], across, towards / length)
