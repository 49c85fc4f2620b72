"""BiCGSTAB with the diagonal of M, on E and L kept apart, as King et al. (2024), section 5.4, solve.

It is the reference that faster solvers are measured against: its iterations double when the spacing
halves. All channels advance in lockstep, each with its own scalars, so that a product reads the tables
once for all of them. The diagonal of A is the same in every row: preconditioning by it scales all of
the system alike, which BiCGSTAB does not see, and it is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cpmkit.linear.solve_report import SolveReport, judge
from cpmkit.protocols import Floats, Operator, Progress, no_progress
from cpmkit.runtime.threads import run_parcels

#: The recursive residual is driven this much below the tolerance, because it drifts from the true one.
RECURSIVE_TOLERANCE_SHARE = 0.5
#: The recursion starts afresh where its shadow residual is orthogonal to the residual to this relative accuracy.
BREAKDOWN_COSINE = 1e-14
#: Rows of the vectors that a thread works on at a time: they fit its cache.
REFERENCE_PARCEL_ROWS = 1 << 14
#: At most this many fresh starts from the true residual.
MOST_RESTARTS = 8


@dataclass(frozen=True)
class Reference:
    """BiCGSTAB, preconditioned by the diagonal.

    Attributes
    ----------
    max_iterations : int
        At most.
    """

    takes_levels: ClassVar[bool] = False

    max_iterations: int = 20_000

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> Iterated:
        """Return the iteration for an operator; nothing is made."""
        del levels
        return Iterated(operator, self.max_iterations)


@dataclass(frozen=True, eq=False)
class Iterated:
    """An operator and its iteration."""

    operator: Operator
    max_iterations: int

    def solve(
        self, b: Floats, tolerance: float, guess: Floats | None = None, progress: Progress = no_progress
    ) -> tuple[Floats, SolveReport]:
        """Solve all channels.

        Raises
        ------
        ConvergenceError
            If a channel's recomputed residual is above the tolerance.
        """
        size = np.linalg.norm(b, axis=0)
        u = np.zeros_like(b) if guess is None else guess.copy()
        u[:, size == 0] = 0.0  # the solution there; no guess gets nearer, and there is no relative residual to aim at
        iterations = products = 0
        for _ in range(MOST_RESTARTS):
            residual = b - self.operator.apply(u)
            open_ = np.flatnonzero(np.linalg.norm(residual, axis=0) > tolerance * size)
            products += b.shape[1]
            if not len(open_) or iterations >= self.max_iterations:
                break
            target, left = RECURSIVE_TOLERANCE_SHARE * tolerance * size[open_], self.max_iterations - iterations
            start = np.ascontiguousarray(residual[:, open_])
            step, taken, applied = _bicgstab(self.operator, start, target, left, progress)
            u[:, open_] += step
            iterations, products = iterations + taken, products + applied
        progress("solve", 1.0)
        remedy = (
            "ask for a larger solver_tolerance or more max_iterations, or use solver='direct' if the scene is small"
        )
        return u, judge(self.operator, b, u, "reference", tolerance, iterations, products, remedy)


def _bicgstab(
    operator: Operator, residual: Floats, target: Floats, max_iterations: int, progress: Progress
) -> tuple[Floats, int, int]:
    """Run BiCGSTAB on A x = residual until every channel is below its target, or one breaks down.

    Returns
    -------
    x : (n, channels) float64
    iterations, products : int
    """
    shadow, direction = residual.copy(), residual.copy()
    x = np.zeros_like(residual)
    (rho,) = _dots((shadow, residual))
    shadow_size = np.sqrt(rho.real)
    start = np.log(shadow_size / target).max()
    iteration = 0
    while iteration < max_iterations:
        iteration += 1
        image = operator.apply(direction)
        alpha = _ratio(rho, *_dots((shadow, image)))
        _subtract(residual, alpha, image)
        image_half = operator.apply(residual)
        omega = _ratio(*_dots((image_half, residual), (image_half, image_half)))
        _advance(x, alpha, direction, omega, residual)
        _subtract(residual, omega, image_half)
        before = rho
        rho, square = _dots((shadow, residual), (residual, residual))
        size = np.sqrt(square.real)
        done = size <= target
        progress("solve", float(np.clip(1 - np.log(np.maximum(size / target, 1.0)).max() / start, 0, 1)))
        broken = np.abs(rho) <= BREAKDOWN_COSINE * shadow_size * size
        if done.all() or np.any(broken & ~done) or not np.isfinite(size).all():
            break
        beta = _ratio(rho, before) * _ratio(alpha, omega)
        _turn(direction, residual, beta, omega, image)
        if done.any():  # a finished channel would divide zero by zero; it stands still
            direction[:, done], residual[:, done] = 0.0, 0.0
    return x, iteration, 2 * iteration * x.shape[1]


def _dots(*pairs: tuple[Floats, Floats]) -> Floats:
    """Return the scalar products a* b (pairs, channels), summed parcel by parcel in a fixed order."""
    rows, channels = pairs[0][0].shape
    parts = np.empty((-(-rows // REFERENCE_PARCEL_ROWS), len(pairs), channels), dtype=pairs[0][0].dtype)

    def add(start: int, stop: int) -> None:
        for number, (a, b) in enumerate(pairs):
            parts[start // REFERENCE_PARCEL_ROWS, number] = np.einsum("nc,nc->c", a[start:stop].conj(), b[start:stop])

    run_parcels(add, rows, REFERENCE_PARCEL_ROWS)
    return np.asarray(parts.sum(axis=0))


def _subtract(residual: Floats, factor: Floats, image: Floats) -> None:
    """Set ``residual -= factor * image``."""

    def work(start: int, stop: int) -> None:
        residual[start:stop] -= factor * image[start:stop]

    run_parcels(work, len(residual), REFERENCE_PARCEL_ROWS)


def _advance(x: Floats, alpha: Floats, direction: Floats, omega: Floats, half: Floats) -> None:
    """Set ``x += alpha * direction + omega * half``."""

    def work(start: int, stop: int) -> None:
        x[start:stop] += alpha * direction[start:stop] + omega * half[start:stop]

    run_parcels(work, len(x), REFERENCE_PARCEL_ROWS)


def _turn(direction: Floats, residual: Floats, beta: Floats, omega: Floats, image: Floats) -> None:
    """Set ``direction = residual + beta * (direction - omega * image)``."""

    def work(start: int, stop: int) -> None:
        part = direction[start:stop] - omega * image[start:stop]
        direction[start:stop] = residual[start:stop] + beta * part

    run_parcels(work, len(direction), REFERENCE_PARCEL_ROWS)


def _ratio(a: Floats, b: Floats) -> Floats:
    """Return a / b, zero where b is zero: a channel that is finished or has broken down stands still."""
    return np.divide(a, b, out=np.zeros_like(a), where=b != 0)
