"""Systems of equations: channels that are coupled at each point, and the biharmonic equation.

With A the operator of one channel and M_ij the mass matrix weighted with C_ij, and the channels of each spline
numbered consecutively, the system is ``(A x I + sum_ij M_ij x e_i e_j') u = b`` with Kronecker products x. The
multigrid levels are those of one channel, repeated for all channels.

The biharmonic equation ``c u + Lap^2 u = f`` is solved as two equations of second order on the same unknowns. With
``v = -Lap u``, K the operator of -Lap and M the mass matrix, ``K u - M v = r`` and ``c M u + K v = q``, where r and q
come from the data of u and of v (Ciarlet and Raviart, 1974). For ``w = v + i s u``, ``s^2 = c``, both are the one
complex system ``(K - i s M) w = q + i s r``. It has the size of K, and not the condition number of its square.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.families.context import SolveContext, apply_mass, with_border
from cpmkit.forms.contract import Discretized, require_ability
from cpmkit.forms.data_checks import Imbalance, balanced_solution
from cpmkit.linear.constant_functions import ConstantFunctions
from cpmkit.linear.multigrid.solver import Level
from cpmkit.linear.operators import Bordered, ComplexShift, CsrOperator, Operator, Stiffness, as_bordered
from cpmkit.linear.residuals import SolveReport
from cpmkit.scene.compound_equations import Biharmonic, Coupled
from cpmkit.scene.equations import Terms
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats, Sides, SparseMatrix


def solve_coupled(context: SolveContext) -> SolutionRecord:
    """Assemble and solve the system of all channels of coupled equations, and return the solution.

    Raises InputError if the coupling is not accepted, and SceneError if the form has no coupled channels or the
    solution is not unique. Raises ConvergenceError if the solver does not reach the tolerance.
    """
    form, problem = context.discretized, cast("Coupled", context.scene.problem)
    require_ability(form, "coupled channels")
    form.check(context.solver_name)
    coupling, channels = _coupling_at_points(problem, form), form.scene.channels
    stiffness = form.stiffness(problem.terms())
    _check_unique(form, stiffness, coupling)
    operator = coupled_operator(stiffness, form, coupling)
    b = (form.load(problem.f) + form.condition_load(stiffness)).reshape(-1, 1)
    prepared = context.solver.prepare(operator, _levels_for_channels(form, stiffness, channels))
    built = time.perf_counter()
    guess = None if context.guess is None else context.guess.reshape(-1, 1)
    each_channel = np.asarray(np.kron(form.constant, np.eye(channels)), dtype=np.float64)
    constants = ConstantFunctions.from_functions(operator, each_channel)
    values, report = constants.solve(prepared, b, context.tolerance, guess, context.progress)
    common = context.common_fields(operator, report, built)
    return SolutionRecord(values=values.reshape(-1, channels), warnings=form.warnings(), **common)


def _coupling_at_points(problem: Coupled, form: Discretized) -> Floats:
    """Return the coupling matrices C (p, k, k) at the form's points, for k channels.

    Raises InputError if the function does not return finite matrices of this shape.
    """
    points, channels = form.points, form.scene.channels
    values = np.asarray(problem.coupling(points.copy()), dtype=np.float64)
    if values.shape != (len(points), channels, channels) or not np.isfinite(values).all():
        raise InputError(
            f"coupling must return finite matrices {(len(points), channels, channels)} at {len(points)} points, one "
            f"row and column a channel, got {shown(values.shape)}."
        )
    return values


def _check_unique(form: Discretized, stiffness: Stiffness, coupling: Floats) -> None:
    """Raise SceneError if on a piece of the manifold no condition or term determines constant channels v (k,).

    Constants are undetermined if nothing fixes that of a single channel, and C v = 0 on the whole piece. ``coupling``
    (p, k, k) is C at the form's points.
    """
    free = form.free_constants(stiffness)
    if free is None:
        return
    for on_piece in (form.at_points(free.indicator.toarray()) > 0.5).T:
        C = coupling[on_piece]
        squares = np.einsum("pij,pik->jk", C, C)  # v' (sum of C'C) v is the sum of |C v|^2
        sizes, combinations = np.linalg.eigh(squares)
        if sizes[0] <= 1e-14 * sizes[-1]:  # rounding
            near = ", ".join(f"{coordinate:.4g}" for coordinate in form.points[on_piece].mean(axis=0))
            constant = ", ".join(f"{entry:.3g}" for entry in combinations[:, 0])
            raise SceneError(
                f"Nothing fixes the channels on the piece about ({near}): the coupling takes the constant ({constant}) "
                "to zero all over it; give c above zero, a value somewhere, or a coupling that does not."
            )


def coupled_operator(stiffness: Stiffness, form: Discretized, coupling: Floats) -> CsrOperator:
    """Return ``A x I + sum_ij M_ij x e_i e_j'``: A = ``stiffness``, M_ij the mass of weight C_ij, C = ``coupling``."""
    from scipy.sparse import bsr_array

    channels = coupling.shape[1]
    single = stiffness.to_csr()
    blocks = np.multiply.outer(single.data, np.eye(channels))
    matrix = bsr_array((blocks, single.indices, single.indptr)).tocsr()
    asymmetry = np.abs(coupling - coupling.transpose(0, 2, 1)).max(initial=0.0)
    symmetric = asymmetry <= 1e-12 * np.abs(coupling).max(initial=0.0)
    masses: dict[tuple[int, int], SparseMatrix] = {}
    for i in range(channels):
        for j in range(channels):
            if (j, i) in masses and symmetric:
                masses[i, j] = masses[j, i]
            elif coupling[:, i, j].any():
                masses[i, j] = form.weighted_mass(coupling[:, i, j])
    if masses:
        pattern = next(iter(masses.values()))
        blocks = np.zeros((len(pattern.data), channels, channels))
        for (i, j), mass in masses.items():
            blocks[:, i, j] = mass.data
        matrix = (matrix + bsr_array((blocks, pattern.indices, pattern.indptr)).tocsr()).tocsr()
    return CsrOperator(matrix, symmetric=bool(symmetric and stiffness.symmetric), symmetric_pattern=True)


def _levels_for_channels(form: Discretized, stiffness: Operator, channels: int) -> Sequence[Level]:
    """Return the multigrid levels of ``stiffness``, the operator of one channel, repeated for all ``channels``."""
    from scipy.sparse import eye_array, kron

    levels = []
    for level in form.levels(stiffness):
        strip = (level.strip[:, None] * channels + np.arange(channels)).ravel()
        prolongation = kron(level.prolongation, eye_array(channels), format="csr")
        lines = level.lines
        if lines is not None:
            lines = (lines[:, None] * channels + np.arange(channels)[:, None]).reshape(-1, lines.shape[1])
        levels.append(replace(level, prolongation=prolongation, strip=strip, lines=lines))
    return levels


@dataclass(frozen=True, eq=False, repr=False)
class BiharmonicRecord(SolutionRecord):
    """The solution of a biharmonic problem, with its Laplacian."""

    second: Floats  #: (unknowns, channels): Lap u at the unknowns.

    def laplacian(self, points: Any, side: Sides = None) -> Floats:
        """Return Lap u at ``points``; parameters and shape of :meth:`cpmkit.Solution.evaluate`."""
        return np.asarray(replace(self, values=self.second).evaluate(points, side))

    def arrays(self) -> dict[str, Any]:
        """Return the arrays of :meth:`SolutionRecord.arrays`, and ``laplacian`` (unknowns, channels)."""
        return {**super().arrays(), "laplacian": self.second}


def solve_biharmonic(context: SolveContext) -> BiharmonicRecord:
    """Assemble and solve the system of a biharmonic problem, and return its solution.

    Where c is zero and no condition fixes a constant on a piece of the manifold, the solution has mean zero there.
    Raises InputError if c is not zero and the linear solver does not solve complex systems, SceneError if the form has
    no second Laplacian, and ConvergenceError if the solver does not reach the tolerance.
    """
    problem, form = cast("Biharmonic", context.scene.problem), context.discretized
    require_ability(form, "second Laplacian")
    form.check(context.solver_name)
    if problem.c and context.solver_name not in ("direct", "multigrid", "reference"):
        raise InputError(
            "a biharmonic problem with c takes solver='direct', 'multigrid' or 'reference', got "
            f"{context.solver_name!r}: its system is complex."
        )
    stiffness = form.stiffness(Terms())
    r = form.condition_load(stiffness)
    q = form.load(problem.f) + form.condition_load(stiffness, of="laplacian")
    built = time.perf_counter()
    solve_pair = _solve_as_complex_system if problem.c else _solve_in_turn
    u, v, report, imbalances = solve_pair(context, stiffness, problem.c, r, q)
    warnings = (*form.warnings(), *(text for defect in imbalances for text in defect.warnings))
    common = context.common_fields(stiffness, report, built)
    return BiharmonicRecord(values=u, second=-v, warnings=warnings, imbalances=imbalances, **common)


#: u (n, channels), v (n, channels), the report, and the imbalances: the parts of f for which there is no solution.
_Pair = tuple[Floats, Floats, SolveReport, tuple[Imbalance, ...]]


def _solve_as_complex_system(context: SolveContext, stiffness: Stiffness, c: float, r: Floats, q: Floats) -> _Pair:
    """Solve ``K u - M v = r`` and ``c M u + K v = q`` for c > 0; return u, v, the report and no imbalances ().

    ``stiffness`` is K; r, q, u, v are (n, channels). M is the mass matrix of equations in time, since for large c the
    consistent mass matrix leaves some unknowns undetermined. Raises ConvergenceError if the solve fails.
    """
    s, mass = float(np.sqrt(c)), context.discretized.mass_in_time
    system = context.cache.get(("complex", s), context.prepare_system, ComplexShift(stiffness, s, mass))
    w, report = system.solve(q + 1j * s * r, context.tolerance, progress=context.progress)
    report = replace(report, operator_applications=2 * report.operator_applications)  # products with the real A
    return np.ascontiguousarray(w.imag / s), np.ascontiguousarray(w.real), report, ()


def _solve_in_turn(context: SolveContext, stiffness: Stiffness, c: float, r: Floats, q: Floats) -> _Pair:
    """Solve ``K v = q``, then ``K u = r + M v``, for c = 0; return u, v, the report and the imbalances of f.

    ``stiffness`` is K; r, q, u, v are (n, channels). On pieces where no condition fixes a constant, u has mean zero.
    Raises ConvergenceError if the solver does not reach the tolerance.
    """
    del c  # is zero
    form = context.discretized
    system = context.cache.get(("pair", 0.0), context.prepare_system, with_border(form, stiffness))
    bordered, imbalances = as_bordered(system.operator), tuple[Imbalance, ...]()
    v, first = system.solve(q, context.tolerance, progress=context.progress)
    if bordered is not None:
        v, imbalances = balanced_solution(bordered, q, v, form)
    u, second = system.solve(r + apply_mass(form, v), context.tolerance, progress=context.progress)
    if bordered is not None:
        u, v = _with_mean_of_laplacian(bordered, form, u, v)
    return u, v, _combined_report(first, second), imbalances


def _with_mean_of_laplacian(operator: Bordered, form: Discretized, u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Return u and v (n, channels), corrected on the pieces where no condition fixes a constant.

    On such a piece u gets mean zero, and v the mean that balances the fluxes of u at the edge. ``K v = q`` does not
    determine the mean of v, and ``K u = r + M v`` has a solution for only one mean, which follows from its imbalance.
    """
    border = operator.border
    u, means = border.remove_means(u)
    indicator = border.indicator.toarray()
    measure = (indicator * apply_mass(form, indicator)).sum(axis=0)
    excess = operator.shift * means * ((indicator * border.constant_load.toarray()).sum(axis=0) / measure)[:, None]
    return u, np.asarray(v - indicator @ excess)


def _combined_report(first: SolveReport, second: SolveReport) -> SolveReport:
    """Return a report of two solves: the sums of their counts, and the rest of the report with the larger residual."""
    worse = max(first, second, key=lambda report: report.residual)
    return replace(
        worse,
        iterations=first.iterations + second.iterations,
        operator_applications=first.operator_applications + second.operator_applications,
    )
