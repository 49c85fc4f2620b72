"""The solves on the way to a target: each is timed, and compared with a coarser solution among them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, cast

import numpy as np

from cpmkit.accuracy.coarse_solutions import error_unit, estimate_alone, estimate_from
from cpmkit.accuracy.error_estimate import ErrorEstimate
from cpmkit.accuracy.estimate import (
    coarser_scene,
    error_in_time,
    measured_source_error,
    order_in_time,
    shifted_origin,
)
from cpmkit.accuracy.solve_history import Purpose, SolveStep
from cpmkit.errors import ResolutionError, SceneError
from cpmkit.families.eigen.selected_modes import fewer_modes
from cpmkit.forms.accuracy_target import AccuracyTarget
from cpmkit.forms.form_records import ExpectedError
from cpmkit.forms.options import lattice_options
from cpmkit.scene.compound_equations import Eigen
from cpmkit.scene.equations_in_time import Evolution
from cpmkit.scene.scene import Scene
from cpmkit.solution.modes import EigenRecord
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats, Progress, no_progress

#: Least, best and largest ratio of the spacings of two solutions that are compared. With the estimate from the solution
#: alone a large ratio is as accurate as a small one, and the coarse solution costs less.
LEAST_RATIO, BEST_RATIO, MOST_RATIO = 1.3, 2.5, 2.75
#: Largest number of first spacings that are tried, each smaller by the root of two than a spacing that was too coarse.
MOST_TRIALS = 10
#: Steps in time are shortened until their error is at most this share of the tolerance.
TIME_SHARE = 0.3


@dataclass(frozen=True, eq=False)
class TimedSolve:
    """One solve with its duration and the estimates of its error.

    Attributes
    ----------
    purpose : str
        See :class:`cpmkit.accuracy.solve_history.SolveStep`.
    solution : SolutionRecord
        The solution.
    seconds : float
        Duration of the solve.
    alone : ExpectedError, optional
        The estimate of the error from this solution alone.
    estimate : ErrorEstimate, optional
        The estimate of the error from a coarser solution too.
    """

    purpose: Purpose
    solution: SolutionRecord
    seconds: float
    alone: ExpectedError | None
    estimate: ErrorEstimate | None

    @property
    def spacing(self) -> float:
        """Spacing of the lattice."""
        return self.solution.spacing

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return self.solution.discretized.size

    def error(self, norm: str) -> float:
        """Return the estimated error in a norm, as a share of the range; NaN without an estimate."""
        return math.nan if self.estimate is None else self.estimate.of(norm)

    def expected_error(self, norm: str) -> float:
        """Return the error in a norm estimated from the solution alone, as a share of the range; NaN if unknown."""
        if self.alone is None:
            return math.nan
        return float(np.max((self.alone.rms if norm == "rms" else self.alone.largest) / self._unit))

    @cached_property
    def _unit(self) -> Floats:
        """The unit (channels,) of relative errors, the range of the solution."""
        return error_unit(self.solution)

    def step(self, norm: str) -> SolveStep:
        """Return the record of the solve for the history, with its estimated error in a norm."""
        problem = self.solution.scene.problem
        length = problem.step if isinstance(problem, Evolution) else 0.0
        return SolveStep(self.purpose, self.spacing, length, self.unknowns, self.seconds, self.error(norm))


@dataclass(eq=False)
class AdaptiveRun:
    """The state of the search for a target: the scene, the options chosen, and the solves so far.

    Attributes
    ----------
    scene : Scene
        The scene; its steps in time may be shorter than those of the user.
    solve_scene : callable
        ``solve_scene(scene, spacing, progress=..., **options)`` returns a solution.
    target : AccuracyTarget
        Tolerance, seconds, memory.
    progress : callable
        Called with the purpose, spacing and stage of each solve, and the share of it that is done.
    in_time : float
        The error of the steps in time, as a share of the range; zero before it is computed.
    started : float
        ``time.perf_counter()`` at the start of the run.
    solves : list of TimedSolve
        The solves so far, in order.
    origin : sequence, optional
        A node of the answer's lattice, if the user gave one.
    solver : str
        The linear solver that the user gave, or "auto".
    degree_given : bool
        Whether the user gave a degree.
    chosen_options : dict
        Options that the run chose.
    order : float, optional
        The order at which errors fall, if it is not that of the form.
    trials : int
        Largest number of first spacings that are tried.
    failure : Exception, optional
        The error that ended the run before its target was met.
    measured_floor : float, optional
        The error due to the source of the manifold, once it is computed, as a share of the range.
    """

    scene: Scene
    solve_scene: Callable[..., SolutionRecord]
    target: AccuracyTarget
    progress: Progress = no_progress
    in_time: float = 0.0
    started: float = field(default_factory=lambda: time.perf_counter())
    solves: list[TimedSolve] = field(default_factory=list)
    origin: Any = None
    solver: str = "auto"
    degree_given: bool = False
    chosen_options: dict[str, Any] = field(default_factory=dict)
    order: float | None = None
    trials: int = MOST_TRIALS
    failure: Exception | None = None
    measured_floor: float | None = None

    @property
    def best(self) -> TimedSolve:
        """The solve with the smallest estimated error; the last solve if no error is known."""
        known = [
            solve for solve in self.solves if self._has_steps_of(solve.solution) and np.isfinite(self.error_of(solve))
        ]
        return min(known, key=self.error_of) if known else self.last

    @property
    def last(self) -> TimedSolve:
        """The last solve, which has the finest lattice."""
        return self.solves[-1]

    def error_of(self, solve: TimedSolve) -> float:
        """Return the estimated error of a solve in the norm of the target; NaN without an estimate."""
        return solve.error(self.target.norm)

    @property
    def error(self) -> float:
        """The estimated error of the last solve in the norm of the target."""
        return self.error_of(self.last)

    @property
    def expected_error(self) -> float:
        """The error of the last solve, estimated from it alone, in the norm of the target; NaN if unknown."""
        return self.last.expected_error(self.target.norm)

    def with_scene_modes(self, solution: SolutionRecord) -> SolutionRecord:
        """Return an eigenvalue solution with as many modes as the scene asks for; other solutions unchanged.

        Coarse solutions of eigenvalue problems have further modes.
        """
        modes = isinstance(self.scene.problem, Eigen) and isinstance(solution, EigenRecord)
        return fewer_modes(cast("EigenRecord", solution), self.scene) if modes else solution

    @property
    def elapsed(self) -> float:
        """Seconds since the start."""
        return time.perf_counter() - self.started

    def solve(self, purpose: Purpose, spacing: float, expected_seconds: float | None = None) -> TimedSolve:
        """Solve at a spacing, add the solve to the list, and return it.

        ``expected_seconds`` is reported to the progress callback.
        """
        scene = self.scene if purpose in ("answer", "correction") else coarser_scene(self.scene)
        about = "" if expected_seconds is None else f", about {expected_seconds:.2g} s"
        label = f"{purpose} at spacing {spacing:.3g}{about}"
        began = time.perf_counter()
        solution = self.solve_scene(
            scene,
            spacing,
            progress=lambda stage, share: self.progress(f"{label}: {stage}", share),
            origin=self._origin(spacing),
            **self.chosen_options,
        )
        seconds, alone = time.perf_counter() - began, None if self.order is not None else estimate_alone(solution)
        self.solves.append(TimedSolve(purpose, solution, seconds, alone, self._estimate(solution, alone)))
        return self.last

    def solve_first(self, spacing: float) -> TimedSolve:
        """Solve at a spacing, or at the first smaller spacing at which the scene can be solved; return the solve.

        Raises
        ------
        CpmkitError
            If there is no such spacing, with the reason for which the first spacing was refused.
        """
        refusal: ResolutionError | SceneError | None = None
        for trial in range(self.trials):
            try:
                return self.solve("pilot", spacing / math.sqrt(2) ** trial)
            except (ResolutionError, SceneError) as error:
                refusal = refusal or error
        assert refusal is not None
        finest = spacing / math.sqrt(2) ** (self.trials - 1)
        if "spacing" not in str(refusal):
            raise refusal
        raise type(refusal)(  # the user gave no spacing
            f"{self.target.target} was asked for, and the scene was refused at every spacing that was tried, from "
            f"{spacing:.3g} to {finest:.3g}, the first time because: {refusal}"
        ) from refusal

    def shorten_steps(self) -> bool:
        """Shorten the steps in time until their error is a small share of the tolerance; return True if they changed.

        The error is computed from the last solution, a coarse one, as it hardly depends on the spacing.
        """
        problem: Any = self.scene.problem
        if not isinstance(problem, Evolution):
            return False
        first = self.last.solution
        same = {"origin": first.discretization()["origin"]}  # on another lattice errors in space would count
        self.in_time = error_in_time(first, lambda scene, spacing: self.solve_scene(scene, spacing, **same))
        order, most = order_in_time(problem), TIME_SHARE * (self.target.tolerance or np.inf)
        if self.in_time <= most:
            return False
        parts = math.ceil((self.in_time / most) ** (1 / order))
        self.scene = replace(self.scene, problem=replace(cast("Any", problem), step=problem.step / parts))
        self.in_time /= parts**order
        return True

    def source_error(self) -> float:
        """Return the error due to the source of the manifold, as a share of the range.

        For a mesh read as smooth it is computed by a solve on the flat triangles, if it may exceed the tolerance.
        """
        solution = self.last.solution
        if self.measured_floor is None:
            if self.target.tolerance is None or self.order is not None or self.failure is not None:
                return solution.discretized.source_error()  # a recipe has no solution on flat triangles
            origin = solution.discretization()["origin"]
            solve = partial(self.solve_scene, spacing=solution.spacing, origin=origin, **self.chosen_options)
            self.measured_floor = measured_source_error(solution, solve, self.target.tolerance)
        return self.measured_floor

    def is_like_last(self, solution: SolutionRecord, other: SolutionRecord | None = None) -> bool:
        """Return True if a solution has the same form and options as ``other``, by default the last solution."""
        pair = (solution, other or self.last.solution)
        mine, others = (lattice_options(each.discretized) for each in pair)
        return mine is not None and others is not None and mine.own == others.own

    def _coarse_solution(self, solution: SolutionRecord) -> SolutionRecord | None:
        """Return the coarser solution with which a solution is compared, by the ratio of spacings; None without any."""
        ratios = {
            solve.spacing / solution.spacing: solve.solution
            for solve in self.solves
            if self._has_steps_of(solve.solution) and self.is_like_last(solve.solution, solution)
        }
        near = {ratio: coarse for ratio, coarse in ratios.items() if LEAST_RATIO <= ratio <= MOST_RATIO}
        return near[min(near, key=lambda ratio: abs(ratio - BEST_RATIO))] if near else None

    def _has_steps_of(self, solution: SolutionRecord) -> bool:
        """Return True if a solution has the same steps in time as the scene has now."""
        problem = self.scene.problem
        return not isinstance(problem, Evolution) or cast("Any", solution.scene.problem).step == problem.step

    def _estimate(self, solution: SolutionRecord, alone: ExpectedError | None) -> ErrorEstimate | None:
        """Return the estimated error of a solution; None if no coarser solution serves or the form has no estimate.

        ``alone`` is the estimate from the solution alone.
        """
        coarse, solution = self._coarse_solution(solution), self.with_scene_modes(solution)
        if coarse is None or any(pair.discretized.diagnosis().no_estimate for pair in (solution, coarse)):
            return None
        return estimate_from(solution, [coarse], self.in_time, self.order, alone)

    def _origin(self, spacing: float) -> Any:
        """Return a node (d,) of the lattice of a solve: the user's if the solve may be the answer, else a shifted node.

        No two solves with shifted nodes have nodes at the same places.
        """
        if self.origin is not None and any(solve.spacing > spacing for solve in self.solves):
            return self.origin  # ratios of later spacings are not integers
        return shifted_origin(self.scene, spacing, len(self.solves) + 1)

    def steps(self) -> tuple[SolveStep, ...]:
        """Return the records of all solves for the history, in order."""
        return tuple(solve.step(self.target.norm) for solve in self.solves)
