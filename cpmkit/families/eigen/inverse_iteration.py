"""Inverse iteration, ``(A - sigma B)^-1 B``, for the eigenvalue problem ``A u = lambda B u``, with ARPACK.

B is the mass matrix of the form, or that of Steklov conditions. Lanczos' iteration (for symmetric problems) or
Arnoldi's finds the eigenvalues theta of a step that are largest in size; lambda is ``sigma + 1 / theta``. Spurious
eigenvalues, due to ghost nodes, stabilisation or functions in the kernel of B, have theta near zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.errors import ConvergenceError, InputError, SceneError
from cpmkit.families.context import SolveContext, operator_key
from cpmkit.linear.direct import factorize_symmetric
from cpmkit.linear.krylov import column_products
from cpmkit.linear.operators import Operator, PreparedSolver, Stiffness
from cpmkit.linear.preconditioned import PreconditionedCG
from cpmkit.linear.residuals import IndefiniteError
from cpmkit.scene.compound_equations import Eigen
from cpmkit.scene.diffusivities import mean_diffusivity
from cpmkit.types import Floats, Ints

#: Eigenvalues that differ by less than this share of the tolerance count as equal.
SAME_EIGENVALUE_TOLERANCES = 0.1
#: A preconditioner is not accepted if it overshoots (:meth:`InverseIteration._overshoots`) by more than this share.
OVERSHOOTING_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class EigenPairs:
    """Eigenvalues (k,) and eigenvectors (n, k) in any order; complex for unsymmetric problems."""

    values: Any
    vectors: Any


@dataclass(eq=False)
class InverseIteration:
    """A step of inverse iteration: ``(A - sigma B)^-1 B``."""

    context: SolveContext  #: The context, with the discretised scene.
    operator: Operator  #: A - sigma B.
    prepared: PreparedSolver  #: Solver of systems with the operator.
    mass: Any  #: Operator or None: B; None for the identity.
    shift: float  #: sigma.
    unit: float  #: A typical eigenvalue of a manifold of this size.
    products: int = 0  #: Number of products with the operator so far.
    solves: int = 0  #: Number of linear solves so far.

    @property
    def symmetric(self) -> bool:
        """Whether A and B are symmetric: eigenvalues are then real, and eigenfunctions orthogonal."""
        return self.operator.symmetric and (self.mass is None or self.mass.symmetric)

    @property
    def preconditioner(self) -> PreconditionedCG | None:
        """The preconditioner that approximates a solve; None for unsymmetric problems and for direct solvers."""
        return self.prepared if self.symmetric and isinstance(self.prepared, PreconditionedCG) else None

    def apply_mass(self, v: Floats) -> Floats:
        """Return B v for v (n,) or (n, k)."""
        return v if self.mass is None else np.asarray(self.mass.apply(v))

    def step(self, v: Floats) -> Floats:
        """Return ``(A - sigma B)^-1 B v`` for v (n,) or (n, k)."""
        return self.apply_inverse(self.apply_mass(v))

    def apply_inverse(self, image: Floats) -> Floats:
        """Return ``(A - sigma B)^-1 image`` for (n,) or (n, k), and count the work; ConvergenceError if that fails."""
        columns = np.ascontiguousarray(image.reshape(len(image), -1))
        u, report = self.prepared.solve(columns, self.context.tolerance)
        self.products, self.solves = self.products + report.operator_applications, self.solves + 1
        self._report_progress()
        return np.asarray(u.reshape(image.shape))

    def apply_preconditioner(self, residual: Floats) -> Floats:
        """Return the preconditioner, which must not be None, times a residual (n, k), and count the products.

        A preconditioner that overshoots, such as a cycle that is indefinite after rounding to float32, is replaced by
        its fallback.
        """
        assert self.preconditioner is not None
        self.products += self.preconditioner.preconditioner.products * residual.shape[1]
        self.solves += 1
        self._report_progress()
        correction = self.preconditioner.precondition(np.ascontiguousarray(residual))
        if self.preconditioner.fallback is None or not self._overshoots(correction, residual):
            return correction
        self.prepared = self.preconditioner.prepared_fallback
        return self.apply_preconditioner(residual)

    def _overshoots(self, correction: Floats, residual: Floats) -> bool:
        """Return whether some column z (n,) of ``correction`` has more energy z' A z than z' r, r its ``residual``.

        A V cycle M of a positive A does not overshoot: it reduces the error in the norm of A, so that M A has no
        eigenvalue above 1.
        """
        self.products += residual.shape[1]
        energies = column_products(correction, self.operator.apply(correction))
        return bool((energies > (1 + OVERSHOOTING_SHARE) * column_products(correction, residual)).any())

    def failure(self, reason: str, remedy: str, residual: float = np.inf) -> ConvergenceError:
        """Return the ConvergenceError, with ``reason``, ``remedy`` and a report with the relative ``residual``."""
        report = self.context.report(False, self.solves, self.products, residual, reason)
        return ConvergenceError(f"The eigenvalues did not converge: {reason}; {remedy}.", report)

    def _report_progress(self) -> None:
        """Report progress; the share done is only a guess, as the number of solves is not known in advance."""
        self.context.progress("solve", 1.0 - 1.0 / (1.0 + 0.05 * self.solves))


def prepare_inverse_iteration(context: SolveContext, problem: Eigen, stiffness: Stiffness) -> InverseIteration:
    """Return prepared inverse iteration for A u = lambda B u, with a shift just below ``problem.near``.

    ``stiffness`` is A. Without ``near`` the shift is below the least c (0 for Steklov conditions), and also below the
    spectrum if A is symmetric and the form's iterative solver is not multigrid. Raises SceneError if no number below
    the spectrum is found, or a Steklov problem has a piece with Neumann conditions alone, and as
    :meth:`SolveContext.prepare` does.
    """
    form = context.discretized
    bounds = np.asarray(context.scene.surface.bounds, dtype=np.float64)
    length = float((bounds[1] - bounds[0]).max())
    distance = 1.0 if problem.near is None else 0.05  # in units of a typical eigenvalue of a manifold of this size
    mass = form.boundary_mass(stiffness)
    if mass is not None:
        free = form.free_constants(stiffness)
        if free is not None and not mass.apply(free.indicator.toarray()).any(axis=0).all():
            raise SceneError(
                "The boundaries cut off a piece of the manifold on which nothing holds but Neumann conditions: there "
                "every lambda is an eigenvalue; give it a Steklov, Dirichlet or Robin condition."
            )
        unit, near = 1 / length, problem.near or 0.0
    else:
        mass = form.mass
        unit = mean_diffusivity(problem.diffusivity, form.points) / length**2
        least = float(form.data_at_points(problem.c, "the factor c").min()) if problem.near is None else 0.0
        near = least if problem.near is None else problem.near
    shift = near - distance * unit
    if problem.near is None and stiffness.symmetric and form.traits.iterative_solver != "multigrid":
        key = ("below", operator_key(problem.terms()), shift)
        shift = context.cache.get(key, _shift_below_spectrum, stiffness, mass, shift, unit)
    key = ("less", operator_key(problem.terms()), shift)
    operator, prepared = context.cache.get(key, _prepare_shifted, context, stiffness, shift, mass)
    return InverseIteration(context, operator, prepared, mass, shift, unit)


def _shift_below_spectrum(stiffness: Stiffness, mass: Any, shift: float, unit: float) -> float:
    """Return a number below all eigenvalues: ``shift`` itself, or one lower by 4 ``unit``, 16 ``unit`` more, ....

    ``stiffness`` is A, ``mass`` B or None for the identity. Conditions that add energy may cause eigenvalues far below
    zero. Raises SceneError if twelve trials find no such number.
    """
    for _ in range(12):
        try:
            factorize_symmetric(stiffness.minus_shifted_mass(shift, mass).to_csr(), "at the shift")
        except IndefiniteError:
            shift, unit = shift - 4 * unit, 4 * unit
            continue
        return shift
    raise SceneError(
        f"There are eigenvalues below {shift:.3g}, and no lower bound of them was found: conditions or c feed more "
        "than the spacing resolves; give near= for the eigenvalues that are meant, or use a smaller spacing."
    )


def _prepare_shifted(
    context: SolveContext, stiffness: Stiffness, shift: float, mass: Any
) -> tuple[Operator, PreparedSolver]:
    """Return A - shift B and the prepared solver of its systems; A is ``stiffness``, B ``mass`` (None: identity)."""
    operator = stiffness.minus_shifted_mass(shift, mass)
    return operator, context.prepare(operator)


def arpack_pairs(iteration: InverseIteration, count: int) -> EigenPairs:
    """Return the ``count`` eigenpairs nearest to the shift, in any order, by ARPACK; eigenvectors have any scale.

    Raises ConvergenceError if a linear solve or the iteration does not reach the tolerance.
    """
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs, eigsh

    shape = iteration.operator.size, iteration.operator.size
    tolerance = SAME_EIGENVALUE_TOLERANCES * iteration.context.tolerance
    start = np.random.default_rng(0).normal(size=iteration.operator.size)

    def matrix(product: Callable[[Floats], Floats]) -> Any:
        return LinearOperator(shape, matvec=product, dtype=np.float64)

    try:
        if not iteration.symmetric:
            theta, vectors = eigs(matrix(iteration.step), count, which="LM", v0=start, tol=tolerance)
            return EigenPairs(iteration.shift + 1 / theta, vectors)
        # in B's inner product; B may be singular, since all vectors are in the range of (A - sigma B)^-1 B
        values, vectors = eigsh(
            matrix(iteration.operator.apply),  # unused in this mode
            count,
            None if iteration.mass is None else matrix(iteration.mass.apply),
            sigma=iteration.shift,
            OPinv=matrix(iteration.apply_inverse),
            v0=iteration.step(start),
            tol=tolerance,
        )
    except ArpackNoConvergence as error:
        name = "Lanczos" if iteration.symmetric else "Arnoldi"
        reason = f"{name}'s iteration found {len(error.eigenvalues)} of {count} eigenvalues"
        raise iteration.failure(reason, "ask for fewer, or for a larger solver_tolerance") from error
    return EigenPairs(values, vectors)


def mass_unknowns(iteration: InverseIteration) -> Ints | None:
    """Return the unknowns (m,) whose rows of B are not zero; None if m exceeds 64 or half of the number of unknowns.

    None also if the problem is not symmetric, or B is the identity or has no matrix.
    """
    if not iteration.symmetric or iteration.mass is None or not hasattr(iteration.mass, "to_csr"):
        return None
    matrix = iteration.mass.to_csr()
    unknowns = np.flatnonzero(abs(matrix) @ np.ones(matrix.shape[1]))
    return unknowns if len(unknowns) <= min(64, matrix.shape[0] // 2) else None


def dense_pairs(iteration: InverseIteration, count: int, unknowns: Ints | None = None) -> EigenPairs:
    """Return all eigenpairs with finite eigenvalues, by a dense matrix on ``unknowns`` (m,), by default all.

    B must be zero outside the rows and columns of the unknowns. Raises InputError if there are fewer than ``count``
    pairs. Raises ConvergenceError if a linear solve fails.
    """
    n = iteration.operator.size
    rows = np.arange(n) if unknowns is None else unknowns
    columns = np.zeros((n, len(rows)))
    columns[rows, np.arange(len(rows))] = 1.0
    steps = iteration.step(columns)
    theta, vectors = np.linalg.eig(steps[rows])
    finite = np.abs(theta) > 1e-9 * np.abs(theta).max()
    if finite.sum() < count:
        found = f"count={count} is more than the {int(finite.sum())} eigenvalues"
        if unknowns is not None:
            raise InputError(f"{found} that there are: lambda is in the conditions of so few points; ask for these.")
        raise InputError(
            f"{found} of a mesh or lattice with {n} unknowns; ask for fewer, or use a finer mesh or a smaller spacing."
        )
    return EigenPairs(iteration.shift + 1 / theta[finite], steps @ (vectors[:, finite] / theta[finite]))
