"""The maps of the reference element onto cells in the plane or in space, whose Jacobians may not be square.

Every Jacobian J (d, k) is split into Q R with orthonormal columns Q: R is the cell unfolded into its tangent space.
``R^-1 Q'`` is then the pseudo-inverse, so gradients come out tangential, and ``det R`` the factor of length, area or
volume. Unlike the metric J'J it does not square the condition number of thin cells.
"""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats, Ints
from cpmkit_fem.elements import Shape


def jacobians(nodes: Floats, cells: Ints, shape: Shape) -> Floats:
    """Return Jacobians (k, d, m, q) of cells (m, n) at the q points of ``shape``; q is 1 where they are constant.

    Their first index is the axis of the reference element. ``nodes`` (v, d) are positions.
    """
    slopes = shape.slopes
    if np.array_equal(slopes, np.broadcast_to(slopes[..., :1], slopes.shape)):
        slopes = slopes[..., :1]
    corner, others = nodes[cells[:, 0]], nodes[cells[:, 1:]] - nodes[cells[:, :1]]
    found = np.zeros((slopes.shape[1], nodes.shape[1], len(corner), slopes.shape[2]))
    for j in range(others.shape[1]):  # the functions' derivatives add up to zero: differences lose no digits far away
        found += slopes[j + 1][:, None, None, :] * others[:, j].T[None, :, :, None]
    return found


def measure_and_pseudoinverse(jacobian: Floats) -> tuple[Floats, Floats]:
    """Return the measure det R (m, q) and the pseudoinverse R^-1 Q' (k, d, m, q) of Jacobians (k, d, m, q).

    The k = 0 to 3 columns of a Jacobian have the QR decomposition Q R.
    """
    measure, axes, above = np.ones(jacobian.shape[2:]), np.empty_like(jacobian), {}
    for j, column in enumerate(jacobian):
        height = column
        for turn in range(2):  # thin cells lose the right angle at first
            for i in range(j):
                part = np.sum(axes[i] * height, axis=0)
                height = height - part * axes[i]
                if turn == 0:
                    above[i, j] = part
        above[j, j] = np.linalg.norm(height, axis=0)
        axes[j] = height / above[j, j]
        measure = measure * above[j, j]
    inverse = np.empty_like(jacobian)
    for j in range(len(jacobian))[::-1]:
        rest = axes[j]
        for i in range(j + 1, len(jacobian)):
            rest = rest - above[j, i] * inverse[i]
        inverse[j] = rest / above[j, j]
    return measure, inverse
