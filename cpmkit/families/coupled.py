"""Problems whose channels are coupled at each point: one linear system for all channels.

With A the operator of one channel and M_ij the mass matrix weighted with C_ij, and the channels of each spline
numbered consecutively, the system is ``(A x I + sum_ij M_ij x e_i e_j') u = b`` with Kronecker products x. The
multigrid levels are those of one channel, repeated for all channels.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.families.context import SolveContext
from cpmkit.forms.contract import Discretized, require
from cpmkit.linear.constant_functions import ConstantFunctions
from cpmkit.linear.multigrid.cycle import Level
from cpmkit.linear.operators import CsrOperator
from cpmkit.linear.protocols import Operator, Stiffness
from cpmkit.scene.compound_equations import Coupled
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Largest asymmetry of a symmetric C, as a share of its largest entry: rounding.
SYMMETRIC_SHARE = 1e-12
#: Largest |C v| for a constant v to be free, as a share of the largest |C v| of any v: rounding of squares.
FREE_SHARE = 1e-7


def solve_coupled(context: SolveContext) -> SolutionRecord:
    """Assemble and solve the system of all channels, and return the solution.

    Raises
    ------
    InputError, SceneError
        If the coupling is not accepted, or the solution is not unique.
    ConvergenceError
        If the solver does not reach the tolerance.
    """
    form, problem = context.discretized, context.scene.problem
    assert isinstance(problem, Coupled)
    require(form, "coupled channels")
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
    constants = ConstantFunctions.of(operator, each_channel)
    values, report = constants.solve(prepared, b, context.tolerance, guess, context.progress)
    seconds = {"build": built - context.started, "solve": time.perf_counter() - built}
    work = form.work(operator, report)
    return SolutionRecord(form, values.reshape(-1, channels), report, work, seconds, warnings=form.warnings())


def _coupling_at_points(problem: Coupled, form: Discretized) -> Floats:
    """Return the coupling matrices C (p, k, k) at the form's points, for k channels.

    Raises
    ------
    InputError
        If the function does not return finite matrices of this shape.
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
    """Raise if C v vanishes on a whole piece for constant channels v (k,), which are then not determined there.

    ``coupling`` (p, k, k) is C at the form's points.

    Raises
    ------
    SceneError
        In this case.
    """
    free = form.free_constants(stiffness)
    if free is None:
        return
    for on_piece in (form.at_points(free.indicator.toarray()) > 0.5).T:
        C = coupling[on_piece]
        squares = np.einsum("pij,pik->jk", C, C)  # v' (sum of C'C) v is the sum of |C v|^2
        sizes, combinations = np.linalg.eigh(squares)
        if sizes[0] <= FREE_SHARE**2 * sizes[-1]:
            near = ", ".join(f"{coordinate:.4g}" for coordinate in form.points[on_piece].mean(axis=0))
            constant = ", ".join(f"{entry:.3g}" for entry in combinations[:, 0])
            raise SceneError(
                f"Nothing fixes the channels on the piece about ({near}): the coupling takes the constant ({constant}) "
                "to zero all over it; give c above zero, a value somewhere, or a coupling that does not."
            )


def coupled_operator(stiffness: Stiffness, form: Discretized, coupling: Floats) -> CsrOperator:
    """Return the operator of all channels, from that of one channel and C (p, k, k) at the form's points."""
    from scipy.sparse import bsr_array

    channels = coupling.shape[1]
    single = stiffness.to_csr()
    blocks = np.multiply.outer(single.data, np.eye(channels))
    matrix = bsr_array((blocks, single.indices, single.indptr)).tocsr()
    asymmetry = np.abs(coupling - coupling.transpose(0, 2, 1)).max(initial=0.0)
    symmetric = asymmetry <= SYMMETRIC_SHARE * np.abs(coupling).max(initial=0.0)
    masses: dict[tuple[int, int], csr_array] = {}
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
    """Return the multigrid levels of a scalar ``stiffness``, each repeated for all ``channels``."""
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
