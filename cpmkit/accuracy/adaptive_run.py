"""The solves on the way to a target: each is timed, and compared with a coarser solution among them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal, cast

import numpy as np

from cpmkit.accuracy.error_estimate import ErrorEstimate, error_unit, estimate_alone, estimate_from
from cpmkit.accuracy.estimate import (
    error_in_time,
    measured_source_error,
    order_in_time,
    shifted_origin,
    with_further_modes,
)
from cpmkit.errors import ResolutionError, SceneError
from cpmkit.families.eigen.solve_eigen import keep_requested_modes
from cpmkit.forms.options import AccuracyTarget, lattice_options
from cpmkit.scene.scene import Scene
from cpmkit.solution.modes import EigenRecord
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats, Progress, no_progress

#: Least, best and largest ratio of the spacings of two solutions that are compared. With the estimate from the solution
#: alone a large ratio is as accurate as a small one, and the coarse solution costs less.
LEAST_RATIO, BEST_RATIO, MOST_RATIO = 1.3, 2.5, 2.75

Purpose = Literal["pilot", "companion", "answer", "correction"]


@dataclass(frozen=True)
class SolveStep:
    """One solve on the way to a target."""

    #: ``pilot``: a coarse solve that shows how the error falls and what solves cost; ``companion``: a coarser solution
    #: with which the answer is compared; ``answer``; ``correction``: a finer answer, after an estimated error above the
    #: tolerance.
    purpose: Purpose
    spacing: float  #: Spacing of the lattice.
    step: float  #: Step in time; 0 for equations without time.
    unknowns: int  #: Number of unknowns.
    seconds: float  #: Duration of the solve.
    error: float  #: The estimated error, as a share of the range; NaN without a coarser solution to compare with.


@dataclass(frozen=True, eq=False)
class TimedSolve(SolveStep):
    """One solve with its solution and the estimates of its error."""

    solution: SolutionRecord  #: The solution.
    estimate: ErrorEstimate | None  #: The estimate of the error from a coarser solution.
    expected_error: float  #: The error estimated from the solution alone, as a share of the range; NaN if unknown.


@dataclass(eq=False)
class AdaptiveRun:
    """The state of the search for a target: the scene, the options chosen, and the solves so far."""

    scene: Scene  #: The scene; its steps in time may be shorter than those of the user.
    solve_scene: Callable[..., SolutionRecord]  #: ``solve_scene(scene, spacing, progress=..., **options)``.
    target: AccuracyTarget  #: Tolerance, seconds, memory.
    #: Called with the purpose, spacing and stage of each solve, and the share of it that is done.
    progress: Progress = no_progress
    #: The options of the user: a node ``origin`` of the answer's lattice, the ``solver`` and the ``degree`` matter.
    options: Mapping[str, Any] = field(default_factory=dict)
    is_recipe: bool = False  #: Whether ``solve_scene`` calls a recipe of the user, whose degree cannot be chosen.
    order: float | None = None  #: The order at which errors fall, if it is not that of the form.
    started: float = field(default_factory=lambda: time.perf_counter())  #: ``perf_counter()`` at the start.
    solves: list[TimedSolve] = field(default_factory=list)  #: The solves so far; the last has the finest lattice.
    #: (2,): the error of the steps in time, root mean square and largest, as shares of the range; zero at first.
    in_time: Floats = field(default_factory=lambda: np.zeros(2))
    chosen_options: dict[str, Any] = field(default_factory=dict)  #: Options that the run chose.
    failure: Exception | None = None  #: The error that ended the run before its target was met.
    #: The error due to the source of the manifold, once it is computed, as a share of the range.
    measured_floor: float | None = None

    @property
    def best(self) -> TimedSolve:
        """The solve with the scene's steps and the smallest estimated error; the last solve if no error is known."""
        known = [solve for solve in self.solves if self._has_scene_steps(solve) and np.isfinite(solve.error)]
        return min(known, key=lambda solve: solve.error) if known else self.last

    @property
    def last(self) -> TimedSolve:
        """The last solve."""
        return self.solves[-1]

    def with_scene_modes(self, solution: SolutionRecord) -> SolutionRecord:
        """Return an eigenvalue solution without the further modes of coarse solves; others and a recipe's unchanged."""
        if not solution.has_modes or self.is_recipe:
            return solution
        return keep_requested_modes(cast("EigenRecord", solution), self.scene)

    @property
    def elapsed(self) -> float:
        """Seconds since the start."""
        return time.perf_counter() - self.started

    def solve(self, purpose: Purpose, spacing: float, expected_seconds: float | None = None) -> TimedSolve:
        """Solve at a spacing, append the solve to ``solves``, and return it. Raises CpmkitError as a solve does.

        ``expected_seconds`` is only reported to the progress callback; None if unknown. For the purposes ``pilot`` and
        ``companion`` an eigenvalue problem has six further modes. The lattice has the ``origin`` of the user only if an
        earlier solve has a larger spacing; other lattices are shifted.
        """
        scene = self.scene if purpose in ("answer", "correction") else with_further_modes(self.scene)
        about = "" if expected_seconds is None else f", about {expected_seconds:.2g} s"
        label = f"{purpose} at spacing {spacing:.3g}{about}"
        origin = shifted_origin(self.scene, spacing, len(self.solves) + 1)
        if self.options.get("origin") is not None and any(solve.spacing > spacing for solve in self.solves):
            origin = self.options["origin"]  # may be the answer; ratios of later spacings are not integers
        began = time.perf_counter()
        solution = self.solve_scene(
            scene,
            spacing,
            progress=lambda stage, share: self.progress(f"{label}: {stage}", share),
            origin=origin,
            **self.chosen_options,
        )
        self.solves.append(self._make_timed_solve(purpose, solution, time.perf_counter() - began))
        return self.last

    def _make_timed_solve(self, purpose: Purpose, solution: SolutionRecord, seconds: float) -> TimedSolve:
        """Return the record of a solve that took ``seconds``, with its error estimated in two ways.

        ``estimate`` and ``error`` come from a coarser solution: None and NaN if there is none to compare with, or the
        form says that differences do not measure errors. ``expected_error`` comes from the solution alone: NaN for
        eigenvalues, a run with an ``order``, and forms without such an estimate.
        """
        alone = None if self.order is not None else estimate_alone(solution)
        coarse, fine = self._coarse_solution(solution), self.with_scene_modes(solution)
        estimate, norm, error, expected = None, self.target.norm, math.nan, math.nan
        if coarse is not None and not any(one.discretized.diagnosis().no_estimate for one in (fine, coarse)):
            estimate = estimate_from(fine, [coarse], self.in_time, self.order, alone)
            error = estimate.of(norm)
        if alone is not None:
            expected = float(np.max((alone.rms if norm == "rms" else alone.largest) / error_unit(solution)))
        problem: Any = solution.scene.problem
        step = problem.step if problem.family == "time" else 0.0
        counts = solution.spacing, step, solution.discretized.size, seconds
        return TimedSolve(purpose, *counts, error, solution, estimate, expected)

    def solve_first(self, spacing: float) -> TimedSolve:
        """Solve at a spacing, or at the first of nine smaller ones at which the scene can be solved; return the solve.

        Raises SceneError or ResolutionError if there is none, with the reason for which the first spacing was refused;
        other errors of a solve end the search at once.
        """
        refusal: ResolutionError | SceneError | None = None
        trials = [spacing / math.sqrt(2) ** k for k in range(10)]
        for trial in trials:
            try:
                return self.solve("pilot", trial)
            except (ResolutionError, SceneError) as error:
                refusal = refusal or error
        assert refusal is not None
        if "spacing" not in str(refusal):
            raise refusal
        raise type(refusal)(  # the user gave no spacing
            f"{self.target.target} cannot be reached: the scene was refused at every spacing that was tried, from "
            f"{spacing:.3g} to {trials[-1]:.3g}, the first time because: {refusal}"
        ) from refusal

    def shorten_steps(self) -> bool:
        """Shorten the scene's steps in time until their error is at most 0.3 of the tolerance; return if they changed.

        A further solve measures the error of the present steps, on the lattice of the last solve but one with these
        steps. The estimate of the last solve then includes that error, and ``in_time`` becomes the error of the new
        steps. Without a tolerance steps are not shortened; in a recipe they are not even measured.
        """
        problem: Any = self.scene.problem
        if not self.has_own_steps:
            return False
        coarse = [solve for solve in self.solves if self._has_scene_steps(solve)][-2:][0].solution
        same = {"origin": coarse.discretization()["origin"]}  # on another lattice errors in space would count
        self.in_time = error_in_time(coarse, lambda scene, spacing: self.solve_scene(scene, spacing, **same))
        last = self.solves.pop()
        self.solves.append(self._make_timed_solve(last.purpose, last.solution, last.seconds))
        order, most = order_in_time(problem), 0.3 * (self.target.tolerance or np.inf)
        if self.step_error <= most:
            return False
        parts = math.ceil((self.step_error / most) ** (1 / order))
        self.scene = replace(self.scene, problem=replace(problem, step=problem.step / parts))
        self.in_time = self.in_time / parts**order
        return True

    @property
    def has_own_steps(self) -> bool:
        """Whether the scene has steps in time that the run may shorten; those of a recipe are the user's."""
        return self.scene.problem.family == "time" and not self.is_recipe

    @property
    def step_error(self) -> float:
        """The error of the steps in time in the norm of the target."""
        return float(self.in_time[int(self.target.norm == "max")])

    def source_error(self) -> float:
        """Return the error due to the source of the manifold, as a share of the range of u; 0 for eigenvalues.

        :func:`measured_source_error` computes it once; for a mesh read as smooth this may take a solve on the flat
        triangles. Without a tolerance, with a recipe (a function of the user that solves the scene), or after a failed
        solve the form's estimate is returned instead.
        """
        solution = self.last.solution
        if self.measured_floor is None:
            if self.target.tolerance is None or self.is_recipe or self.failure is not None:
                return 0.0 if solution.has_modes else solution.discretized.source_error()
            origin = solution.discretization()["origin"]
            solve = partial(self.solve_scene, spacing=solution.spacing, origin=origin, **self.chosen_options)
            self.measured_floor = measured_source_error(solution, solve, self.target.tolerance)
        return self.measured_floor

    def has_same_options(self, solution: SolutionRecord, other: SolutionRecord | None = None) -> bool:
        """Return whether two solutions have a lattice and equal options of their form; ``other`` None: the last one."""
        pair = (solution, other or self.last.solution)
        first, second = (lattice_options(each.discretized) for each in pair)
        return first is not None and second is not None and first.own == second.own

    def _coarse_solution(self, solution: SolutionRecord) -> SolutionRecord | None:
        """Return the solution with equal options and steps at about 2.5 (1.3 to 2.75) times the spacing, or None."""
        ratios = {
            solve.spacing / solution.spacing: solve.solution
            for solve in self.solves
            if self._has_scene_steps(solve) and self.has_same_options(solve.solution, solution)
        }
        near = {ratio: coarse for ratio, coarse in ratios.items() if LEAST_RATIO <= ratio <= MOST_RATIO}
        return near[min(near, key=lambda ratio: abs(ratio - BEST_RATIO))] if near else None

    def _has_scene_steps(self, solve: TimedSolve) -> bool:
        """Return True if a solve has the same steps in time as the scene has now."""
        problem: Any = self.scene.problem
        return problem.family != "time" or bool(solve.step == problem.step)
