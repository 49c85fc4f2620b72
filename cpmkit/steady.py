"""Steady problems: one linear system."""

from __future__ import annotations

import time

from cpmkit.assembly import assemble
from cpmkit.balance import Leak, put_mean_right
from cpmkit.diagnosis import warnings_of
from cpmkit.eigen.resonance import near_resonance, unresolved_waves
from cpmkit.flux_balance import balance_fluxes, prepare_balance
from cpmkit.job import Job
from cpmkit.null_space import find_border, settle
from cpmkit.solution import Solution
from cpmkit.work import measure_work


def solve_job(job: Job) -> Solution:
    """Assemble and solve the linear system of a steady problem.

    Raises
    ------
    ResolutionError
        If the spacing is too coarse for waves or a velocity.
    ConvergenceError
        If the solver does not reach the tolerance.
    """
    poor = unresolved_waves(job.tables.layout, job.scene.problem.terms())
    prepared = prepare_balance(job.scene, job.tables) if job.balance else None
    system = assemble(job.tables, job.scene.problem, find_border(job.tables, job.scene))
    built = time.perf_counter()
    values, report = job.solver(system, job.tolerance, job.progress)
    values, defects = settle(job.tables, job.scene, system, values)
    leaks: tuple[Leak, ...] = ()
    if prepared is None:
        values, leaks = put_mean_right(job.tables, job.scene, system, values)
    poor += near_resonance(job, system, values)
    seconds = {"build": built - job.started, "solve": time.perf_counter() - built}
    work = measure_work(job.tables, system, report)
    told = [text for one in defects for text in one.warnings] + [text for one in leaks for text in one.warnings]
    warnings = (*warnings_of(job.tables.layout), *poor, *told)
    solution = Solution(
        job.scene, values, report, work, seconds, job.tables, warnings=warnings, defects=defects, leaks=leaks
    )
    return solution if prepared is None else balance_fluxes(solution, prepared, job.balance)
