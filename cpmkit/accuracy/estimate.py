"""How large the error of a solution is, from independent solutions of the same scene at larger spacings."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Unpack, cast

import numpy as np

from cpmkit.accuracy.comparison import Difference, difference
from cpmkit.errors import InputError, place
from cpmkit.families.keywords import PreparingKeywords
from cpmkit.forms.choice import FORMS
from cpmkit.forms.contract import Discretized
from cpmkit.forms.options import Options
from cpmkit.linear.choice import SolverOptions
from cpmkit.meshes.display_mesh import DisplayMesh, evaluate_on_sides
from cpmkit.preparing import solved
from cpmkit.protocols import Floats
from cpmkit.runtime.declared import showing
from cpmkit.runtime.warn import collected_warnings, warn_each
from cpmkit.scene.compound_equations import Eigen
from cpmkit.scene.equations_in_time import FIRST_ORDER_SCHEMES, Evolution
from cpmkit.scene.scene import Scene
from cpmkit.solution.matched_modes import with_further_modes
from cpmkit.solution.modes import EigenSolution
from cpmkit.solution.solution import Solution

#: What a cautious user multiplies the estimate by.
ERROR_SAFETY_FACTOR = 2.0
#: Spacings of the solutions that one is held against, over its own.
RATIOS = {False: (2.0,), True: (math.sqrt(2), 2.0)}
#: By what part of a spacing the coarser lattices are shifted: nodes at the same places make the same errors there.
SHIFT = (0.37, 0.59, 0.43)

#: Solves a scene at a spacing, with the lattice's origin and all other options as they were.
SolveAt = Callable[[Scene, float], Solution]


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """An estimate of the error of a solution, or of its eigenvalues.

    Attributes
    ----------
    rms, largest : (channels,) float64
        Root mean square over the manifold, and the largest, as shares of the solution's range; of an eigenvalue problem
        both are the relative error of each eigenvalue, infinite where a coarser lattice has no mode like its own.
    unit : (channels,) float64
        What they are shares of: the range, the size where a solution is constant, each eigenvalue.
    in_time : float
        What of both is due to the steps in time; 0 where there are none.
    floor : (channels,) float64
        What the source alone leaves, whatever the spacing, as a share; of eigenvalues not known, and zero.
    at : (d,) float64
        Where the solutions differ most, in the scene's coordinates.
    slow : str
        Why the error may fall slowly with the spacing; empty where nothing says so.
    solution : Solution
        Whose error it is.
    companions : tuple of Solution
        That it was held against, the one at twice the spacing last.
    order : float
        At which errors are taken to fall from the last companion on: the form's, or one that is given.
    """

    rms: Floats
    largest: Floats
    unit: Floats
    in_time: float
    floor: Floats
    at: Floats
    slow: str
    solution: Solution
    companions: tuple[Solution, ...]
    order: float

    @property
    def error(self) -> Floats:
        """The largest error in the solution's own unit, (channels,)."""
        return np.asarray(self.largest * self.unit)

    @property
    def bound(self) -> Floats:
        """Twice the largest error and the source's floor, in the solution's unit: what is hardly exceeded."""
        return np.asarray(ERROR_SAFETY_FACTOR * self.error + self.floor * self.unit)

    @property
    def coarse(self) -> Solution:
        """The solution at twice the spacing."""
        return self.companions[-1]

    def of(self, norm: str) -> float:
        """Return the error in a norm, ``"rms"`` or ``"max"``, of the channel where it is greatest, as a share."""
        return float(np.max(self.rms if norm == "rms" else self.largest))

    def at_points(self, points: Any) -> Floats:
        """Return the estimated error (n,) or (n, channels) at points of the manifold, in the solution's own unit."""
        found = self._apart(*(one.evaluate(points).reshape(len(points), -1) for one in (self.solution, self.coarse)))
        return np.asarray(found[:, 0] if found.shape[1] == 1 else found)

    def on_mesh(self, mesh: DisplayMesh) -> Floats:
        """Return the estimated error (v, channels) at a mesh's vertices, each on the side that its cells lie on."""
        sides = np.zeros((len(mesh.points), 0), dtype=np.int64) if mesh.sides is None else mesh.sides
        return self._apart(*(evaluate_on_sides(one, mesh.points, sides) for one in (self.solution, self.coarse)))

    def _apart(self, ours: Floats, theirs: Floats) -> Floats:
        if isinstance(self.solution, EigenSolution):  # a multiplet's functions are any basis of it
            theirs = theirs @ np.linalg.lstsq(theirs, ours, rcond=None)[0]
        ratio = self.coarse.spacing / self.solution.spacing
        return np.asarray(np.abs(ours - theirs) / (ratio**self.order - 1))

    def as_dict(self) -> dict[str, Any]:
        """Return the estimate as plain values."""
        arrays = {name: getattr(self, name).tolist() for name in ("rms", "largest", "unit", "floor", "at")}
        spacings = [one.spacing for one in self.companions]
        return {**arrays, "in_time": self.in_time, "slow": self.slow, "held_against_spacings": spacings}

    def __str__(self) -> str:
        errors = ", ".join(f"{error:.2g}" for error in self.error)
        rms = ", ".join(f"{100 * one:.2g}" for one in self.rms)
        return (
            f"error about {errors} at spacing {self.solution.spacing:g}, at most {float(self.bound.max()):.2g}, "
            f"largest near {place(self.at)}; rms {rms} percent of the range{'; ' if self.slow else ''}{self.slow}"
        )


def estimated(solution: Solution, solve_at: SolveAt, tight: bool = False) -> ErrorEstimate:
    """Solve coarser companions of a solution, and estimate its error from the differences.

    Parameters
    ----------
    solution : Solution
        Whose error is estimated.
    solve_at : callable
        Solves a scene at a spacing.
    tight : bool
        Whether it is held against solutions at the root of two and at two times the spacing, or at two times alone.

    Raises
    ------
    CpmkitError
        As ``solve`` does at the larger spacings.
    """
    scene = coarser_scene(solution.scene)
    companions = [solve_at(scene, ratio * solution.spacing) for ratio in RATIOS[tight]]
    in_time = error_in_time(companions[-1], solve_at)
    return from_companions(solution, companions, in_time)


def coarser_scene(scene: Scene) -> Scene:
    """Return the scene that companions are solved of: modes may come in another order there, and further ones help."""
    return with_further_modes(scene) if isinstance(scene.problem, Eigen) else scene


def from_companions(
    solution: Solution, companions: Sequence[Solution], in_time: float = 0.0, order: float | None = None
) -> ErrorEstimate:
    """Estimate from solutions at larger spacings that are there; ``in_time`` is what the steps add, as a share.

    The estimate is the geometric mean of those from each companion: |u_h - u_rh| / (r^p - 1) at r times the spacing,
    with the order p that the form has for differences at that ratio (GALERKIN 10), or that is given.
    """
    form = solution.discretized
    found = [difference(solution, one) for one in companions]
    orders = [order or _order(form, solution, *both) for both in zip(companions, found, strict=True)]
    divisors = [one.ratio**p - 1 for one, p in zip(found, orders, strict=True)]
    rms, largest = (
        _mean([getattr(one, norm) / divisor for one, divisor in zip(found, divisors, strict=True)])
        for norm in ("rms", "largest")
    )
    last = found[-1]
    left = 0.0 if isinstance(solution, EigenSolution) else form.source_error()
    floor = np.full(len(last.unit), left)
    slow = form.slow_beside(companions[-1].discretized)
    return ErrorEstimate(
        rms + in_time,
        largest + in_time,
        last.unit,
        in_time,
        floor,
        last.at,
        slow,
        solution,
        tuple(companions),
        orders[-1],
    )


def _order(form: Discretized, solution: Solution, companion: Solution, found: Difference) -> float:
    of = form.eigenvalue_order if isinstance(solution, EigenSolution) else form.order_of_difference
    return of(found.ratio, companion.discretized, float(found.rms.max()))


def _mean(found: Sequence[Floats]) -> Floats:
    return np.asarray(np.exp(np.mean(np.log(np.maximum(found, np.finfo(float).tiny)), axis=0)))


def error_in_time(solution: Solution, solve_at: SolveAt) -> float:
    """Return what steps in time add to a solution's error, as a share of its range: solved again with twice the step.

    It depends little on the spacing, and is looked at where that is cheap.
    """
    problem = solution.scene.problem
    if not isinstance(problem, Evolution) or 2 * problem.step > problem.duration:
        return 0.0
    longer: Any = replace(cast(Any, problem), step=2 * problem.step)
    other = solve_at(replace(solution.scene, problem=longer), solution.spacing)
    return float(difference(solution, other).largest.max() / (2 ** order_in_time(problem) - 1))


def order_in_time(problem: Evolution) -> int:
    """Return the order of a problem's scheme; 1 where something is done after each step."""
    return 1 if problem.scheme in FIRST_ORDER_SCHEMES or problem.after_step is not None else 2


def error_of(solution: Solution, tight: bool = False) -> ErrorEstimate:
    """Estimate the error of a solution from what it tells of how it was discretised.

    Raises
    ------
    InputError
        If it was not solved on a lattice.
    """
    form = solution.discretized
    options = form.lattice_options
    if solution.estimated is False:
        raise InputError("the error of this solution was not to be estimated, estimate=False; leave that out.")
    if options is None:
        raise InputError(
            f"the error of a solution by {form.form!r} is estimated on a coarser lattice, and it has none; solve with "
            "backend='cpm', or on a finer mesh and compare."
        )
    return estimated(solution, companion_solver({**options.as_dict(), "form": form.form}), tight)


def with_estimate(solution: Solution, how: bool | str | None, options: Mapping[str, Any]) -> Solution:
    """Return a solution with its estimate made, ``True`` or ``"tight"``, refused, ``False``, or left for later."""
    if how is None:
        return solution
    if how is False:
        return replace(solution, estimated=False)
    return replace(solution, estimated=estimated(solution, companion_solver(options), how == "tight"))


def companion_solver(options: Mapping[str, Any]) -> SolveAt:
    """Return what solves companions with the options of ``solve``, on lattices whose nodes lie elsewhere."""
    kept = {name: value for name, value in options.items() if name not in ("spacing", "origin")}

    def solve_at(scene: Scene, spacing: float) -> Solution:
        with collected_warnings():
            return solved(scene, spacing, origin=shifted_origin(scene, spacing), **kept)

    return solve_at


def shifted_origin(scene: Scene, spacing: float, number: int = 1) -> Floats:
    """Return where the lattice of companion ``number`` has a node: no two at the same place of theirs."""
    shift = number * np.array(SHIFT)[: scene.surface.dim] % 1.0
    return np.asarray(np.asarray(scene.surface.bounds).mean(axis=0) + spacing * shift)


@showing(Options, *FORMS.values(), SolverOptions)
def estimate_error(
    scene: Scene, spacing: float, *, tight: bool = False, **options: Unpack[PreparingKeywords]
) -> ErrorEstimate:
    """Solve a scene at ``spacing`` and at twice it, and estimate the error of the finer solution.

    On a single position of the lattice the estimate is within a factor of two or three of the true error; where the
    coarse grid does not see the scene (thin parts, boundaries near each other) it is larger than that. Eigenvalues are
    matched by their functions, multiplets as a whole.

    Parameters
    ----------
    scene : Scene
        What is solved.
    spacing : float
        Of the finer solution.
    tight : bool
        Whether a third solution, at the root of two times the spacing, is taken into account: half as dear again, and
        nearer to the truth.
    **options
        As for :func:`cpmkit.solve`. The error is taken to fall with the power ``order`` of the spacing, 3 counting as
        2.

    Returns
    -------
    ErrorEstimate

    Raises
    ------
    CpmkitError
        As ``solve`` does, at either spacing.

    Examples
    --------
    >>> import cpmkit as ck
    >>> f = ck.ScreenedPoisson(lambda points: 2 * points[:, 0], c=1.0)  # u = x
    >>> circle = ck.source("analytic.circle")
    >>> estimate = ck.estimate_error(ck.Scene(circle, f), spacing=0.05)
    >>> points = circle.mesh(0.01)[0]
    >>> bool(1 < estimate.error[0] / abs(estimate.solution.evaluate(points) - points[:, 0]).max() < 5)
    True
    """
    with collected_warnings():
        solution = solved(scene, spacing, **options)
        estimate = estimated(solution, companion_solver(options), tight)
    warn_each(solution.warnings)
    return estimate
