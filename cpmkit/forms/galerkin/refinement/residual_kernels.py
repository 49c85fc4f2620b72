"""Compiled: second derivatives of splines along the manifold."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.forms.galerkin.space.sample_kernels import spline_slopes, spline_values
from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled


@compiled
def second_derivatives(
    unknowns: Ints, cells: Ints, spacing: float, patch: Any, points: Floats, normals: Floats, u: Floats, found: Floats
) -> None:
    """Fill ``found`` (q, channels) with the sum of second derivatives along tangents: the trace of P H P.

    ``points`` (q, d) in the patches ``patch`` (q,), where ``normals`` (q, c, d) are normal to the manifold.
    """
    d, width = cells.shape[1], unknowns.shape[1]
    splines = np.empty((3, 3, 3))  # by order of the derivative, axis, place
    splines[:] = 1.0
    hessian = np.empty((d, d))
    for q in range(len(points)):
        p = patch[q]
        for axis in range(d):
            t = points[q, axis] / spacing - cells[p, axis] + 0.5
            spline_values(t, 3, splines[0, axis])
            spline_slopes(t, 3, splines[1, axis])
            splines[2, axis, 0], splines[2, axis, 1], splines[2, axis, 2] = 1.0, -2.0, 1.0
        for channel in range(u.shape[1]):
            hessian[:] = 0.0
            for place in range(width):
                value = u[unknowns[p, place], channel]
                for i in range(d):
                    for j in range(i, d):
                        product, rest = value, place
                        for axis in range(d - 1, -1, -1):
                            product *= splines[(axis == i) + (axis == j), axis, rest % 3]
                            rest //= 3
                        hessian[i, j] += product
            total = 0.0
            for i in range(d):
                total += hessian[i, i]
            for c in range(normals.shape[1]):
                for i in range(d):
                    total -= normals[q, c, i] ** 2 * hessian[i, i]
                    for j in range(i + 1, d):
                        total -= 2.0 * normals[q, c, i] * normals[q, c, j] * hessian[i, j]
            found[q, channel] = total / spacing**2
