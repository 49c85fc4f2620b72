"""The biharmonic equation c u + Lap^2 u = f, as two equations of second order over the same ghosts.

With ``v = -Lap u`` and K the operator of -Lap, ``K u - v = r`` and ``c u + K v = q``, r and q what the data of u and
of v add. For ``w = v + i s u``, ``s^2 = c``, these are one: ``(K - i s) w = q + i s r``. It has K's size and not its
square's condition number.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import ConvergenceError, InputError, SceneError
from cpmkit.families.job import Job
from cpmkit.forms.collocation.assembly import build_operator
from cpmkit.forms.collocation.boundary.reading import sum_of_data
from cpmkit.forms.collocation.conservation.components import unpinned
from cpmkit.forms.collocation.diagnosis.warnings import warnings_of
from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.linear.operators import LinearSystem, Operator
from cpmkit.linear.report import SolveReport
from cpmkit.protocols import Floats, Side
from cpmkit.scene.compound_equations import Biharmonic
from cpmkit.scene.equations import Terms
from cpmkit.scene.special_conditions import SupportData
from cpmkit.solution.solution import Solution
from cpmkit.solution.work import measure_work

if TYPE_CHECKING:
    from collections.abc import Mapping

#: Iterations of the solver "reference" at most.
ITERATIONS = 20_000
#: The iteration is driven this much below the tolerance, because its residual drifts from the true one.
MARGIN = 0.1


@dataclass(frozen=True, eq=False)
class BiharmonicSolution(Solution):
    """The solution of a biharmonic problem, with its Laplacian.

    Attributes
    ----------
    second : (unknowns, channels) float64
        Lap u at the unknowns.
    """

    second: Floats

    def laplacian(self, points: Any, side: Side | Mapping[str, Side] | None = None) -> Floats:
        """Return Lap u; the parameters are those of :meth:`cpmkit.Solution.evaluate`."""
        return replace(self, values=self.second).evaluate(points, side)

    def arrays(self) -> dict[str, Any]:
        """Return the lattice, the nodes, the values and the Laplacian as plain arrays."""
        return {**super().arrays(), "laplacian": self.second}


def solve_job(job: Job) -> BiharmonicSolution:
    """Solve a biharmonic problem.

    Raises
    ------
    InputError
        If the solver is another than direct and reference.
    SceneError
        If nothing fixes the solution on a piece of the manifold.
    ConvergenceError
        If the solver does not reach the tolerance.
    """
    problem, tables = job.scene.problem, job.tables
    assert isinstance(problem, Biharmonic)
    if problem.c and job.solver_name not in ("direct", "reference"):
        raise InputError(
            f"a biharmonic problem with c takes solver='direct' or 'reference', got {job.solver_name!r}: its system is "
            "complex."
        )
    if unpinned(tables, job.scene)[0]:
        raise SceneError(
            "Nothing fixes the solution of the biharmonic problem on a piece of the manifold, where any constant may "
            "be added; give a SimplySupported condition there, or c above zero."
        )
    operator = build_operator(tables, Terms())
    pair = Pair(operator, problem.c, *_right_sides(tables, operator, problem))
    built = time.perf_counter()
    u, v, report = solve_pair(pair, job)
    work = measure_work(tables, LinearSystem(operator, u), report)
    seconds = {"build": built - job.started, "solve": time.perf_counter() - built}
    told = warnings_of(tables.layout)
    return BiharmonicSolution(job.scene, u, report, work, seconds, tables, -v, warnings=told)


def _right_sides(tables: Discretization, operator: Operator, problem: Biharmonic) -> tuple[Floats, Floats]:
    """Return r and q (n, channels): what the data of u add, and f with what those of v = -Lap u add."""
    second = [
        replace(datum, data=datum.data.laplacian, factor=-datum.factor, what=f"the Laplacian of {datum.what}")
        for datum in tables.data
        if isinstance(datum.data, SupportData)
    ]
    rows, channels = tables.extension.shape[0], tables.layout.channels
    f = tables.read_sources(problem.f, "the right-hand side f")
    return operator.spread(tables.datum()), f + operator.spread(sum_of_data(second, rows, channels))


@dataclass(frozen=True, eq=False)
class Pair:
    """``K u - v = r`` and ``c u + K v = q``.

    Attributes
    ----------
    operator : Operator
        K.
    c : float
        Not below zero.
    first, second : (n, channels) float64
        r and q.
    """

    operator: Operator
    c: float
    first: Floats
    second: Floats

    def residual(self, u: Floats, v: Floats) -> float:
        """Return the larger of the relative residuals of the complex equation's channels; NaN counts as infinite."""
        s = np.sqrt(self.c) or 1.0
        defect = np.hypot(
            np.linalg.norm(self.second - self.c * u - self.operator.apply(v), axis=0),
            s * np.linalg.norm(self.first - self.operator.apply(u) + v, axis=0),
        )
        size = np.hypot(np.linalg.norm(self.second, axis=0), s * np.linalg.norm(self.first, axis=0))
        size = np.where(size > 0, size, 1.0)
        worst = float(np.max(defect / size, initial=0.0))
        return worst if np.isfinite(worst) else np.inf


def solve_pair(pair: Pair, job: Job) -> tuple[Floats, Floats, SolveReport]:
    """Return u, v and the report.

    Raises
    ------
    ConvergenceError
        If the recomputed residual is above the tolerance.
    """
    s = np.sqrt(pair.c)
    if s == 0:
        v, told = job.solver(LinearSystem(pair.operator, pair.second), job.tolerance, job.progress)
        u, also = job.solver(LinearSystem(pair.operator, pair.first + v), job.tolerance, job.progress)
        iterations, products = (a + b for a, b in zip(_counts(told), _counts(also), strict=True))
    else:
        solve = _factorised if job.solver_name == "direct" else _iterated
        w, iterations, products = solve(pair.operator, s, pair.second + 1j * s * pair.first, job)
        u, v = np.ascontiguousarray(w.imag / s), np.ascontiguousarray(w.real)
    job.progress("solve", 1.0)
    residual = pair.residual(u, v)
    reason = f"relative residual {residual:.2e} after {iterations} iterations, {job.tolerance:.2e} asked for"
    report = SolveReport(
        job.solver_name, residual <= job.tolerance, iterations, products, residual, job.tolerance, reason
    )
    if not report.converged:
        raise ConvergenceError(
            f"The biharmonic problem did not converge: {reason}; ask for a larger tolerance, or use solver='direct'.",
            report,
        )
    return u, v, report


def _counts(report: SolveReport) -> tuple[int, int]:
    return report.iterations, report.operator_applications


def _factorised(operator: Operator, s: float, b: Any, job: Job) -> tuple[Any, int, int]:
    """Solve ``(K - i s) w = b`` by sparse LU with one step of refinement; return w, iterations and products."""
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import splu

    job.progress("solve", 0.0)
    matrix = (operator.matrix() - diags_array(np.full(operator.size, 1j * s))).tocsc()
    factors = splu(matrix)
    w = factors.solve(b)
    return w + factors.solve(b - matrix @ w), 0, 2 * b.shape[1]


def _iterated(operator: Operator, s: float, b: Any, job: Job) -> tuple[Any, int, int]:
    """Solve ``(K - i s) w = b`` by BiCGSTAB, channel by channel; return w, iterations and products."""
    from scipy.sparse.linalg import LinearOperator, bicgstab

    products = 0

    def apply(w: Any) -> Any:
        nonlocal products
        products += 2
        parts = operator.apply(np.stack([w.real, w.imag], axis=1))
        return parts[:, 0] + 1j * parts[:, 1] - 1j * s * w

    matrix = LinearOperator((len(b), len(b)), matvec=apply, dtype=np.complex128)
    channels = []
    for channel in range(b.shape[1]):
        job.progress("solve", channel / b.shape[1])
        w, _ = bicgstab(matrix, b[:, channel], rtol=MARGIN * job.tolerance, maxiter=ITERATIONS)
        channels.append(w)
    return np.stack(channels, axis=1), products // (4 * b.shape[1]), products
