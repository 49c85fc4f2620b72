"""The closest point source: samples of the zero set in a k-d tree, and a descent from those that may lead nearest."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from cpmkit.plugin import Bools, ClosestPoints, Floats, InputError, Ints, as_points, dots, norms, positive, unit
from cpmkit_neural.feet import descend, project, tangent_projection
from cpmkit_neural.field import SineNetwork
from cpmkit_neural.tetrahedra import zero_triangles

#: Queries that are answered at a time: temporary arrays stay in the cache.
NEURAL_PARCEL_QUERIES = 1024
#: How many of the nearest samples are looked at, and from how many of them a query descends at most.
NEAREST_SAMPLES, MOST_DESCENT_STARTS = 48, 8
#: A mesh has at least this many cells along the longest side of the bounds.
NEURAL_LEAST_CELLS = 32


@dataclass(frozen=True, eq=False)
class NeuralSurface:
    """The points inside ``bounds`` at which a network is zero.

    Attributes
    ----------
    field : SineNetwork
    bounds : (2, 3) float64
        The corners of a box that holds the surface.
    samples, directions : (k, 3) float64
        Points of the surface and its unit normals there.
    bending : (k,) float64
        The largest curvature at the samples, or more.
    covering : float
        Each point of the surface has a sample within about this distance.
    tree : scipy.spatial.KDTree
        Of the samples.
    """

    field: SineNetwork
    bounds: Floats
    samples: Floats
    directions: Floats
    bending: Floats
    covering: float
    tree: KDTree

    dim = 3
    manifold_dim = 2
    exact = True

    @property
    def size(self) -> float:
        """The diagonal of the bounds, to which tolerances are relative."""
        return float(norms(self.bounds[1:] - self.bounds[0])[0])

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of ``x`` (n, 3); ``doubtful`` where a nearer one cannot be ruled out.

        Raises
        ------
        InputError
            If ``x`` holds NaN or infinity, or its shape is not (n, 3).
        """
        x = as_points(x, 3)
        parcels = [x[start : start + NEURAL_PARCEL_QUERIES] for start in range(0, len(x), NEURAL_PARCEL_QUERIES)] or [x]
        return ClosestPoints.join([self._feet(parcel) for parcel in parcels])

    def normals(self, feet: ClosestPoints, /) -> Floats:
        """Return (n, 3) unit normals at ``feet``: where the network grows."""
        return unit(self.field.gradient(feet.points)[1])

    def mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return vertices (v, 3) on the surface and triangles (m, 3), of about ``spacing`` or smaller."""
        coarsest = np.ptp(self.bounds, axis=0).max() / NEURAL_LEAST_CELLS
        vertices, triangles = triangulate(self.field, self.bounds, min(positive(spacing, "spacing"), coarsest))
        feet = self.closest_point(vertices)
        corners = feet.points[triangles]
        facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        inward = dots(facing, self.normals(feet)[triangles].sum(axis=1)) < 0
        return feet.points, np.where(inward[:, None], triangles[:, ::-1], triangles)

    def _feet(self, x: Floats) -> ClosestPoints:
        found = self.tree.query(x, NEAREST_SAMPLES)
        gap, near = np.asarray(found[0]), np.asarray(found[1])
        points, distance = self.samples[near[:, 0]], gap[:, 0].copy()
        doubtful, untried = np.zeros(len(x), dtype=bool), np.ones(near.shape, dtype=bool)
        for _ in range(MOST_DESCENT_STARTS):
            rows = np.flatnonzero(untried.any(axis=1))
            if not len(rows):
                break
            start = near[rows, untried[rows].argmax(axis=1)]
            foot, converged = descend(self.field, x[rows], self.samples[start], 2 * self.covering, self.size)
            away = norms(x[rows] - foot)
            better = away <= distance[rows]
            points[rows[better]], distance[rows[better]] = foot[better], away[better]
            doubtful[rows] |= ~converged
            untried[rows] &= ~self._beside(self.samples[start], self.directions[start], near[rows])
            untried[rows] &= ~self._beside(foot, unit(self.field.gradient(foot)[1]), near[rows])
            untried &= self._may_lead_nearer(gap, near, distance)
        doubtful |= untried.any(axis=1)
        doubtful |= self._may_lead_nearer(gap[:, -1:], near[:, -1:], distance)[:, 0]  # then others may, too
        inside = np.full(len(x), -1)  # the surface is closed: no foot lies on an edge
        return ClosestPoints(points, distance, inside, doubtful=doubtful)

    def _may_lead_nearer(self, gap: Floats, near: Ints, distance: Floats) -> Bools:
        """Return (n, k): whether a point within ``covering`` of a sample may be nearer than ``distance``.

        To second order the squared distance from a query falls by at most r^2 (1 + curvature * distance) on the
        way from a sample to a closest point that is r away from it.
        """
        distance = distance[:, None]
        fall = self.covering**2 * (1 + self.bending[near] * distance)
        nearer: Bools = (gap - distance) * (gap + distance) <= fall  # squares of far queries would lose digits
        return nearer

    def _beside(self, points: Floats, normals: Floats, near: Ints) -> Bools:
        """Return (n, k): which samples lie around ``points`` (n, 3), and not on the other side of a thin part."""
        around = np.linalg.norm(self.samples[near] - points[:, None], axis=2) <= 2 * self.covering
        beside: Bools = around & (np.einsum("nki,ni->nk", self.directions[near], normals) > 0.7)
        return beside


def neural_surface(field: SineNetwork, bounds: Any, resolution: float) -> NeuralSurface:
    """Return the zero set of ``field`` in ``bounds``, with samples from a lattice of ``resolution`` cells a side.

    Raises
    ------
    InputError
        If the bounds are none, hold no zero set, or one that runs out of them.
    """
    box = as_points(bounds, 3, "bounds")
    if len(box) != 2 or not (box[0] < box[1]).all():
        raise InputError(f"bounds must be the lower and the upper corner of a box, got {box.tolist()}.")
    spacing = np.ptp(box, axis=0).max() / positive(resolution, "resolution")
    vertices, triangles = triangulate(field, box, spacing)
    sides = vertices[triangles] - vertices[np.roll(triangles, 1, axis=1)]
    # no point of a triangle is farther from all its corners than its longest side / sqrt(3)
    covering = float(np.linalg.norm(sides, axis=2).max() / np.sqrt(3))
    samples, found = project(field, vertices, spacing, float(norms(box[1:] - box[0])[0]))
    samples = samples[found]
    _, gradient, hessian = field.hessian(samples)
    tangential = tangent_projection(unit(gradient))
    bending = np.linalg.norm(tangential @ hessian @ tangential, axis=(1, 2)) / norms(gradient)
    return NeuralSurface(field, box, samples, unit(gradient), bending, covering, KDTree(samples))


def triangulate(field: SineNetwork, bounds: Floats, spacing: float) -> tuple[Floats, Ints]:
    """Return vertices (v, 3) near the zero set of ``field``, and triangles (m, 3), from a lattice of ``spacing``."""
    cells = np.ceil(np.ptp(bounds, axis=0) / spacing).astype(np.int64)
    step = np.ptp(bounds, axis=0) / cells
    nodes = bounds[0] + step * np.indices(cells + 1).reshape(3, -1).T
    values = np.concatenate(
        [field.value(part) for part in np.array_split(nodes, len(nodes) // NEURAL_PARCEL_QUERIES + 1)]
    )
    values = values.reshape(cells + 1)
    if not (values < 0).any():
        raise InputError(f"the network is zero nowhere in the bounds: its values start at {values.min():.6g}.")
    if (values < 0).sum() > (values[1:-1, 1:-1, 1:-1] < 0).sum():
        raise InputError("the zero set runs out of the bounds; widen them until the network is positive all around.")
    vertices, triangles = zero_triangles(values)
    return bounds[0] + step * vertices, triangles
