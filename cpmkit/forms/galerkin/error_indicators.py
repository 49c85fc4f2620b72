"""Estimates of errors from two solutions and from a single solution, and the dispersion of splines."""

from __future__ import annotations

import math

import numpy as np

from cpmkit.forms.form_records import Dispersion, ExpectedError
from cpmkit.forms.galerkin.dof_map import DofMap
from cpmkit.forms.galerkin.resolution import PERSISTING_AREA, Resolution
from cpmkit.forms.galerkin.solution_warnings import FOLDED_SHARE
from cpmkit.manifold.local_source import LocalSource
from cpmkit.mesh.mesh import SUPPORTED, UNSUPPORTED, CellGeometry
from cpmkit.meshing.curved_from_normals import own_curvature_support
from cpmkit.meshing.mesh_cache import mesh_cache_of
from cpmkit.types import Floats, Ints

#: Largest divisors: on meshes, where orders are lower; on smooth sources that are folded on the coarser lattice, or
#: curved about as sharply as the finer spacing on more than this share of their area, or with a layer narrower than so
#: many spacings; where boundaries end, a layer is not resolved, or folds of meshes persist.
MESH_DIVISOR, TURNING_DIVISOR, CURVED_AREA, SEEN_LAYER_SPACINGS, SLOW_DIVISOR = 2.5, 2.0, 1e-4, 1.6, 0.65
#: On smooth sources that are curved so sharply on the coarser lattice alone: along an edge whose radius is between both
#: spacings the largest error hardly falls (with a divisor of 6 it was three times the estimate; on a torus 8 was
#: right).
BENDING_DIVISOR = 3.0
#: On meshes that are folded on the coarser lattice, or on the finer one on more than a small share, and where charts
#: cut at folds alone on one of the lattices; where they cut at voids, on smooth sources whose folds persist on more
#: than this share of the area, and on solids with reentrant corners or edges.
FOLDED_DIVISOR, THIN_DIVISOR, THIN_SHARE = 1.25, 1.0, 0.1
#: Root mean square of third differences over that of errors, and largest over largest, of cells that follow the source
#: (on 22 problems at 250 to 3,000 unknowns: 60 to 240, and 50 to 300), of flat cells (95 to 110, and 80 to 150), of
#: cells curved from normals or folded sources (3 to 50, and 2 to 200), where boundaries end (22 to 36, and 25 to 50) or
#: charts cut at voids (11 to 50), and where they cut at folds alone or ends have singular functions (25 to 135).
SMOOTH, FLAT, ROUGH, ENDING, FOLDED = (145.0, 175.0), (100.0, 125.0), (22.0, 29.0), (30.0, 37.0), (60.0, 75.0)
#: These two ratios for cells curved from normals on organic meshes from 10,000 unknowns on (25 to 50, and 50 to 320).
RESOLVED = (32.0, 100.0)
#: The two ratios where a value and a flux are prescribed side by side, with the geometric mean of the root mean square
#: and the largest third difference: these are of order 1.5 and .5 there, the error is of order 1 (15 to 100, and 6 to
#: 48, at any position and spacing).
MIXED = (38.0, 16.0)
#: Where u is not singular at such a place, although it may be, third differences within the first distance of it are at
#: most as large as elsewhere (.6 to 1.03 times; where u is singular 1.4 to 25 times).
NEAR_SPACINGS, NEARBY_FACTOR = 2.5, 1.2
#: Largest differences of smooth and flat sources are 3 to 8 times their root mean square. If they exceed the first
#: factor, and the second share of the coefficients' range, there is a peak that the lattice does not resolve yet, and
#: third differences are too small. They are too small, too, if their root mean square exceeds that share: waves have
#: six spacings or fewer. (Peaks below that share are jumps beside boundaries, at 6,000 unknowns and more.)
PEAKED, WAVY = 10.5, 0.1
#: The share of the difference between a curved surface and its triangles that is in doubt: at least the first number,
#: or the second times the share of the area with edges that are not fully supported, and the third times that where
#: more than the last share is not supported at all. Over true errors of 23 meshes: .8 to 22.
LEAST_DOUBT, DOUBT_PER_SHARE, PILLOW_FACTOR, PILLOW_SHARE = 0.1, 3.0, 2.5, 0.05


def difference_order(
    resolution: Resolution, degree: int, ratio: float, coarser: Resolution | None, difference: float, eigenvalues: bool
) -> float:
    """Return the order p with which ``|u_h - u_rh| / (r^p - 1)`` estimates the error, at a ``ratio`` r of spacings.

    At r = 2 the divisor r^p - 1 is, on smooth sources, 1.1 to 2.8 with ``degree`` 1, 2.7 to 7 with degree 2 (5.4 to 14
    for ``eigenvalues``), and 5.4 to 14 with degree 3. It decreases with the root mean square ``difference`` of the two
    solutions, a share of the range, and with the spacing of the resolution ``coarser``, None if unknown. On meshes it
    is at most 2.5, and less where errors fall slowly.
    """
    # at orders 3 and 4 differences are 7 and 15 times the error; of eigenvalues, at order 4, 13 to 17 times (measured)
    smooth = {1: 2.4, 2: 12.0 if eigenvalues else 6.0, 3: 12.0}[degree]
    divisor = _divisor(resolution, smooth, coarser, difference)
    # the order follows from the divisor at r = 2, and from one of its own at the root of two; it is interpolated in the
    # logarithm of r between these, and constant beyond
    from_root = float(np.interp(divisor, (0.65, 1.0, 2.5, 6.0, 12.0), (0.42, 0.59, 1.25, 1.8, 2.8)))
    at_root = math.log(1 + from_root) / math.log(math.sqrt(2))
    at_two = math.log2(1 + divisor)
    share = min(max(2 * math.log2(ratio) - 1, 0.0), 1.0)
    return at_root + share * (at_two - at_root)


def _divisor(resolution: Resolution, smooth: float, coarser: Resolution | None, difference: float) -> float:
    """Return the divisor r^p - 1 of :func:`difference_order` at r = 2; ``smooth`` is the largest, on smooth sources."""
    if resolution.end_or_layer_reason():
        return SLOW_DIVISOR
    if resolution.coefficients.sampled.slow_part_of_solid or len(resolution.coefficients.sampled.mixed_edge):
        return THIN_DIVISOR
    lattices = [each.coefficients.sampled for each in (resolution, coarser) if each is not None]
    if any(each.has_charts for each in lattices):
        return min(smooth, THIN_DIVISOR if any(each.has_voids for each in lattices) else FOLDED_DIVISOR)
    spread = resolution.normal_spread
    coarser_share = 0.0 if coarser is None else coarser.normal_spread.unresolved_share
    persists = spread.unresolved_share > FOLDED_SHARE if coarser is None else resolution.folds_persist(coarser)
    if resolution.coefficients.sampled.geometry != "closest_point":
        folded = spread.unresolved_share > PERSISTING_AREA or coarser_share > FOLDED_SHARE
        return SLOW_DIVISOR if persists else min(smooth, FOLDED_DIVISOR if folded else MESH_DIVISOR)
    if persists and spread.unresolved_share > THIN_SHARE:
        return THIN_DIVISOR
    if (
        spread.bending_share > CURVED_AREA
        or coarser_share > FOLDED_SHARE
        or resolution.layer_spacings < SEEN_LAYER_SPACINGS
    ):
        return min(smooth, TURNING_DIVISOR)
    if coarser is not None and coarser.normal_spread.bending_share > CURVED_AREA:
        return min(smooth, BENDING_DIVISOR)
    # With larger differences, as shares of the range, errors are not yet asymptotic (of 370 pairs on smooth surfaces, 5
    # in 100 had true divisors of degree 2 below 5.8 for differences up to 3e-4, below 3 up to 3e-3, below 1.6 beyond).
    shares = np.array([3e-4, 3e-3, 2e-2])
    factor = float(np.interp(math.log(max(difference, shares[0])), np.log(shares), (7 / 6, 4 / 6, 0.45)))
    if coarser is None:
        return smooth * min(factor, 1.0)
    # The divisor falls with the coarser spacing, as a share of the manifold's largest side (medians of divisors: 8.3
    # below .13, 7.3 at .18, 6.4 at .23, 4.5 at .27, 3.4 at .33).
    side = float(np.ptp(np.asarray(coarser.scene.surface.bounds), axis=0).max())
    return smooth * min(factor, float(np.interp(coarser.spacing / side, (0.17, 0.32), (7 / 6, 1 / 2))))


def dispersion_of(degree: int, geometry: CellGeometry) -> Dispersion:
    """Return the dispersion of splines of a ``degree`` 1 to 3 on cells of a ``geometry``, by measured eigenvalues.

    Of quadratic splines (3.5 nodes a wavelength and 2.9) the first 144 eigenvalues of a sphere at h = .2 and .25 have
    errors of .0007 to .0018 (k h)^4; of linear splines .031 to .041 (k h)^2; of cubic splines .0005 to .001 (k h)^4
    beyond the first few, which the curvature of the sphere affects at spacings as coarse as these. On cells that follow
    a smooth source the first eigenvalues of the circle at h = .05 and of the sphere at .2 have .5 to 1.5 times these
    errors; with the square of h / radius the predicted errors would be a hundred times as large.
    """
    resolved, coarsest, power, waves = {1: (0.55, 0.75, 2, 0.035), 2: (1.8, 2.2, 4, 0.002), 3: (1.9, 2.2, 4, 0.001)}[
        degree
    ]
    return Dispersion(resolved, coarsest, power, waves, 0.02, power if geometry == "closest_point" else 2)


def single_solution_estimate(resolution: Resolution, u: Floats) -> ExpectedError | None:
    """Return an estimate of the error of ``u`` (n, channels) by third differences of its coefficients.

    None for splines of another degree than 2, for which nothing was measured, and where no two patches are adjacent.
    """
    dof_map, spread = resolution.coefficients.space.dof_map, resolution.normal_spread
    if dof_map.degree != 2:
        return None
    third, patches = highest_differences(dof_map, u)
    if not len(third):
        return None
    sampled = resolution.coefficients.sampled
    geometry = sampled.geometry
    if len(sampled.mixed_edge) and _is_largest_near(sampled.mixed_edge, dof_map, third, patches):
        ratios = MIXED
    elif geometry == "normals":
        ratios = _rough_ratios(RESOLVED, (spread.unresolved_share, (0.003, 0.01)))
    elif (sampled.has_tips and not sampled.singular) or sampled.has_voids:
        ratios = ENDING
    elif sampled.has_charts or sampled.has_tips:
        ratios = FOLDED
    elif geometry == "flat":
        ratios = FLAT
    else:
        ratios = _rough_ratios(SMOOTH, (spread.unresolved_share, (0.003, 0.02)), (spread.bending_share, (0.04, 0.1)))
    rms, largest = np.sqrt(np.mean(third**2, axis=0)), np.abs(third).max(axis=0)
    if ratios is MIXED:
        return ExpectedError(np.sqrt(rms * largest) / ratios[0], largest / ratios[1], False, differences_cancel=True)
    even = min(ratios) > max(ROUGH + ENDING) and not sampled.has_charts
    peaked = largest > PEAKED * rms
    unresolved = even and bool((np.where(peaked, largest, rms) > WAVY * np.ptp(u, axis=0)).any())
    return ExpectedError(rms / ratios[0], largest / ratios[1], unresolved)


def _is_largest_near(points: Floats, dof_map: DofMap, differences: Floats, patches: Ints) -> bool:
    """Return whether ``differences`` (k, channels), in ``patches`` (k,), of some channel are largest near ``points``.

    Largest is `NEARBY_FACTOR` times as large as elsewhere, near is within `NEAR_SPACINGS` of a point (n, d).
    """
    from scipy.spatial import cKDTree

    reach = NEAR_SPACINGS * dof_map.spacing
    tree = cKDTree(points)
    distance = tree.query(dof_map.spacing * dof_map.cells, distance_upper_bound=reach)[0]
    near = (distance < reach)[patches]
    largest, elsewhere = (np.abs(differences[rows]).max(axis=0, initial=0.0) for rows in (near, ~near))
    return bool((largest > NEARBY_FACTOR * elsewhere).any())


def _rough_ratios(smooth: tuple[float, float], *areas: tuple[float, tuple[float, float]]) -> tuple[float, float]:
    """Return ratios (rms, largest) between ``smooth`` and `ROUGH`, for ``areas``: shares, each with its two limits.

    They are the smooth ratios if each share is below its first limit, and `ROUGH` if one is above its second; between
    the limits they are interpolated in the logarithm of the share.
    """
    rough = max(float(np.interp(math.log(max(area, limits[0])), np.log(limits), [0, 1])) for area, limits in areas)
    rms, largest = (first ** (1 - rough) * second**rough for first, second in zip(smooth, ROUGH, strict=True))
    return rms, largest


def highest_differences(dof_map: DofMap, u: Floats) -> tuple[Floats, Ints]:
    """Return the differences (k, channels) of order degree + 1 of coefficients along axes, and a patch (k,) of each.

    ``u`` (n, channels) are the coefficients. A difference extends over two adjacent patches: patches that touch, whose
    lattice cells are neighbours along the axis, and that have the same unknowns at common nodes. A pair of patches
    gives width^(d - 1) lines of width + 1 coefficients.
    """
    width, d = dof_map.width, dof_map.dim
    signs = [(-1.0) ** (width - place) * math.comb(width, place) for place in range(width + 1)]
    first, second = dof_map.touching.T
    steps = dof_map.cells[second] - dof_map.cells[first]
    found, patches = [np.zeros((0, u.shape[1]))], [first[:0]]
    for axis in range(d):
        pairs = np.flatnonzero((np.abs(steps).sum(axis=1) == 1) & (steps[:, axis] != 0))
        ahead = steps[pairs, axis] > 0
        low, high = (
            np.moveaxis(dof_map.unknowns[np.where(ahead, *ends)].reshape(-1, *[width] * d), 1 + axis, -1)
            for ends in ((first[pairs], second[pairs]), (second[pairs], first[pairs]))
        )
        joined = (low[..., 1:] == high[..., :-1]).all(axis=tuple(range(1, d + 1)))
        lines = np.concatenate([low[joined], high[joined][..., -1:]], axis=-1).reshape(-1, width + 1)
        found.append(sum(sign * u[lines[:, place]] for place, sign in enumerate(signs)))
        patches.append(np.repeat(first[pairs[joined]], width ** (d - 1)))
    return np.concatenate(found), np.concatenate(patches)


def support_floor(surface: LocalSource, area: float, difference: float | None) -> float:
    """Return the error that curving a mesh from its normals leaves in solutions, as a share of their range.

    The ``surface`` is a mesh that is read as smooth, or a union of such, and ``area`` that of the curved surface.
    ``difference`` is the root mean square difference of a solution on it from one on the triangles, as a share of the
    range; by default the relative difference of their areas, which is as a rule larger. The error is 0 if a part of the
    source has no mesh that is the same at any spacing.
    """
    by_member = [_areas_by_support(member) for member in surface.members]
    areas = np.array([member for member in by_member if member is not None])
    if len(areas) < len(by_member):
        return 0.0
    flat, unsupported, doubtful = areas.sum(axis=0)
    change = abs(area / flat - 1) if difference is None else difference
    doubt = max(LEAST_DOUBT, min(1.0, DOUBT_PER_SHARE * doubtful / flat))
    return float(min(1.0, change * doubt * (PILLOW_FACTOR if unsupported > PILLOW_SHARE * flat else 1.0)))


def _areas_by_support(surface: LocalSource) -> Floats | None:
    """Return the areas (3,) of a source's triangles: of all, of those with an unsupported edge, with a doubtful edge.

    For support see :class:`CurvatureSupport`; unsupported edges are doubtful too. None if the source has no mesh that
    is the same at any spacing, or if that mesh was not made yet.
    """
    cache, support = mesh_cache_of(surface), own_curvature_support(surface)
    if cache is None or support is None:
        return None
    corners = cache.mesh.vertices[cache.mesh.cells]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    has_edge = [support.unsupported(limit)[cache.mesh.edges.of_cells].any(axis=1) for limit in (UNSUPPORTED, SUPPORTED)]
    return np.array([areas.sum(), *(areas[rows].sum() for rows in has_edge)])
