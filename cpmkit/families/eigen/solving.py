"""Eigenvalue problems ``A u = lambda B u``: steps of inverse iteration, or a block of functions without such steps."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.errors import ConvergenceError
from cpmkit.families.context import SolveContext
from cpmkit.families.eigen.block_iteration import MOST_BLOCK_SHARE, block_changes, block_pairs
from cpmkit.families.eigen.inverse_iteration import InverseIteration, Pairs, inverse_iteration
from cpmkit.families.eigen.multiplets import cut_multiplet
from cpmkit.families.eigen.shift_invert import SAME_EIGENVALUE_TOLERANCES, shift_inverted_pairs
from cpmkit.families.eigen.small_range import all_pairs, dense_pairs, few_seen
from cpmkit.forms.contract import Discretized
from cpmkit.linear.residuals import MAX_ROUNDING_SHARE, ROUNDING_FACTOR, rounding_of
from cpmkit.linear.solve_report import SolveReport
from cpmkit.scene.compound_equations import Eigen
from cpmkit.solution.modes import EigenRecord
from cpmkit.types import Floats

#: Further pairs that are sought, so that of a multiple eigenvalue none is missed.
SPARE_PAIRS = 6
#: The same where a block is iterated, as a share of those asked for: the last ones of a block are slow.
SPARE_SHARE = 0.1
#: Imaginary parts above this share of an eigenvalue's distance from the shift are no rounding.
COMPLEX_SHARE = 1e-8
#: An eigenvalue below zero is one of the wrong sign if it is farther from it than this share of ``unit``.
WRONG_SIGN_UNITS = 0.2
#: Values are of the greatest size down to this share of it.
NEARLY_GREATEST_SHARE = 1 - 1e-3
#: So many modes are read at the points of the manifold at a time: all would take more memory than their matrix.
READ_TOGETHER = 4


def solve_eigen(context: SolveContext) -> EigenRecord:
    """Find the eigenvalues of a scene that its problem asks for.

    Raises
    ------
    InputError
        If there are fewer unknowns than eigenvalues are asked for.
    SceneError
        If a Steklov problem has a piece on which nothing holds but Neumann conditions.
    ResolutionError
        If there is an eigenvalue of the wrong sign, or functions do not fit into memory.
    ConvergenceError
        If a linear solve, the iteration, or the residual of a pair misses the tolerance.
    """
    problem, form = context.scene.problem, context.discretized
    assert isinstance(problem, Eigen)
    form.check(context.solver_name)
    stiffness = form.stiffness(problem.terms())
    stepped = inverse_iteration(context, problem, stiffness)
    built = time.perf_counter()
    pairs = _pairs(problem, stepped)
    if stepped.mass is form.mass:  # Steklov's eigenvalues may be of either sign
        form.check_signs(float(np.min(pairs.values.real)), WRONG_SIGN_UNITS * abs(stepped.unit))
    modes = _modes(problem, stepped, pairs)
    report = _judge(stepped, modes)
    told = (
        *form.warnings(),
        *_complex_pairs(modes, stepped.shift),
        *cut_multiplet(problem, pairs.values.real, stepped.shift),
    )
    work = form.work(stiffness, report)
    seconds = {"build": built - context.started, "solve": time.perf_counter() - built}
    real, imaginary = modes.values.real, modes.values.imag
    return EigenRecord(form, modes.functions, report, work, seconds, real, imaginary, modes.residuals, warnings=told)


def _pairs(problem: Eigen, stepped: InverseIteration) -> Pairs:
    """Return more eigenpairs than are asked for.

    Raises
    ------
    InputError, ConvergenceError
        As :func:`solve_eigen` does.
    """
    seen = few_seen(stepped)
    if seen is not None:
        return all_pairs(stepped, seen, problem.count)
    n, wanted = stepped.operator.size, problem.count + SPARE_PAIRS
    if wanted > n - 2:  # iterations have no room
        return dense_pairs(stepped, problem.count)
    wide = problem.count + max(SPARE_PAIRS, int(SPARE_SHARE * problem.count))
    if stepped.preconditioner is not None and wide <= MOST_BLOCK_SHARE * n:
        return block_pairs(stepped, problem.count, wide)
    return shift_inverted_pairs(stepped, wanted)


@dataclass(frozen=True, eq=False)
class Modes:
    """Eigenvalues (k,), complex, real eigenfunctions (n, k), and residuals (k,)."""

    values: Any
    functions: Floats
    residuals: Floats


def _modes(problem: Eigen, stepped: InverseIteration, pairs: Pairs) -> Modes:
    """Return the modes nearest to the number asked for, ascending.

    A complex pair gives two, the real and the imaginary part of the one eigenvector.
    """
    values, vectors = pairs.values, pairs.vectors
    kept = np.flatnonzero(values.imag >= 0)
    about = stepped.shift if problem.near is None else problem.near
    kept = kept[np.argsort(np.abs(values[kept] - about), kind="stable")][: problem.count]
    values, vectors = values[kept], vectors[:, kept]
    residuals = _residuals(stepped, values, vectors)
    paired = np.flatnonzero(values.imag > 0)
    both = np.concatenate([values, values[paired].conj()]).astype(np.complex128)
    functions = np.concatenate([vectors.real, vectors.imag[:, paired]], axis=1)
    order = np.argsort(np.abs(both - about), kind="stable")[: problem.count]
    order = order[np.argsort(both[order].real, kind="stable")]
    both, residuals = both[order], np.concatenate([residuals, residuals[paired]])[order]
    both.imag[np.abs(both.imag) <= COMPLEX_SHARE * np.abs(both - stepped.shift)] = 0.0
    same = SAME_EIGENVALUE_TOLERANCES * stepped.context.tolerance * np.abs(both - stepped.shift)
    return Modes(both, _normalised(stepped.context.discretized, both.real, functions[:, order], same), residuals)


def _normalised(form: Discretized, values: Floats, functions: Floats, same: Floats) -> Floats:
    """Return functions of unit mean square and a fixed sign, orthogonal where ``values`` differ by ``same`` at most."""
    starts = np.flatnonzero(np.diff(values, prepend=-np.inf) > same)
    made = []
    for group in np.split(functions, starts[1:], axis=1):
        root = np.linalg.cholesky(form.inner(group, group))
        made.append(group @ np.linalg.inv(root).T)
    result = np.concatenate(made, axis=1)
    few = np.array_split(result, -(-result.shape[1] // READ_TOGETHER), axis=1)
    return np.ascontiguousarray(result * np.concatenate([_signs(form.at_points(some)) for some in few]))


def _signs(at_points: Floats) -> Floats:
    """Return the sign (k,) of each column of values (p, k) at the first point where its size is nearly the greatest."""
    size = np.abs(at_points)
    first = np.argmax(size >= NEARLY_GREATEST_SHARE * size.max(axis=0), axis=0)
    return np.asarray(np.sign(at_points[first, np.arange(at_points.shape[1])]))


def _residuals(stepped: InverseIteration, values: Any, vectors: Any) -> Floats:
    """Return by how much of its size each eigenvector (n, k) changes in one more step of inverse iteration.

    Where a block was iterated a cycle of the multigrid stands for the step.
    """
    if stepped.preconditioner is not None:
        return block_changes(stepped, values, vectors)
    paired = np.flatnonzero(values.imag > 0)
    steps = stepped.step(np.concatenate([vectors.real, vectors.imag[:, paired]], axis=1))
    step = steps[:, : len(values)].astype(np.complex128)
    step[:, paired] += 1j * steps[:, len(values) :]
    change = (values - stepped.shift) * step - vectors
    return np.asarray(np.sqrt(_squares(stepped, change) / _squares(stepped, vectors)))


def _squares(stepped: InverseIteration, vectors: Any) -> Floats:
    """Return the mean square of each function (n, k) over the manifold."""
    form = stepped.context.discretized
    return np.asarray(sum(np.diag(form.inner(part, part)) for part in (vectors.real, vectors.imag)))


def _judge(stepped: InverseIteration, modes: Modes) -> SolveReport:
    """Return the report.

    Raises
    ------
    ConvergenceError
        If the residual of a pair is above the tolerance, and above what rounding leaves.
    """
    context, residual = stepped.context, float(modes.residuals.max())
    reason = (
        f"one more step of inverse iteration changes the eigenfunctions by {residual:.2e} of their size after "
        f"{stepped.solves} steps, {context.tolerance:.2e} asked for"
    )
    converged = residual <= context.tolerance
    if not converged and residual <= MAX_ROUNDING_SHARE and stepped.preconditioner is None:
        left = _left_by_rounding(stepped, modes)
        converged, reason = residual <= left, f"{reason}, {left:.2e} left by rounding"
    report = context.report(converged, stepped.solves, stepped.products, residual, reason)
    if not report.converged:
        raise ConvergenceError(
            f"The eigenvalues did not converge: {reason}; ask for a larger solver_tolerance.", report
        )
    return report


def _left_by_rounding(stepped: InverseIteration, modes: Modes) -> float:
    """Return by how much of its size rounding may change an eigenfunction in a step: what rounding leaves, solved for.

    What a solve leaves of ``(A - sigma B) u`` is bounded entry by entry; signs are taken at random.
    """
    functions = modes.functions
    spread = np.abs(modes.values - stepped.shift)
    bound = rounding_of(stepped.operator, functions) + spread * np.abs(stepped.image(functions))
    signs = np.random.default_rng(0).choice([-1.0, 1.0], bound.shape)
    moved = stepped.inverted(ROUNDING_FACTOR * np.finfo(float).eps * bound * signs)
    return float(np.sqrt(_squares(stepped, moved) / _squares(stepped, functions)).max())


def _complex_pairs(modes: Modes, shift: float) -> list[str]:
    """Name the eigenvalues that are complex beyond rounding."""
    found = np.flatnonzero(modes.values.imag)
    if not len(found):
        return []
    worst = float(np.max(np.abs(modes.values[found].imag / (modes.values[found] - shift))))
    return [
        f"{len(found)} of {len(modes.values)} eigenvalues are complex, by up to {worst:.1e} of themselves, where those "
        "of the manifold are real: neighbours closer than the scheme's error; their real parts are given."
    ]
