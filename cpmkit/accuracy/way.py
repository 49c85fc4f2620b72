"""The solves on the way to an answer: each is timed, and held against the coarser ones that are there."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, cast

import numpy as np

from cpmkit.accuracy.companions import expected_of, from_companions
from cpmkit.accuracy.comparison import scales_of
from cpmkit.accuracy.error_estimate import ErrorEstimate
from cpmkit.accuracy.estimate import coarser_scene, error_in_time, order_in_time, shifted_origin
from cpmkit.accuracy.facets import floor_by_facets
from cpmkit.accuracy.trade import Purpose, Step
from cpmkit.errors import ResolutionError, SceneError
from cpmkit.families.eigen.fewer import fewer_modes
from cpmkit.forms.accuracy_target import AccuracyTarget
from cpmkit.forms.form_records import ExpectedError
from cpmkit.forms.options import lattice_options
from cpmkit.protocols import Floats, Progress, no_progress
from cpmkit.scene.compound_equations import Eigen
from cpmkit.scene.equations_in_time import Evolution
from cpmkit.scene.scene import Scene
from cpmkit.solution.modes import EigenRecord
from cpmkit.solution.record import SolutionRecord

ANSWERS = ("answer", "correction")
#: Ratios of spacings between which a solution serves another as companion, and the best of them: what the farther one
#: tells is as near to the truth, together with what the solution tells alone, and costs less.
LEAST_RATIO, BEST_RATIO, MOST_RATIO = 1.3, 2.5, 2.75
#: Spacings that were too coarse for a scene are made finer by the root of two, so many times.
MOST_TRIALS = 10
#: Steps in time are shortened until they leave this share of the tolerance.
TIME_SHARE = 0.3

#: ``solve(scene, spacing, progress, options)``, the options in place of those that were given.
Solve = Callable[..., SolutionRecord]


@dataclass(frozen=True, eq=False)
class Run:
    """One solve: what for, the solution, its seconds, what it alone lets expect, its error by a coarser one if any."""

    purpose: Purpose
    solution: SolutionRecord
    seconds: float
    alone: ExpectedError | None
    estimate: ErrorEstimate | None

    @property
    def spacing(self) -> float:
        """Of the lattice."""
        return self.solution.spacing

    @property
    def unknowns(self) -> int:
        """Size of the system."""
        return self.solution.discretized.size

    def error(self, norm: str) -> float:
        """Return the estimate in a norm; NaN where there is none."""
        return math.nan if self.estimate is None else self.estimate.of(norm)

    def expected(self, norm: str) -> float:
        """Return about the error in a norm by the solution alone, as a share of the range; NaN where it is not told."""
        if self.alone is None:
            return math.nan
        return float(np.max((self.alone.rms if norm == "rms" else self.alone.largest) / self._unit))

    @cached_property
    def _unit(self) -> Floats:
        return scales_of(self.solution)

    def step(self, norm: str) -> Step:
        """Return what a report says of it."""
        problem = self.solution.scene.problem
        length = problem.step if isinstance(problem, Evolution) else 0.0
        return Step(self.purpose, self.spacing, length, self.unknowns, self.seconds, self.error(norm))


@dataclass(eq=False)
class Way:
    """What was solved so far, and what is asked for.

    Attributes
    ----------
    scene : Scene
        Whose steps in time may be shorter than those that were given.
    solve : callable
        ``solve(scene, spacing, progress=..., **options)``.
    target : Asked
        What is asked for.
    progress : callable
        Told what is solved, and what for.
    in_time : float
        What the steps in time leave of an error, as a share of the range; nothing before it is looked at.
    started : float
        When the clock was at zero.
    runs : list of Run
        In order.
    origin : sequence, optional
        Position of a node of the answer's lattice, if one was given.
    solver : str
        That is asked for.
    degree_given : bool
        Whether the degree of the form is asked for.
    further : dict
        Options that were chosen on the way.
    order : float, optional
        At which errors are taken to fall, where it is not the form's.
    trials : int
        How often spacings that are too coarse are made finer.
    refused : Exception, optional
        Why the way ended before its goal.
    left : float, optional
        What the source leaves of an error, once that is looked at.
    """

    scene: Scene
    solve: Solve
    target: AccuracyTarget
    progress: Progress = no_progress
    in_time: float = 0.0
    started: float = field(default_factory=lambda: time.perf_counter())
    runs: list[Run] = field(default_factory=list)
    origin: Any = None
    solver: str = "auto"
    degree_given: bool = False
    further: dict[str, Any] = field(default_factory=dict)
    order: float | None = None
    trials: int = MOST_TRIALS
    refused: Exception | None = None
    left: float | None = None

    @property
    def best(self) -> Run:
        """The run whose error is known to be smallest; the finest where none is known."""
        known = [run for run in self.runs if self._answers(run) and np.isfinite(run.error(self.target.norm))]
        return min(known, key=lambda run: run.error(self.target.norm)) if known else self.last

    @property
    def last(self) -> Run:
        """The finest."""
        return self.runs[-1]

    @property
    def error(self) -> float:
        """The estimate of the last one's error in the norm that is asked for."""
        return self.last.error(self.target.norm)

    @property
    def expected(self) -> float:
        """What the last one alone lets expect of its error; NaN where it tells nothing, as where a recipe made it."""
        return self.last.expected(self.target.norm)

    def asked_of(self, solution: SolutionRecord) -> SolutionRecord:
        """Return what is asked for out of a solution: of pilots of eigenvalue problems fewer modes."""
        modes = isinstance(self.scene.problem, Eigen) and isinstance(solution, EigenRecord)
        return fewer_modes(cast("EigenRecord", solution), self.scene) if modes else solution

    @property
    def elapsed(self) -> float:
        """Seconds since the start."""
        return time.perf_counter() - self.started

    def run(self, purpose: Purpose, spacing: float, expected: float | None = None) -> Run:
        """Solve at a spacing; ``expected`` seconds are told."""
        scene = self.scene if purpose in ANSWERS else coarser_scene(self.scene)
        about = "" if expected is None else f", about {expected:.2g} s"
        what = f"{purpose} at spacing {spacing:.3g}{about}"
        began = time.perf_counter()
        solution = self.solve(
            scene,
            spacing,
            progress=lambda stage, share: self.progress(f"{what}: {stage}", share),
            origin=self._origin(spacing),
            **self.further,
        )
        took, alone = time.perf_counter() - began, None if self.order is not None else expected_of(solution)
        made = Run(purpose, solution, took, alone, self._estimate(solution, alone))
        self.runs.append(made)
        return made

    def first(self, spacing: float) -> Run:
        """Solve a pilot at a spacing, or at the first finer one that the scene can be solved at.

        Raises
        ------
        CpmkitError
            Where none serves, with the reason that the first one was refused for.
        """
        refused: ResolutionError | SceneError | None = None
        for trial in range(self.trials):
            try:
                return self.run("pilot", spacing / math.sqrt(2) ** trial)
            except (ResolutionError, SceneError) as error:
                refused = refused or error
        assert refused is not None
        raise self._about_target(refused, spacing, spacing / math.sqrt(2) ** (self.trials - 1)) from refused

    def _about_target(
        self, refused: ResolutionError | SceneError, coarse: float, fine: float
    ) -> ResolutionError | SceneError:
        """Return an error about a spacing as one about what was asked for: nobody gave the spacing."""
        if "spacing" not in str(refused):
            return refused
        return type(refused)(
            f"{self.target.target} was asked for, and the scene was refused at every spacing that was tried, from "
            f"{coarse:.3g} to {fine:.3g}, the first time because: {refused}"
        )

    def look_at_steps(self) -> bool:
        """Shorten the steps in time until they leave a small share of the tolerance; tell whether they were too long.

        Asked of the first pilot, for that hardly depends on the spacing; what they leave counts from here on.
        """
        problem: Any = self.scene.problem
        if not isinstance(problem, Evolution):
            return False
        same = {"origin": self.last.solution.discretization()["origin"]}  # elsewhere errors in space would count
        self.in_time = error_in_time(self.last.solution, lambda scene, spacing: self.solve(scene, spacing, **same))
        order = order_in_time(problem)
        wanted = TIME_SHARE * (self.target.tolerance or np.inf)
        if self.in_time <= wanted:
            return False
        parts = math.ceil((self.in_time / wanted) ** (1 / order))
        self.scene = replace(self.scene, problem=replace(cast("Any", problem), step=problem.step / parts))
        self.in_time /= parts**order
        return True

    def floor(self) -> float:
        """Return what the source leaves of an error, by the last pilot, solved on a mesh's triangles if it matters."""
        last = self.last.solution
        if self.left is None:
            if self.target.tolerance is None or self.order is not None or self.refused is not None:
                return last.discretized.source_error()  # a recipe makes no solution on triangles
            solve_at = partial(self.solve, spacing=last.spacing, origin=last.discretization()["origin"], **self.further)
            self.left = floor_by_facets(last, solve_at, self.target.tolerance)
        return self.left

    def companion(self, solution: SolutionRecord) -> SolutionRecord | None:
        """Return the solution that one is held against, of those whose spacings are neither too near nor too far."""
        ratios = {
            one.spacing / solution.spacing: one.solution for one in self.runs if self._serves(one.solution, solution)
        }
        near = {ratio: one for ratio, one in ratios.items() if LEAST_RATIO <= ratio <= MOST_RATIO}
        return near[min(near, key=lambda ratio: abs(ratio - BEST_RATIO))] if near else None

    def _answers(self, run: Run) -> bool:
        """Return whether a run is of the scene itself, its steps in time as they were chosen last."""
        mine, other = self.scene.problem, run.solution.scene.problem
        return not isinstance(mine, Evolution) or cast("Any", other).step == mine.step

    def alike(self, solution: SolutionRecord, other: SolutionRecord | None = None) -> bool:
        """Return whether two solutions are of one form with one degree, the last one if no ``other`` is given."""
        mine, theirs = (lattice_options(one.discretized) for one in (solution, other or self.last.solution))
        return mine is not None and theirs is not None and mine.own == theirs.own

    def _serves(self, companion: SolutionRecord, solution: SolutionRecord) -> bool:
        mine, other = self.scene.problem, companion.scene.problem
        same_steps = not isinstance(mine, Evolution) or cast("Any", other).step == mine.step
        return same_steps and self.alike(companion, solution)

    def _estimate(self, solution: SolutionRecord, alone: ExpectedError | None) -> ErrorEstimate | None:
        companion, solution = self.companion(solution), self.asked_of(solution)
        if companion is None or any(one.discretized.diagnosis().no_estimate for one in (solution, companion)):
            return None
        return from_companions(solution, [companion], self.in_time, self.order, alone)

    def _origin(self, spacing: float) -> Any:
        """Return where a node is: as given, but on the coarsest lattices, else in no two runs at the same place."""
        if self.origin is not None and any(run.spacing > spacing for run in self.runs):
            return self.origin  # what may be the answer; further ratios of spacings are no whole numbers
        return shifted_origin(self.scene, spacing, len(self.runs) + 1)

    def steps(self) -> tuple[Step, ...]:
        """Return what a report says of all runs."""
        return tuple(run.step(self.target.norm) for run in self.runs)
