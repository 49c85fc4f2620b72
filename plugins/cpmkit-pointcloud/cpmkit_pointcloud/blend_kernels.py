"""Compiled values of the function whose zero set is the surface that blended patches define.

The surface is the zero set of f(y) = sum_i w_i(y) f_i(y) / sum_i w_i(y). In the frame of sample i, f_i is the
height of y above the patch; w_i = (1 - |y - p_i|^2 / r_i^2)^3 within the radius r_i, zero beyond: a partition of
unity (Ohtake et al. 2003, Multi-level partition of unity implicits), so every query sees the same smooth surface.
Points of the plane have a third coordinate of zero, and patches that do not depend on it.
"""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import compiled


@compiled
def polynomial_and_derivatives(coefficients, sample, degree, a, b):
    """Return q = sum c_ij a^i b^j, i + j <= ``degree``, and q_a, q_b, q_aa, q_ab, q_bb, by Horner's rule in b and in a.

    Row ``sample`` of ``coefficients`` has c_00, c_01, ..., c_10, c_11, ...: by ascending i, of one i by ascending j. A
    row alone would be an array of its own, which takes a tenth of the time.
    """
    q = qa = qb = qaa = qab = qbb = 0.0
    t = coefficients.shape[1]
    for i in range(degree, -1, -1):
        r = rb = rbb = 0.0
        for _ in range(degree + 1 - i):
            t -= 1
            rbb = rbb * b + 2.0 * rb
            rb = rb * b + r
            r = r * b + coefficients[sample, t]
        qaa = qaa * a + 2.0 * qa
        qa = qa * a + q
        q = q * a + r
        qab = qab * a + qb
        qb = qb * a + rb
        qbb = qbb * a + rbb
    return q, qa, qb, qaa, qab, qbb


@compiled
def evaluate_blend(y, j, cloud):
    """Return f and its three derivatives at ``y`` (3,), and three numbers, the weighted mean of the samples around.

    The sign is that of the patch of ``j``, the sample nearest to ``y``; ``cloud`` is :attr:`Blend.arrays`. The mean is
    relative to ``y``, in units of the mean radius. All seven numbers are zero where no patch reaches.
    """
    points, frames, radii, coefficients, degree, starts, reaching = cloud
    f = gx = gy = gz = total = tx = ty = tz = mx = my = mz = wide = 0.0
    for m in range(starts[j], starts[j + 1]):
        i = reaching[m]
        ux, uy, uz = y[0] - points[i, 0], y[1] - points[i, 1], y[2] - points[i, 2]
        r = radii[i]
        inside = 1.0 - (ux * ux + uy * uy + uz * uz) / (r * r)
        if inside <= 0.0:
            continue
        e = frames[i]
        a = (e[0, 0] * ux + e[0, 1] * uy + e[0, 2] * uz) / r
        b = (e[1, 0] * ux + e[1, 1] * uy + e[1, 2] * uz) / r
        c = e[2, 0] * ux + e[2, 1] * uy + e[2, 2] * uz
        q, qa, qb, _, _, _ = polynomial_and_derivatives(coefficients, np.int64(i), degree, a, b)
        o = frames[j, 2]
        sign = -1.0 if e[2, 0] * o[0] + e[2, 1] * o[1] + e[2, 2] * o[2] < 0.0 else 1.0
        h = sign * (c - r * q)
        w = inside * inside * inside
        v = -6.0 * inside * inside / (r * r)
        total += w
        f += w * h
        tx += v * ux
        ty += v * uy
        tz += v * uz
        gx += w * sign * (e[2, 0] - qa * e[0, 0] - qb * e[1, 0]) + v * ux * h
        gy += w * sign * (e[2, 1] - qa * e[0, 1] - qb * e[1, 1]) + v * uy * h
        gz += w * sign * (e[2, 2] - qa * e[0, 2] - qb * e[1, 2]) + v * uz * h
        wide += w * r
        mx -= w * ux
        my -= w * uy
        mz -= w * uz
    if total == 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    f /= total
    gx, gy, gz = (gx - f * tx) / total, (gy - f * ty) / total, (gz - f * tz) / total
    return f, gx, gy, gz, mx / wide, my / wide, mz / wide


@compiled
def nearest_sample(y, j, cloud):
    """Return the sample nearest to ``y`` (3,), found by descent from sample ``j``, which is near it.

    Each step goes to the nearest of the samples whose patches reach the present one; it ends where none is nearer.
    ``cloud`` is :attr:`Blend.arrays`.
    """
    points, starts, reaching = cloud[0], cloud[5], cloud[6]
    best = np.inf
    while True:
        start = j
        for m in range(starts[start], starts[start + 1]):
            i = reaching[m]
            ux, uy, uz = y[0] - points[i, 0], y[1] - points[i, 1], y[2] - points[i, 2]
            square = ux * ux + uy * uy + uz * uz
            if square < best:
                best, j = square, i
        if j == start:
            return j
