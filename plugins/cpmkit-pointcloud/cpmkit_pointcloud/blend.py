"""The surface of blended patches: built once from the samples, evaluated by compiled kernels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cpmkit.plugin import Bools, Floats, Ints, run_parcels
from cpmkit_pointcloud.patches import Patches, exponents

#: Samples whose neighbours are collected at a time.
COLLECTED_SAMPLES = 4096
#: Queries handed to a thread at a time.
BLEND_PARCEL_QUERIES = 2048
#: A patch counts as far as about this many neighbours lie: fewer leave holes between random samples.
REACHED_NEIGHBOURS = 20


@dataclass(frozen=True, eq=False)
class Blend:
    """Samples with their patches, and for every sample those that may count at a point to which it is the nearest.

    A patch i counts at y within its radius r_i. The sample nearest to y is then no farther from y than sample i,
    so at most 2 r_i from sample i: only those list it.

    Attributes
    ----------
    points : (n, d) float64
        The samples.
    patches : Patches
        With radii within which they count, and coefficients in their units.
    starts : (n + 1,) int64
        Positions in ``reaching``.
    reaching : (starts[-1],) int32
        The patches of sample j are ``reaching[starts[j]:starts[j + 1]]``.
    """

    points: Floats
    patches: Patches
    starts: Ints
    reaching: NDArray[np.int32]

    @cached_property
    def arrays(self) -> tuple[Any, ...]:
        """Points, frames (n, 3, 3), radii, coefficients, degree, ``starts`` and ``reaching``, as the kernels read them.

        A cloud in the plane gets third coordinates of zero, and (0, 0, 1) as second tangent of its frames.
        """
        patches = self.patches
        frames = patches.frames
        if self.points.shape[1] == 2:
            frames = np.zeros((len(self.points), 3, 3))
            frames[:, ::2, :2] = patches.frames
            frames[:, 1, 2] = 1.0
        samples = (_pad_to_3d(self.points), frames, patches.radii, patches.coefficients)
        return (*samples, patches.degree, self.starts, self.reaching)


def shrink_patches(patches: Patches, share: float) -> Patches:
    """Return patches of the same height fields, with their radii and units of length multiplied by ``share``."""
    total = np.sum(exponents(patches.degree), axis=1)
    return replace(patches, radii=share * patches.radii, coefficients=patches.coefficients * share ** (total - 1.0))


def blend_patches(points: Floats, patches: Patches, normals: Floats | None) -> Blend:
    """Return the blend of ``patches`` (one for each of ``points`` (n, d)), with lists of the patches near each sample.

    The radii of the patches are those within which they count. With unit ``normals`` (n, d) of the samples, the list of
    a sample has no patches of samples whose normal points the other way: they are of another sheet.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(points)
    samples, reaching = [], []
    for start in range(0, len(points), COLLECTED_SAMPLES):
        rows = np.arange(start, min(start + COLLECTED_SAMPLES, len(points)))
        lists = tree.query_ball_point(points[rows], 2.0 * patches.radii[rows], return_sorted=False)
        counts = np.fromiter((len(entry) for entry in lists), dtype=np.int64, count=len(rows))
        samples.append(np.concatenate(lists).astype(np.int32))
        reaching.append(np.repeat(rows.astype(np.int32), counts))
    sample, patch = np.concatenate(samples), np.concatenate(reaching)
    if normals is not None:
        same = np.einsum("nd,nd->n", normals[sample], normals[patch]) > 0.0
        sample, patch = sample[same], patch[same]
    starts = np.concatenate([[0], np.cumsum(np.bincount(sample, minlength=len(points)))])
    return Blend(points, patches, starts, patch[np.argsort(sample, kind="stable")])


def find_feet(surface: Blend, x: Floats, nearest: Ints, tiny: float, closed: bool) -> tuple[Floats, Ints, Ints, Bools]:
    """Return feet (n, d) of ``x``, the sample (n,) nearest to each, its edge (n,), and (n,) whether it is doubtful.

    ``nearest`` (n,) are the samples nearest to the queries ``x`` (n, d); a search ends at a step of length ``tiny``. If
    ``closed``, every edge is -1. Else feet on the rim, and those beyond it, which are moved onto it, have edge 0. A
    foot is doubtful where the search did not converge or all samples lie on one side of it, unless it was moved onto
    the rim, and not finite where the patches define no surface.
    """
    from cpmkit_pointcloud import kernels

    n, dim = x.shape
    foot, element, edge = np.empty((n, 3)), np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    doubtful = np.empty(n, dtype=np.bool_)
    cloud, x = surface.arrays, _pad_to_3d(x)

    def work(start: int, stop: int) -> None:
        kernels.fill_feet(x, start, stop, nearest, cloud, tiny, closed, foot, element, edge, doubtful)

    run_parcels(work, n, BLEND_PARCEL_QUERIES)
    return np.ascontiguousarray(foot[:, :dim]), element, edge, doubtful


def surface_normals(surface: Blend, feet: Floats, element: Ints) -> Floats:
    """Return (n, d) unit normals at ``feet`` (n, d) of the surface; NaN where no patch reaches.

    ``element`` (n,) are the samples nearest to the feet. Signs are arbitrary: each is that of this sample's patch.
    """
    from cpmkit_pointcloud import kernels

    n, dim = feet.shape
    normal = np.empty((n, 3))
    cloud, y = surface.arrays, _pad_to_3d(feet)
    run_parcels(
        lambda start, stop: kernels.fill_normals(y, start, stop, element, cloud, normal), n, BLEND_PARCEL_QUERIES
    )
    return np.ascontiguousarray(normal[:, :dim])


def _pad_to_3d(points: Floats) -> Floats:
    """Return ``points`` (n, 2) with a third coordinate of zero, or ``points`` (n, 3) themselves."""
    return points if points.shape[1] == 3 else np.hstack([points, np.zeros((len(points), 1))])
