"""Problems whose channels are tied to each other point by point: one linear system for all of them.

With A the operator of one channel and M_ij the mass of C_ij, the unknowns ordered channel after channel at each spline,
``(A x I + sum_ij M_ij x e_i e_j') u = b``. Levels of a multigrid are those of one channel, each for all channels.
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
from cpmkit.forms.free_constants import MOSTLY
from cpmkit.linear.constant_functions import ConstantFunctions
from cpmkit.linear.multigrid.cycle import Level
from cpmkit.linear.operators import CsrOperator
from cpmkit.linear.protocols import Operator, Stiffness
from cpmkit.scene.compound_equations import Coupled
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: C is symmetric where its entries differ from their mirror images by no more than this share of the largest.
SYMMETRIC_SHARE = 1e-12
#: A constant v is free where |C v| is no more than this share of the largest such: what rounding leaves of the squares.
FREE_SHARE = 1e-7


def solve_coupled(context: SolveContext) -> SolutionRecord:
    """Assemble and solve the system of all channels.

    Raises
    ------
    InputError, SceneError
        If the coupling is not what is accepted, or nothing fixes the solution.
    ConvergenceError
        If the solver does not reach the tolerance.
    """
    form, problem = context.discretized, context.scene.problem
    assert isinstance(problem, Coupled)
    require(form, "coupled channels")
    form.check(context.solver_name)
    coupling, channels = _read(problem, form), form.channels
    stiffness = form.stiffness(problem.terms())
    _check_fixed(form, stiffness, coupling)
    operator = operator_of(stiffness, form, coupling)
    b = (form.load(problem.f) + form.condition_load(stiffness)).reshape(-1, 1)
    prepared = context.solver.prepare(operator, _levels(form, stiffness, channels))
    built = time.perf_counter()
    guess = None if context.guess is None else context.guess.reshape(-1, 1)
    each = np.asarray(np.kron(form.constant, np.eye(channels)), dtype=np.float64)
    constants = ConstantFunctions.of(operator, each)
    values, report = constants.solve(prepared, b, context.tolerance, guess, context.progress)
    seconds = {"build": built - context.started, "solve": time.perf_counter() - built}
    work = form.work(operator, report)
    return SolutionRecord(form, values.reshape(-1, channels), report, work, seconds, warnings=form.warnings())


def _read(problem: Coupled, form: Discretized) -> Floats:
    """Return C (p, k, k) at the form's points."""
    points, channels = form.points, form.channels
    found = np.asarray(problem.coupling(points.copy()), dtype=np.float64)
    if found.shape != (len(points), channels, channels) or not np.isfinite(found).all():
        raise InputError(
            f"coupling must return finite matrices {(len(points), channels, channels)} at {len(points)} points, one "
            f"row and column a channel, got {shown(found.shape)}."
        )
    return found


def _check_fixed(form: Discretized, stiffness: Stiffness, coupling: Floats) -> None:
    """Refuse a piece on which some mixture of constant channels is free: C times it vanishes all over the piece.

    Raises
    ------
    SceneError
        If there is one.
    """
    free = form.free_constants(stiffness)
    if free is None:
        return
    for on in (form.at_points(free.indicator.toarray()) > MOSTLY).T:
        squares = np.einsum("pij,pik->jk", coupling[on], coupling[on])  # v' (sum of C'C) v is the sum of |C v|^2
        sizes, mixtures = np.linalg.eigh(squares)
        if sizes[0] <= FREE_SHARE**2 * sizes[-1]:
            near = ", ".join(f"{one:.4g}" for one in form.points[on].mean(axis=0))
            mixture = ", ".join(f"{one:.3g}" for one in mixtures[:, 0])
            raise SceneError(
                f"Nothing fixes the channels on the piece about ({near}): the coupling takes the constant ({mixture}) "
                "to zero all over it; give c above zero, a value somewhere, or a coupling that does not."
            )


def operator_of(stiffness: Stiffness, form: Discretized, coupling: Floats) -> CsrOperator:
    """Return the operator of all channels."""
    from scipy.sparse import bsr_array

    channels = coupling.shape[1]
    one = stiffness.to_csr()
    blocks = np.multiply.outer(one.data, np.eye(channels))
    matrix = bsr_array((blocks, one.indices, one.indptr)).tocsr()
    mirrored = np.abs(coupling - coupling.transpose(0, 2, 1)).max(initial=0.0)
    symmetric = mirrored <= SYMMETRIC_SHARE * np.abs(coupling).max(initial=0.0)
    tied: dict[tuple[int, int], csr_array] = {}
    for i in range(channels):
        for j in range(channels):
            if (j, i) in tied and symmetric:
                tied[i, j] = tied[j, i]
            elif coupling[:, i, j].any():
                tied[i, j] = form.weighted_mass(coupling[:, i, j])
    if tied:
        pattern = next(iter(tied.values()))
        blocks = np.zeros((len(pattern.data), channels, channels))
        for (i, j), mass in tied.items():
            blocks[:, i, j] = mass.data
        matrix = (matrix + bsr_array((blocks, pattern.indices, pattern.indptr)).tocsr()).tocsr()
    return CsrOperator(matrix, symmetric=bool(symmetric and stiffness.symmetric), symmetric_pattern=True)


def _levels(form: Discretized, stiffness: Operator, channels: int) -> Sequence[Level]:
    """Return the levels of one channel, each for all of them."""
    from scipy.sparse import eye_array, kron

    found = []
    for level in form.levels(stiffness):
        strip = (level.strip[:, None] * channels + np.arange(channels)).ravel()
        prolongation = kron(level.prolongation, eye_array(channels), format="csr")
        lines = level.lines
        if lines is not None:
            lines = (lines[:, None] * channels + np.arange(channels)[:, None]).reshape(-1, lines.shape[1])
        found.append(replace(level, prolongation=prolongation, strip=strip, lines=lines))
    return found
