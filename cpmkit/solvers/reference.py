"""BiCGSTAB with the diagonal of M, on E and L kept apart, as King et al. (2024), section 5.4, solve.

It is the reference that faster solvers are measured against: its iterations double when the spacing
halves. All channels advance in lockstep, each with its own scalars, so that a product reads the tables
once for all of them; the diagonal of A is constant, so that preconditioning with it is a scaling.
"""

from __future__ import annotations

import numpy as np

from cpmkit.operators import LinearSystem
from cpmkit.protocols import Floats, Progress
from cpmkit.solvers.report import SolveReport, judge

#: The recursive residual is driven this much below the tolerance, because it drifts from the true one.
MARGIN = 0.5
#: The recursion starts afresh where its shadow residual is orthogonal to the residual to this relative accuracy.
BREAKDOWN = 1e-14
#: At most this many fresh starts from the true residual.
RESTARTS = 8


def solve_reference(
    system: LinearSystem, tolerance: float, progress: Progress, max_iterations: int = 20_000
) -> tuple[Floats, SolveReport]:
    """Solve all channels by BiCGSTAB, preconditioned by the diagonal.

    Raises
    ------
    ConvergenceError
        If a channel's recomputed residual is above the tolerance.
    """
    b = system.right_side
    size = np.linalg.norm(b, axis=0)
    u = np.zeros_like(b)
    iterations = products = 0
    for _ in range(RESTARTS):
        residual = b - system.apply(u)
        open_ = np.flatnonzero(np.linalg.norm(residual, axis=0) > tolerance * size)
        products += b.shape[1]
        if not len(open_) or iterations >= max_iterations:
            break
        target = MARGIN * tolerance * size[open_]
        step, taken, applied = _bicgstab(
            system, np.ascontiguousarray(residual[:, open_]), target, max_iterations - iterations, progress
        )
        u[:, open_] += step
        iterations, products = iterations + taken, products + applied
    progress("solve", 1.0)
    remedy = "ask for a larger tolerance or more max_iterations, or use solver='direct' if the scene is small"
    return u, judge(system, u, "reference", tolerance, iterations, products, remedy)


def _bicgstab(
    system: LinearSystem, residual: Floats, target: Floats, max_iterations: int, progress: Progress
) -> tuple[Floats, int, int]:
    """Run BiCGSTAB on A x = residual until every channel is below its target, or one breaks down.

    Returns
    -------
    x : (n, channels) float64
    iterations, products : int
    """
    shadow, direction = residual.copy(), residual.copy()
    x = np.zeros_like(residual)
    scaled = system.diagonal
    rho = _dot(shadow, residual)
    start = np.log(_norm(residual) / target).max()
    iteration = 0
    while iteration < max_iterations:
        iteration += 1
        image = system.apply(direction / scaled)
        alpha = _ratio(rho, _dot(shadow, image))
        half = residual - alpha * image
        image_half = system.apply(half / scaled)
        omega = _ratio(_dot(image_half, half), _dot(image_half, image_half))
        x += (alpha * direction + omega * half) / scaled
        residual = half - omega * image_half
        size = _norm(residual)
        done = size <= target
        progress("solve", float(np.clip(1 - np.log(np.maximum(size / target, 1.0)).max() / start, 0, 1)))
        before, rho = rho, _dot(shadow, residual)
        broken = np.abs(rho) <= BREAKDOWN * _norm(shadow) * size
        if done.all() or np.any(broken & ~done) or not np.isfinite(size).all():
            break
        beta = _ratio(rho, before) * _ratio(alpha, omega)
        direction = residual + beta * (direction - omega * image)
        if done.any():  # a finished channel would divide zero by zero; it stands still
            direction[:, done], residual[:, done] = 0.0, 0.0
    return x, iteration, 2 * iteration * x.shape[1]


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("nc,nc->c", a, b))


def _norm(a: Floats) -> Floats:
    return np.asarray(np.sqrt(_dot(a, a)))


def _ratio(a: Floats, b: Floats) -> Floats:
    """Return a / b, zero where b is zero: a channel that is finished or has broken down stands still."""
    return np.divide(a, b, out=np.zeros_like(a), where=b != 0)
