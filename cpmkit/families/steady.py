"""Steady problems: one linear system, A u = b."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

from cpmkit.families.context import SolveContext, left_side
from cpmkit.families.eigen.resonance import near_resonance, solved_or_resonant, unresolved_waves
from cpmkit.forms.contract import Discretized
from cpmkit.linear.constant_functions import ConstantFunctions
from cpmkit.linear.operators import Bordered, LinearSystem
from cpmkit.linear.protocols import Operator, PreparedSolver, Stiffness
from cpmkit.solution.record import SolutionRecord


def assemble(form: Discretized) -> LinearSystem:
    """Return the linear system A u = b of a steady problem, constants moved out of the kernel where they are free.

    Parameters
    ----------
    form : Discretized
        The discretised scene.
    """
    stiffness, operator = _operators(form)
    return LinearSystem(operator, form.load(form.scene.problem.terms().f) + form.condition_load(stiffness))


def _operators(form: Discretized) -> tuple[Stiffness, Operator]:
    """Return A as it is, and with its free constants moved out of the kernel."""
    stiffness = form.stiffness(form.scene.problem.terms())
    free = form.free_constants(stiffness)
    return stiffness, stiffness if free is None else Bordered(stiffness, free)


@dataclass(frozen=True, eq=False)
class _Ready:
    """A, A with its free constants moved out of the kernel, the solver of systems with it, and its constants."""

    stiffness: Stiffness
    operator: Operator
    prepared: PreparedSolver
    constants: ConstantFunctions


def _ready(context: SolveContext) -> _Ready:
    form = context.discretized
    stiffness, operator = _operators(form)
    return _Ready(stiffness, operator, context.prepare(operator), context.constants(operator))


def solve_steady(context: SolveContext) -> SolutionRecord:
    """Assemble and solve the linear system of a steady problem.

    Raises
    ------
    ResolutionError
        If the spacing is too coarse for waves or a velocity, or gives the operator an eigenvalue of the wrong sign.
    ConvergenceError
        If the solver does not reach the tolerance.
    """
    form, terms = context.discretized, context.scene.problem.terms()
    poor = unresolved_waves(form, terms)
    form.check(context.solver_name)
    load = form.load(terms.f)
    ready: _Ready = context.kept.get(("steady", left_side(terms)), _ready, context)
    operator, prepared = ready.operator, ready.prepared
    b = load + form.condition_load(ready.stiffness)
    built = time.perf_counter()
    values, report = solved_or_resonant(context, prepared, ready.constants, b)
    work: Any = form.work(operator, report)
    settled = form.remove_constants(operator, b, values)
    if settled.queries:
        work = replace(work, closest_point_queries=work.closest_point_queries + settled.queries)
    resonant, resonance = near_resonance(context, prepared, settled.values)
    small_c = () if isinstance(operator, Bordered) else ready.constants.cancellation_warnings(b, values)
    seconds = {"build": built - context.started, "solve": time.perf_counter() - built, **settled.seconds}
    found = form.warnings()
    unbalanced = [text for one in settled.imbalances for text in (*one.warnings, *one.nothing_given)]
    return SolutionRecord(
        form,
        settled.values,
        report,
        work,
        seconds,
        warnings=(*found, *poor, *resonant, *small_c, *unbalanced, *settled.warnings),
        imbalances=settled.imbalances,
        resonance=resonance,
    )
