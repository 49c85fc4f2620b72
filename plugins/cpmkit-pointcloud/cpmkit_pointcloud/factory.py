"""The kind ``pointcloud.points``: from the keys of a scene to a source."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.plugin import Floats, InputError, place, shown
from cpmkit_pointcloud.blend import REACHED_NEIGHBOURS, blend_patches, shrink_patches
from cpmkit_pointcloud.cloud import OrientedPointCloud, PointCloud
from cpmkit_pointcloud.nearest import NearestSamples
from cpmkit_pointcloud.patches import exponents, fit_patches, neighbourhoods
from cpmkit_pointcloud.reading import as_cloud, as_normals, distinct_point_rows, read_points
from cpmkit_pointcloud.samples import build_kd_tree

#: A cloud that ends at a larger share of its samples is open; at fewer it may only be sampled too thinly there.
OPEN_RIM_SHARE = 0.01
#: Neighbours of a fit, by the dimension of the space and the degree.
FIT_NEIGHBOURS = {2: {1: 5, 2: 7, 3: 9, 4: 11}, 3: {1: 12, 2: 20, 3: 30, 4: 45}}


def points(
    *,
    file: str | Path | None = None,
    points: Any = None,
    method: str = "mls",
    degree: int = 2,
    neighbours: int | None = None,
    normals: Any = None,
    closed: bool = True,
) -> PointCloud | NearestSamples:
    """Return the surface (in the plane: the curve) that a point cloud samples.

    Parameters
    ----------
    file : str or Path
        A PLY, XYZ, TXT, CSV, NPY or PCD file.
    points : (n, 2) or (n, 3) array
        Instead of a file. Of points at the same place the first one counts.
    method : "mls" or "nearest"
        Moving least squares: polynomial patches fitted around every sample and blended into one smooth
        surface. Or the nearest sample: then the options below are ignored.
    degree : 1 to 4
        Of the patches. The error of a foot falls with the power degree + 1 of the distance between samples or faster.
    neighbours : int, optional
        How many samples a patch is fitted to, its own included, at least as many as it has coefficients; by default
        12, 20, 30, 45 for the degrees 1 to 4, on curves 5, 7, 9, 11. More of them average noise better.
    normals : file or (n, d) array, optional
        One normal a point, all on the same side of the surface: with them samples of another sheet
        close by are distinguished, and the surface has a side.
    closed : bool
        True: a cloud whose surface ends is refused. False: the surface ends where the samples end, and its rim is
        edge 0.

    Raises
    ------
    InputError
        If both or neither of ``file`` and ``points`` are given, they hold no cloud, an option is none of those
        accepted, there are fewer points than d + 1, normals are of another number, zero or opposite to those of all
        neighbours, or the cloud is open and ``closed`` is not false.
    MissingDependencyError
        If a PCD file is given and Open3D is absent or cannot load.
    """
    if (file is None) == (points is None):
        raise InputError(
            f"pointcloud.points takes either points or a file, got {'neither' if file is None else 'both'}."
        )
    if method not in ("mls", "nearest"):
        raise InputError(f"method must be 'mls' or 'nearest', got {shown(method)}.")
    cloud_points = as_cloud(points if file is None else read_points(file))
    if method == "nearest":
        return NearestSamples(cloud_points)
    cloud_normals = None
    if normals is not None:
        cloud_normals = as_normals(read_points(normals) if isinstance(normals, (str, Path)) else normals, cloud_points)
    count = _neighbour_count(degree, neighbours, cloud_points.shape[1])
    return _fit_cloud(cloud_points, cloud_normals, degree, count, bool(closed))


def _neighbour_count(degree: Any, neighbours: Any, dim: int) -> int:
    """Return the number of samples in a fit: ``neighbours``, or if that is None the default of ``degree``.

    ``dim`` is that of the space. Raise InputError if the degree is not 1 to 4, or the number is not whole or below that
    of the patch's coefficients.
    """
    if not isinstance(degree, (int, np.integer)) or degree not in FIT_NEIGHBOURS[dim]:
        raise InputError(f"degree must be 1, 2, 3 or 4, got {shown(degree)}.")
    least = len(exponents(degree, dim - 1))
    count = FIT_NEIGHBOURS[dim][degree] if neighbours is None else neighbours
    if not isinstance(count, (int, np.integer)) or isinstance(count, bool) or count < least:
        raise InputError(
            f"neighbours must be a whole number of at least {least} for degree {degree}, got {shown(count)}."
        )
    return int(count)


def _fit_cloud(cloud_points: Floats, normals: Floats | None, degree: int, count: int, closed: bool) -> PointCloud:
    """Return the cloud of patches of ``degree``, each fitted to ``count`` of ``cloud_points`` (n, d) at most.

    ``normals`` (n, d) are unit vectors or None. Raise InputError if fewer than d + 1 points differ, a normal is
    opposite to those of all neighbours, or the cloud is open and ``closed`` is true.
    """
    first = distinct_point_rows(cloud_points)
    points, dim = cloud_points[first], cloud_points.shape[1]
    if len(points) < dim + 1:
        raise InputError(
            f"A cloud in {dim}D needs at least {dim + 1} points that differ, got {len(points)}; use analytic.point "
            "or method='nearest'."
        )
    normals = None if normals is None else normals[first]
    count = min(count, len(points))
    rows = np.arange(len(points))
    around = neighbourhoods(points, build_kd_tree(points), count, normals, rows)
    alone = np.flatnonzero((around == rows[:, None]).all(axis=1))
    if len(alone):
        raise InputError(
            f"normals must point to one side of the surface; at {len(alone)} points, the first at "
            f"{place(points[alone[0]])}, all neighbours have the opposite normal; turn those normals, or leave "
            "normals out."
        )
    patches = fit_patches(points, around, degree, rows)
    reached = FIT_NEIGHBOURS[2][4] if dim == 2 else REACHED_NEIGHBOURS
    share = min(1.0, (reached / count) ** (1.0 / (dim - 1)))
    surface = blend_patches(points, shrink_patches(patches, share), normals)
    cloud = (
        PointCloud(surface, first, len(cloud_points), closed, cloud_points)
        if normals is None
        else OrientedPointCloud(surface, first, len(cloud_points), closed, cloud_points, normals)
    )
    if closed:
        _refuse_open(cloud)
    return cloud


def _refuse_open(cloud: PointCloud) -> None:
    """Raise InputError if the surface ends at more than :data:`OPEN_RIM_SHARE` of the examined samples of ``cloud``."""
    ends, target = cloud.open_samples
    if ends > OPEN_RIM_SHARE * target:
        raise InputError(
            f"The cloud is open: at {ends} of {target} samples the surface ends; set closed=False, which gives it a "
            "rim, or add the samples that lack."
        )
