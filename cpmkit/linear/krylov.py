"""Krylov solvers: rounds of iterations that start from the true residual, and the iterations of these rounds.

All channels advance together, each with its own scalars, so that a product reads the matrix once for all of them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import ConvergenceError
from cpmkit.linear.operators import Operator, PreparedSolver
from cpmkit.linear.residuals import IndefiniteError, SolveReport, judge
from cpmkit.types import Floats, Progress, no_progress


@dataclass(frozen=True, eq=False)
class KrylovSolver(ABC):
    """An operator with an iteration, ready to solve."""

    operator: Operator  #: A, with its border where it fixes no constant.
    #: The preconditioner of A, or None: an object whose method ``apply(b)`` returns an approximate solution x
    #: (n, channels) of ``A x = b``, with ``products`` products with A. For conjugate gradients it is symmetric and
    #: positive.
    preconditioner: Any
    max_iterations: int  #: Most iterations of a solve.
    solver: str  #: Name of the solver, for reports.
    slack: float = 1.0  #: A guess is accepted only if its residual is this many times smaller than the tolerance.
    #: Returns another solver of the same operator, for right-hand sides for which this one does not converge.
    fallback: Callable[[], PreparedSolver] | None = None

    #: Most iterations from one true residual to the next.
    round_iterations: ClassVar[int] = 10**9
    #: Consecutive rounds that stop early without halving the residual of any channel, after which a solve ends.
    stalled_rounds: ClassVar[int] = 1

    @abstractmethod
    def correct(self, residual: Any, target: Floats, most: int, progress: Progress) -> tuple[Any, int, int]:
        """Return an approximate solution x (n, k) of ``A x = residual``, and the numbers of iterations and of products.

        The iteration stops when the norm of each column's residual is below its ``target`` (k,), or after ``most``
        iterations. ``residual`` (n, k) may be overwritten. Raises IndefiniteError if A or the preconditioner turns out
        to be indefinite in an iteration that needs positive ones.
        """

    def solve(
        self, b: Any, tolerance: float, guess: Any = None, progress: Progress = no_progress
    ) -> tuple[Any, SolveReport]:
        """Return u with ``A u = b``, both (n, channels), and a report; ``guess`` is the initial u, None for zero.

        If this solver does not converge, the ``fallback``, if any, solves the system. Raises ConvergenceError if a
        channel's recomputed relative residual is above the tolerance and above rounding, or the system is indefinite.
        """
        try:
            return self._solve(b, tolerance, guess, progress)
        except ConvergenceError:
            if self.fallback is None:
                raise
        return self.prepared_fallback.solve(b, tolerance, guess, progress)

    @cached_property
    def prepared_fallback(self) -> PreparedSolver:
        """The solver that ``fallback`` returns, prepared at its first use."""
        assert self.fallback is not None
        return self.fallback()

    def _solve(self, b: Any, tolerance: float, guess: Any, progress: Progress) -> tuple[Any, SolveReport]:
        """Return u (n, channels) with ``A u = b``, and a report, without the fallback.

        Each round computes the true residual and corrects the channels in which it is above the tolerance. The rounds
        end if there is no such channel, after ``max_iterations``, or if ``stalled_rounds`` rounds have not halved the
        residual, which rounding then limits. Parameters and errors are those of :meth:`solve`.
        """
        size = np.linalg.norm(b, axis=0)
        u = np.zeros_like(b) if guess is None else guess.copy()
        u[:, size == 0] = 0.0  # the exact solution there, where no relative residual is defined
        iterations = products = 0
        accepted, stopped_early, before, stalled = tolerance / self.slack, False, size, 0
        residual = b if guess is None else b - self.operator.apply(u)
        while True:
            norms = np.linalg.norm(residual, axis=0)
            stalled = stalled + 1 if stopped_early and not np.any(norms < 0.5 * before) else 0
            if stalled == self.stalled_rounds:
                break
            products += b.shape[1]
            unsolved = np.flatnonzero(norms > accepted * size)
            most = min(self.max_iterations - iterations, self.round_iterations)
            if not len(unsolved) or most <= 0:
                break
            target = 0.9 * tolerance * size[unsolved]  # the residual of the iteration drifts from the true residual
            try:
                step, taken, applied = self.correct(np.ascontiguousarray(residual[:, unsolved]), target, most, progress)
            except IndefiniteError as error:
                raise indefinite_error(self.solver, error, iterations, tolerance) from error
            u[:, unsolved] += step
            iterations, products = iterations + taken, products + applied
            accepted, stopped_early, before = tolerance, taken < most, norms
            residual = b - self.operator.apply(u)
        progress("solve", 1.0)
        remedy = "ask for a larger solver_tolerance or more max_iterations, or use solver='direct'"
        return u, judge(self.operator, b, u, self.solver, tolerance, iterations, products, remedy)


def indefinite_error(solver: str, error: IndefiniteError, iterations: int, tolerance: float) -> ConvergenceError:
    """Return the ConvergenceError, with a report, of a solve by ``solver`` ended by ``error`` after ``iterations``."""
    report = SolveReport(solver, False, iterations, 0, np.inf, tolerance, str(error))
    return ConvergenceError(
        f"The system is indefinite, and solver {solver!r} stopped after {iterations} iterations: {error}; use "
        "solver='direct', or a smaller spacing.",
        report,
    )


def conjugate_gradients(
    apply: Callable[[Floats], Floats],
    precondition: Callable[[Floats], Floats],
    residual: Floats,
    target: Floats,
    most: int,
    progress: Progress,
    slack: float = 1.0,
) -> tuple[Floats, int]:
    """Return an approximate solution x (n, channels) of ``A x = residual``, and the number of conjugate gradient steps.

    A channel is finished when the norm of its residual r is below its ``target`` (channels,), and ``(r, M r)^(1/2)``
    has fallen by the same factor times ``slack``: in that norm large entries of A do not hide the error. The iteration
    stops when all channels are finished, or after ``most`` steps. ``apply`` returns products with A, ``precondition``
    with M; both are symmetric. Raises IndefiniteError if A or the preconditioner M turns out not to be positive.
    """
    r = residual.copy()
    x, direction, before = np.zeros_like(r), np.zeros_like(r), np.ones(r.shape[1])
    shares = target / slack / np.sqrt(column_products(r, r))
    first = start = None
    for iteration in range(most + 1):
        z = precondition(r)
        energy, size = column_products(r, z), np.sqrt(column_products(r, r))
        first = energy if first is None else first
        excess = np.maximum(size / target, np.sqrt(np.abs(energy / first)) / shares)
        unfinished = (size > 0) & ~(excess <= 1)
        if (unfinished & ~(energy > 0)).any():
            raise IndefiniteError("what preconditions it has eigenvalues of the wrong sign")
        start = excess.max() if start is None else start
        progress("solve", float(np.clip(1 - np.log(excess.max()) / np.log(max(start, 2.0)), 0, 1)))
        if not unfinished.any() or iteration == most:
            break
        direction = z + np.where(unfinished, energy / before, 0.0) * direction
        image = apply(direction)
        curvature = column_products(direction, image)
        if (unfinished & ~(curvature > 0)).any():
            raise IndefiniteError("it has eigenvalues of the wrong sign")
        alpha = np.divide(energy, curvature, out=np.zeros_like(energy), where=unfinished)
        x += alpha * direction
        r -= alpha * image
        before = np.where(energy > 0, energy, 1.0)
    return x, iteration


def column_products(a: Floats, b: Floats) -> Floats:
    """Return the scalar products a* b (channels,) of the columns of a and b (n, channels); a* is conjugated."""
    return np.asarray(np.einsum("nc,nc->c", a.conj(), b))


def gmres(
    apply: Callable[[Any], Any],
    precondition: Callable[[Any], Any],
    residual: Any,
    target: Floats,
    most: int,
    progress: Progress,
) -> tuple[Any, int]:
    """Return an approximate solution x (n, channels) of ``A x = residual`` by GMRES, and the number of iterations.

    It stops when the norm of every channel's residual is below its ``target`` (channels,), or after ``most``
    iterations. One vector (n, channels) is stored for each iteration. ``apply`` returns products with A,
    ``precondition`` with the preconditioner; both may be indefinite, real or complex. The method is that of Saad and
    Schultz, SIAM J. Sci. Stat. Comput. 7 (1986), preconditioned from the right, so that it minimises the residual of
    the equations.
    """
    start = np.linalg.norm(residual, axis=0)
    basis = [_divide_by_norms(residual, start)]
    hessenberg = np.zeros((len(start), most + 1, most), dtype=residual.dtype)
    finished, taken = start <= target, 0
    first = max(float(np.log(np.maximum(start / target, 2.0)).max()), 1e-300)
    while taken < most and not finished.all():
        column = hessenberg[:, : taken + 2, taken]
        image = apply(precondition(basis[-1]))
        for _ in range(2):  # orthogonalised twice, against rounding
            for row, vector in enumerate(basis):
                share = column_products(vector, image)
                image = image - vector * share
                column[:, row] += share
        column[:, -1] = np.linalg.norm(image, axis=0)
        basis.append(_divide_by_norms(image, column[:, -1].real))
        taken += 1
        rotation = np.linalg.qr(hessenberg[:, : taken + 1, :taken], mode="complete").Q
        norms = start * np.abs(rotation[:, 0, -1])  # the least |e - H y|, with e the first unit vector
        finished |= norms <= target
        progress("solve", float(np.clip(1 - np.log(np.maximum(norms / target, 1.0)).max() / first, 0, 1)))
    if not taken:
        return np.zeros_like(residual), 0
    weights = np.linalg.pinv(hessenberg[:, : taken + 1, :taken])[:, :, 0] * start[:, None]
    return precondition(sum(vector * weights[:, row] for row, vector in enumerate(basis[:-1]))), taken


def _divide_by_norms(vectors: Any, norms: Floats) -> Any:
    """Return ``vectors`` (n, channels) divided by their ``norms`` (channels,); zero vectors stay zero."""
    return vectors * np.divide(1.0, norms, out=np.zeros_like(norms), where=norms > 0)


@dataclass(frozen=True)
class ReferenceSolver:
    """The solver ``reference``: BiCGSTAB as in King et al. (2024), section 5.4, up to ``max_iterations`` iterations.

    Faster solvers are measured against it: its iterations double when the spacing halves. The paper preconditions by
    the diagonal of A, which is the same in every row: that does not change BiCGSTAB, and is left out.
    """

    takes_levels: ClassVar[bool] = False

    max_iterations: int = 20_000

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> PreparedReference:
        """Return the iteration for an operator; nothing is computed before the solve, and ``levels`` are not used."""
        del levels
        return PreparedReference(operator, None, self.max_iterations, "reference")


class PreparedReference(KrylovSolver):
    """An operator, ready to solve by BiCGSTAB."""

    stalled_rounds = 8  # after a breakdown an iteration from the true residual may go on

    def correct(self, residual: Floats, target: Floats, most: int, progress: Progress) -> tuple[Floats, int, int]:
        """Return x (n, k) with ``A x = residual``, the iterations and products; see :meth:`KrylovSolver.correct`.

        The iteration also ends when a channel breaks down or is not finite; ``residual`` is overwritten.
        """
        shadow, direction = residual.copy(), residual.copy()
        x = np.zeros_like(residual)
        rho = column_products(shadow, residual)
        shadow_size = np.sqrt(rho.real)
        start = np.log(shadow_size / target).max()
        iteration = 0
        while iteration < most:
            iteration += 1
            image = self.operator.apply(direction)
            alpha = _ratio(rho, column_products(shadow, image))
            residual -= alpha * image
            image_half = self.operator.apply(residual)
            omega = _ratio(column_products(image_half, residual), column_products(image_half, image_half))
            x += alpha * direction + omega * residual
            residual -= omega * image_half
            before, rho = rho, column_products(shadow, residual)
            size = np.sqrt(column_products(residual, residual).real)
            finished = size <= target
            progress("solve", float(np.clip(1 - np.log(np.maximum(size / target, 1.0)).max() / start, 0, 1)))
            broken = np.abs(rho) <= 1e-14 * shadow_size * size  # the shadow residual is orthogonal but for rounding
            if finished.all() or np.any(broken & ~finished) or not np.isfinite(size).all():
                break
            beta = _ratio(rho, before) * _ratio(alpha, omega)
            direction = residual + beta * (direction - omega * image)
            if finished.any():  # a finished channel would divide zero by zero; it does not change any more
                direction[:, finished], residual[:, finished] = 0.0, 0.0
        return x, iteration, 2 * iteration * x.shape[1]


def _ratio(a: Floats, b: Floats) -> Floats:
    """Return a / b (channels,), or zero if b is zero: in a channel that is finished or has broken down."""
    return np.divide(a, b, out=np.zeros_like(a), where=b != 0)
