"""A manifold and a function of position that cuts it: projection on the cut, and the directions at its points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import (
    Bools,
    ClosestPoints,
    Floats,
    LocalSource,
    dots,
    norms,
    outward_conormals,
    unit,
    unit_normals,
    unit_tangents,
)
from cpmkit_combinations.position_function import PositionFunction

#: Steps of the secant method on the way to the cut.
SECANT_STEPS = 12
#: A point is on the cut when the last step was shorter than this, relative to the size; or, of a manifold that knows
#: itself less well, relative to the spacing.
ON_CUT_SHARE, NEARLY_ON_CUT_SPACINGS = 1e-14, 1e-6
#: The step of differences, relative to the size.
CUT_DIFFERENCE_SHARE = 1e-4


@dataclass(frozen=True, eq=False)
class LevelCut:
    """The points of a manifold at which a function vanishes.

    All positions are relative to the centre of the manifold's bounds.

    Attributes
    ----------
    surface : LocalSource
        The manifold: a surface in space, a region of the plane, or a curve.
    phi : PositionFunction
    size : float
        Diagonal of the manifold's bounds.
    spacing : float
        Distance of the samples with which zeros are looked for.
    """

    surface: LocalSource
    phi: PositionFunction
    size: float
    spacing: float

    @property
    def knows_directions(self) -> bool:
        """True where the manifold's own normals or tangents are used, not differences of its closest points."""
        dimension = self.surface.manifold_dim
        return dimension == self.surface.dim or self.surface.knows_directions(dimension or 0)

    def project(self, feet: ClosestPoints) -> tuple[ClosestPoints, Bools]:
        """Return points of the cut near points of the manifold, and where that succeeded.

        The secant method along the manifold: phi's slope is that between the last two feet, so that neither normals
        nor the function's surface gradient are asked for. A step is no longer than a spacing.
        """
        y, value = feet.points.copy(), self.phi(feet.points)
        gradient = self.phi.gradient(y, CUT_DIFFERENCE_SHARE * self.size)
        with np.errstate(all="ignore"):
            step = -value[:, None] * gradient / dots(gradient, gradient)[:, None]
        length, rows = np.full(len(y), np.inf), np.arange(len(y))
        for k in range(SECANT_STEPS):
            following = norms(step[rows])
            # the first step knows the slope in space only and may be shorter than the second
            stalled = (k > 1) & (following >= length[rows]) & (length[rows] <= NEARLY_ON_CUT_SPACINGS * self.spacing)
            rows = rows[np.isfinite(following) & ~stalled]
            if not len(rows):
                break
            length[rows] = norms(step[rows])
            share = np.minimum(1.0, self.spacing / np.maximum(length[rows], ON_CUT_SHARE * self.size))
            moved = self.surface.closest_point(y[rows] + share[:, None] * step[rows]).points
            across, before = moved - y[rows], value[rows]
            y[rows], value[rows] = moved, self.phi(moved)
            with np.errstate(all="ignore"):
                step[rows] = -value[rows, None] * across / (value[rows] - before)[:, None]
            rows = rows[(length[rows] > ON_CUT_SHARE * self.size) & (value[rows] != 0)]
        near = max(ON_CUT_SHARE * self.size, NEARLY_ON_CUT_SPACINGS * self.spacing)
        return self.surface.closest_point(y), (value == 0) | (length <= near)

    def directions(self, feet: ClosestPoints) -> tuple[Floats, Floats, Floats]:
        """Return, at points of the cut, its unit tangents, unit conormals towards phi > 0, and phi's surface gradient.

        Tangents (n, d) have any sign; of a point on a curve they are zero. The length of the gradient is (n,), as a
        share of the gradient in space: it vanishes where the cut branches or only touches.
        """
        step = CUT_DIFFERENCE_SHARE * self.size
        edge = np.flatnonzero(feet.edge >= 0)
        if self.knows_directions or not len(edge):
            return self._directions(feet)
        # Differences across the edge would bend the tangent plane: directions are extrapolated from inside.
        lean = outward_conormals(self.surface, feet.take(edge), step)
        near, far = (self.surface.closest_point(feet.points[edge] - distance * step * lean) for distance in (2.0, 4.0))
        inner = self._directions(ClosestPoints.join([near, far]))
        whole = self._directions(feet)
        for values, of_inner in zip(whole, inner, strict=True):
            first, second = of_inner[: len(edge)], of_inner[len(edge) :]
            if values.ndim == 2:
                turned = np.where(dots(first, second)[:, None] < 0, -second, second)
                first = unit(2 * first - turned)
            values[edge] = first
        return whole

    def _directions(self, feet: ClosestPoints) -> tuple[Floats, Floats, Floats]:
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
