"""Errors estimated from one solution: by third differences of its coefficients, and by the support of a curved mesh.

Splines of degree 2 approximate a function up to a share of h^3 times its third derivatives, and third differences of
their coefficients are of the same size. They do not contain errors of the samples, and are one half of an estimate; the
other half is the difference from another solution, which is independent of them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cpmkit.forms.form_records import ExpectedError
from cpmkit.forms.galerkin.dof_map import DofMap
from cpmkit.forms.galerkin.resolution import Resolution
from cpmkit.manifold.local_source import LocalSource
from cpmkit.mesh.normals_of_mesh import SUPPORTED, UNSUPPORTED
from cpmkit.meshing.curved_from_normals import source_support
from cpmkit.meshing.mesh_cache import mesh_cache_of
from cpmkit.runtime.compilation import compiled
from cpmkit.types import Floats, Ints

#: Root mean square of third differences over that of errors, and largest over largest, of cells that follow the source
#: (measured on 22 problems at 250 to 3,000 unknowns: 60 to 240, and 50 to 300), of flat cells (95 to 110, and 80 to
#: 150), of cells curved from normals or folded sources (3 to 50, and 2 to 200), and where boundaries end (22 to 36, and
#: 25 to 50).
SMOOTH, FLAT, ROUGH, ENDING = (145.0, 175.0), (100.0, 125.0), (22.0, 29.0), (30.0, 37.0)
#: The same of cells curved from normals where less than the first share of the area is folded, as on organic meshes
#: from some 10,000 unknowns on (25 to 50, and 50 to 320); from the second share on the ratios are ROUGH.
RESOLVED, FOLDED_AREA = (32.0, 100.0), (0.003, 0.01)
#: Largest differences of smooth and flat sources are 3 to 8 times their root mean square. Where they are more than the
#: first factor, and more than the second share of the coefficients' range, there is a peak that the lattice does not
#: resolve yet, and third differences are too small. They are too small, too, if their root mean square exceeds that
#: share: a wave has six spacings or fewer. (Below it peaks are jumps beside boundaries, at 6,000 unknowns and more.)
PEAKED, WAVY = 10.5, 0.1
#: Sources that are folded, and that are sharply curved, on less than the first share of their area count as smooth, on
#: more than the second as rough, and are interpolated in between.
TURNED_AREA, SHARPLY_CURVED_AREA = (0.003, 0.02), (0.04, 0.1)
#: At least so large a share of the difference between a curved surface and its triangles is in doubt; three times the
#: share of the area with edges that are not fully supported; and 2.5 times that where more than the last share is not
#: supported at all. Over true errors of 23 meshes: .8 to 22.
LEAST_DOUBT, DOUBT_PER_SHARE, PILLOW_FACTOR, PILLOW_SHARE = 0.1, 3.0, 2.5, 0.05


@compiled
def write_differences(
    touching: Any, cells: Ints, unknowns: Any, strides: Ints, signs: Floats, u: Floats, out: Floats
) -> int:
    """Fill ``out`` (k, channels) with differences along lines of coefficients through adjacent patches; return k.

    The pairs ``touching`` (t, 2) of patches are adjacent if their ``cells`` (p, d) differ by one along one axis and the
    ``unknowns`` (p, width^d) at their common nodes are the same. Each pair gives width^(d-1) lines of width + 1
    coefficients of u (n, channels), multiplied by ``signs`` (width + 1,) and summed. ``strides`` (d,) are the distances
    of neighbours along each axis in a row of ``unknowns``.
    """
    width, dim, found = len(signs) - 1, cells.shape[1], 0
    block, line = unknowns.shape[1], np.empty(len(signs), dtype=np.int64)
    for pair in range(len(touching)):
        first, second = touching[pair, 0], touching[pair, 1]
        along, apart = 0, 0
        for axis in range(dim):
            step = cells[second, axis] - cells[first, axis]
            apart += abs(step)
            if step != 0:
                along = axis
        if apart != 1:
            continue
        low, high = (first, second) if cells[second, along] > cells[first, along] else (second, first)
        stride, joined = strides[along], True
        for at in range(block):
            if (at // stride) % width < width - 1 and unknowns[low, at + stride] != unknowns[high, at]:
                joined = False
                break
        if not joined:
            continue
        for at in range(block):
            if (at // stride) % width == 0:
                for place in range(width):
                    line[place] = unknowns[low, at + place * stride]
                line[width] = unknowns[high, at + (width - 1) * stride]
                for channel in range(u.shape[1]):
                    total = 0.0
                    for place in range(width + 1):
                        total += signs[place] * u[line[place], channel]
                    out[found, channel] = total
                found += 1
    return found


def single_solution_estimate(resolution: Resolution, u: Floats) -> ExpectedError | None:
    """Return an estimate of the error of u (n, channels) from third differences of its coefficients.

    None for splines of another degree than 2, for which nothing was measured, and where no two patches are adjacent.
    """
    dof_map, spread = resolution.coefficients.space.dof_map, resolution.normal_spread
    third = highest_differences(dof_map, u) if dof_map.degree == 2 else u[:0]
    if not len(third):
        return None
    geometry = resolution.sampled.geometry
    if geometry == "normals":
        ratios = _interpolated_ratios(RESOLVED, _rough_share(spread.unresolved_share, FOLDED_AREA))
    elif resolution.sampled.mesh.beyond_tip.any():
        ratios = ENDING
    elif geometry == "flat":
        ratios = FLAT
    else:
        rough = max(
            _rough_share(spread.unresolved_share, TURNED_AREA), _rough_share(spread.bending_share, SHARPLY_CURVED_AREA)
        )
        ratios = _interpolated_ratios(SMOOTH, rough)
    rms, largest = np.sqrt(np.mean(third**2, axis=0)), np.abs(third).max(axis=0)
    even = min(ratios) > max(ROUGH + ENDING)
    peaked = largest > PEAKED * rms
    unresolved = even and bool((np.where(peaked, largest, rms) > WAVY * np.ptp(u, axis=0)).any())
    return ExpectedError(rms / ratios[0], largest / ratios[1], unresolved)


def highest_differences(dof_map: DofMap, u: Floats) -> Floats:
    """Return (k, channels) the differences of order degree + 1 of coefficients along axes, over adjacent patches."""
    width = dof_map.width
    signs = np.array([(-1.0) ** (width - place) * math.comb(width, place) for place in range(width + 1)])
    out = np.empty((len(dof_map.touching) * width ** (dof_map.dim - 1), u.shape[1]))
    tables = dof_map.touching, dof_map.cells, dof_map.unknowns, np.array(dof_map.strides, dtype=np.int64)
    return out[: write_differences(*tables, signs, np.ascontiguousarray(u), out)]


def _rough_share(area: float, limits: tuple[float, float]) -> float:
    """Return 0 if ``area`` is below the first limit, 1 above the second, and interpolated in its logarithm between."""
    return float(np.interp(math.log(max(area, limits[0])), np.log(limits), [0, 1]))


def _interpolated_ratios(smooth: tuple[float, float], rough: float) -> tuple[float, float]:
    """Return ratios between the ``smooth`` ratios (for ``rough`` = 0) and `ROUGH` (for ``rough`` = 1)."""
    rms, largest = (first ** (1 - rough) * second**rough for first, second in zip(smooth, ROUGH, strict=True))
    return rms, largest


def support_floor(surface: LocalSource, area: float, difference: float | None) -> float:
    """Return the error that curving a mesh from its normals leaves in solutions, as a share of their range.

    It is 0 if a part of the source is no mesh.

    Parameters
    ----------
    surface : LocalSource
        The manifold, a mesh that is read as smooth, or a union of such.
    area : float
        The area of the curved surface.
    difference : float, optional
        Root mean square difference of a solution on the curved surface from one on the triangles, as a share of the
        range. By default the relative difference of their areas, which is as a rule larger.
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

    None for a source without a mesh.
    """
    cache, support = mesh_cache_of(surface), source_support(surface)
    if cache is None or support is None:
        return None
    corners = cache.mesh.vertices[cache.mesh.cells]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    has_edge = [support.unsupported(limit)[cache.mesh.edges.of_cells].any(axis=1) for limit in (UNSUPPORTED, SUPPORTED)]
    return np.array([areas.sum(), *(areas[rows].sum() for rows in has_edge)])
