"""About how large errors are, told by one solution alone: from how much the third derivative's size leaves unresolved.

Splines of degree 2 follow a function but for a share of h^3 times its third derivatives, and so much do third
differences of their coefficients tell. They see nothing of what samples leave, and are half of an estimate: the other
half is another solution, which knows nothing of them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.forms.form_records import ExpectedError
from cpmkit.forms.galerkin.space.dof_map import DofMap
from cpmkit.runtime.compilation import compiled
from cpmkit.types import Floats, Ints

if TYPE_CHECKING:
    from cpmkit.forms.galerkin.form import Galerkin


@compiled
def write_differences(
    touching: Any, cells: Ints, unknowns: Any, strides: Ints, signs: Floats, u: Floats, out: Floats
) -> int:
    """Write the differences along each line of coefficients through two patches side by side; return how many.

    Of each pair ``touching`` (t, 2) of patches whose ``cells`` (p, d) are one apart along an axis, and which share the
    ``unknowns`` (p, width^d) between them, width^(d-1) rows of ``out`` (k, channels). The lines have as many
    coefficients as ``signs``, one more than the width; ``strides`` (d,) lie between neighbours along each axis.
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


#: Root mean squares of third differences over those of errors, and the largest over the largest: where cells follow the
#: source (measured on 22 problems at 250 to 3,000 unknowns: 60 to 240, and 50 to 300), where they are flat (95 to 110,
#: and 80 to 150), where they are bent by normals or the source turns under splines (3 to 50, and 2 to 200), and where
#: boundaries end (22 to 36, and 25 to 50).
SMOOTH, FLAT, ROUGH, ENDING = (145.0, 175.0), (100.0, 125.0), (22.0, 29.0), (30.0, 37.0)
#: The same where cells are bent by normals and the source turns under splines on less than the one share of its area,
#: as organic meshes do from some 10,000 unknowns on (25 to 50, and 50 to 320); from the other share on they are ROUGH.
RESOLVED, FOLDED_AREA = (32.0, 100.0), (0.003, 0.01)
#: Where the source is smooth or flat, largest differences are 3 to 8 times their root mean square; where they are more
#: than this, and more than a share of the coefficients' range, there is a peak that the lattice does not resolve yet,
#: and third differences are too small. So they are where their root mean square alone is more than that share: a wave
#: has six spacings or fewer. (Below it peaks are those of jumps beside boundaries, at 6,000 unknowns and more.)
PEAKED, WAVY = 10.5, 0.1
#: Sources that turn, and that bend, under splines on less than the one share of their area count as smooth, on more
#: than the other as rough, between them as in between.
TURNED_AREA, SHARPLY_CURVED_AREA = (0.003, 0.02), (0.04, 0.1)


def single_solution_estimate(form: Galerkin, u: Floats) -> ExpectedError | None:
    """Return about the error of u (unknowns, channels).

    None where splines have another degree than 2, for which nothing was measured, or where no two patches stand beside
    each other.
    """
    if form.options.own.degree != 2:
        return None
    found = highest_differences(form.space.dof_map, u)
    if not len(found):
        return None
    ratios = _ratios(form)
    rms, largest = np.sqrt(np.mean(found**2, axis=0)), np.abs(found).max(axis=0)
    even = min(ratios) > max(ROUGH + ENDING)
    peaked = largest > PEAKED * rms
    unresolved = even and bool((np.where(peaked, largest, rms) > WAVY * np.ptp(u, axis=0)).any())
    return ExpectedError(rms / ratios[0], largest / ratios[1], unresolved)


def highest_differences(dof_map: DofMap, u: Floats) -> Floats:
    """Return (k, channels) differences of coefficients along the axes, of one order more than the degree.

    Of each pair of patches side by side that share unknowns, along the axis that they stand beside each other.
    """
    width = dof_map.width
    signs = np.array([(-1.0) ** (width - place) * math.comb(width, place) for place in range(width + 1)])
    out = np.empty((len(dof_map.touching) * width ** (dof_map.dim - 1), u.shape[1]))
    strides = np.array(dof_map.strides, dtype=np.int64)
    return out[
        : write_differences(
            dof_map.touching, dof_map.cells, dof_map.unknowns, strides, signs, np.ascontiguousarray(u), out
        )
    ]


def _ratios(form: Galerkin) -> tuple[float, float]:
    bend = form.sampled.geometry
    if bend == "normals":
        return _interpolated_ratios(RESOLVED, _rough_share(form.turned.share, FOLDED_AREA))
    if form.sampled.mesh.beyond_tip.any():
        return ENDING
    if bend == "flat":
        return FLAT
    return _interpolated_ratios(
        SMOOTH, max(_rough_share(form.turned.share, TURNED_AREA), _rough_share(form.turned.bent, SHARPLY_CURVED_AREA))
    )


def _rough_share(area: float, limits: tuple[float, float]) -> float:
    """Return 0 where a share of the area is below the first limit, 1 where it is above the second, else between."""
    return float(np.interp(math.log(max(area, limits[0])), np.log(limits), [0, 1]))


def _interpolated_ratios(smooth: tuple[float, float], rough: float) -> tuple[float, float]:
    rms, largest = (one ** (1 - rough) * other**rough for one, other in zip(smooth, ROUGH, strict=True))
    return rms, largest
