"""Compiled search for the closest point on the surface that blended patches define.

The surface is the zero set of f(y) = sum_i w_i(y) f_i(y) / sum_i w_i(y). In the frame of sample i, f_i is the
height of y above the patch; w_i = (1 - |y - p_i|^2 / r_i^2)^3 within the radius r_i, zero beyond: a partition of
unity (Ohtake et al. 2003, Multi-level partition of unity implicits), so every query sees the same smooth surface.
Points of the plane have a third coordinate of zero, and patches that do not depend on it.
"""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import compiled

#: Rounds after which a search gives up.
MOST_SEARCH_ROUNDS = 60
#: Halvings of a step that left the reach of all patches.
STEP_HALVINGS = 40
#: Steps onto the surface after the search, at most, and the share of a search's last step at which they end.
MOST_LANDINGS = 6
LANDING_STEP_SHARE = 1e-3
#: A step goes no farther than this share of the patch's radius.
STRIDE_RADII = 0.5
#: Share of its plain value below which the second derivative of the distance counts as lost: a focal point is near.
FOCAL_SHARE = 0.1
#: The samples' weighted mean is this share of a radius away from a foot that has left them behind. On a straight
#: rim it is 0.26; among random samples with 20 in reach it is above 0.45 once in 25,000.
BEYOND_RIM_RADII = 0.45
#: That share is met to this accuracy on the rim of an open cloud.
ON_RIM_ACCURACY = 1e-9
#: Strides, in radii, by which the rim is sought, and how many of them.
PACE_RADII, MOST_PACES = 0.25, 12
#: Rounds of false position across the rim, of steps along it, and the step in radii at which those end.
FALSE_POSITION_ROUNDS, ALONG_RIM_ROUNDS, LAST_RIM_STEP_RADII = 60, 30, 1e-6


@compiled
def _polynomial_and_derivatives(coefficients, degree, a, b):
    """Return q = sum c_ij a^i b^j, i + j <= ``degree``, and q_a, q_b, q_aa, q_ab, q_bb, by Horner's rule in b and in a.

    ``coefficients`` are c_00, c_01, ..., c_10, c_11, ...: by ascending i, of one i by ascending j.
    """
    q = qa = qb = qaa = qab = qbb = 0.0
    t = len(coefficients)
    for i in range(degree, -1, -1):
        r = rb = rbb = 0.0
        for _ in range(degree + 1 - i):
            t -= 1
            rbb = rbb * b + 2.0 * rb
            rb = rb * b + r
            r = r * b + coefficients[t]
        qaa = qaa * a + 2.0 * qa
        qa = qa * a + q
        q = q * a + r
        qab = qab * a + qb
        qb = qb * a + rb
        qbb = qbb * a + rbb
    return q, qa, qb, qaa, qab, qbb


@compiled
def _evaluate_blend(y, j, cloud):
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
        q, qa, qb, _, _, _ = _polynomial_and_derivatives(coefficients[i], degree, a, b)
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
def _nearest_sample(y, j, cloud):
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


@compiled
def _tangential_step(x, y, g, j, cloud):
    """Return Newton's step (3,) along the surface from ``y`` (3,) towards the foot of ``x`` (3,).

    Near a focal point it is a damped step down the gradient of the distance. It is orthogonal to ``g`` (3,), the
    gradient of f at ``y``. ``j`` is the sample nearest to ``y``, ``cloud`` is :attr:`Blend.arrays`. The second
    derivatives are those of the patch of ``j`` alone: what they lack is of the order of its radius, and costs rounds,
    not accuracy.
    """
    points, frames, radii, coefficients, degree = cloud[0], cloud[1], cloud[2], cloud[3], cloud[4]
    e, r = frames[j], radii[j]
    n = g / np.sqrt(g @ g)
    p = e[0] - (e[0] @ n) * n
    p /= np.sqrt(p @ p)
    s = np.array([n[1] * p[2] - n[2] * p[1], n[2] * p[0] - n[0] * p[2], n[0] * p[1] - n[1] * p[0]])
    u = y - points[j]
    _, _, _, qaa, qab, qbb = _polynomial_and_derivatives(coefficients[j], degree, (e[0] @ u) / r, (e[1] @ u) / r)
    away = x - y
    multiplier = (away @ g) / (g @ g)
    pa, pb, sa, sb = e[0] @ p, e[1] @ p, e[0] @ s, e[1] @ s
    bend = -multiplier / r
    h11 = 1.0 + bend * (qaa * pa * pa + 2.0 * qab * pa * pb + qbb * pb * pb)
    h12 = bend * (qaa * pa * sa + qab * (pa * sb + pb * sa) + qbb * pb * sb)
    h22 = 1.0 + bend * (qaa * sa * sa + 2.0 * qab * sa * sb + qbb * sb * sb)
    right1, right2 = away @ p, away @ s
    size = 1.0 + abs(bend) * (abs(qaa) + 2.0 * abs(qab) + abs(qbb))
    determinant = h11 * h22 - h12 * h12
    if h11 <= FOCAL_SHARE or h22 <= FOCAL_SHARE or determinant <= FOCAL_SHARE * max(h11, h22):
        return (right1 * p + right2 * s) / size
    return ((h22 * right1 - h12 * right2) * p + (h11 * right2 - h12 * right1) * s) / determinant


@compiled
def _move_to_surface(y, j, cloud, tiny):
    """Move ``y`` (3,), in place, onto the surface along the gradient; return its nearest sample.

    It ends with a step below a thousandth of ``tiny``, or after :data:`MOST_LANDINGS`. ``j`` is a sample near ``y``,
    ``cloud`` is :attr:`Blend.arrays`. Where no patch reaches, ``y`` stays.
    """
    for _ in range(MOST_LANDINGS):
        j = _nearest_sample(y, j, cloud)
        f, gx, gy, gz, _, _, _ = _evaluate_blend(y, j, cloud)
        square = gx * gx + gy * gy + gz * gz
        if square == 0.0:
            return j
        step = f / square
        y[0] -= step * gx
        y[1] -= step * gy
        y[2] -= step * gz
        if abs(f) <= LANDING_STEP_SHARE * tiny * np.sqrt(square):
            return j
    return j


@compiled
def _search_foot(x, y, j, cloud, tiny):
    """Move ``y`` (3,) in place to the foot of ``x`` (3,); return the sample nearest to it and whether it converged.

    ``j`` is the sample nearest to the given ``y``, ``cloud`` is :attr:`Blend.arrays`. It converges at a step of length
    ``tiny``. A search that leaves the reach of all patches ends, not converged, at a place that one still reaches.
    """
    radii = cloud[2]
    reach = np.sqrt((x - y) @ (x - y))
    g, last, last_sample = np.empty(3), y.copy(), j
    for _ in range(MOST_SEARCH_ROUNDS):
        f, g[0], g[1], g[2], _, _, _ = _evaluate_blend(y, j, cloud)
        square = g @ g
        if square == 0.0:
            # Half way back again and again; in the end to the last place itself, and the sample that reached it.
            for _ in range(STEP_HALVINGS):
                y[:] = 0.5 * (y + last)
                j = _nearest_sample(y, j, cloud)
                f, g[0], g[1], g[2], _, _, _ = _evaluate_blend(y, j, cloud)
                if g @ g > 0.0:
                    return j, False
            y[:] = last
            return last_sample, False
        last[:], last_sample = y, j
        step = _tangential_step(x, y, g, j, cloud) - (f / square) * g
        length = np.sqrt(step @ step)
        if length > STRIDE_RADII * radii[j]:
            step *= STRIDE_RADII * radii[j] / length
        y += step
        j = _nearest_sample(y, j, cloud)
        if length <= tiny + 1e-15 * reach:
            return j, True
    return j, False


@compiled
def _distance_beyond_rim(y, j, cloud):
    """Return |mean offset of samples around ``y``| - :data:`BEYOND_RIM_RADII`, in radii: above zero beyond the rim.

    The mean offset is 0 where no patch reaches. ``j`` is the sample nearest to ``y`` (3,), ``cloud`` is
    :attr:`Blend.arrays`.
    """
    _, _, _, _, mx, my, mz = _evaluate_blend(y, j, cloud)
    return np.sqrt(mx * mx + my * my + mz * mz) - BEYOND_RIM_RADII


@compiled
def _outward_direction(y, j, cloud):
    """Return the unit vector (3,) tangential to the surface at ``y`` (3,) that points away from the samples around.

    ``j`` is the sample nearest to ``y``, ``cloud`` is :attr:`Blend.arrays`.
    """
    _, gx, gy, gz, mx, my, mz = _evaluate_blend(y, j, cloud)
    along = (gx * mx + gy * my + gz * mz) / (gx * gx + gy * gy + gz * gz)
    away = np.array([along * gx - mx, along * gy - my, along * gz - mz])
    return away / np.sqrt(away @ away)


@compiled
def _move_to_rim(y, j, cloud, tiny):
    """Move ``y`` (3,), in place, along the surface to the rim, across it, by false position; return its nearest sample.

    ``j`` is the sample nearest to ``y``, ``tiny`` the length of a last step, ``cloud`` is :attr:`Blend.arrays`. If no
    rim is within :data:`MOST_PACES` strides, ``y`` stays at the last one.
    """
    away, pace = _outward_direction(y, j, cloud), PACE_RADII * cloud[2][j]
    start, low, high = y.copy(), 0.0, 0.0
    at_low = at_high = _distance_beyond_rim(y, j, cloud)
    for _ in range(MOST_PACES):
        if at_low <= 0.0 <= at_high:
            break
        if at_low > 0.0:
            high, at_high, low = low, at_low, low - pace
        else:
            low, at_low, high = high, at_high, high + pace
        y[:] = start + (low if at_high > 0.0 else high) * away
        j = _move_to_surface(y, j, cloud, tiny)
        if at_high > 0.0:
            at_low = _distance_beyond_rim(y, j, cloud)
        else:
            at_high = _distance_beyond_rim(y, j, cloud)
    if not at_low <= 0.0 <= at_high:
        return j
    side = 0
    for _ in range(FALSE_POSITION_ROUNDS):
        middle = low if at_high == at_low else (low * at_high - high * at_low) / (at_high - at_low)
        y[:] = start + middle * away
        j = _move_to_surface(y, j, cloud, tiny)
        value = _distance_beyond_rim(y, j, cloud)
        if abs(value) <= ON_RIM_ACCURACY or high - low <= tiny:
            return j
        if value > 0.0:
            high, at_high, at_low = middle, value, at_low * (0.5 if side == 1 else 1.0)
            side = 1
        else:
            low, at_low, at_high = middle, value, at_high * (0.5 if side == -1 else 1.0)
            side = -1
    return j


@compiled
def _move_along_rim(x, y, j, cloud, tiny):
    """Move ``y`` (3,), in place, to the foot of ``x`` (3,) on the rim; return its nearest sample.

    Steps across to the rim and along it alternate. ``j`` is the sample nearest to ``y``, ``tiny`` the length of a last
    step, ``cloud`` is :attr:`Blend.arrays`.
    """
    j = _move_to_rim(y, j, cloud, tiny)
    for _ in range(ALONG_RIM_ROUNDS):
        away = _outward_direction(y, j, cloud)
        _, gx, gy, gz, _, _, _ = _evaluate_blend(y, j, cloud)
        s = np.array([gy * away[2] - gz * away[1], gz * away[0] - gx * away[2], gx * away[1] - gy * away[0]])
        step = ((x - y) @ s) / (s @ s)
        step = min(max(step * np.sqrt(s @ s), -PACE_RADII * cloud[2][j]), PACE_RADII * cloud[2][j])
        if abs(step) <= LAST_RIM_STEP_RADII * cloud[2][j]:
            return j
        y += step * s / np.sqrt(s @ s)
        j = _move_to_surface(y, _nearest_sample(y, j, cloud), cloud, tiny)
        j = _move_to_rim(y, j, cloud, tiny)
    return j


@compiled
def fill_feet(x, start, stop, nearest, cloud, tiny, closed, foot, element, edge, doubtful):
    """Fill rows ``start`` to ``stop`` of the feet of queries ``x`` (n, 3), and their records.

    These are ``foot`` (n, 3), ``element``, ``edge`` and ``doubtful`` (n,). ``nearest`` (n,) are the samples nearest to
    the queries, ``cloud`` is :attr:`Blend.arrays`, ``tiny`` the length of a last step. ``element`` is the sample
    nearest to the foot, ``edge`` 0 on the rim of an open cloud, else -1.

    The surface goes on for a while beyond the rim of an open cloud, and into holes, where the samples that reach are
    all on one side. A foot that has left them behind is doubtful if the cloud is ``closed``; if it is open, the foot is
    moved back to the rim and is not doubtful. Otherwise a search that did not converge leaves a doubtful foot: where it
    ended, or, if ``closed``, near the nearest sample.
    """
    points = cloud[0]
    y = np.empty(3)
    for k in range(start, stop):
        y[:] = points[nearest[k]]
        j, converged = _search_foot(x[k], y, nearest[k], cloud, tiny)
        if not converged and closed:
            j = nearest[k]
            y[:] = points[j]
        j = _move_to_surface(y, j, cloud, tiny)
        beyond = _distance_beyond_rim(y, j, cloud)
        if not closed and beyond > ON_RIM_ACCURACY:
            j = _move_along_rim(x[k], y, j, cloud, tiny)
            beyond, converged = _distance_beyond_rim(y, j, cloud), True
        edge[k] = 0 if not closed and beyond > -ON_RIM_ACCURACY else -1
        foot[k], element[k], doubtful[k] = y, j, not converged or beyond > ON_RIM_ACCURACY


@compiled
def fill_normals(y, start, stop, element, cloud, normal):
    """Fill rows ``start`` to ``stop`` of ``normal`` (n, 3) with unit gradients at feet ``y`` (n, 3).

    They are on the side of the patch of ``element`` (n,), the nearest samples, and NaN where no patch reaches;
    ``cloud`` is :attr:`Blend.arrays`.
    """
    g = np.empty(3)
    for k in range(start, stop):
        _, g[0], g[1], g[2], _, _, _ = _evaluate_blend(y[k], element[k], cloud)
        normal[k] = g / np.sqrt(g @ g)
