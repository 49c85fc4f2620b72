"""The cut of a manifold by a function of position: a plane's distance, a formula or a callable; its directions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.plugin import (
    Bools,
    ClosestPoints,
    Expression,
    Floats,
    InputError,
    LocalSource,
    as_vector,
    dots,
    norms,
    outward_conormals,
    shown,
    unit,
    unit_normals,
    unit_tangents,
)

#: Number of steps of the secant method.
SECANT_STEPS = 12
#: The secant method has converged when a step is shorter than this, relative to the size; for a less accurate manifold,
#: relative to the spacing.
ON_CUT_SHARE, NEARLY_ON_CUT_SPACINGS = 1e-14, 1e-6
#: Step of differences, relative to the size.
CUT_DIFFERENCE_SHARE = 1e-4


@dataclass(frozen=True, eq=False)
class PlaneDistance:
    """The signed distance from the plane through ``point`` (d,), positive where the unit ``normal`` (d,) points."""

    point: Floats
    normal: Floats

    def __call__(self, x: Floats) -> Floats:
        """Return the distances (n,) of points (n, d)."""
        return dots(x - self.point, self.normal)


@dataclass(frozen=True, eq=False)
class PositionFunction:
    """A function of position in coordinates relative to ``origin``.

    Attributes
    ----------
    function : callable
        Of points (n, d) in the user's coordinates; returns (n,).
    origin : (d,) float64
        Added to positions. A plane is moved instead, so that it keeps its accuracy far from zero.
    label : str
        Its name in messages: the key of the scene.
    """

    function: Callable[[Floats], Any]
    origin: Floats
    label: str

    def __call__(self, y: Floats) -> Floats:
        """Return the values (n,) at points (n, d) relative to the origin.

        Raise InputError if a value is not finite, and as :meth:`values_unchecked`.
        """
        values = self.values_unchecked(y)
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            raise InputError(
                f"{self.label} must be finite on the manifold, got {values[bad[0]]} at "
                f"{(y[bad[0]] + self.origin).tolist()} and {len(bad)} of {len(y)} points."
            )
        return values

    def values_unchecked(self, y: Floats) -> Floats:
        """Return the values (n,) at points ``y`` (n, d) relative to the origin, which may be NaN or infinite.

        A single number holds at all points. Raise InputError if the function raises TypeError or ValueError, or returns
        another shape.
        """
        try:
            if isinstance(self.function, PlaneDistance):
                return PlaneDistance(self.function.point - self.origin, self.function.normal)(y)
            values = np.asarray(self.function(y + self.origin), dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.label} must return one number a point: {error}") from error
        if values.shape not in ((len(y),), ()):
            raise InputError(f"{self.label} must return shape ({len(y)},) for {len(y)} points, got {values.shape}.")
        return np.broadcast_to(values, (len(y),)).copy()

    def gradient(self, y: Floats, step: float) -> Floats:
        """Return gradients (n, d) at ``y`` (n, d) relative to the origin, by differences of 4th order in ``step``.

        That of a plane's distance is exact. NaN where a difference is not finite.
        """
        if isinstance(self.function, PlaneDistance):
            return np.tile(self.function.normal, (len(y), 1))
        n, dim = y.shape
        offsets = step * np.array([1.0, -1.0, 2.0, -2.0])[:, None, None] * np.eye(dim)
        around = self.values_unchecked((y + offsets.reshape(-1, 1, dim)).reshape(-1, dim)).reshape(4, dim, n)
        return np.ascontiguousarray((8 * (around[0] - around[1]) - (around[2] - around[3])).T / (12 * step))

    def variation(self, y: Floats, reach: float) -> Floats:
        """Return estimates (n,) of the largest change of values within ``reach`` of ``y`` (n, d); inf if not finite."""
        n, dim = y.shape
        if isinstance(self.function, PlaneDistance):
            return np.full(n, reach)
        offsets = reach * np.concatenate([np.eye(dim), -np.eye(dim)])
        around = self.values_unchecked((y + offsets[:, None]).reshape(-1, dim)).reshape(2 * dim, n)
        change = np.abs(around - self.values_unchecked(y)).max(axis=0)
        return np.where(np.isfinite(change), 2 * np.sqrt(dim) * change, np.inf)


def plane_distance(point: Any, normal: Any, dim: int) -> PlaneDistance:
    """Return signed distance function of the plane (in 2D the line) through ``point`` with ``normal``, (dim,) each.

    Raise InputError if a vector has another length than ``dim``, is not finite, or the normal is zero.
    """
    base, direction = as_vector(point, dim, "point"), as_vector(normal, dim, "normal")
    if not direction.any():
        raise InputError(f"normal must not be zero, got {shown(normal)}.")
    direction = direction / np.abs(direction).max()
    return PlaneDistance(base, direction / np.linalg.norm(direction))


def position_function(function: Any, dim: int, label: str) -> Callable[[Floats], Any]:
    """Return ``function`` if it is callable, or the formula in the string ``function``; ``label`` is for messages.

    ``dim`` is that of the space. Raise InputError if ``function`` is neither, or a string that is no formula of
    position, such as one that depends on t.
    """
    if isinstance(function, str):
        formula = Expression(function, dim)
        if formula.takes_time:
            raise InputError(f"{label} must not depend on t, got {shown(function)}.")
        return formula
    if isinstance(function, bool) or not callable(function):
        raise InputError(
            f"{label} must be a formula in x, y, z or a function of points (n, {dim}), got {shown(function)}."
        )
    checked: Callable[[Floats], Any] = function
    return checked


@dataclass(frozen=True, eq=False)
class LevelCut:
    """The points of a manifold at which a function vanishes.

    All positions are relative to the centre of the manifold's bounds.

    Attributes
    ----------
    surface : LocalSource
        The manifold: a surface in space, a region of the plane, or a curve.
    phi : PositionFunction
        The function.
    size : float
        Diagonal of the manifold's bounds.
    spacing : float
        Distance of the samples among which zeros are searched.
    """

    surface: LocalSource
    phi: PositionFunction
    size: float
    spacing: float

    @property
    def knows_directions(self) -> bool:
        """True if the manifold has normals or tangents, so that no differences of closest points are needed."""
        dimension = self.surface.manifold_dim
        return dimension == self.surface.dim or self.surface.knows_directions(dimension or 0)

    def project_onto_cut(self, feet: ClosestPoints) -> tuple[ClosestPoints, Bools]:
        """Return points of the cut near the manifold's points ``feet``, and (n,) whether the iteration converged.

        The secant method along the manifold: phi's slope is that between the last two feet, so neither normals nor the
        surface gradient of phi are needed. A step is at most a spacing, the last one :data:`ON_CUT_SHARE` of the size,
        or :data:`NEARLY_ON_CUT_SPACINGS` where the manifold is less accurate.
        """
        y, value = feet.points.copy(), self.phi(feet.points)
        gradient = self.phi.gradient(y, CUT_DIFFERENCE_SHARE * self.size)
        with np.errstate(all="ignore"):
            step = -value[:, None] * gradient / dots(gradient, gradient)[:, None]
        length, rows = np.full(len(y), np.inf), np.arange(len(y))
        for k in range(SECANT_STEPS):
            next_length = norms(step[rows])
            # the first step uses the gradient in space and may be shorter than the second
            stalled = (k > 1) & (next_length >= length[rows]) & (length[rows] <= NEARLY_ON_CUT_SPACINGS * self.spacing)
            rows = rows[np.isfinite(next_length) & ~stalled]
            if not len(rows):
                break
            length[rows] = norms(step[rows])
            share = np.minimum(1.0, self.spacing / np.maximum(length[rows], ON_CUT_SHARE * self.size))
            reached = self.surface.closest_point(y[rows] + share[:, None] * step[rows]).points
            move, before = reached - y[rows], value[rows]
            y[rows], value[rows] = reached, self.phi(reached)
            with np.errstate(all="ignore"):
                step[rows] = -value[rows, None] * move / (value[rows] - before)[:, None]
            rows = rows[(length[rows] > ON_CUT_SHARE * self.size) & (value[rows] != 0)]
        tolerance = max(ON_CUT_SHARE * self.size, NEARLY_ON_CUT_SPACINGS * self.spacing)
        return self.surface.closest_point(y), (value == 0) | (length <= tolerance)

    def directions(self, feet: ClosestPoints) -> tuple[Floats, Floats, Floats]:
        """Return unit tangents (n, d), unit conormals (n, d) towards phi > 0, and a share (n,), at points of the cut.

        Tangents point so that phi > 0 is on the left, on surfaces without normals to either side; at points on a curve
        they are zero. The share is the length of phi's gradient along the manifold over that in space: it vanishes
        where the cut branches or only touches.
        """
        step = CUT_DIFFERENCE_SHARE * self.size
        edge = np.flatnonzero(feet.edge >= 0)
        if self.knows_directions or not len(edge):
            return self._directions_inside(feet)
        # Differences across the edge would tilt the tangent plane: directions are extrapolated from inside.
        lean = outward_conormals(self.surface, feet.take(edge), step)
        near, far = (self.surface.closest_point(feet.points[edge] - distance * step * lean) for distance in (2.0, 4.0))
        inner = self._directions_inside(ClosestPoints.join([near, far]))
        whole = self._directions_inside(feet)
        for values, of_inner in zip(whole, inner, strict=True):
            first, second = of_inner[: len(edge)], of_inner[len(edge) :]
            if values.ndim == 2:
                aligned = np.where(dots(first, second)[:, None] < 0, -second, second)
                first = unit(2 * first - aligned)
            values[edge] = first
        return whole

    def _directions_inside(self, feet: ClosestPoints) -> tuple[Floats, Floats, Floats]:
        """Return the answers of :meth:`directions`; near the edge differences of closest points make them wrong."""
        step, dim = CUT_DIFFERENCE_SHARE * self.size, self.surface.dim
        gradient = self.phi.gradient(feet.points, step)
        if self.surface.manifold_dim == dim:
            across, along = gradient, np.stack([gradient[:, 1], -gradient[:, 0]], axis=1)
        elif self.surface.manifold_dim == 1:
            t = unit_tangents(self.surface, feet, step)
            across, along = dots(gradient, t)[:, None] * t, np.zeros_like(t)
        else:
            n = unit_normals(self.surface, feet, step)
            across = gradient - dots(gradient, n)[:, None] * n
            along = np.cross(across, n)
        with np.errstate(all="ignore"):
            share = norms(across) / norms(gradient)
        return unit(along), unit(across), np.where(np.isfinite(share), share, 0.0)
