"""The positions of the ghosts of a boundary, and the points and weights with which they read u and other data."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.forms.collocation.row_formula import ExtraPoint, RowFormula, extrapolation_weights
from cpmkit.forms.collocation.side_view import ALONGSIDE_COSINE, BoundariesOnBand, BoundaryOnLattice, SideView
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.tangent_space import nearest_points_on_sheet
from cpmkit.manifold.vector_algebra import dots, norms
from cpmkit.scene.conditions import Condition, same_condition
from cpmkit.scene.laws import Law, OneSided, Value
from cpmkit.types import Bools, Floats, Ints

#: Data that jump across a boundary are read at least this share of the spacing away from it, on their side.
INSIDE_SIDE_SPACINGS = 1e-6
#: Data are read at this distance from the boundary, in spacings, and at twice that distance. (At 0.25 the Dziuk surface
#: of the studies is a fifth less accurate at a spacing of 0.1.)
SIDE_READING_SPACINGS = 0.15
#: If a point's distance from the boundary is below this share of the intended distance, there is an edge or a fold.
LEAST_INSIDE_SHARE = 0.75


def mirror_distance(law: Law, t: Floats, spacing: float) -> Floats:
    """Return how far (n,) beyond the boundary a ghost of order 2 reads u: its own distance ``t`` (n,), or more."""
    return np.maximum(t, 0.5 * spacing) if isinstance(law, Value) else t


def coefficient_and_factor(
    law: OneSided, beta: Floats, t: Floats, s: Floats, first_order: Bools, spacing: float
) -> tuple[Floats, Floats]:
    """Return the coefficient of u(mirror) and the factor of gamma, each (n,), of ``alpha du/db + beta u = gamma``.

    Order 2: ``[(alpha - beta s/2) u(mirror) + s gamma] / (alpha + beta s/2)``, and for Dirichlet, with
    the mirror at distance ``h = max(t, spacing/2)``, ``-(t/h) u(mirror) + (1 + t/h) g``.
    Order 1, with u read on the boundary: ``[alpha u + t gamma] / (alpha + beta t)``, for Dirichlet g.

    Differs from King et al. (2024), eq. 8 and section 4.3: there h = t, and a ghost on the boundary then
    reads itself with weight -1, which no smoother damps. Raises ResolutionError if the condition makes the solution
    grow so strongly that the spacing is too coarse.

    ``law``: the law, with its alpha.
    ``beta`` (n,): its beta at the boundary's points nearest to the ghosts.
    ``t``, ``s`` (n,): distance of the ghost from the boundary, and from its mirror point.
    ``first_order`` (n,): whether the ghost is of order 1.
    ``spacing``: spacing of the lattice.
    """
    if isinstance(law, Value):
        ratio = np.where(first_order, 0.0, t / np.maximum(t, 0.5 * spacing))
        return -ratio, (1.0 + ratio) / beta
    alpha = law.alpha
    first = alpha + beta * t
    second = alpha + 0.5 * beta * s
    divisors = np.where(first_order, first, second) / alpha
    if np.any(divisors <= 0):
        room = spacing / (1.0 - float(divisors.min()))
        raise ResolutionError(
            f"spacing={spacing:g} is too coarse for the Robin condition alpha={alpha:g}, "
            f"beta={float(beta[divisors.argmin()]):g}, which feeds the solution; try {room:.2g} or less."
        )
    coefficient = np.where(first_order, alpha / first, (alpha - 0.5 * beta * s) / second)
    return coefficient, np.where(first_order, t / first, s / second)


@dataclass(frozen=True, eq=False)
class GhostGeometry:
    """The g ghosts of boundary ``index``: distances and sides of their nodes, and directions across the boundary."""

    index: int  #: The boundary's number.
    boundaries: BoundariesOnBand  #: All boundaries of the scene.
    lattice: Lattice  #: Origin and spacing.
    seen: SideView  #: Distances and sides of the nodes' closest points; its rows are the nodes.
    #: (g, d): the points that the nodes would read without the boundary: closest points, or mirror points past an edge.
    foot_point: Floats
    direction: Floats  #: (g, d): unit vectors from there towards the boundary and across it.
    #: (g,): True for nodes past an edge that the boundary separates from the part that they continue; then
    #: ``foot_point`` is the node's own place in the tangent plane of the edge.
    past_edge: Bools
    #: The surface's records of ``foot_point``; given where several of its sheets share the band.
    own_feet: ClosestPoints | None = None

    def __len__(self) -> int:
        return len(self.seen.rows)

    @property
    def spacing(self) -> float:
        """The spacing of the lattice."""
        return self.lattice.spacing

    @property
    def boundary(self) -> BoundaryOnLattice:
        """The boundary on the lattice."""
        return self.boundaries.on_lattice[self.index]

    @property
    def name(self) -> str:
        """The boundary's name for errors."""
        return f"boundary {self.boundaries.definitions[self.index].name!r}"

    @cached_property
    def start(self) -> ClosestPoints | None:
        """The surface's records of the boundary's points, from which walks on sheets start; None for a single sheet."""
        return None if self.boundary.sheets is None else self.boundary.surface.closest_point(self.seen.foot)

    @cached_property
    def _ahead(self) -> Floats:
        """(g,) the distances beyond the boundary at which ghosts of order 2 read u."""
        ahead = np.empty(len(self))
        for condition, rows in self.sides():
            ahead[rows] = mirror_distance(condition.law, self.seen.distance[rows], self.spacing)
        return ahead

    @cached_property
    def mirror(self) -> ClosestPoints:
        """The g mirror points, at which ghosts of order 2 read u."""
        # King et al. (2024), eq. 15, has cp_S(2 y - x); here it is cp_S(2 y - z), or farther behind y.
        goal = self.seen.foot + self._ahead[:, None] * self.direction
        return nearest_points_on_sheet(self.boundary.surface, self.start, goal, self.spacing)

    @cached_property
    def is_hidden(self) -> Bools:
        """(g,) whether the ghost's mirror point is beyond another boundary."""
        reach = 2 * float(self._ahead.max(initial=0.0))
        return is_beyond_other_boundary(self, np.arange(len(self)), self.mirror.points, reach)

    def boundary_points(self, rows: Ints) -> Floats:
        """Return the boundary's points (k, d) nearest to the ghosts ``rows`` (k,), in the scene's coordinates."""
        return self.lattice.to_scene(self.seen.foot[rows])

    def sides(self) -> list[tuple[Condition, Ints]]:
        """Return each condition, once if both sides share it, with the ghosts (k,) that continue a side with it."""
        boundary = self.boundaries.definitions[self.index]
        left, right = boundary.condition("left"), boundary.condition("right")
        if same_condition(left, right):
            return [(left, np.arange(len(self)))]
        return [(left, np.flatnonzero(self.seen.signed < 0)), (right, np.flatnonzero(self.seen.signed >= 0))]

    def side_views(self, rows: Ints, points: Floats, radius: float, own_side: bool = False) -> list[SideView]:
        """Return for each boundary the distances and sides of ``points`` (k, d) that the ghosts ``rows`` (k,) read.

        The view of another boundary has the points within ``radius`` of it, in the scene's unit. The view of the
        ghosts' own boundary has k rows with the feet and distances of the ghosts' nodes, not of the points, and the
        side that the ghosts continue, or with ``own_side`` that of their nodes.
        """
        seen, sign = self.seen.take(rows), 1.0 if own_side else -1.0
        own = replace(seen, rows=np.arange(len(rows)), director=sign * seen.director, signed=sign * seen.signed)
        return [
            own if number == self.index else boundary.side_view(points, radius, self.spacing)
            for number, boundary in enumerate(self.boundaries.on_lattice)
        ]

    def with_side_views(self, term: ExtraPoint, radius: float, own_side: bool = False) -> ExtraPoint:
        """Return ``term``, whose rows are ghosts, with the side views of its points, as in :meth:`side_views`."""
        side_views = self.side_views(term.rows, term.points, radius, own_side)
        return replace(term, owner=self.index, side_views=side_views)


def is_beyond_other_boundary(geometry: GhostGeometry, rows: Ints, points: Floats, reach: float) -> Bools:
    """Return whether (k,) the ``points`` (k, d) that ghosts ``rows`` (k,) read are beyond another boundary than theirs.

    Other boundaries do not count if they are farther than ``reach`` from the point, or if they are points on a surface,
    around which the solution is continuous. Nor does a boundary that starts at the ghosts' own, or that meets it at an
    angle and has one value on both sides: ghosts of order 1 would have several times the error there.
    """
    foot, beyond, spacing = geometry.seen.foot[rows], np.zeros(len(rows), dtype=bool), geometry.spacing
    for boundary, other in zip(geometry.boundaries.definitions, geometry.boundaries.on_lattice, strict=True):
        if other is geometry.boundary or not other.has_sides:
            continue
        at_point = other.side_view(points, reach, spacing)
        at_foot = other.side_view(foot[at_point.rows], 2 * reach, spacing)
        facing = at_point.take(at_foot.rows)
        opposite = dots(facing.director, at_foot.director) < 0
        # where the two boundaries meet, neither is beyond the other
        opposite &= np.abs(at_foot.signed) > INSIDE_SIDE_SPACINGS * spacing
        left, right = boundary.condition("left"), boundary.condition("right")
        if isinstance(left.law, Value) and same_condition(left, right):  # one value, across which u is continuous
            own = geometry.seen.conormal[rows][facing.rows]
            opposite &= np.abs(dots(own, at_foot.conormal)) > ALONGSIDE_COSINE
        beyond[facing.rows[opposite & ~facing.end & ~at_foot.end]] = True
    return beyond


# A curve given by points, or snapped to a mesh, is a share of the spacing off the place where data jump: such data are
# read at points farther inside and extrapolated to the boundary.


def ghost_sources(geometry: GhostGeometry) -> RowFormula:
    """Return the formula by which ghosts read right-hand sides at the boundary, from the side that they continue.

    It extrapolates from two points inside that side. Where another boundary or an edge leaves no room for them, or the
    boundary has no sides, ghosts read a single point just inside.
    """
    seen, boundary, spacing = geometry.seen, geometry.boundary, geometry.spacing
    just_inside = seen.foot + INSIDE_SIDE_SPACINGS * spacing * geometry.direction
    if not boundary.has_sides or not len(just_inside):
        return RowFormula(just_inside, np.ones(len(just_inside)))
    step = SIDE_READING_SPACINGS * spacing
    points, complete = points_at_two_steps(boundary, seen.foot, geometry.start, geometry.direction, step)
    rows = np.flatnonzero(complete)
    complete[rows[is_beyond_other_boundary(geometry, rows, points[-1].points[rows], 2 * len(points) * step)]] = False
    return _extrapolation_formula(just_inside, points, complete, np.zeros(len(just_inside)))


def node_sources(
    feet: Floats, boundary: BoundaryOnLattice, others: list[BoundaryOnLattice], side_view: SideView
) -> RowFormula:
    """Return the formula of the right-hand sides at nodes nearly on a boundary, evaluated on each node's own side.

    ``feet`` (k, d) are the nodes' closest points on the manifold, ``side_view`` their distances and sides; ``others``
    are the other boundaries, near which a right-hand side is evaluated at a single point.
    """
    spacing, sign = boundary.spacing, np.sign(side_view.signed)[:, None]
    on_boundary = np.abs(side_view.signed)[:, None] < INSIDE_SIDE_SPACINGS * spacing
    just_inside = np.where(on_boundary, feet + sign * INSIDE_SIDE_SPACINGS * spacing * side_view.conormal, feet)
    start = None if boundary.sheets is None else boundary.surface.closest_point(side_view.foot)
    step = SIDE_READING_SPACINGS * spacing
    points, complete = points_at_two_steps(boundary, side_view.foot, start, sign * side_view.conormal, step)
    reach = 2 * len(points) * step
    for other in others:
        complete &= other.source.closest_point(side_view.foot).distance > reach
    return _extrapolation_formula(just_inside, points, complete, np.abs(side_view.signed) / step)


def points_at_two_steps(
    boundary: BoundaryOnLattice, foot: Floats, start: ClosestPoints | None, direction: Floats, step: float
) -> tuple[list[ClosestPoints], Bools]:
    """Return a list of n points one ``step`` from each foot and n two steps from it, and whether (n,) both exist.

    A point exists if no edge or fold is nearer. ``foot`` (n, d) are points of a boundary, ``direction`` (n, d) unit
    vectors, ``start`` the surface's records of the feet, None unless several sheets share the band.
    """
    points, complete = [], np.ones(len(foot), dtype=bool)
    for k in (1, 2):
        on = nearest_points_on_sheet(boundary.surface, start, foot + k * step * direction, boundary.spacing)
        complete &= (norms(on.points - foot) > LEAST_INSIDE_SHARE * k * step) & (on.edge < 0)
        points.append(on)
    return points, complete


def _extrapolation_formula(just_inside: Floats, points: list[ClosestPoints], complete: Bools, at: Floats) -> RowFormula:
    """Return the formula that extrapolates data linearly from ``points`` at 1 and 2 steps to ``at`` (n,) steps.

    Rows that are not ``complete`` read the single point ``just_inside``.
    """
    rows = np.flatnonzero(complete)
    weights = extrapolation_weights(np.tile([1.0, 2.0], (len(rows), 1)), at[rows])
    first, coefficient = just_inside.copy(), np.ones(len(just_inside))
    first[rows], coefficient[rows] = points[0].points[rows], weights[:, 0]
    return RowFormula(first, coefficient, (), [ExtraPoint(rows, points[1].points[rows], weights[:, 1])])
