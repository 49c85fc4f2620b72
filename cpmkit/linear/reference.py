"""The solver ``reference``: BiCGSTAB as in King et al. (2024), section 5.4, with E and L as separate tables.

Faster solvers are measured against it: its iterations double when the spacing halves. All channels advance together,
each with its own scalars, so that a product reads the tables once for all of them. The paper preconditions by the
diagonal of A, which is the same in every row: that scales the whole system and does not change BiCGSTAB, so it is left
out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cpmkit.linear.krylov import REMEDY, solve_by_corrections
from cpmkit.linear.protocols import Operator
from cpmkit.linear.residuals import judge
from cpmkit.linear.solve_report import SolveReport
from cpmkit.runtime.threads import run_parcels
from cpmkit.types import Floats, Progress, no_progress

#: Rows of the vectors that a thread works on at a time: they fit its cache.
REFERENCE_PARCEL_ROWS = 1 << 14


@dataclass(frozen=True)
class ReferenceSolver:
    """The solver: BiCGSTAB, with at most ``max_iterations`` iterations."""

    takes_levels: ClassVar[bool] = False

    max_iterations: int = 20_000

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> PreparedReference:
        """Return the iteration for an operator; nothing is computed before the solve."""
        del levels
        return PreparedReference(operator, self.max_iterations)


@dataclass(frozen=True, eq=False)
class PreparedReference:
    """An operator and the largest number of iterations, ready to solve by BiCGSTAB."""

    operator: Operator
    max_iterations: int

    def solve(
        self, b: Floats, tolerance: float, guess: Floats | None = None, progress: Progress = no_progress
    ) -> tuple[Floats, SolveReport]:
        """Return u (n, channels) with ``A u = b``, and a report.

        Raises
        ------
        ConvergenceError
            If a channel's recomputed residual is above the tolerance.
        """
        u, iterations, products = solve_by_corrections(
            lambda u: b - self.operator.apply(u),
            b,
            guess,
            tolerance,
            lambda residual, target, most: _bicgstab(self.operator, residual, target, most, progress),
            max_iterations=self.max_iterations,
            target_share=0.5,
            rounds=8,
        )
        progress("solve", 1.0)
        remedy = f"{REMEDY} if the scene is small"
        return u, judge(self.operator, b, u, "reference", tolerance, iterations, products, remedy)


def _bicgstab(
    operator: Operator, residual: Floats, target: Floats, max_iterations: int, progress: Progress
) -> tuple[Floats, int, int]:
    """Return an approximate solution x (n, channels) of ``A x = residual``, the iterations, and the products with A.

    The iteration stops when the norm of every channel's residual is below its ``target`` (channels,), or when a channel
    breaks down; ``residual`` is overwritten.
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
        finished = size <= target
        progress("solve", float(np.clip(1 - np.log(np.maximum(size / target, 1.0)).max() / start, 0, 1)))
        broken = np.abs(rho) <= 1e-14 * shadow_size * size  # the shadow residual is orthogonal but for rounding
        if finished.all() or np.any(broken & ~finished) or not np.isfinite(size).all():
            break
        beta = _ratio(rho, before) * _ratio(alpha, omega)
        _update_direction(direction, residual, beta, omega, image)
        if finished.any():  # a finished channel would divide zero by zero; it does not change any more
            direction[:, finished], residual[:, finished] = 0.0, 0.0
    return x, iteration, 2 * iteration * x.shape[1]


def _dots(*pairs: tuple[Floats, Floats]) -> Floats:
    """Return the scalar products a* b (pairs, channels) of pairs of (n, channels), summed in a fixed order."""
    rows, channels = pairs[0][0].shape
    parts = np.empty((-(-rows // REFERENCE_PARCEL_ROWS), len(pairs), channels), dtype=pairs[0][0].dtype)

    def add(start: int, stop: int) -> None:
        for number, (a, b) in enumerate(pairs):
            parts[start // REFERENCE_PARCEL_ROWS, number] = np.einsum("nc,nc->c", a[start:stop].conj(), b[start:stop])

    run_parcels(add, rows, REFERENCE_PARCEL_ROWS)
    return np.asarray(parts.sum(axis=0))


def _subtract(residual: Floats, factor: Floats, image: Floats) -> None:
    """Subtract ``factor * image`` from ``residual`` (n, channels) in place."""

    def work(start: int, stop: int) -> None:
        residual[start:stop] -= factor * image[start:stop]

    run_parcels(work, len(residual), REFERENCE_PARCEL_ROWS)


def _advance(x: Floats, alpha: Floats, direction: Floats, omega: Floats, half: Floats) -> None:
    """Add ``alpha * direction + omega * half`` to x (n, channels) in place."""

    def work(start: int, stop: int) -> None:
        x[start:stop] += alpha * direction[start:stop] + omega * half[start:stop]

    run_parcels(work, len(x), REFERENCE_PARCEL_ROWS)


def _update_direction(direction: Floats, residual: Floats, beta: Floats, omega: Floats, image: Floats) -> None:
    """Overwrite ``direction`` (n, channels) with ``residual + beta * (direction - omega * image)``."""

    def work(start: int, stop: int) -> None:
        part = direction[start:stop] - omega * image[start:stop]
        direction[start:stop] = residual[start:stop] + beta * part

    run_parcels(work, len(direction), REFERENCE_PARCEL_ROWS)


def _ratio(a: Floats, b: Floats) -> Floats:
    """Return a / b (channels,), zero where b is zero: there a channel is finished or has broken down, and is kept."""
    return np.divide(a, b, out=np.zeros_like(a), where=b != 0)
