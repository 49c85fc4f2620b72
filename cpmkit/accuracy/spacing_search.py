"""The search for the spacing at which a target (error, time, memory) is met.

A first, coarse solve gives an estimate of its error, and from that the spacing of the next solve, with which it is
compared. If the target is far away, a solve at a spacing in between shows how fast the error falls and what solves
cost, and the answer is compared with it.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from cpmkit.accuracy.adaptive_run import BEST_RATIO, LEAST_RATIO, AdaptiveRun, TimedSolve
from cpmkit.errors import CpmkitError, ResolutionError
from cpmkit.forms.choice import cost_model
from cpmkit.forms.cost_model import fit_linear_cost, fitting_unknowns, growth_through
from cpmkit.forms.options import lattice_options
from cpmkit.grid.lattice import COARSEST_SPACING_SHARE, unknowns_at_unit_spacing
from cpmkit.manifold.local_source import largest_dim, localize
from cpmkit.runtime import memory
from cpmkit.scene.scene import Scene

#: Share of the tolerance that is aimed at. With this and the factors below, benchmarks/trade.py had answers nearer to
#: the target, for less time in addition to the last solve, than with other values.
AIMED_SHARE = 0.55
#: Largest order at which errors are assumed to fall where they may fall slowly.
MOST_SLOW_ORDER = 1.3
#: Ratios of consecutive spacings: the least (a smaller ratio shows little and costs nearly as much again); the largest,
#: with which solutions can be compared (no integer, since lattices would share nodes); and the largest ratio without a
#: solve in between.
LEAST_FACTOR, MOST_FACTOR, WORTH_COMPANION = 1.38, 2.45, 3.3
#: Number of answers after which the search ends, and number of times that steps in time are shortened.
MOST_ANSWERS, MOST_SHORTENED = 3, 5
#: The largest ratio from the cheap first solve to the second, and the ratio if the first has no estimate.
FIRST_MOST_FACTOR, UNESTIMATED_FACTOR = 2.48, 2.2
#: The error below which cubic splines take less time than quadratic ones: the mean over a sphere and a torus, by the
#: two finest solves of each degree in benchmarks/tables/knobs.md, between which time is a power of the error.
CUBIC_ERROR = 5.8e-6

#: ``reached``: the estimate is below the tolerance. ``floor``: the error due to the source of the manifold is above the
#: tolerance, and the estimate is below that error. ``within``: without a tolerance, time and memory were kept. ``not
#: reached``: none of these.
Status = Literal["reached", "floor", "within", "not reached"]


def search_spacing(run: AdaptiveRun) -> tuple[Status, float]:
    """Solve at one spacing after another until the target is met or cannot be met.

    Return how the search ended, and the larger of the tolerance and the source's error (0 without a tolerance). Once
    there is a solution, a solve that fails ends the search with the error in ``run.failure``, and the solutions so far
    are kept. Raises CpmkitError as a solve does if there is no solution yet, and as :func:`check_memory` does.
    """
    tolerance = run.target.tolerance
    run.solve_first(first_spacing(run.scene))
    try:
        if run.shorten_steps():
            run.solve("pilot", run.last.spacing)
        run.solve("pilot", run.last.spacing / _first_factor(run))
        check_memory(run)
        _refine_spacing(run)
        if tolerance and run.has_own_steps:
            _refine_steps(run)
    except (CpmkitError, MemoryError) as error:
        run.failure = error
    check_memory(run)
    aim = _reachable_tolerance(run)
    if tolerance is None:
        late = run.target.seconds is not None and run.elapsed > 1.5 * run.target.seconds
        return ("not reached" if late else "within"), aim
    if run.failure is not None or not _is_accepted(run, aim):
        return "not reached", aim
    return ("reached" if aim == tolerance else "floor"), aim


def _reachable_tolerance(run: AdaptiveRun) -> float:
    """Return the tolerance, or the error due to the source if that is larger; 0 without a tolerance."""
    tolerance = run.target.tolerance
    return 0.0 if tolerance is None else max(tolerance, run.source_error())


def _first_factor(run: AdaptiveRun) -> float:
    """Return the ratio of the first spacing to the second: 2.1 to 2.48 by the first error, 2.2 if that is unknown."""
    tolerance, expected = run.target.tolerance, run.last.expected_error
    if math.isnan(expected):
        return UNESTIMATED_FACTOR
    if tolerance is None:
        return FIRST_MOST_FACTOR
    factor = (expected / (0.45 * tolerance)) ** (1 / 2.4)  # less than the aimed share, and a safe order
    return float(min(max(factor, 2.1), FIRST_MOST_FACTOR))


def _refine_spacing(run: AdaptiveRun) -> None:
    """Append solves at smaller spacings, up to three answers, until the tolerance or a limit is met or errors stay.

    Where a higher degree pays it is set in ``run.chosen_options``, and the last two spacings are solved again first.
    Raises CpmkitError or MemoryError as a solve does.
    """
    aim = _reachable_tolerance(run)
    if _takes_cubic_splines(run, aim):
        run.chosen_options["degree"] = run.last.solution.discretized.traits.higher_degree
        for solve in run.solves[-2:]:
            run.solve("pilot", solve.spacing)
    answers = 0
    while not _is_accepted(run, aim) and answers < MOST_ANSWERS and not errors_stagnate(run):
        here = run.last.spacing
        coarse, fine = ((float(solve.spacing), float(solve.unknowns)) for solve in _last_two(run))
        growth = growth_through(fine, coarse, largest_dim(run.scene.surface))
        room = 0.8 * min(run.target.memory or np.inf, memory.available_bytes())
        most_in_memory = fitting_unknowns(room, lambda unknowns: predicted_bytes(run, unknowns), fine[1])
        limit = growth.spacing_with(min(most_in_memory, _most_unknowns_in_time(run)))
        goal, farthest = max(_goal_spacing(run, aim), limit), max(here / MOST_FACTOR, limit)
        start, slope = _seconds_line(run)
        if here / goal > WORTH_COMPANION:
            between = max(math.sqrt(goal * here), MOST_FACTOR * goal, farthest)
            run.solve("companion", between, start + slope * growth.count_at(between))
            continue
        goal = max(goal, farthest)
        if here / goal < LEAST_RATIO:
            break
        answers += 1
        run.solve("answer" if answers == 1 else "correction", goal, start + slope * growth.count_at(goal))


def _refine_steps(run: AdaptiveRun) -> None:
    """Shorten the steps in time and append solves until the errors in time and space are within the tolerance.

    The loop also ends if no solve improves the errors. It is needed since on coarse lattices, which smooth moving
    features, errors of steps are too small, and errors of long steps are all alike. Raises CpmkitError or MemoryError
    as a solve does.
    """
    for _ in range(MOST_SHORTENED):
        here, count = run.last.spacing, len(run.solves)
        if run.shorten_steps():
            run.solve("companion", BEST_RATIO * here)
            run.solve("correction", here)
        _refine_spacing(run)
        if len(run.solves) == count:
            return


def answers_used_up(run: AdaptiveRun) -> bool:
    """Return whether the search made all its answers, so that neither time nor memory ended it."""
    return sum(solve.purpose in ("answer", "correction") for solve in run.solves) >= MOST_ANSWERS


def _takes_cubic_splines(run: AdaptiveRun, tolerance: float) -> bool:
    """Return whether to go on with splines of a higher degree, which reach small tolerances sooner.

    Only where this was measured: ``tolerance`` is above 0 and below :data:`CUBIC_ERROR`, the equation is a Poisson or
    screened Poisson equation, neither a degree, a memory nor a recipe is given, the form has a higher degree, the
    manifold is known exactly, and the error falls at its expected order.
    """
    form = run.last.solution.discretized
    return bool(
        0 < tolerance < CUBIC_ERROR
        and not run.is_recipe
        and "degree" not in run.options
        and run.target.memory is None
        and form.traits.higher_degree is not None
        and run.scene.problem.kind in ("poisson", "screened")
        and not form.source_error()
        and not form.diagnosis().slow
    )


def _is_accepted(run: AdaptiveRun, aim: float) -> bool:
    """Return True if the estimated error of the last solution is below the tolerance ``aim``, with a margin.

    The solution is never accepted if pieces of the manifold with one unknown each are so large that their errors, which
    no estimate includes, may exceed the tolerance. Without an estimate from the solution alone the margin is larger if
    errors fall more slowly than expected, as they do while a layer is about as wide as a spacing.
    """
    last = run.last
    if last.solution.discretized.diagnosis().unresolved_share > aim**2:
        return False
    first = len(_comparable_solves(run)) < 2
    # largest errors vary more; with one coarser solution it is unknown whether errors fall at their order yet
    accepted = aim * (0.93 if first else 0.97) if run.target.norm == "rms" else aim * (0.75 if first else 0.87)
    if last.estimate is not None and last.estimate.slow:
        accepted *= 0.55  # estimates of slits with exact solutions were down to .49
    if not math.isnan(last.expected_error):
        return last.error <= accepted
    prior = _prior_order(run)
    slower = (UNESTIMATED_FACTOR**prior - 1) / (UNESTIMATED_FACTOR ** min(assumed_order(run), prior) - 1)
    at_first, later = (0.8, 0.92) if last.solution.has_modes else (0.6, 0.75)  # estimates are larger
    return bool(last.error * slower <= accepted * (at_first if first else later))


def errors_stagnate(run: AdaptiveRun) -> bool:
    """Return True if smaller spacings no longer reduce the error.

    Either the error has risen and is of the size that residuals of linear solves cause, which grow as the spacing
    falls; or the first of the last four errors is the smallest, and the fourth is not below the second. False unless
    the last error is known, and an earlier one at 1.3 times the spacing or more.
    """
    known = _comparable_solves(run)[-4:]
    errors = [solve.error for solve in known]
    if len(known) < 2 or known[-1] is not run.last or known[-2].spacing < LEAST_RATIO * known[-1].spacing:
        return False
    # at most about this share of the range is the error of linear solves (measured: tests/accuracy/test_tolerance.py)
    algebraic = 50.0 * run.last.solution.report.residual
    stay = len(known) == 4 and errors[0] <= min(errors) and errors[1] <= errors[3]
    return errors[-2] <= errors[-1] <= algebraic or stay


def _goal_spacing(run: AdaptiveRun, aim: float) -> float:
    """Return the spacing at which the error is expected to be below the tolerance ``aim``; zero if that is zero.

    The last spacing is returned if its error is accepted, else one smaller by a factor of 1.38 or more.
    """
    here = run.last.spacing
    if aim == 0:
        return 0.0
    if _is_accepted(run, aim):
        return here
    known = _comparable_solves(run)
    if not known:  # no mode was matched, so no error is known
        return here / math.sqrt(2)
    p, last = assumed_order(run), known[-1]
    error = last.error * (here / last.spacing) ** p
    return float(here / max((error / (AIMED_SHARE * aim)) ** (1 / p), LEAST_FACTOR))


def assumed_order(run: AdaptiveRun) -> float:
    """Return the order at which the error is assumed to fall: the mean of the observed order and :func:`_prior_order`.

    The order is between 0.8 and 3, or 1.3 if the prior order is below 1.3. It is observed between the last two solves
    with estimated errors, without the error in time; if there are fewer, between the errors estimated from the last two
    solutions alone; if these are unknown, or the spacings nearly equal, the prior order is returned.
    """
    observed = prior = _prior_order(run)
    pair = _comparable_solves(run)[-2:]
    errors = [solve.error - run.step_error for solve in pair]
    if len(pair) < 2 and not math.isnan(run.last.expected_error):
        pair = run.solves[-2:]
        errors = [solve.expected_error for solve in pair]
    if len(pair) == 2 and pair[0].spacing > LEAST_RATIO * pair[1].spacing:
        coarse, fine = (max(error, np.finfo(float).tiny) for error in errors)
        observed = math.log(coarse / fine) / math.log(pair[0].spacing / pair[1].spacing)
    return min(max((observed + prior) / 2, 0.8), MOST_SLOW_ORDER if prior < MOST_SLOW_ORDER else 3.0)


def _prior_order(run: AdaptiveRun) -> float:
    """Return the order of the last estimate; without an estimate, that of the run, or else of the form."""
    estimate = run.last.estimate
    if estimate is not None:
        return estimate.order
    return run.order or run.last.solution.discretized.diagnosis().order


def _comparable_solves(run: AdaptiveRun) -> list[TimedSolve]:
    """Return the solves with the options of the last solve whose errors are known, the finest last."""
    return [solve for solve in run.solves if np.isfinite(solve.error) and run.has_same_options(solve.solution)]


def first_spacing(scene: Scene) -> float:
    """Return the spacing of the first solve, with 35 to 400 unknowns by the manifold's dimension, or more if needed."""
    surface = localize(scene.surface, np.zeros(scene.surface.dim))
    m = surface.largest_dim
    counted = unknowns_at_unit_spacing(surface, 2, 100)  # in few blocks, as closest points may be expensive
    spacing = (counted / {0: 35, 1: 35, 2: 100, 3: 400}[m]) ** (1 / max(m, 1))
    return float(min(spacing, COARSEST_SPACING_SHARE * np.ptp(surface.bounds, axis=0).max()))


def predicted_bytes(run: AdaptiveRun, unknowns: float) -> float:
    """Return the predicted peak of memory, in bytes, of a solve with this number of unknowns.

    The peak includes stored coarser solutions, and the fragmentation of memory by earlier solves (measured on 24
    problems of 500 to 58,000 unknowns: .1 of the need, 20 MB at most, in separate processes, and 1 to 2 times as much,
    50 MB at most, after many solves; a value in between is added).
    """
    used, stored = _needed_bytes(run, unknowns)
    return stored + used + min(3e6 + 0.4 * used, 20e6)


def _needed_bytes(run: AdaptiveRun, unknowns: float) -> tuple[float, float]:
    """Return the bytes that a solve with ``unknowns`` needs, and those of the run's solutions with fewer unknowns."""
    options = lattice_options(run.last.solution.discretized)
    assert options is not None  # a target is for a form on a lattice
    model = cost_model(run.scene, options)
    solver = model.choose_solver(str(run.options.get("solver", "auto")), unknowns)
    used = model.peak_bytes(unknowns, solver, run.last.solution.work)
    return used, sum(model.stored_bytes(solve.solution.work) for solve in run.solves if solve.unknowns < unknowns)


def check_memory(run: AdaptiveRun) -> None:
    """Raise ResolutionError if the last solve, with the solutions before it, needs more memory than the target has."""
    needed, target = sum(_needed_bytes(run, run.last.unknowns)), run.target.memory
    if target is not None and needed > target:
        raise ResolutionError(
            f"memory={target:.3g} bytes are less than the {needed:.3g} of a coarse solve with {run.last.unknowns:,} "
            "unknowns; ask for more."
        )


def _last_two(run: AdaptiveRun) -> tuple[TimedSolve, TimedSolve]:
    """Return the latest solve whose spacing is over 1.1 times that of the last one, and the last solve."""
    fine = run.last
    return next(solve for solve in reversed(run.solves) if solve.spacing > 1.1 * fine.spacing), fine


def _seconds_line(run: AdaptiveRun) -> tuple[float, float]:
    """Return a and b of the duration ``a + b unknowns`` in seconds, from the last two solves of different spacing."""
    coarse, fine = ((float(solve.unknowns), solve.seconds) for solve in _last_two(run))
    return fit_linear_cost(coarse, fine)


def _most_unknowns_in_time(run: AdaptiveRun) -> float:
    """Return the number of unknowns for which the remaining time suffices; infinite without a time limit.

    A solve at twice the spacing for comparison is included, unless the last solve serves for it.
    """
    if run.target.seconds is None:
        return np.inf
    start, slope = _seconds_line(run)
    m = largest_dim(run.scene.surface)
    remaining = (run.target.seconds - run.elapsed) / 1.25  # a solve may take longer than expected
    coarse_share = 0.0 if run.last.purpose == "companion" else 0.5**m
    return max((remaining - start * (1 + (coarse_share > 0))) / (slope * (1 + coarse_share)), 1.0)
