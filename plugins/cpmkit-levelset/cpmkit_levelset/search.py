"""The global part of the search: from which samples to descend, and when the nearest point is beyond doubt.

Each point of the zero set has a sample within the covering radius r. Around a sample s the squared distance from a
query x is, to second order, |x - s|^2 - 2 F u + u M u in tangential coordinates u, and its least value over |u| <= r
bounds the distance to all points that have s as their sample. When a point has been found, only samples whose bound is
below its distance can lead to a nearer one. These are tried, but for those whose model has its minimum where the search
has been. A query is doubtful where not all could be tried, or where the surface curves too much for its samples.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from cpmkit.plugin import Bools, Floats, Ints, norms
from cpmkit_levelset.descent import minimize_distance
from cpmkit_levelset.manifold import ZeroSet, normal_basis
from cpmkit_levelset.sample_kernels import (
    choose_starts,
    clear_nearby_samples,
    discard_untried,
    fill_models,
    keep_nearest,
)

#: How many of the nearest samples are looked at: first by every query, then by those for which that was too few.
SAMPLE_TIERS = (12, 192)
#: Pairs of queries and samples that are looked at in one go: their models take some 80 bytes each.
PAIRS_IN_ONE_GO = 200_000
#: Descents from different samples, for one query and tier: first from one, then from all that lead elsewhere at once.
LEVELSET_DESCENTS = 10
#: What a sample's model says is trusted to this share of the covering radius and of its curvature.
SAME_BASIN_COVERINGS, MODEL_TRUST_SHARE, STATIONARY_COVERINGS = 1.25, 0.1, 0.5
#: A descent that ends within this share of the covering radius from a crease has been stopped by it.
ON_CREASE_COVERINGS = 0.01
#: Samples whose radius of curvature is below this many covering radii have no model to trust.
ROUGH_RADIUS_COVERINGS = 1.0
#: A model's minimum is looked for up to this many covering radii from its sample.
FARTHEST_MINIMUM_COVERINGS = 4.0
MODEL_SHARES = np.array([MODEL_TRUST_SHARE, FARTHEST_MINIMUM_COVERINGS, STATIONARY_COVERINGS])

Keep = Callable[[Floats], Bools]


class Models(NamedTuple):
    """What samples say of queries to second order.

    Attributes
    ----------
    lowest : (n, k) float64
        A lower bound of the squared distance to what the sample stands for, less the squared distance to the sample.
    minimum : (n, k, d) float64
        Where the model has its minimum; NaN where it has none.
    promising : (n, k) bool
        Whether what the sample stands for may hold a point from which the query is seen at a right angle.
    """

    lowest: Floats
    minimum: Floats
    promising: Bools


@dataclass(frozen=True, eq=False)
class Layer:
    """A zero set with samples on it.

    Attributes
    ----------
    zero_set : ZeroSet
    samples : (k, d) float64
    tree : scipy.spatial.cKDTree
        Of the samples.
    tangents : (k, m, d) float64
        Principal directions at the samples, of unit length.
    curvatures : (k, m, d) float64
        Their curvature vectors: along direction i, M is 1 - curvatures_i . (x - s).
    covering : float
        Each point of the zero set has a sample within this distance.
    creases : tuple of ZeroSet
        Where a descent may end without being stationary; they are searched as layers of their own.
    """

    zero_set: ZeroSet
    samples: Floats
    tree: Any
    tangents: Floats
    curvatures: Floats
    covering: float
    creases: tuple[ZeroSet, ...] = ()

    @cached_property
    def largest_curvatures(self) -> Floats:
        """(k,) the largest curvature at the samples."""
        largest_curvatures: Floats = norms(self.curvatures).max(axis=1, initial=0.0)
        return largest_curvatures

    @cached_property
    def rough(self) -> Bools:
        """(k,) at which samples the zero set's radius of curvature is below the covering radius: models fail."""
        rough: Bools = ~(self.largest_curvatures * self.covering * ROUGH_RADIUS_COVERINGS <= 1.0)
        return rough

    def models(self, x: Floats, gap: Floats, near: Ints) -> Models:
        """Return the models of samples ``near`` (n, k) at queries ``x`` (n, d), whose distances are ``gap`` (n, k)."""
        models = Models(np.empty(near.shape), np.empty((*near.shape, x.shape[1])), np.empty(near.shape, dtype=bool))
        of_samples = self.samples, self.tangents, self.curvatures, self.largest_curvatures, self.covering
        fill_models(x, gap, near, *of_samples, MODEL_SHARES, *models)
        return models


@dataclass(frozen=True, eq=False)
class BestPoints:
    """The nearest points (n, d), NaN for none, their distances (n,), infinite for none, and which are certain (n,)."""

    points: Floats
    distance: Floats
    sure: Bools


@dataclass(frozen=True, eq=False)
class LayeredSet:
    """A zero set with creases: each face and each crease is searched by itself, as no descent crosses a crease.

    Attributes
    ----------
    layers : tuple of Layer
        Samples of the faces, then of the creases.
    corners : (c, d) float64
        The points at which creases meet.
    """

    layers: tuple[Layer, ...]
    corners: Floats

    @property
    def size(self) -> float:
        """The length that tolerances are relative to."""
        return self.layers[0].zero_set.size

    def find_nearest(self, x: Floats, known: Floats | None = None, keep: Keep | None = None) -> BestPoints:
        """Return the nearest points for the queries ``x`` (n, d); parameters as in :func:`find_nearest_points`."""
        result = find_nearest_points(self.layers[0], x, known, keep)
        for layer in self.layers[1:]:
            other = find_nearest_points(layer, x, result.distance, keep)
            nearer = other.distance < result.distance
            points = np.where(nearer[:, None], other.points, result.points)
            result = BestPoints(points, other.distance, result.sure & other.sure)
        for corner in self.corners if keep is None else self.corners[keep(self.corners)]:
            distance = norms(x - corner)
            nearer = distance < result.distance
            result.points[nearer], result.distance[nearer] = corner, distance[nearer]
        return result


def build_layer(zero_set: ZeroSet, samples: Floats, covering: float, creases: tuple[ZeroSet, ...] = ()) -> Layer:
    """Return the layer of ``zero_set`` with ``samples`` (k, d), one within ``covering`` of each of its points."""
    from scipy.spatial import cKDTree

    tangents, curvatures = _principal_curvatures(zero_set, samples)
    return Layer(zero_set, samples, cKDTree(samples), tangents, curvatures, covering, creases)


def find_nearest_points(where: Layer, x: Floats, known: Floats | None = None, keep: Keep | None = None) -> BestPoints:
    """Return the nearest points of a layer for the queries ``x`` (n, d).

    Parameters
    ----------
    where : Layer
    x : (n, d) float64
    known : (n,) float64, optional
        Distances within which an answer is wanted; where no point is nearer, the result is NaN at this distance.
    keep : callable, optional
        Of points (n, d): which belong to the manifold, (n,). Others are passed over.
    """
    n, d = x.shape
    distance = np.full(n, np.inf) if known is None else known.copy()
    points, sure = np.full((n, d), np.nan), np.zeros(n, dtype=bool)
    rows = np.arange(n)
    for count in SAMPLE_TIERS:
        last, most = count >= len(where.samples), min(count, len(where.samples))
        for some in np.array_split(rows, -(-len(rows) * most // PAIRS_IN_ONE_GO)) if len(rows) else ():
            before = BestPoints(points[some], distance[some], sure[some])
            after = _descend_from_samples(where, x[some], before, most, keep)
            points[some], distance[some], sure[some] = after.points, after.distance, after.sure
        rows = rows[~sure[rows]]
        if last or not len(rows):
            break
    return BestPoints(points, distance, sure)


def _descend_from_samples(where: Layer, x: Floats, before: BestPoints, count: int, keep: Keep | None) -> BestPoints:
    """Return the best points after descents from those of the ``count`` nearest samples that may lead nearer.

    ``before`` are those known for the queries ``x`` (n, d), ``keep`` as for :func:`find_nearest_points`.
    """
    gap, near = where.tree.query(x, np.arange(1, count + 1))
    lowest, minimum, untried = where.models(x, gap, near)
    starts, n = where.samples[near], len(x)
    points, best = before.points.copy(), before.distance.copy()
    reach = SAME_BASIN_COVERINGS * where.covering
    clear_nearby_samples(untried, minimum, starts, np.arange(n), points, reach)
    untried[:, 0] |= np.isinf(best)  # some point must be found, whatever the models say
    sure, failed, room = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool), np.full(n, LEVELSET_DESCENTS)
    active, most = np.arange(n), 1
    while True:
        active = active[: discard_untried(untried, active, gap, lowest, best, sure)]
        active = active[room[active] > 0]
        if not len(active):
            break
        rows, columns = np.empty((2, most * len(active)), dtype=np.int64)
        chosen = choose_starts(untried, minimum, starts, active, room, most, reach, rows, columns)
        rows, columns, most = rows[:chosen], columns[:chosen], LEVELSET_DESCENTS
        foot, converged = minimize_distance(where.zero_set, x[rows], starts[rows, columns], 2 * where.covering)
        stuck, end = rows[~converged], foot[~converged]
        for crease in where.creases:
            away = crease.distance_estimate(end) > ON_CREASE_COVERINGS * where.covering
            stuck, end = stuck[away], end[away]
        failed[stuck] = True
        clear_nearby_samples(untried, minimum, starts, rows, foot, reach)
        distance = norms(x[rows] - foot)
        if keep is not None:
            distance = np.where(keep(foot), distance, np.inf)
        keep_nearest(points, best, rows, foot, distance)
    # the samples beyond the last may lead to a nearer point if the most that any of these promises would do it
    more = _may_be_nearer(gap[:, -1], lowest.min(axis=1), best) & (count < len(where.samples))
    return BestPoints(points, best, sure & ~failed & ~more & ~where.rough[near[:, 0]])


def _may_be_nearer(gap: Floats, lowest: Floats, best: Floats) -> Bools:
    """Return (n,) whether gap^2 + lowest <= best^2, all (n,), True for NaN."""
    with np.errstate(all="ignore"):
        # (gap - best) (gap + best), because the squares of far queries differ by less than they are rounded
        return ~((gap - best) * (gap + best) + lowest > 0)


def _principal_curvatures(zero_set: ZeroSet, samples: Floats) -> tuple[Floats, Floats]:
    """Return principal directions and their curvature vectors, each (k, m, d), at ``samples`` (k, d)."""
    normals = normal_basis([field.gradient(samples)[1] for field in zero_set.fields])
    shapes = [zero_set.local_shape(samples + normal, samples) for normal in normals]
    tangents = shapes[0].tangents
    if tangents.shape[1] == 2:
        bending = shapes[0].bending
        angle = 0.5 * np.arctan2(2 * bending[:, 0, 1], bending[:, 0, 0] - bending[:, 1, 1])
        cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
        first, second = tangents[:, 0], tangents[:, 1]
        tangents = np.stack([cosine * first + sine * second, cosine * second - sine * first], axis=1)
    curvatures = np.zeros_like(tangents)
    for normal, shape in zip(normals, shapes, strict=True):
        along = np.einsum("nai,nbi->nab", tangents, shape.tangents, optimize=False)
        bending = np.einsum("nab,nbc,nac->na", along, shape.bending, along, optimize=False)
        curvatures -= bending[:, :, None] * normal[:, None]
    return tangents, curvatures
