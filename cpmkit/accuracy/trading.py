"""Solving to an error, in a time, within a memory: what is asked for goes in, the answer and the way to it come out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from cpmkit.accuracy.knobs import error_of_equal_cost
from cpmkit.accuracy.ladder import errors_stay, walk
from cpmkit.accuracy.limits import predicted_bytes
from cpmkit.accuracy.trade import Status, Trade
from cpmkit.accuracy.way import Run, Way
from cpmkit.dispatch import solve_scene
from cpmkit.errors import InputError
from cpmkit.families.checkpointing import Checkpointing
from cpmkit.forms.accuracy_target import AccuracyTarget
from cpmkit.manifold.abilities import advice_of
from cpmkit.manifold.mixed_dimension import joints_sentence, touching_joints
from cpmkit.protocols import Progress
from cpmkit.runtime.messages import collected_warnings
from cpmkit.runtime.options import declared_options
from cpmkit.scene.equations_in_time import Wave
from cpmkit.scene.scene import Scene
from cpmkit.solution.record import SolutionRecord

#: Relative residuals that leave less than a twentieth of an error, over it, and the largest and smallest that are asked
#: for (measured: tests/accuracy/test_tolerance.py).
RESIDUAL_SHARE, LARGEST_RESIDUAL, SMALLEST_RESIDUAL = 1e-3, 1e-6, 1e-10
NORM_IN_WORDS = {"rms": "root mean square", "max": "largest error"}


def traded(scene: Scene, target: AccuracyTarget, progress: Progress, options: Mapping[str, Any]) -> SolutionRecord:
    """Solve until what is asked for is reached, or cannot be.

    Returns
    -------
    Solution
        With its estimate, its trade, and a warning where the tolerance was not reached.

    Raises
    ------
    InputError
        If an option fixes what is to be found out.
    CpmkitError
        As ``solve`` does, where no spacing serves.
    """
    _check(scene, options)
    kept = {name: value for name, value in options.items() if name != "origin"}
    if target.tolerance is not None:
        kept = {"solver_tolerance": algebraic_tolerance(target.tolerance), **kept}

    def solve(scene: Scene, spacing: float, **further: Any) -> SolutionRecord:
        with collected_warnings():
            return solve_scene(scene, spacing, **{**kept, **further})

    solver = str(options.get("solver", "auto"))
    return walked(
        Way(
            scene,
            solve,
            target,
            progress,
            origin=options.get("origin"),
            solver=solver,
            degree_given="degree" in options,
        )
    )


def walked(way: Way) -> SolutionRecord:
    """Return the answer at the end of a way, with its estimate and its trade."""
    target = way.target
    status, aim = walk(way)
    best = way.last if status in ("reached", "floor") else way.best
    answer, estimate = way.asked_of(best.solution), best.estimate
    if estimate is not None and way.left is not None:
        estimate = replace(estimate, floor=np.full(len(estimate.unit), way.left))
    trade = Trade(
        target,
        status,
        best.error(target.norm),
        predicted_bytes(way, best.unknowns),
        way.elapsed,
        way.steps(),
        _told(way, best, status, aim),
        _chosen(way, best),
    )
    told = (trade.told,) if status in ("floor", "not reached") or way.refused is not None else ()
    return replace(answer, estimated=estimate, trade=trade, warnings=(*answer.warnings, *told))


def algebraic_tolerance(tolerance: float) -> float:
    """Return the relative residual at which linear systems are solved well enough for an error of ``tolerance``."""
    return min(max(RESIDUAL_SHARE * tolerance, SMALLEST_RESIDUAL), LARGEST_RESIDUAL)


def _check(scene: Scene, options: Mapping[str, Any]) -> None:
    given = [name for name in declared_options(Checkpointing) if name in options]
    given += ["backend"] if options["backend"] != "cpm" else []
    if given:
        raise InputError(
            f"{given[0]}={options[given[0]]!r} goes with one solve at one spacing, and a tolerance, seconds or memory "
            "may take several; give a spacing."
        )
    joints = touching_joints(scene.surface)
    if joints:
        raise InputError(
            "A tolerance, seconds or memory goes by estimates of the error, of which there is none here; give a "
            f"spacing. {joints_sentence(scene.surface, joints)}"
        )
    if isinstance(scene.problem, Wave) and scene.problem.scheme == "leapfrog":
        raise InputError(
            "scheme 'leapfrog' ties its step to the spacing, which is not known where a tolerance, seconds or memory "
            "is asked for; use scheme='newmark', or give a spacing."
        )


def _told(way: Way, best: Run, status: Status, aim: float) -> str:
    target, estimate = way.target, best.estimate
    said = f"at spacing {best.spacing:.3g} with {best.unknowns:,} unknowns"
    size, norm = best.error(target.norm), NORM_IN_WORDS[target.norm]
    error = f"{norm} not known {said}" if math.isnan(size) else f"{norm} about {size:.2g} of the range {said}"
    slow = f"; {estimate.slow}" if estimate is not None and estimate.slow else ""
    if way.refused is not None:
        why = str(way.refused) or f"memory ran out ({type(way.refused).__name__})."
        return f"{target.target} not reached: {error}{slow}; a further solve was refused: {why}"
    finest = f"the finest that {_limits(way)} allow"
    if errors_stay(way):
        finest = "and smaller spacings gave no less: rounding, noise or the residuals of linear solves leave that much"
    if status == "within":
        return f"{error}, {finest}{slow}."
    if status == "reached":
        return f"tolerance {target.tolerance:g} reached: {error}{slow}."
    if status == "floor":
        causes = " ".join(advice_of(way.scene.surface, best.spacing).warnings)
        return (
            f"tolerance {target.tolerance:g} is below what the surface's representation alone leaves, about {aim:.1g} "
            f"of the range at any spacing: {error}{slow}; give a more accurate surface.{' ' if causes else ''}{causes}"
        )
    if target.tolerance is None:
        return f"{target.seconds:g} seconds were not enough, it took {way.elapsed:.2g}: {error}{slow}."
    doubt = "; errors do not fall yet as they should" if size <= target.tolerance else ""
    return f"tolerance {target.tolerance:g} not reached: {error}, {finest}{doubt}{slow}."


def _chosen(way: Way, best: Run) -> str:
    if not way.further or not way.alike(best.solution):  # the last one has the degree that was chosen
        return ""
    return (
        f"degree {way.further['degree']} was chosen: on smooth surfaces that are known exactly it reaches errors below "
        f"{error_of_equal_cost():.1g} sooner than degree 2 does; degree=2 takes less memory for each unknown."
    )


def _limits(way: Way) -> str:
    target = way.target
    limits = [] if target.seconds is None else [f"{target.seconds:g} seconds"]
    limits.append(
        "the memory of this machine" if target.memory is None else f"{target.memory / 2**20:.4g} MiB of memory"
    )
    return " and ".join(limits)
