"""The kind ``tube``: all points at one distance from a curve, in space a tube around it, in the plane its offset."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpmkit.plugin import (
    Advice,
    ClosestPoints,
    ClosestPointSource,
    Floats,
    HasMesh,
    HasTranslation,
    InputError,
    Ints,
    Polyline,
    advice_of,
    as_points,
    as_vector,
    chain_segments,
    check_source,
    norms,
    place,
    positive,
    shown,
    source_repr,
    unit,
)
from cpmkit_combinations.sweep import swept

#: Nearer to the curve than this share of the radius, no direction leads away from it.
ON_CURVE_SHARE = 1e-10
#: Nearer than this the direction is rounding in part, and is taken anew from where it leads.
NEAR_CURVE_SHARE = 1e-4
#: A point of the tube may lie nearer to the curve than the radius by this share: curves are tried at samples.
RADIUS_MISMATCH_SHARE = 1e-3
#: Of these samples: their distance along the curve as a share of the radius, and how many directions around it.
REACH_STEP_SHARE, REACH_DIRECTIONS = 0.05, 16
#: No more samples than about this along the curve.
MOST_REACH_SAMPLES = 4096


@dataclass(frozen=True, eq=False)
class Tube:
    """The points at the distance ``radius`` from a curve; past an open end they round it off.

    Attributes
    ----------
    around : ClosestPointSource
        The curve.
    radius : float
        Below the curve's reach: each point this near to the curve has one foot on it.
    """

    around: ClosestPointSource
    radius: float

    __repr__ = source_repr

    @property
    def dim(self) -> int:
        """Dimension of the space."""
        return self.around.dim

    @property
    def manifold_dim(self) -> int:
        """One less than that of the space."""
        return self.dim - 1

    @property
    def exact(self) -> bool:
        """Whether the curve's feet are true nearest points: then the tube's are."""
        return self.around.exact

    @property
    def bounds(self) -> Floats:
        """(2, d) corners of the curve's box, the radius farther out."""
        return np.asarray(self.around.bounds, dtype=np.float64) + self.radius * np.array([[-1.0], [1.0]])

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d): from the foot on the curve, the radius towards ``x``.

        On the curve all directions across it are as good, and the feet are ``doubtful``.

        Raises
        ------
        InputError
            If ``x`` holds NaN or infinity, or its shape is not (n, d).
        """
        x = as_points(x, self.dim)
        middle = self.around.closest_point(x)
        away = x - middle.points
        length = norms(away)
        lost = length <= ON_CURVE_SHARE * self.radius
        if lost.any():
            away[lost], length[lost] = self._across(middle.points[lost]), 1.0
        feet = middle.points + (self.radius / length)[:, None] * away
        near = lost | (length < NEAR_CURVE_SHARE * self.radius)
        if near.any():
            feet[near] = self._put_back(feet[near])
        # Feet that were put back have left the line through the foot on the curve, and have a distance of their own.
        distance = np.where(near, norms(x - feet), np.abs(length - self.radius))
        doubtful = lost if middle.doubtful is None else lost | middle.doubtful
        return ClosestPoints(feet, distance, np.full(len(x), -1), doubtful=doubtful)

    def normals(self, feet: ClosestPoints, /) -> Floats:
        """Return (n, d) unit normals at ``feet``: away from the curve."""
        return unit(feet.points - self.around.closest_point(feet.points).points)

    def mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return vertices (v, d) on the tube and cells (m, d), triangles or segments, of about ``spacing``.

        Triangles are wound counterclockwise as seen from outside; segments have that on their right.

        Raises
        ------
        InputError
            If the curve itself cannot be drawn.
        """
        made = swept(_curves(self.around, positive(spacing, "spacing")), self.radius, spacing)
        return self.closest_point(made.points).points, made.cells

    def advice(self, spacing: float, /) -> Advice:
        """Return what the curve has to say of itself."""
        return advice_of(self.around, spacing)

    def translated(self, offset: Floats, /) -> Tube:
        """Return the same tube moved by ``offset`` (d,)."""
        if isinstance(self.around, HasTranslation):
            return replace(self, around=self.around.translated(as_vector(offset, self.dim, "offset")))
        from cpmkit_combinations.motion import moved

        return replace(self, around=moved(of=self.around, translation=offset))

    def _put_back(self, points: Floats) -> Floats:
        """Return the feet (n, d) of points near the tube: there directions away from the curve are exact."""
        middle = self.around.closest_point(points).points
        return np.asarray(middle + self.radius * unit(points - middle))

    def _across(self, points: Floats) -> Floats:
        """Return unit vectors (n, d) across the curve at points on it, by its feet a little way off along each axis."""
        step, best = 0.1 * self.radius, np.zeros(points.shape)
        for axis in np.eye(self.dim):
            found = points + step * axis
            found = found - self.around.closest_point(found).points
            best = np.where((norms(found) > norms(best))[:, None], found, best)
        return unit(best)


def tube(*, around: ClosestPointSource, radius: Any) -> Tube:
    """Return the points at one distance from a curve: a tube in space, in the plane the curve's offset to both sides.

    Parameters
    ----------
    around : source
        A curve. An open one is rounded off at its ends.
    radius : number
        The distance, above zero, and less than the curve's radii of curvature and half its distance from itself.

    Raises
    ------
    InputError
        If ``around`` is no curve, the radius is not above zero, or the tube would meet itself.

    Examples
    --------
    >>> import cpmkit as ck
    >>> torus = ck.source("tube", around=ck.source("analytic.circle", normal=[0, 0, 1]), radius=0.3)
    >>> torus.closest_point([[2.0, 0.0, 0.0]]).points.tolist()
    [[1.3, 0.0, 0.0]]
    """
    check_source(around, "what the tube lies around")
    if around.manifold_dim != 1:
        raise InputError(
            f"A tube lies around a curve, got {shown(around)} of manifold_dim {around.manifold_dim}; of a surface take "
            "a level set of its distance."
        )
    made = Tube(around, positive(radius, "radius"))
    if isinstance(around, HasMesh):
        _refuse_if_it_meets_itself(made, around)
    return made


def _refuse_if_it_meets_itself(made: Tube, around: HasMesh) -> None:
    size = float(np.ptp(made.around.bounds, axis=0).max())
    step = max(REACH_STEP_SHARE * made.radius, size / MOST_REACH_SAMPLES)
    points = swept(_curves(around, step), made.radius, made.radius, REACH_DIRECTIONS).points
    short = made.radius - made.around.closest_point(points).distance
    worst = int(np.argmax(short))
    if short[worst] > RADIUS_MISMATCH_SHARE * made.radius:
        raise InputError(
            f"A tube of the radius {made.radius:g} meets itself near {place(points[worst])}: the curve turns there, or "
            f"comes back to itself, within {made.radius - short[worst]:.3g}; take a smaller radius."
        )


def _curves(around: Any, spacing: float) -> list[Polyline]:
    if not isinstance(around, HasMesh):
        raise InputError(f"{type(around).__name__} cannot be drawn, so neither can a tube around it.")
    return chain_segments(*around.mesh(spacing))
