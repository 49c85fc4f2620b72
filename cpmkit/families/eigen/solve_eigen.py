"""Eigenvalue problems ``A u = lambda B u``, by inverse iteration or by a block of functions without factorisation."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.families.context import SolveContext, is_nonnegative
from cpmkit.families.eigen.block_iteration import block_changes, block_pairs
from cpmkit.families.eigen.inverse_iteration import (
    SAME_EIGENVALUE_TOLERANCES,
    EigenPairs,
    InverseIteration,
    arpack_pairs,
    dense_pairs,
    mass_unknowns,
    prepare_inverse_iteration,
)
from cpmkit.forms.contract import Discretized
from cpmkit.linear.residuals import MAX_ROUNDING_SHARE, ROUNDING_FACTOR, SolveReport, rounding_bound
from cpmkit.scene.compound_equations import Eigen
from cpmkit.scene.scene import Scene
from cpmkit.solution.modes import EigenRecord
from cpmkit.types import Floats


def solve_eigen(context: SolveContext) -> EigenRecord:
    """Return the eigenvalues and eigenfunctions that a problem requests, as its solution.

    Raises InputError if more eigenvalues are requested than there are finite ones. Raises SceneError if there is no
    lower bound of the eigenvalues, or a Steklov problem has a piece with Neumann conditions alone. Raises
    ResolutionError if an eigenvalue has the wrong sign, or functions do not fit into memory. Raises ConvergenceError if
    a linear solve, the iteration, or the residual of a pair does not reach the tolerance.
    """
    problem, form = cast("Eigen", context.scene.problem), context.discretized
    form.check(context.solver_name)
    stiffness = form.stiffness(problem.terms())
    iteration = prepare_inverse_iteration(context, problem, stiffness)
    built = time.perf_counter()
    pairs = _compute_pairs(problem, iteration)
    if iteration.mass is form.mass:  # Steklov eigenvalues may be of either sign
        _check_signs(form, float(np.min(pairs.values.real)), 0.2 * abs(iteration.unit))
    modes = _select_modes(problem, iteration, pairs)
    report = _checked_report(iteration, modes)
    warnings = (
        *form.warnings(),
        *_complex_pair_warnings(modes, iteration.shift),
        *split_multiplet_warning(problem, pairs.values.real, iteration.shift),
    )
    return EigenRecord(
        values=modes.functions,
        eigenvalues=modes.values.real,
        imaginary=modes.values.imag,
        residuals=modes.residuals,
        warnings=warnings,
        **context.common_fields(stiffness, report, built),
    )


def _check_signs(form: Discretized, least: float, negligible: float) -> None:
    """Raise ResolutionError if the ``least`` eigenvalue is below ``-negligible``, but no exact one is negative."""
    if least < -negligible and is_nonnegative(form):
        raise ResolutionError(
            f"spacing={form.spacing:g} is too coarse for this surface: parts of it about two spacings thick read each "
            f"other, and the operator of {form.scene.problem} has an eigenvalue of the wrong sign, {least:.3g}; use "
            f'form="galerkin", or a spacing of {2 / 3 * form.spacing:.2g}.'
        )


def _compute_pairs(problem: Eigen, iteration: InverseIteration) -> EigenPairs:
    """Return eigenpairs, some more than requested if there are more, by the method that suits their number.

    Raises InputError, ResolutionError or ConvergenceError as :func:`solve_eigen` does.
    """
    unknowns = mass_unknowns(iteration)
    if unknowns is not None:
        return dense_pairs(iteration, problem.count, unknowns)
    # Further pairs are computed so that no pair of a multiple eigenvalue is missed, and since the last pairs of a block
    # converge slowly.
    n, count = iteration.operator.size, problem.count + 6
    if count > n - 2:  # too many for an iteration
        return dense_pairs(iteration, problem.count)
    width = problem.count + max(6, problem.count // 10)
    if iteration.preconditioner is not None and width <= 0.1 * n:
        return block_pairs(iteration, problem.count, width)
    return arpack_pairs(iteration, count)


@dataclass(frozen=True, eq=False)
class Modes:
    """Complex eigenvalues (k,), real eigenfunctions (n, k), and residuals (k,)."""

    values: Any
    functions: Floats
    residuals: Floats


def _select_modes(problem: Eigen, iteration: InverseIteration, pairs: EigenPairs) -> Modes:
    """Return the ``problem.count`` modes with eigenvalues nearest to ``problem.near``, by default the shift, ascending.

    A pair of complex eigenvalues gives two modes, the real and the imaginary part of an eigenvector.
    """
    values, vectors = pairs.values, pairs.vectors
    chosen = np.flatnonzero(values.imag >= 0)
    about = iteration.shift if problem.near is None else problem.near
    chosen = chosen[np.argsort(np.abs(values[chosen] - about), kind="stable")][: problem.count]
    values, vectors = values[chosen], vectors[:, chosen]
    residuals = _residuals(iteration, values, vectors)
    paired = np.flatnonzero(values.imag > 0)
    both = np.concatenate([values, values[paired].conj()]).astype(np.complex128)
    functions = np.concatenate([vectors.real, vectors.imag[:, paired]], axis=1)
    order = np.argsort(np.abs(both - about), kind="stable")[: problem.count]
    order = order[np.argsort(both[order].real, kind="stable")]
    both, residuals = both[order], np.concatenate([residuals, residuals[paired]])[order]
    both.imag[np.abs(both.imag) <= 1e-8 * np.abs(both - iteration.shift)] = 0.0  # rounding
    equal = SAME_EIGENVALUE_TOLERANCES * iteration.context.tolerance * np.abs(both - iteration.shift)
    return Modes(both, _normalise(iteration.context.discretized, both.real, functions[:, order], equal), residuals)


def _normalise(form: Discretized, values: Floats, functions: Floats, equal: Floats) -> Floats:
    """Return the eigenfunctions ``functions`` (n, k) with mean square 1, positive where they are largest in size.

    Functions whose eigenvalues ``values`` (k,), ascending, differ by at most ``equal`` (k,) are made orthogonal.
    """
    starts = np.flatnonzero(np.diff(values, prepend=-np.inf) > equal)
    groups = []
    for group in np.split(functions, starts[1:], axis=1):
        root = np.linalg.cholesky(form.inner(group, group))
        groups.append(group @ np.linalg.inv(root).T)
    result = np.concatenate(groups, axis=1)
    at_points = form.at_points(result)
    size = np.abs(at_points)
    first = np.argmax(size >= (1 - 1e-3) * size.max(axis=0), axis=0)  # the first point with nearly the largest size
    return np.ascontiguousarray(result * np.sign(at_points[first, np.arange(len(first))]))


def _residuals(iteration: InverseIteration, values: Any, vectors: Any) -> Floats:
    """Return the relative change (k,) of each eigenvector in one more step of inverse iteration.

    ``values`` (k,) are the eigenvalues, ``vectors`` (n, k) the eigenvectors, real or complex. If ``iteration`` has a
    preconditioner, the step is a preconditioned one.
    """
    if iteration.preconditioner is not None:
        return block_changes(iteration, values, vectors)
    paired = np.flatnonzero(values.imag > 0)
    steps = iteration.step(np.concatenate([vectors.real, vectors.imag[:, paired]], axis=1))
    step = steps[:, : len(values)].astype(np.complex128)
    step[:, paired] += 1j * steps[:, len(values) :]
    change = (values - iteration.shift) * step - vectors
    return np.asarray(np.sqrt(_mean_squares(iteration, change) / _mean_squares(iteration, vectors)))


def _mean_squares(iteration: InverseIteration, vectors: Any) -> Floats:
    """Return the mean square (k,) over the manifold of each of k complex functions ``vectors`` (n, k)."""
    form = iteration.context.discretized
    return np.asarray(sum(np.diag(form.inner(part, part)) for part in (vectors.real, vectors.imag)))


def _checked_report(iteration: InverseIteration, modes: Modes) -> SolveReport:
    """Return the report of the solve; its residual is the largest residual of a mode.

    Raises ConvergenceError if the residual is above the tolerance. Without a preconditioner a residual up to
    :data:`MAX_ROUNDING_SHARE` that rounding explains is accepted.
    """
    context, residual = iteration.context, float(modes.residuals.max())
    reason = (
        f"one more step of inverse iteration changes the eigenfunctions by {residual:.2e} of their size after "
        f"{iteration.solves} steps, tolerance {context.tolerance:.2e}"
    )
    converged = residual <= context.tolerance
    if not converged and residual <= MAX_ROUNDING_SHARE and iteration.preconditioner is None:
        rounding = _rounding_change(iteration, modes)
        converged, reason = residual <= rounding, f"{reason}, {rounding:.2e} left by rounding"
    if not converged:
        raise iteration.failure(reason, "ask for a larger solver_tolerance", residual)
    return context.report(True, iteration.solves, iteration.products, residual, reason)


def _rounding_change(iteration: InverseIteration, modes: Modes) -> float:
    """Return the largest relative change of an eigenfunction in one step of iteration that rounding may cause.

    The rounding of ``(A - sigma B) u`` is bounded entry by entry, with random signs.
    """
    functions = modes.functions
    distance = np.abs(modes.values - iteration.shift)
    bound = rounding_bound(iteration.operator, functions) + distance * np.abs(iteration.apply_mass(functions))
    signs = np.random.default_rng(0).choice([-1.0, 1.0], bound.shape)
    change = iteration.apply_inverse(ROUNDING_FACTOR * np.finfo(float).eps * bound * signs)
    return float(np.sqrt(_mean_squares(iteration, change) / _mean_squares(iteration, functions)).max())


def _complex_pair_warnings(modes: Modes, shift: float) -> list[str]:
    """Return a warning in a list if eigenvalues are complex, with the largest ``|imag / (value - shift)|``; else []."""
    pairs = np.flatnonzero(modes.values.imag)
    if not len(pairs):
        return []
    worst = float(np.max(np.abs(modes.values[pairs].imag / (modes.values[pairs] - shift))))
    return [
        f"{len(pairs)} of {len(modes.values)} eigenvalues are complex, by up to {worst:.1e} of their distance from "
        f"{shift:.3g}, where those of the manifold are real: neighbours closer than the scheme's error; their real "
        "parts are given."
    ]


#: The words by which a warning of :func:`split_multiplet_warning` is recognised.
SPLIT_MULTIPLET = "ends inside a multiplet"


def split_multiplet_warning(problem: Eigen, values: Floats, shift: float) -> list[str]:
    """Return a list with a warning if an eigenvalue that is left out is within 1e-3 of a returned one, or [].

    ``values`` (k,) are the computed eigenvalues, in any order; if they are no more than ``problem`` requests, there is
    no warning. Differences are relative to the distance of the one left out from ``shift``.
    """
    about = shift if problem.near is None else problem.near
    ordered = values[np.argsort(np.abs(values - about), kind="stable")]
    returned, others = ordered[: problem.count], ordered[problem.count :]
    gaps = np.abs(others[:, None] - returned).min(axis=1, initial=np.inf)
    equal = others[gaps <= 1e-3 * np.abs(others - shift)]  # they may be one multiple eigenvalue
    if not len(equal):
        return []
    complete, many = len(equal) < len(others), len(equal) > 1
    return [
        f"count={problem.count} {SPLIT_MULTIPLET}: {'' if complete else 'at least '}{len(equal)} further eigenvalue"
        f"{'s' if many else ''} near {equal[0]:.6g} {'are' if many else 'is'} left out, and which functions of the "
        f"multiplet are returned is arbitrary; use count={problem.count + len(equal)}{'' if complete else ' or more'}."
    ]


def keep_requested_modes(solution: EigenRecord, scene: Scene) -> EigenRecord:
    """Return ``solution`` with only the modes that ``scene`` requests; itself if the scene requests as many or more."""
    problem, values = cast("Eigen", scene.problem), solution.eigenvalues
    if problem.count >= len(values):
        return solution
    # without a number they were sought from below the spectrum: from about zero, if no eigenvalue is negative
    below = min(float(values.min()), 0.0)
    about = below if problem.near is None else problem.near
    chosen = np.sort(np.argsort(np.abs(values - about), kind="stable")[: problem.count])
    warnings = [text for text in solution.warnings if SPLIT_MULTIPLET not in text]
    return replace(
        solution,
        discretized=solution.discretized.with_scene(scene),
        values=np.ascontiguousarray(solution.values[:, chosen]),
        eigenvalues=values[chosen],
        imaginary=solution.imaginary[chosen],
        residuals=solution.residuals[chosen],
        warnings=(*warnings, *split_multiplet_warning(problem, values, below)),
    )
