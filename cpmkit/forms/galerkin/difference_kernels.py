"""Compiled: differences of coefficients from one patch to the next."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled


@compiled
def differences(touching: Any, cells: Ints, unknowns: Any, strides: Ints, signs: Floats, u: Floats, out: Floats) -> int:
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
