"""The two moves of the search: a point onto the surface phi = 0, and along it to the nearest point downhill."""

import numpy as np

from cpmkit.plugin import Bools, Floats, dots, norms, unit
from cpmkit_neural.field import SineNetwork

#: A step of Newton's method shorter than this, relative to the size, is the last: the next would be its square.
LAST_STEP_SIZE_SHARE = 1e-9
#: Where the squared distance bends less than this, near a centre of curvature, it is taken to bend so much.
LEAST_CURVATURE = 1e-3
MOST_FIELD_PROJECTIONS, NEURAL_NEWTON_STEPS = 12, 40


def project(field: SineNetwork, p: Floats, reach: float, size: float) -> tuple[Floats, Bools]:
    """Return points (n, 3) of the surface near ``p``, and where one was found within ``reach``."""
    q, rows = p.copy(), np.arange(len(p))
    found = np.zeros(len(p), dtype=bool)
    for _ in range(MOST_FIELD_PROJECTIONS):
        phi, gradient = field.gradient(q[rows])
        with np.errstate(divide="ignore", invalid="ignore"):
            step = (phi / dots(gradient, gradient))[:, None] * gradient
        length = norms(step)
        near = length <= reach  # False for NaN
        q[rows[near]] -= step[near]
        found[rows] = length <= LAST_STEP_SIZE_SHARE * size
        rows = rows[near & ~found[rows]]
        if not len(rows):
            break
    return q, found & (norms(q - p) <= reach)


def descend(field: SineNetwork, x: Floats, start: Floats, reach: float, size: float) -> tuple[Floats, Bools]:
    """Return the points (n, 3) of the surface nearest to the queries ``x`` downhill of ``start``, and which converged.

    Every step stays on the surface and is taken only if it does not lead away from the query; otherwise, a
    shorter one is tried. So no point is farther than its start.
    """
    y, rows = start.copy(), np.arange(len(x))
    converged = np.zeros(len(x), dtype=bool)
    longest = np.full(len(x), reach)
    for _ in range(NEURAL_NEWTON_STEPS):
        position, across = y[rows], x[rows] - y[rows]
        step = newton_step(field, across, position)
        length = norms(step)
        step *= np.minimum(1.0, longest[rows] / np.maximum(length, 1e-300))[:, None]
        trial, found = project(field, position + step, 2 * reach, size)
        change = trial - position
        # |x - trial|^2 - |x - y|^2 without cancellation, against what rounding makes of it
        noise = 8 * np.finfo(float).eps * size * (norms(across) + size)
        nearer = found & (dots(change, change - 2 * across) <= noise)
        y[rows[nearer]] = trial[nearer]
        longest[rows] = np.where(nearer, reach, 0.3 * norms(step))
        converged[rows] = nearer & (length <= LAST_STEP_SIZE_SHARE * size)
        rows = rows[~converged[rows]]
        if not len(rows):
            break
    return y, converged


def newton_step(field: SineNetwork, across: Floats, y: Floats) -> Floats:
    """Return tangential steps (n, 3) from ``y``, on the surface, towards where ``across`` = x - y is its normal.

    They are Newton's for |x - y|^2 / 2 + lambda phi(y), with lambda as it is at a closest point. Its Hessian
    I + lambda H, seen in the tangent plane, is made positive, or the steps could lead to the farthest point.
    """
    _, gradient, hessian = field.hessian(y)
    square = dots(gradient, gradient)
    multiplier = (dots(across, gradient) / square)[:, None, None]
    tangential = tangent_projection(unit(gradient))
    bending = np.eye(3) + tangential @ (multiplier * hessian) @ tangential
    values, axes = np.linalg.eigh(bending)
    slope = tangential @ across[:, :, None]
    along = axes.transpose(0, 2, 1) @ slope / np.maximum(np.abs(values), LEAST_CURVATURE)[:, :, None]
    step: Floats = (tangential @ axes @ along)[:, :, 0]
    return step


def tangent_projection(normal: Floats) -> Floats:
    """Return matrices (n, 3, 3) that take the part of a vector at right angles to a unit normal (n, 3)."""
    return np.eye(3) - normal[:, :, None] * normal[:, None, :]
