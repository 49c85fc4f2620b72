"""How much error a cloud alone leaves in a solution, whatever the spacing.

Measured on spheres and tori with 2,000 to 50,000 samples, random or even, with noise of 0 to 5e-3, against solutions on
the exact surfaces with the same lattice, at spacings 0.2 to 0.025. What counts is the slope by which the surface is
wrong: a foot at a distance of some spacings slides by that slope times the distance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import Floats
from cpmkit_pointcloud.patches import Patches, exponents, fit_patches, neighbourhoods, patch_normals

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

#: Samples whose slopes are looked at.
SLOPE_SAMPLES = 500
#: What patches of one degree more differ by, over the error of the blended surface's slope: of even degrees 1.2 to
#: 2.3, of odd ones, which share more with the next, 0.7 to 1.3; on random samples, with noise and without.
DIFFERENCE_OVER_ERROR = (1.75, 1.0)
#: Error of a solution as a share of its range, over the slope's error, on curves and on surfaces; over its square.
ERROR_PER_SLOPE, ERROR_PER_SLOPE_SQUARED = {2: 3.5, 3: 0.6}, 1.5
#: The same by the form ``galerkin``: over the slope's square, and over the distance of samples from the surface, as a
#: share of its extent, over the square root of their number: by so much the noise of all samples shifts all of it.
#: Values given on a curve were missed by up to five times as much beside it; without noise it is below 1e-5.
INTEGRAL_ERROR_PER_SLOPE_SQUARED, INTEGRAL_ERROR_PER_SHIFT = 0.2, 7.0
#: Of plain samples: the share over the distance to the nearest sample in spacings, and the largest that was seen.
PLAIN_ERROR_PER_SPACING, WORST_PLAIN_ERROR = 0.8, 0.3
#: Neighbours by which the density of plain samples is measured.
DENSITY_NEIGHBOURS = 6


def slope_error(points: Floats, patches: Patches, tree: cKDTree, normals: Floats | None) -> tuple[float, float]:
    """Return the root mean square error of the surface's slope, and the median width of its bumps as a length.

    The slope is that of ``patches``, one for each of ``points`` (n, d), against patches of the next degree, at 500
    samples at most; the error is 0 if the neighbours of none of these determine both patches. ``tree`` is that of the
    points; ``normals`` (n, d) or None separate sheets. The error includes truncation and noise; on even samples without
    noise it is overestimated up to 4 times.
    """
    rows = np.sort(np.random.default_rng(0).choice(len(points), min(SLOPE_SAMPLES, len(points)), replace=False))
    degree = patches.degree + 1
    needed = len(exponents(degree, points.shape[1] - 1)) + 1
    count = min(max(patches.neighbours, needed), len(points))
    finer = fit_patches(points, neighbourhoods(points, tree, count, normals, rows), degree, rows)
    determined = (finer.degrees == degree) & (patches.degrees[rows] == patches.degree)
    own, other = patch_normals(patches)[rows][determined], patch_normals(finer)[determined]
    other = np.where(np.einsum("nd,nd->n", own, other)[:, None] < 0.0, -other, other)
    square = np.sum((own - other) ** 2, axis=1)
    slope = np.sqrt(square.sum() / max(len(square), 1)) / DIFFERENCE_OVER_ERROR[patches.degree % 2]
    return float(slope), float(np.median(np.sqrt(patches.radii[rows] * finer.radii)))


def fitted_floor(slope: float, width: float, spacing: float, dim: int) -> float:
    """Return the error by the form ``collocation``, relative to a solution's range and at most 1, on a fitted surface.

    ``slope`` and ``width`` are those of :func:`slope_error`; ``width`` of the bumps and the grid's ``spacing`` have one
    unit of length; ``dim`` is that of the space. A lattice that is finer than the bumps follows them, and what their
    slopes cost falls with the square of the spacing. What is left is that a bumpy surface is larger than a smooth one,
    by the square of its slope.
    """
    followed = min(1.0, (spacing / width) ** 2)
    return min(1.0, ERROR_PER_SLOPE[dim] * slope * followed + ERROR_PER_SLOPE_SQUARED * slope**2)


def integral_floor(slope: float, noise: float, count: int) -> float:
    """Return the error by the form ``galerkin``, relative to a solution's range and at most 1, for ``count`` samples.

    ``slope`` is that of :func:`slope_error`, ``noise`` the samples' root mean square distance from the surface, over
    the longest side of the cloud's box.
    """
    shift = noise / float(np.sqrt(count))
    return min(1.0, INTEGRAL_ERROR_PER_SLOPE_SQUARED * slope**2 + INTEGRAL_ERROR_PER_SHIFT * shift)


def plain_floor(points: Floats, tree: cKDTree, spacing: float) -> float:
    """Return the error, relative to a solution's range, at grid ``spacing`` if feet are the samples ``points`` (n, d).

    They jump from sample to sample. It is at most :data:`WORST_PLAIN_ERROR`, and 0 for a single point. ``tree`` is that
    of the points.
    """
    count = min(DENSITY_NEIGHBOURS, len(points) - 1)
    if not count:
        return 0.0
    rows = np.random.default_rng(0).choice(len(points), min(SLOPE_SAMPLES, len(points)), replace=False)
    reach = np.asarray(tree.query(points[rows], k=count + 1)[0])[:, -1]
    slide = np.sqrt(np.mean(reach**2)) / count ** (1.0 / (points.shape[1] - 1))
    return min(WORST_PLAIN_ERROR, float(PLAIN_ERROR_PER_SPACING * slide / spacing))
