"""Ghosts: a second unknown at the nodes near a boundary, that carries the solution of the other side.

A ghost stands where its node stands, on one side of the boundary, and continues the solution from
the other side across it, by the formula of the condition that holds there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cpmkit.boundary.edge import Reading
from cpmkit.boundary.formulas import coefficient_and_factor, mirror_distance
from cpmkit.boundary.frame import Frame, Sighted, near
from cpmkit.conditions import Condition, evaluate_data
from cpmkit.grid.band import Band
from cpmkit.grid.lattice import Lattice
from cpmkit.grid.stencils import reading_radius
from cpmkit.protocols import Bools, BoundarySet, Floats, Ints

#: Below this share of the spacing, the direction from a ghost to the boundary is taken from the conormal.
TOUCHING = 1e-3
#: Data that jump across a boundary are read this share of the spacing inside the side they belong to.
INSIDE = 1e-6
#: A foot that is lifted off the tangent plane by more than this share of its distance lies on another sheet.
OFF_SHEET = 0.75


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
    frames : sequence of Frame
        How the ghosts' stencils see each boundary.
    off_sheet : (g,) bool
        True where the node's foot does not lie beside the boundary but above it: on another sheet.
    inside : (g, d) float64
        Points just inside the side that each ghost carries, where right-hand sides are read.
    carries_left : (g,) bool
        True where the ghost carries the left side's solution.
    first_order : (g,) bool
        True where the ghost is of order 1.
    """

    nodes: Ints
    unknowns: int
    numbers: Ints
    director: Floats
    reading: Reading
    frames: Sequence[Frame]
    off_sheet: Bools
    inside: Floats
    carries_left: Bools
    first_order: Bools

    @cached_property
    def unknown_numbers(self) -> Ints:
        """(band nodes,) ``numbers`` of those ghosts that are unknowns, -1 elsewhere."""
        return np.where(self.numbers < self.unknowns, self.numbers, -1)


@dataclass(frozen=True, eq=False)
class Sight:
    """All boundaries of a scene, and how the band's nodes see them."""

    boundaries: Sequence[BoundarySet]
    sighted: Sequence[Sighted]
    frames: Sequence[Frame]


def build_ghosts(index: int, sight: Sight, band: Band, lattice: Lattice, reading: Reading, order: int) -> Ghosts:
    """Return the ghosts of boundary ``index``.

    A node has a ghost if it is within the reach of a stencil from the boundary, and the boundary's
    point nearest to its foot is no open end.
    """
    seen, unknowns = _ghost_nodes(sight.sighted[index], sight.frames[index], band)
    foot_point = reading.points[seen.rows]
    direction = _direction(seen, foot_point, band.spacing)
    sides = _sides(sight.boundaries[index], seen)
    mirror, first = _mirrors(index, sight, seen, direction, sides, order, band.spacing)
    coefficient, datum = _coefficients(
        sight.boundaries[index], lattice, seen, foot_point, mirror, sides, first, reading
    )
    past_edge = reading.take(seen.rows)
    composed = Reading(
        mirror, past_edge.coefficient * coefficient, past_edge.coefficient[:, None] * datum + past_edge.datum
    )
    numbers = np.full(len(band.nodes), -1)
    numbers[seen.rows] = np.arange(len(seen.rows))
    frames = _ghost_frames(index, sight, seen, mirror, band)
    inside = seen.foot + INSIDE * band.spacing * direction
    off_sheet = seen.lift > OFF_SHEET * seen.distance + 0.5 * band.spacing
    carries_left = seen.signed < 0
    return Ghosts(seen.rows, unknowns, numbers, seen.director, composed, frames, off_sheet, inside, carries_left, first)


def _sides(boundary: BoundarySet, seen: Frame) -> list[tuple[Condition, Bools]]:
    """Return each condition with the ghosts that carry it: a node on the right has a ghost of the left."""
    left, right = boundary.condition("left"), boundary.condition("right")
    if left is right:
        return [(left, np.ones(len(seen.rows), dtype=bool))]
    return [(left, seen.signed < 0), (right, seen.signed >= 0)]


def _ghost_nodes(sighted: Sighted, seen: Frame, band: Band) -> tuple[Frame, int]:
    """Return the frame of the nodes that have a ghost, unknowns first, and the number of unknowns."""
    reach = reading_radius(band.dim, band.degree) * band.spacing
    reach += sighted.gap
    close, feet = near(sighted.source, band.positions[seen.rows], reach + band.spacing, band.spacing)
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


def _mirrors(
    index: int,
    sight: Sight,
    seen: Frame,
    direction: Floats,
    sides: list[tuple[Condition, Bools]],
    order: int,
    spacing: float,
) -> tuple[Floats, Bools]:
    """Return the points (g, d) that the ghosts read, and which ghosts are of order 1 and read on the boundary."""
    first = np.empty(len(seen.rows), dtype=bool)
    h = np.empty(len(seen.rows))
    for condition, rows in sides:
        first[rows] = (condition.order or order) == 1
        h[rows] = mirror_distance(condition, seen.distance[rows], spacing)
    mirror, second = seen.foot.copy(), np.flatnonzero(~first)
    if len(second):
        ahead = seen.foot[second] + h[second, None] * direction[second]
        mirror[second] = sight.sighted[index].surface.closest_point(ahead).points
        beyond = second[_beyond_another(index, sight, seen.foot[second], mirror[second], 2 * h.max(), spacing)]
        first[beyond], mirror[beyond] = True, seen.foot[beyond]
    return mirror, first


def _beyond_another(index: int, sight: Sight, foot: Floats, mirror: Floats, reach: float, spacing: float) -> Bools:
    """Tell which mirror points lie beyond another boundary than their own; such ghosts can only be of order 1.

    Points on a surface do not count: the solution goes on around them. Nor does a boundary that starts
    where this one is met (on the sphere, an arc and a point at its end, spacing 0.05: error 6e-4, and
    3.6e-3 if such ghosts were of order 1).
    """
    beyond = np.zeros(len(foot), dtype=bool)
    others = [other for other, one in enumerate(sight.sighted) if other != index and one.has_sides]
    for other in others:
        at_mirror = sight.sighted[other].frame(mirror, reach, spacing)
        at_foot = sight.sighted[other].frame(foot[at_mirror.rows], 2 * reach, spacing)
        facing = at_mirror.take(at_foot.rows)
        opposite = np.sum(facing.director * at_foot.director, axis=1) < 0
        opposite &= (
            np.abs(at_foot.signed) > INSIDE * spacing
        )  # where the boundaries meet, neither lies beyond the other
        beyond[facing.rows[opposite & ~facing.end & ~at_foot.end]] = True
    return beyond


def _coefficients(
    boundary: BoundarySet,
    lattice: Lattice,
    seen: Frame,
    foot_point: Floats,
    mirror: Floats,
    sides: list[tuple[Condition, Bools]],
    first: Bools,
    reading: Reading,
) -> tuple[Floats, Floats]:
    """Return the coefficient (g,) and the datum (g, channels) of the ghosts' formula, edges aside."""
    coefficient, datum = np.empty(len(seen.rows)), np.empty((len(seen.rows), reading.datum.shape[1]))
    for condition, rows in sides:
        s = np.linalg.norm(foot_point[rows] - mirror[rows], axis=1)
        t = seen.distance[rows]
        coefficient[rows], factor = coefficient_and_factor(condition, t, s, first[rows], lattice.spacing)
        where = lattice.to_scene(seen.foot[rows])
        gamma = evaluate_data(condition.gamma, where, datum.shape[1], f"boundary {boundary.name!r}")
        datum[rows] = factor[:, None] * gamma
    return coefficient, datum


def _ghost_frames(index: int, sight: Sight, seen: Frame, mirror: Floats, band: Band) -> list[Frame]:
    """Return how the ghosts see each boundary: their own from the opposite side, the others from the mirror point."""
    radius = 2 * reading_radius(band.dim, band.degree) * band.spacing
    numbered = replace(seen.reversed(), rows=np.arange(len(seen.rows)))
    return [
        numbered if other == index else sighted.frame(mirror, radius, band.spacing)
        for other, sighted in enumerate(sight.sighted)
    ]
