"""Points along the curves of a boundary, in order, with tangents, conormals and arc lengths."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.errors import InputError, SceneError
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.orientation import link_chains
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.manifold.tangent_space import unit_normals
from cpmkit.manifold.vector_algebra import norms
from cpmkit.runtime.arrays import positive, whole
from cpmkit.scene.boundary import Boundary
from cpmkit.scene.conditions import Neumann
from cpmkit.scene.equations import Laplace
from cpmkit.scene.oriented import OrientedBoundary, orient
from cpmkit.scene.scene import Scene
from cpmkit.solution.integrals import boundary_rule
from cpmkit.types import Bools, Floats, Ints


def join_at_corners(
    runs: Sequence[Ints], closed: Sequence[bool], points: Floats, tangents: Floats, weights: Floats
) -> tuple[list[Ints], tuple[bool, ...]]:
    """Return the runs of a boundary's points, joined if one begins where another ends, and whether each is closed.

    A run has the indices (k,) of ``points`` (n, d) along a smooth curve, with unit ``tangents`` (n, d) in its
    direction; at corners, such as right angles of polylines, the ends of runs coincide. If three or more ends meet,
    they are not joined. ``closed`` is True for each closed run; these come first in the result. ``weights`` (n,) are
    the lengths of curve that points represent, half on either side.
    """
    opened = [run for run, is_closed in zip(runs, closed, strict=True) if not is_closed]
    if not opened:
        return list(runs), tuple(closed)
    last, first = (np.array([run[place] for run in opened]) for place in (-1, 0))
    arriving = points[last] + 0.5 * weights[last, None] * tangents[last]
    leaving = points[first] - 0.5 * weights[first, None] * tangents[first]
    ends, scale = np.concatenate([arriving, leaving]), weights[np.concatenate([last, first])]
    apart = norms(ends[:, None] - ends[None])
    # on straight sides the distance is rounding, on curved ones the square of the weight over the radius
    meet = apart <= 0.25 * np.minimum(scale[:, None], scale[None])
    count = len(opened)
    alone = meet.sum(axis=1) == 2  # itself and one other
    follows: Bools = meet[:count, count:] & alone[:count, None] & alone[None, count:]
    return _join_runs(opened, follows, [run for run, is_closed in zip(runs, closed, strict=True) if is_closed])


def _join_runs(opened: Sequence[Ints], follows: Bools, others: Sequence[Ints]) -> tuple[list[Ints], tuple[bool, ...]]:
    """Return the closed runs ``others`` followed by the joined runs of ``opened``, and whether each is closed.

    ``follows`` (runs, runs) is True at [i, j] if open run j begins where open run i ends.
    """
    following = np.where(follows.any(axis=1), follows.argmax(axis=1), -1)
    joined, are_closed, left = list(others), [True] * len(others), np.ones(len(opened), dtype=bool)
    starts = [*np.flatnonzero(~follows.any(axis=0)), *np.flatnonzero(follows.any(axis=0))]  # loops begin anywhere
    for start in starts:
        chain, at = [], start
        while at >= 0 and left[at]:
            left[at] = False
            chain.append(opened[at])
            at = following[at]
        if chain:
            joined.append(np.concatenate(chain))
            are_closed.append(bool(at == start))
    return joined, tuple(are_closed)


#: Step of differences of closest points, in spacings.
DIFFERENCE_SPACINGS = 0.1
#: Neighbours along a curve are at most so many spacings apart.
REACH_SPACINGS = 1.5
#: Step of differences where there is no spacing, as a share of the surface's size.
STEP_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class BoundaryPoints:
    """Quadrature points of a boundary, curve by curve, in the direction of each curve."""

    source: ClosestPointSource  #: The boundary.
    surface: ClosestPointSource  #: The manifold that contains it.
    points: Floats  #: (k, d): points of the manifold, in the scene's coordinates.
    weights: Floats  #: (k,): length of curve that each point represents; 1 where the boundary is points.
    tangents: Floats  #: (k, d): unit vectors in the direction of the boundary; zero where it is points.
    #: (k, d): unit tangents of the manifold normal to the boundary, to its left; zero if it has no sides.
    conormals: Floats
    curve: Ints  #: (k,): number of the curve of each point, from 0.
    arc_length: Floats  #: (k,): arc length from the start of the curve; a closed curve starts anywhere.
    closed: tuple[bool, ...]  #: Whether each curve is closed.

    def __len__(self) -> int:
        return len(self.points)

    @property
    def lengths(self) -> Floats:
        """(curves,) length of each curve."""
        return np.asarray(np.bincount(self.curve, self.weights, minlength=len(self.closed)), dtype=np.float64)

    def spaced(self, count: int, curve: int = 0) -> Floats:
        """Return ``count`` points (count, d) of a curve at equal arc lengths, with both ends of an open curve.

        The points run in the direction of curve number ``curve``, from its start, which is the only point if ``count``
        is 1. Raises InputError if there is no such curve, the boundary consists of points, or ``count`` is not a whole
        number from 1 to 10,000,000.
        """
        count = whole(count, "count", 1, 10_000_000)
        if not 0 <= curve < len(self.closed) or not self.source.manifold_dim:
            raise InputError(f"points are spaced on one of {len(self.closed)} curves, from 0 on, got {curve}.")
        rows = np.flatnonzero(self.curve == curve)
        length, closed = float(self.lengths[curve]), self.closed[curve]
        wanted = np.arange(count) * length / (count if closed else max(count - 1, 1))
        at, points = self.arc_length[rows], self.points[rows]
        if closed:
            at, points = np.concatenate([at, at[:1] + length]), np.concatenate([points, points[:1]])
        else:  # from the outermost points along their tangents to the ends
            ends = points[[0, -1]] + np.array([[-at[0]], [length - at[-1]]]) * self.tangents[rows[[0, -1]]]
            at, points = np.concatenate([[0.0], at, [length]]), np.concatenate([ends[:1], points, ends[1:]])
        period = length if closed else None
        spaced = np.stack([np.interp(wanted, at, axis, period=period) for axis in points.T], axis=1)
        return self.surface.closest_point(self.source.closest_point(spaced).points).points


def boundary_points(source: ClosestPointSource, surface: ClosestPointSource, spacing: float) -> BoundaryPoints:
    """Return quadrature points along a boundary of ``surface``, at most ``spacing`` apart, with tangents and conormals.

    Conormals point to the left of the boundary. A boundary off the manifold is moved to the closest points on it.

    Parameters
    ----------
    source : ClosestPointSource
        The boundary: curves in a surface, or points on a curve or surface.
    surface : ClosestPointSource
        The manifold: a curve or surface.
    spacing : float
        Largest distance of neighbouring points of a curve, in the scene's unit.

    Raises
    ------
    InputError, SceneError
        If the spacing is not positive, the boundary is neither points nor curves, or its dimension does not fit the
        manifold.

    Examples
    --------
    >>> import cpmkit as ck
    >>> equator = ck.source("analytic.circle", normal=[0, 0, 1])
    >>> along = ck.boundary_points(equator, ck.source("analytic.sphere"), spacing=0.1)
    >>> round(float(along.lengths[0]), 4), along.closed, (along.conormals[0].round(3) + 0.0).tolist()
    (6.2832, (True,), [0.0, 0.0, 1.0])
    """
    spacing = positive(spacing, "spacing")
    oriented = _orient_boundary(source, surface)
    points, weights = boundary_rule(source, surface, spacing)
    tangents, conormals = _tangents_and_conormals(oriented, points, DIFFERENCE_SPACINGS * spacing)
    if not source.manifold_dim:
        count = len(points)
        each = points, weights, tangents, conormals, np.arange(count), np.zeros(count)
        return BoundaryPoints(source, surface, *each, (False,) * count)
    curves = link_chains(points, tangents, conormals, REACH_SPACINGS * spacing)
    runs, closed = join_at_corners(
        [_order_along_tangents(points, tangents, curve.order) for curve in curves],
        [curve.closed for curve in curves],
        points,
        tangents,
        weights,
    )
    order = np.concatenate(runs)
    curve = np.repeat(np.arange(len(runs)), [len(run) for run in runs])
    arc = np.concatenate([np.cumsum(weights[run]) - 0.5 * weights[run] for run in runs])
    picked = points[order], weights[order], tangents[order], conormals[order]
    return BoundaryPoints(source, surface, *picked, curve, arc, closed)


def directions_along(
    source: ClosestPointSource, surface: ClosestPointSource
) -> Callable[[Floats], tuple[Floats, Floats]]:
    """Return a function that maps points (k, d) of a boundary to its unit tangents (k, d) and left conormals (k, d).

    Tangents and conormals are as in :class:`BoundaryPoints`; those that the sources do not provide are differences of
    closest points with a step of a thousandth of the surface's size. Raises SceneError as :func:`boundary_points` does.
    """
    oriented, step = _orient_boundary(source, surface), STEP_SHARE * float(np.ptp(surface.bounds, axis=0).max())
    return lambda points: _tangents_and_conormals(oriented, np.asarray(points, dtype=np.float64), step)


def normals_at(surface: ClosestPointSource, points: Floats) -> Floats:
    """Return unit normals (k, d) of a surface in space, or a curve in the plane, at the points nearest to ``points``.

    Where the surface has no normals of its own, they are differences of closest points with a step of a thousandth of
    its size, and their sign is arbitrary.
    """
    local = LocalSource(surface, np.zeros(surface.dim))
    step = STEP_SHARE * float(np.ptp(surface.bounds, axis=0).max())
    return unit_normals(local, local.closest_point(np.asarray(points, dtype=np.float64)), step)


def _orient_boundary(source: ClosestPointSource, surface: ClosestPointSource) -> OrientedBoundary:
    """Return the boundary ``source`` of ``surface`` with its orientation.

    Raises SceneError if the boundary is neither points nor curves, or does not fit the dimension of the surface.
    """
    if (source.manifold_dim or 0) > 1:
        raise SceneError(f"points are distributed along curves, got a boundary of dimension {source.manifold_dim}.")
    boundary = Boundary("boundary", source, both=Neumann())
    Scene(surface, Laplace(), [boundary])  # checks that they belong together
    return orient(boundary, surface)


def _tangents_and_conormals(oriented: OrientedBoundary, points: Floats, step: float) -> tuple[Floats, Floats]:
    """Return unit tangents (k, d) and left conormals (k, d) of a boundary at points (k, d) in the scene's coordinates.

    Tangents are zero if the boundary is points, both are zero if it has no sides. ``step`` is the step of the
    differences that replace directions which the sources do not provide.
    """
    if not oriented.has_sides:
        return np.zeros_like(points), np.zeros_like(points)
    feet, on = oriented.feet(points - oriented.left.origin)
    left = oriented.leftward(feet, on, step)
    return np.zeros_like(points) if oriented.dimension == 1 else oriented.tangents(feet, on, left, step), left


def _order_along_tangents(points: Floats, tangents: Floats, order: Ints) -> Ints:
    """Return ``order`` (k,), indices of a chain of ``points`` (n, d), reversed if most of it opposes the tangents."""
    if len(order) < 2:
        return order
    ahead = np.einsum("kd,kd->", points[order[1:]] - points[order[:-1]], tangents[order[:-1]])
    return order if ahead >= 0 else order[::-1]
