"""The compiled geometry of a zero set, of all but the fields' own values, which any function may give.

Fields come first: values (f, n), gradients (f, n, d), Hessians (f, n, d, d), for the one or two fields of a zero set.
Each row is worked out for itself, so that a point's answer never depends on its batch.
"""

from __future__ import annotations

import math

import numpy as np

from cpmkit.plugin import compiled, inlined


@inlined
def _dot(a, b):
    """Return the inner product, summed as ``dots`` does."""
    total = a[0] * b[0]
    for k in range(1, len(a)):
        total += a[k] * b[k]
    return total


@inlined
def _gradient_weights(gradients, i, first, second):
    """Return w_0, w_1 such that v = sum w_k grad_k, in row ``i``, has grad_k . v equal to ``first``, ``second``."""
    g = gradients[0, i]
    a = _dot(g, g)
    if len(gradients) == 1:
        return first / a, 0.0
    h = gradients[1, i]
    b, c = _dot(g, h), _dot(h, h)
    determinant = a * c - b * b
    return (c * first - b * second) / determinant, (a * second - b * first) / determinant


@compiled
def fill_corrections(values, gradients, step, length):
    """Fill in the shortest steps (n, d) whose subtraction makes all fields vanish to first order, and lengths (n,).

    ``values`` (f, n) and ``gradients`` (f, n, d) are those of the f = 1 or 2 fields.
    """
    fields, n, d = gradients.shape
    for i in range(n):
        first, second = _gradient_weights(gradients, i, values[0, i], values[fields - 1, i])
        for k in range(d):
            step[i, k] = first * gradients[0, i, k]
            if fields == 2:
                step[i, k] += second * gradients[1, i, k]
        length[i] = math.sqrt(_dot(step[i], step[i]))


@compiled
def correct_points(q, done, rows, values, gradients, reach, least):
    """Move the points ``rows`` of ``q`` (n, d) by their corrections; return how many of the rows go on.

    Parameters
    ----------
    q : (n, d) float64
        Moved in place, but for steps longer than ``reach``.
    done : (n,) bool
        Set in place where the step is no longer than ``least``.
    rows : (r,) int64
        The first of them are overwritten by those that go on.
    values, gradients : (f, r), (f, r, d) float64
        Of the f fields at the points ``rows``.
    reach, least : float
        Lengths.
    """
    step, length = np.empty(gradients.shape[1:]), np.empty(len(rows))
    fill_corrections(values, gradients, step, length)
    left = 0
    for i, row in enumerate(rows):
        if length[i] <= reach:  # False for NaN
            for k in range(q.shape[1]):
                q[row, k] -= step[i, k]
            if length[i] > least:
                rows[left] = row
                left += 1
        if length[i] <= least:
            done[row] = True
    return left


@compiled
def fill_local_shapes(x, y, gradients, hessians, tangents, bending, force):
    """Fill in a ``LocalShape`` of zero sets with these derivatives at ``y`` (n, d), seen from ``x`` (n, d)."""
    fields, n, d = gradients.shape
    m = d - fields
    across, normal, helper, hessian = np.empty(d), np.empty(d), np.empty(d), np.empty((d, d))
    for i in range(n):
        _fill_tangents(gradients, i, normal, helper, tangents[i])
        for k in range(d):
            across[k] = x[i, k] - y[i, k]
        along = _dot(across, gradients[0, i]), _dot(across, gradients[fields - 1, i])
        first, second = _gradient_weights(gradients, i, along[0], along[1])
        for j in range(d):
            for k in range(d):
                hessian[j, k] = first * hessians[0, i, j, k]
                if fields == 2:
                    hessian[j, k] += second * hessians[1, i, j, k]
        for a in range(m):
            force[i, a] = _dot(tangents[i, a], across)
            for b in range(m):
                total = 0.0
                for j in range(d):
                    total += tangents[i, a, j] * _dot(hessian[j], tangents[i, b])
                bending[i, a, b] = total


@inlined
def _fill_tangents(gradients, i, normal, helper, tangents):
    """Fill in orthonormal vectors (m, d) at right angles to the gradients of row ``i``; the others (d,) are room."""
    fields, _, d = gradients.shape
    g = gradients[0, i]
    if d == 3 and fields == 2:
        _unit_cross(g, gradients[1, i], tangents[0])
    elif fields < d:
        length = math.sqrt(_dot(g, g))
        for k in range(d):
            normal[k], helper[k] = g[k] / length, 0.0
        if d == 2:
            tangents[0, 0], tangents[0, 1] = -normal[1], normal[0]
            return
        least = 0
        for k in range(1, 3):
            if abs(normal[k]) < abs(normal[least]):
                least = k
        helper[least] = 1.0
        _unit_cross(normal, helper, tangents[0])
        _unit_cross(normal, tangents[0], tangents[1])


@inlined
def _unit_cross(a, b, out):
    """Store the normalised cross product of ``a`` and ``b`` in ``out``, all (3,); NaN where it vanishes."""
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    length = math.sqrt(_dot(out, out))
    for k in range(3):
        out[k] /= length
