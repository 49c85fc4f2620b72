"""Steady problems: one linear system."""

from __future__ import annotations

import time
from dataclasses import replace

from cpmkit.errors import ResolutionError
from cpmkit.families.eigen.resonance import near_resonance, unresolved_waves
from cpmkit.families.job import Job
from cpmkit.forms.collocation.assembly import assemble
from cpmkit.forms.collocation.conservation.balance import put_mean_right
from cpmkit.forms.collocation.conservation.flux_balance import balance_fluxes, prepare_balance
from cpmkit.forms.collocation.conservation.free_constants import find_border, settle
from cpmkit.forms.collocation.diagnosis.definiteness import wrong_sign
from cpmkit.forms.collocation.diagnosis.warnings import warnings_of
from cpmkit.solution.solution import Solution
from cpmkit.solution.work import measure_work


def solve_job(job: Job) -> Solution:
    """Assemble and solve the linear system of a steady problem.

    Raises
    ------
    ResolutionError
        If the spacing is too coarse for waves or a velocity, or for limbs side by side, which give the operator an
        eigenvalue of the wrong sign. Of the plain method, which is there to be compared with, that is told only.
    ConvergenceError
        If the solver does not reach the tolerance.
    """
    poor = unresolved_waves(job.tables.layout, job.scene.problem.terms())
    prepared = prepare_balance(job.scene, job.tables) if job.balance else None
    system = assemble(job.tables, job.scene.problem, find_border(job.tables, job.scene))
    wrong, looked = wrong_sign(job.tables, job.scene, system.operator)
    if wrong and job.tables.layout.parted:
        raise ResolutionError(wrong)
    built = time.perf_counter()
    values, report = job.solver(system, job.tolerance, job.progress)
    report = replace(report, operator_applications=report.operator_applications + looked)
    values, defects = settle(job.tables, job.scene, system, values)
    even, leaks = put_mean_right(job.tables, job.scene, system, values)
    poor += near_resonance(job, system, even)
    seconds = {"build": built - job.started, "solve": time.perf_counter() - built}
    work = measure_work(job.tables, system, report)
    found = warnings_of(job.tables.layout, max((one.share for one in leaks), default=0.0))
    told = (*found, *([wrong] if wrong else []), *poor, *(text for one in defects for text in one.warnings))
    raw = Solution(job.scene, values, report, work, seconds, job.tables, warnings=told, defects=defects)
    told = (*told, *(text for one in leaks for text in one.warnings))
    solution = replace(raw, values=even, warnings=told, leaks=leaks)
    return solution if prepared is None else balance_fluxes(raw, prepared, job.balance, solution)
