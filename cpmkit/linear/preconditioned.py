"""Preconditioned conjugate gradients and GMRES, and the solver ``jacobi``, which preconditions by the diagonal.

Where constants are free on pieces of the manifold, conjugate gradients run in the orthogonal complement of the
indicators of these pieces, and the means that the border fixes are added afterwards.

``jacobi`` is for matrices in which the mass dominates, such as M + factor A of short steps in time: they need as many
iterations as M, 90 to 100 for splines, each in an eighth of the time of a multigrid cycle. Penalties and couplings of
conditions cause large eigenvalues whose eigenvectors are zero except near the conditions; without an exact solve for
the unknowns there, a circle with Dirichlet values takes 440 to 620 iterations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.linear.csr_matrices import SymmetricCsr, UnsignedCsr, uses_threads
from cpmkit.linear.direct import factorize_symmetric
from cpmkit.linear.krylov import KrylovSolver, conjugate_gradients, gmres, indefinite_error
from cpmkit.linear.operators import LinearSolver, Operator, PreparedSolver, as_bordered, without_border
from cpmkit.linear.residuals import IndefiniteError
from cpmkit.types import Floats, Ints, Progress

#: Iterations after which multigrid would have been faster, and takes over.
MAX_BEFORE_MULTIGRID = 200


class PreconditionedCG(KrylovSolver):
    """A symmetric positive operator, which may have a border, ready to solve by conjugate gradients."""

    @cached_property
    def _matrix(self) -> UnsignedCsr | SymmetricCsr:
        """A without its border, in the storage with the fastest products."""
        matrix = self.operator.to_csr()
        return UnsignedCsr.from_matrix(matrix) if uses_threads(matrix.nnz) else SymmetricCsr.from_matrix(matrix)

    def correct(self, residual: Floats, target: Floats, most: int, progress: Progress) -> tuple[Floats, int, int]:
        """Return x (n, k) with ``A x = residual``, the iterations and products; see :meth:`KrylovSolver.correct`."""
        bordered, compatible, excess = as_bordered(self.operator), residual, np.zeros(0)
        if bordered is not None:
            compatible, excess = bordered.border.balance(residual)
        step, taken = conjugate_gradients(
            self._matrix.apply, self.precondition, compatible, target, most, progress, self.slack
        )
        if bordered is not None:
            step += bordered.border.indicator @ (excess / bordered.shift - bordered.border.mean @ step)
        return step, taken, (taken + (taken + 1) * self.preconditioner.products) * residual.shape[1]

    def precondition(self, residual: Floats) -> Floats:
        """Return the preconditioner times ``residual`` (n, channels), both orthogonal to constants on the pieces."""
        return self._without_constants(self.preconditioner.apply(self._without_constants(residual)))

    def _without_constants(self, vector: Floats) -> Floats:
        """Return the part of ``vector`` (n, channels) that is orthogonal to the indicators of the border's pieces."""
        bordered = as_bordered(self.operator)
        if bordered is None:
            return vector
        indicator = bordered.border.indicator
        sums, members = indicator.T @ vector, indicator.sum(axis=0)
        return np.asarray(vector - indicator @ (sums / members[:, None]))


class PreconditionedGMRES(KrylovSolver):
    """An operator that is indefinite, complex or unsymmetric, ready to solve by GMRES."""

    round_iterations = 60  # a vector is stored for each

    def correct(self, residual: Any, target: Floats, most: int, progress: Progress) -> tuple[Any, int, int]:
        """Return x (n, k) with ``A x = residual``, the iterations and products; see :meth:`KrylovSolver.correct`."""
        step, taken = gmres(self.operator.apply, self._precondition, residual, target, most, progress)
        return step, taken, taken * (1 + self.preconditioner.products) * residual.shape[1]

    def _precondition(self, residual: Any) -> Any:
        """Return the preconditioner, which is real, applied to a real or complex ``residual`` (n, channels)."""
        if not np.iscomplexobj(residual):
            return self.preconditioner.apply(residual)
        parts = np.concatenate([residual.real, residual.imag], axis=1)
        real, imaginary = np.split(self.preconditioner.apply(parts), 2, axis=1)
        return real + 1j * imaginary


def stop_by_preconditioned_residual(prepared: PreparedSolver) -> tuple[PreparedSolver, float] | None:
    """Return a solver that stops by the preconditioned residual too (1e-8), and the tolerance for its residual (1e-6).

    With a multigrid cycle the preconditioned residual is proportional to the error of u at any spacing. None unless
    ``prepared`` is conjugate gradients with a multigrid cycle.
    """
    if not isinstance(prepared, PreconditionedCG) or prepared.solver != "multigrid":
        return None
    # To 1e-8 and 1e-6: it leaves less than 0.05 percent of a discretisation's error, with conditions on curves too.
    return replace(prepared, slack=100.0), 1e-6


@dataclass(frozen=True, eq=False)
class JacobiPreconditioner:
    """Division by the diagonal, with an exact solve for the unknowns near conditions."""

    inverse: Floats  #: (n, 1): inverse of the diagonal.
    strip: Ints  #: (k,): the unknowns near conditions, which are solved for together.
    #: object with a method ``solve``: factors of the rows and columns of the strip; None if the strip is empty.
    factors: Any
    products: int = 0  #: The number of products with the matrix in one application.

    def apply(self, b: Floats) -> Floats:
        """Return an approximate solution (n, channels) of ``A x = b`` for b (n, channels)."""
        x = b * self.inverse
        if len(self.strip):
            x[self.strip] = self.factors.solve(b[self.strip])
        return np.asarray(x)


@dataclass(frozen=True)
class JacobiSolver:
    """The solver ``jacobi``: conjugate gradients preconditioned by the diagonal, up to ``max_iterations`` times."""

    max_iterations: int = 5000

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> PreconditionedCG:
        """Return the iteration; ``levels[0]``, if any, gives the unknowns near conditions, unless there is a border.

        Raises SceneError if the operator is not real and symmetric. Raises ConvergenceError if the diagonal has an
        entry that is not above zero, or the matrix of the unknowns near conditions is not positive definite.
        """
        inner = without_border(operator)
        if not inner.symmetric or np.iscomplexobj(inner.diagonal):
            raise SceneError("solver 'jacobi' solves real symmetric systems, got another one; use solver='direct'.")
        matrix = inner.to_csr()
        strip = levels[0].strip if levels and inner is operator else np.zeros(0, dtype=np.int64)
        diagonal = matrix.diagonal()[:, None]
        try:
            if not (diagonal > 0).all():
                raise IndefiniteError("it has entries on the diagonal that are not above zero")
            block = matrix[strip][:, strip].tocsr()
            factors = factorize_symmetric(block, "beside boundaries") if len(strip) else None
        except IndefiniteError as error:
            raise indefinite_error("jacobi", error, 0, np.nan) from error
        return PreconditionedCG(
            operator, JacobiPreconditioner(1 / diagonal, strip, factors), self.max_iterations, "jacobi"
        )


@dataclass(frozen=True)
class JacobiOrMultigrid:
    """The solver that preconditions by the diagonal if the mass dominates the matrix, else by ``multigrid``.

    The diagonal is tried again for each right-hand side, so that a run in time is reproduced from a checkpoint.
    """

    multigrid: LinearSolver

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> PreparedSolver:
        """Return the faster iteration, chosen by row sums if the operator is symmetric; else that of multigrid.

        As A 1 = 0, the row sums of M + factor A are those of M alone, while the diagonal is the sum of both: their
        ratio determines the condition number for any unit of length, step and diffusivity. If it is at least 1/64 (for
        -Lap up to steps of 140 spacings squared), there are at most 140 iterations, which take as long as 16 to 20 of
        multigrid. Raises the errors of multigrid.
        """
        matrix = operator.to_csr() if operator.symmetric else None
        if matrix is None or np.median(matrix @ np.ones(operator.size) / matrix.diagonal()) < 1 / 64:
            return self.multigrid.prepare(operator, levels)
        fallback = partial(self.multigrid.prepare, operator, levels)
        return replace(JacobiSolver(MAX_BEFORE_MULTIGRID).prepare(operator, levels), fallback=fallback)
