"""The kind ``trimmed``: the part of a surface or curve where a function of position is at most zero."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partialmethod
from typing import Any

import numpy as np

from cpmkit.plugin import (
    MOST_EDGES,
    Bools,
    ClosestPoints,
    ClosestPointSource,
    Floats,
    Ints,
    as_points,
    as_vector,
    cell_levels,
    dots,
    edge_limit_of,
    norms,
    positive,
    source_repr,
)
from cpmkit_combinations.cut import as_cuttable, find_zero_set, level_cut
from cpmkit_combinations.level_cut import CUT_DIFFERENCE_SHARE, LevelCut, PositionFunction, position_function
from cpmkit_combinations.points import PointSet
from cpmkit_combinations.trimmed_edge import CurveEdge, TrimmedEdge, clip_mesh, point_edge
from cpmkit_combinations.wrapper import Wrapper, smooth_surface_of, with_abilities

#: Distance from the edge, relative to the size, below which a foot lies on it: four times its deviation or more.
ON_TRIMMED_EDGE_SHARE = 1e-11
#: Spacing of the samples of the part that is left, over that of the samples among which the edge is searched.
COARSE_SAMPLE_FACTOR = 2
#: Largest distance of a point of the part from a sample, in spacings of the samples.
COVERING_SAMPLE_DISTANCES = 1.75
#: Number of descents from samples for a query whose closest point on the whole is cut away.
TRIMMED_DESCENTS = 3
#: Least sine of the angle, inwards, under which a query is seen from the edge if its foot is not there.
INWARD_SINE = 1e-6
#: Least number of cells of a mesh along the largest side.
TRIMMED_LEAST_CELLS = 16
#: Largest number of steps of a descent, and the length of its last step relative to the coordinates.
DESCENT_STEPS, LAST_STEP_SHARE = 100, 1e-13
#: Share of the way to the query of the first probe of a descent, and of the longest.
FIRST_PROBE_SHARE, LONGEST_PROBE_SHARE = 0.5, 0.9


@dataclass(frozen=True, eq=False)
class Trimmed(Wrapper):
    """The points of a manifold with trim <= 0.

    Attributes
    ----------
    of : ClosestPointSource
        The whole.
    trim : PositionFunction
        The function of position that is at most zero on the part.
    new_edge : TrimmedEdge
        The edge made by trimming.
    samples : (k, d) float64
        Points of the part.
    covering : float
        Every point of the part has a sample within this distance.
    margin : float
        Points with trim above minus this count as points of the edge.
    tolerance : float
        Length below which a query does not count as seen from the edge inwards.
    """

    trim: PositionFunction
    new_edge: TrimmedEdge
    samples: Floats
    covering: float
    margin: float
    tolerance: float

    __repr__ = source_repr

    @property
    def bounds(self) -> Floats:
        """(2, d) corners of a box around the part, a little larger than the smallest."""
        edge, whole = self.new_edge.source.bounds, np.asarray(self.of.bounds, dtype=np.float64)
        lower = np.minimum(self.samples.min(axis=0) - self.covering, edge[0])
        upper = np.maximum(self.samples.max(axis=0) + self.covering, edge[1])
        return np.stack([np.clip(lower, *whole), np.clip(upper, *whole)])

    @property
    def deviation(self) -> float:
        """The largest distance, in the unit of length, of the edge from the zeros of trim on the manifold."""
        return self.new_edge.deviation

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d).

        On a surface ``edge`` is 0, 1, ... on the edges made by trimming, the longest first, then come the edges of the
        whole in their order; on a curve it is 0 at the start and 1 at the end; -1 elsewhere. ``element`` and ``local``
        are those of the foot on the whole. A foot is ``doubtful`` where it is on the whole, or where the closest point
        of the whole is cut away and the search of the part that is left was not complete or did not converge. Raise
        InputError if ``x`` does not have shape (n, d) or is not finite.
        """
        x = as_points(x, self.dim)
        feet = self.of.closest_point(x)
        edge = self.new_edge.numbers_of_whole(feet.edge)
        away = np.flatnonzero(~self._is_inside(feet.points))
        points, distance = feet.points.copy(), feet.distance.copy()
        doubtful = np.zeros(len(x), dtype=bool) if feet.doubtful is None else feet.doubtful.copy()
        points[away], distance[away], edge[away], doubtful[away] = self._feet_of_cut_away(x[away])
        part = ClosestPoints(points, distance, edge, feet.element, feet.local, doubtful)
        return part if feet.element is None and feet.local is None else self._add_elements(part, away)

    def _is_inside(self, points: Floats) -> Bools:
        """Return (n,) whether each of ``points`` (n, d) of the whole has trim below minus :attr:`margin`."""
        return np.asarray(self.trim(points) < -self.margin)

    def _add_elements(self, feet: ClosestPoints, rows: Ints) -> ClosestPoints:
        """Return ``feet``, at ``rows`` (k,) with ``element`` and ``local`` of their closest points on the whole."""
        whole = self.of.closest_point(np.ascontiguousarray(feet.points[rows]))
        return feet.replace_rows(rows, replace(feet.take(rows), element=whole.element, local=whole.local))

    def _feet_of_cut_away(self, x: Floats) -> tuple[Floats, Floats, Ints, Bools]:
        """Return points (n, d), distances, edge numbers and doubt (n,) of queries ``x`` (n, d) whose foot is cut away.

        Each closest point lies on the new edge or inside the part, where descents from samples lead. Doubt is True
        where more than :data:`TRIMMED_DESCENTS` descents are needed, or the chosen descent does not converge.
        """
        on_edge = self.new_edge.source.closest_point(x)
        points, distance, doubtful = on_edge.points.copy(), on_edge.distance.copy(), np.zeros(len(x), dtype=bool)
        edge = self.new_edge.numbers(on_edge)
        starts, left = self._descent_starts(x, on_edge)
        for tried in range(TRIMMED_DESCENTS + 1):
            rows = np.flatnonzero(left.any(axis=1))
            if not len(rows):
                break
            if tried == TRIMMED_DESCENTS:
                doubtful[rows] = True
                break
            pick = left[rows].argmax(axis=1)
            foot, converged = descend_to_foot(self.of, x[rows], starts[rows, pick], 3 * self.covering)
            reached = norms(x[rows] - foot)
            better = (reached < distance[rows]) & self._is_inside(foot)
            nearer = rows[better]
            points[nearer], distance[nearer], doubtful[nearer] = foot[better], reached[better], ~converged[better]
            edge[nearer] = self.new_edge.numbers_of_whole(self.of.closest_point(foot[better]).edge)
            searched = norms(starts[rows] - starts[rows, pick][:, None]) <= 3 * self.covering
            searched |= norms(starts[rows] - foot[:, None]) <= 3 * self.covering
            promising = norms(x[rows, None] - starts[rows]) ** 2 - (2 * self.covering) ** 2 < distance[rows, None] ** 2
            left[rows] &= promising & ~searched
            left[rows, pick] = False
        return points, distance, edge, doubtful

    def _descent_starts(self, x: Floats, on_edge: ClosestPoints) -> tuple[Floats, Bools]:
        """Return points (n, k, d) of the part, and a mask (n, k) of those from which a descent may end nearer.

        The first start is ``on_edge``, the foot of ``x`` (n, d) on the edge, marked if the query is seen from it
        inwards. The others are the nearest samples, marked if they are not near this foot (points near it are farther
        than the edge, or reached from it) and a point near them may be nearer than it.
        """
        toward_part = dots(x - on_edge.points, self.new_edge.outward(on_edge))
        inwards = toward_part < -INWARD_SINE * on_edge.distance - self.tolerance
        count = min(2 * TRIMMED_DESCENTS, len(self.samples))
        gap, nearest = self._tree.query(x, np.arange(1, count + 1))
        samples = self.samples[nearest]
        near_edge = norms(samples - on_edge.points[:, None]) <= 3 * self.covering
        promising = (gap**2 - (2 * self.covering) ** 2 < on_edge.distance[:, None] ** 2) & ~near_edge
        starts = np.concatenate([on_edge.points[:, None], samples], axis=1)
        return starts, np.concatenate([inwards[:, None], promising], axis=1)

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self.samples)

    def _directions(self, name: str, feet: ClosestPoints, /) -> Floats:
        """Return unit vectors (n, d) at ``feet`` by the method ``name`` of the whole."""
        return np.asarray(getattr(self.of, name)(feet))

    _normals = partialmethod(_directions, "normals")
    _facet_normals = partialmethod(_directions, "facet_normals")
    _tangents = partialmethod(_directions, "tangents")
    _leftward = partialmethod(_directions, "leftward")

    @property
    def left_of(self) -> Floats | None:
        """(d,) the point on the left of the whole; None if it has none, or its closest point is cut away."""
        point = getattr(self.of, "left_of", None)
        if point is None:
            return None
        foot = self.of.closest_point(as_vector(point, self.dim, "left_of")[None]).points
        return as_vector(point, self.dim, "left_of") if self._is_inside(foot)[0] else None

    def _interpolate(self, values: Floats, feet: ClosestPoints, /) -> Floats:
        """Return (n, ...) ``values`` (value_count, ...), a row for each of the whole's, interpolated at ``feet``."""
        return np.asarray(self.of.interpolate(values, feet))

    def _mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return vertices (v, d) and cells (m, k) of the whole's mesh, clipped at the new edge.

        The whole's mesh has about ``spacing``, at most a sixteenth of the part's largest side.
        """
        coarsest = float(np.ptp(self.bounds, axis=0).max()) / TRIMMED_LEAST_CELLS
        vertices, cells = self.of.mesh(min(positive(spacing, "spacing"), coarsest))
        beyond = self.trim(vertices) + self.margin
        return clip_mesh(vertices, cells, beyond, lambda points: self.new_edge.source.closest_point(points).points)

    def _translate(self, offset: Floats, /) -> Trimmed:
        """Return the part translated by ``offset`` (d,)."""
        shift = as_vector(offset, self.dim, "offset")
        return replace(
            self,
            of=self.of.translate(shift),
            trim=replace(self.trim, origin=self.trim.origin - shift),
            new_edge=self.new_edge.translate(shift),
            samples=self.samples + shift,
        )

    @property
    def edge_limit(self) -> int:
        """The exclusive upper bound of edge numbers: those of the whole follow those made by trimming."""
        return edge_limit_of(self.of) + MOST_EDGES


def trimmed_source(*, of: ClosestPointSource, trim: Any, resolution: int | None = None) -> Any:
    """Return the part of a surface or curve where a function of position is at most zero, with a true edge.

    Raise InputError if an argument is not accepted, trim is not finite on the whole or only jumps over zero, nothing is
    cut off or nothing is left, trim has no slope at a zero on a curve or leaves more than one piece of it, or the new
    edge of a surface branches, or is too small or too sharply curved for the samples.

    Parameters
    ----------
    of : source or mesh
        The whole: a surface, or a curve of which one piece must be left.
    trim : str or callable
        A formula in x, y, z, or a function of points (n, d) that returns (n,). The part with trim <= 0 is left.
    resolution : int, optional
        Number of samples along the largest side among which the edge is searched, as for the kind ``cut.function``.

    Examples
    --------
    >>> import numpy as np, cpmkit as ck
    >>> bowl = trimmed_source(of=ck.source("analytic.sphere"), trim="z")
    >>> feet = bowl.closest_point(np.array([[0.6, 0.0, 0.8], [0.6, 0.0, -0.8]]))
    >>> feet.points[:, [0, 2]].round(12).tolist(), feet.edge.tolist()
    ([[1.0, 0.0], [0.6, -0.8]], [0, -1])
    """
    of = smooth_surface_of(as_cuttable(of, "of"))
    function = position_function(trim, of.dim, "trim")
    cut = level_cut(of, function, "trim", resolution)
    where = find_zero_set(cut)
    samples = _samples_of_part(cut)
    ends_left = np.unique(samples.edge[samples.edge >= 0])
    new_edge: TrimmedEdge = point_edge(cut, where, ends_left) if isinstance(where, PointSet) else CurveEdge(where)
    tolerance = max(ON_TRIMMED_EDGE_SHARE * cut.size, 4 * new_edge.deviation)
    along = where.mesh(cut.spacing)[0] - cut.phi.origin
    steepest = float(norms(cut.phi.gradient(along, CUT_DIFFERENCE_SHARE * cut.size)).max())
    covering = COVERING_SAMPLE_DISTANCES * COARSE_SAMPLE_FACTOR * cut.spacing
    function_in_place = PositionFunction(function, np.zeros(of.dim), "trim")
    points = samples.points + cut.phi.origin
    return with_abilities(Trimmed, "trimmed", of)(
        of, function_in_place, new_edge, points, covering, steepest * tolerance, tolerance
    )


def _samples_of_part(cut: LevelCut) -> ClosestPoints:
    """Return closest points that sample the part with trim <= 0, relative to the cut's origin.

    They are :data:`COARSE_SAMPLE_FACTOR` spacings apart; on a curve with its own ends among them.
    """
    spacing = COARSE_SAMPLE_FACTOR * cut.spacing
    cells = next(blocks for side, blocks in cell_levels(cut.surface, spacing, 0.5) if side == 1)
    if (
        cut.surface.manifold_dim == 1
    ):  # the foot of a cell's centre may miss the end in it, that of a neighbour does not
        offsets = np.stack(np.meshgrid(*[np.arange(-1, 2)] * cut.surface.dim, indexing="ij"), axis=-1)
        cells = np.unique((cells[:, None] + offsets.reshape(-1, cut.surface.dim)).reshape(-1, cut.surface.dim), axis=0)
    feet = cut.surface.closest_point(np.asarray(cells * spacing, dtype=np.float64))
    return feet.take(cut.phi(feet.points) <= 0)


def descend_to_foot(of: ClosestPointSource, x: Floats, start: Floats, reach: float) -> tuple[Floats, Bools]:
    """Return points y of ``of`` near ``start`` with x - y normal to it, and a mask (n,) of the converged ones.

    ``x`` (n, d) are queries, ``start`` (n, d) points of the manifold ``of``, ``reach`` is the greatest length of the
    first step. Each step replaces y by the closest point of the probe y + share (x - y), which is y itself if x - y is
    normal, and else nearer to x: a tangential error shrinks by (1 - share) / (1 - share |x - y| k), k the curvature
    towards x. Of three steps the third starts ahead of y, by the geometric series of the shrinking steps; it may be up
    to 40 times as long as its predecessor, others at most twice. A longer step, or one that increases the distance, may
    lead to another part of the manifold: it is rejected. If it is the first, or follows an extrapolated one, the share
    is halved.
    """
    y, distance, step = start.copy(), norms(x - start), np.zeros_like(x)
    share, most, longest = (np.full(len(x), value) for value in (FIRST_PROBE_SHARE, LONGEST_PROBE_SHARE, reach))
    ahead, converged, rows = np.zeros_like(x), np.zeros(len(x), dtype=bool), np.arange(len(x))
    rounding = LAST_STEP_SHARE * (np.abs(x).max(axis=1, initial=0.0) + np.abs(start).max(axis=1, initial=0.0))
    for k in range(DESCENT_STEPS):
        if not len(rows):
            break
        base = y[rows] + ahead[rows]
        foot = of.closest_point(base + share[rows, None] * (x[rows] - base)).points
        advance, reached = foot - y[rows], norms(x[rows] - foot)
        length = norms(advance)
        accepted = (length <= longest[rows] + 2 * norms(ahead[rows])) & (reached <= distance[rows] + rounding[rows])
        improved = rows[accepted]
        converged[rows] = accepted & (length <= rounding[rows])
        if k % 3 == 1:  # two steps without extrapolation give the rate at which they shrink
            shrink = dots(advance, step[rows]) / np.maximum(dots(step[rows], step[rows]), np.finfo(float).tiny)
            shrink = np.where(accepted, np.clip(shrink, 0.0, 0.95), 0.0)
            ahead[rows] = (shrink / (1 - shrink))[:, None] * advance
        else:
            ahead[rows] = 0.0
            # after a rejected step the share stays below that step's
            most[rows] = np.where(accepted | (k % 3 == 2), most[rows], 0.5 * share[rows])
        y[improved], distance[improved], longest[improved] = foot[accepted], reached[accepted], 2 * length[accepted]
        step[rows] = np.where(accepted[:, None], advance, 0.0)
        share[rows] = np.minimum(most[rows], np.where(accepted, 1.5, 1.0) * share[rows])
        rows = rows[~converged[rows]]
    return y, converged
