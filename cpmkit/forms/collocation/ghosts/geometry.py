"""The ghosts of one boundary while they are made: where their nodes stand, and which way leads across."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cpmkit.forms.collocation.boundary.on_band import BoundariesOnBand
from cpmkit.forms.collocation.boundary.row_formula import ExtraPoint
from cpmkit.forms.collocation.boundary.side_view import BoundaryOnLattice, SideView
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.walking import nearest_on_sheet
from cpmkit.protocols import Bools, BoundarySet, ClosestPoints, Floats, Ints
from cpmkit.scene.conditions import Condition, same_condition
from cpmkit.scene.laws import Law, Value

#: Data that jump across a boundary are read this share of the spacing inside the side they belong to.
INSIDE_SIDE_SPACINGS = 1e-6
#: Cosine of the angle up to which two boundaries run side by side.
ALONGSIDE_COSINE = 0.9


def mirror_distance(law: Law, t: Floats, spacing: float) -> Floats:
    """Return how far beyond the boundary a second-order ghost at distance ``t`` (n,) reads."""
    return np.maximum(t, 0.5 * spacing) if isinstance(law, Value) else t


@dataclass(frozen=True, eq=False)
class GhostGeometry:
    """The ghosts of boundary ``index``: the view of their nodes, the nodes' feet, and directions across.

    What they read at any order is a function of this: points that were asked for are kept.

    Attributes
    ----------
    index : int
        The boundary's number.
    boundaries : BoundariesOnBand
        All boundaries of the scene.
    lattice : Lattice
        Its spacing is that of the ghosts.
    seen : SideView
        How the boundary sees the nodes' feet.
    foot_point : (g, d) float64
        Those feet.
    direction : (g, d) float64
        Unit vectors from them towards the boundary and on.
    apart : (g,) bool
        True for nodes past an edge from which the boundary keeps what it carries; they have their place for a foot.
    own_feet : ClosestPoints, optional
        The surface's records of the nodes' feet: where several of its sheets share the band.
    """

    index: int
    boundaries: BoundariesOnBand
    lattice: Lattice
    seen: SideView
    foot_point: Floats
    direction: Floats
    apart: Bools
    own_feet: ClosestPoints | None = None

    def __len__(self) -> int:
        return len(self.seen.rows)

    @property
    def spacing(self) -> float:
        """Of the lattice."""
        return self.lattice.spacing

    @property
    def own(self) -> BoundaryOnLattice:
        """The boundary itself."""
        return self.boundaries.on_lattice[self.index]

    @cached_property
    def start(self) -> ClosestPoints | None:
        """The surface's records of the boundary's points, to walk from along their sheets; None where it has one."""
        return None if self.own.sheets is None else self.own.surface.closest_point(self.seen.foot)

    @cached_property
    def _ahead(self) -> Floats:
        """(g,) how far beyond the boundary ghosts of order 2 look."""
        ahead = np.empty(len(self))
        for condition, rows in self.sides():
            ahead[rows] = mirror_distance(condition.law, self.seen.distance[rows], self.spacing)
        return ahead

    @cached_property
    def mirror(self) -> ClosestPoints:
        """The g points at which ghosts of order 2 read."""
        # King et al. (2024), eq. 15, has cp_S(2 y - x); here it is cp_S(2 y - z), or farther behind y.
        ahead = self.seen.foot + self._ahead[:, None] * self.direction
        return nearest_on_sheet(self.own.surface, self.start, ahead, self.spacing)

    @cached_property
    def is_hidden(self) -> Bools:
        """(g,) whose mirror points lie beyond another boundary."""
        reach = 2 * float(self._ahead.max(initial=0.0))
        return beyond_another(self, np.arange(len(self)), self.mirror.points, reach)

    def at_boundary(self, rows: Ints) -> Floats:
        """Return the boundary's points (k, d) of the ghosts ``rows``, in the scene's coordinates."""
        return self.lattice.to_scene(self.seen.foot[rows])

    @property
    def what(self) -> str:
        """The boundary's name for errors."""
        return f"boundary {self.boundaries.given[self.index].name!r}"

    def sides(self) -> list[tuple[Condition, Ints]]:
        """Return each condition with the ghosts that carry it: a node on the right has a ghost of the left."""
        boundary, seen = self.boundaries.given[self.index], self.seen
        left, right = boundary.condition("left"), boundary.condition("right")
        if same_condition(left, right):
            return [(left, np.arange(len(seen.rows)))]
        return [(left, np.flatnonzero(seen.signed < 0)), (right, np.flatnonzero(seen.signed >= 0))]

    def side_views(self, rows: Ints, points: Floats, radius: float, own_side: bool = False) -> list[SideView]:
        """Return how the ghosts ``rows`` see each boundary from ``points``.

        Their own they see from the side that they carry, or from the one on which they stand; the others from there.
        """
        own = self.seen.take(rows) if own_side else self.seen.take(rows).reversed()
        own = replace(own, rows=np.arange(len(rows)))
        return [
            own if other == self.index else on_lattice.side_view(points, radius, self.spacing)
            for other, on_lattice in enumerate(self.boundaries.on_lattice)
        ]

    def located(self, term: ExtraPoint, radius: float, own_side: bool = False) -> ExtraPoint:
        """Return a point that ghosts read with how they see each boundary from there."""
        side_views = self.side_views(term.rows, term.points, radius, own_side)
        return replace(term, own=self.index, side_views=side_views)


def _holds_one_value(boundary: BoundarySet) -> bool:
    """Tell whether the solution is continuous across a boundary because both sides hold the same value there."""
    left, right = boundary.condition("left"), boundary.condition("right")
    return isinstance(left.law, Value) and same_condition(left, right)


def beyond_another(geometry: GhostGeometry, rows: Ints, points: Floats, reach: float) -> Bools:
    """Tell which points read by the ghosts ``rows`` lie beyond another boundary than their own.

    Points on a surface do not count: the solution goes on around them. Nor does a boundary that starts
    where this one is met (on the sphere, an arc and a point at its end, spacing 0.05: error 6e-4, and
    3.6e-3 if such ghosts were of order 1), nor one that is met at an angle and holds one value for both sides, across
    which the solution goes on (an arc that ends on a circle, spacing 0.1: error 3e-3 instead of 1.5e-2).
    """
    foot, beyond, spacing = geometry.seen.foot[rows], np.zeros(len(rows), dtype=bool), geometry.spacing
    for boundary, other in zip(geometry.boundaries.given, geometry.boundaries.on_lattice, strict=True):
        if other is geometry.own or not other.has_sides:
            continue
        at_point = other.side_view(points, reach, spacing)
        at_foot = other.side_view(foot[at_point.rows], 2 * reach, spacing)
        facing = at_point.take(at_foot.rows)
        opposite = np.sum(facing.director * at_foot.director, axis=1) < 0
        # where they meet, neither lies beyond the other
        opposite &= np.abs(at_foot.signed) > INSIDE_SIDE_SPACINGS * spacing
        if _holds_one_value(boundary):
            own = geometry.seen.conormal[rows][facing.rows]
            opposite &= np.abs(np.sum(own * at_foot.conormal, axis=1)) > ALONGSIDE_COSINE
        beyond[facing.rows[opposite & ~facing.end & ~at_foot.end]] = True
    return beyond
