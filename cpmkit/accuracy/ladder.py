"""From an error, a time or a memory that is asked for to a spacing, and to the solution there.

One coarse solve tells about how large its error is, and the next, at the spacing that is foretold from it, is held
against it. Where the goal is far away, one is solved in between, which tells how the error falls and what solving
costs, and which the answer is then held against.
"""

from __future__ import annotations

import math

import numpy as np

from cpmkit.accuracy.knobs import HIGHER_DEGREE, worth_higher_degree
from cpmkit.accuracy.limits import check_memory, expected_seconds, finest_spacing, first_spacing
from cpmkit.accuracy.trade import Purpose, Status
from cpmkit.accuracy.way import LEAST_RATIO, Run, Way
from cpmkit.errors import CpmkitError
from cpmkit.solution.modes import EigenRecord

#: The spacing is taken for this share of the tolerance; that of the second solve, which is foretold from the first
#: alone, for a smaller one, at this order: with these and the factors below benchmarks/trade.py had answers nearer to
#: what was asked, for less time beside the last solve's, than with others.
AIMED_SHARE, FIRST_AIMED_SHARE, FIRST_ORDER = 0.55, 0.45, 2.4
#: Shares of the tolerance below which an estimate is accepted: largest errors scatter more, and where no coarser error
#: is known nothing tells whether errors fall yet as they should.
ACCEPTED_SHARE, FIRST_ACCEPTED_SHARE = {"rms": 0.97, "max": 0.87}, {"rms": 0.93, "max": 0.75}
#: By this again where something says that errors may fall slowly: of slits with an exact solution the estimate was down
#: to .49 of the error.
SLOW_SHARE = 0.55
#: By these again where a solution alone tells nothing, at first and later; estimates of eigenvalues are rather large.
UNTOLD_SHARES, EIGENVALUE_SHARES = (0.6, 0.75), (0.8, 0.92)
#: Orders at which errors are taken to fall, at least, at most, and at most where something says that it is slow.
LEAST_ORDER, MOST_ORDER, MOST_SLOW_ORDER = 0.8, 3.0, 1.3
#: Spacings go down by at least so much at a time, for less tells little and costs nearly as much again, and at most so
#: much, so that each error is known: no whole number, by which lattices would have nodes in common. A goal that is not
#: much farther than that is tried at once.
LEAST_FACTOR, MOST_FACTOR, WORTH_COMPANION = 1.38, 2.45, 3.3
#: The same from the first solve to the second: it costs little beside it. And where nothing tells how large the error
#: of the first one is.
FIRST_LEAST_FACTOR, FIRST_MOST_FACTOR, UNTOLD_FACTOR = 2.1, 2.48, 2.2
#: A limit nearer than this is as good as reached where no tolerance is asked for; what is nearer serves no estimate.
NO_FINER = LEAST_RATIO
#: A time is kept to within this factor.
LATE = 1.5
#: Spacings nearer to each other than this tell neither an order nor an error.
TELLING_RATIO = 1.35
#: Finer answers than the first, at most.
MOST_CORRECTIONS = 2
#: Linear solves that reach a relative residual leave an error of at most about so many times it, as a share of the
#: range (measured: tests/accuracy/test_tolerance.py).
RESIDUAL_FACTOR = 50.0


def walk(way: Way) -> tuple[Status, float]:
    """Solve until what is asked for is reached; return the status, and the tolerance that was aimed at.

    Once there is a solution a solve that fails ends the way, with the reason in ``way.refused``: what was found is not
    lost.

    Raises
    ------
    CpmkitError
        As a solve does where there is no solution yet; if a coarse solve exceeds the memory that is asked for.
    """
    tolerance = way.target.tolerance
    way.first(first_spacing(way.scene))
    try:
        pilots(way, tolerance)
        _refine(way)
    except (CpmkitError, MemoryError) as error:
        way.refused = error
    check_memory(way)
    aim = _aim(way)
    accepted = tolerance is not None and way.refused is None and _accepted(way, aim)
    if tolerance is None:
        late = way.target.seconds is not None and way.elapsed > LATE * way.target.seconds
        return ("not reached" if late else "within"), aim
    if not accepted:
        return "not reached", aim
    return ("reached" if aim == tolerance else "floor"), aim


def _aim(way: Way) -> float:
    """Return the tolerance that can be reached: what is asked for, or what the source leaves; 0 without a tolerance."""
    tolerance = way.target.tolerance
    return 0.0 if tolerance is None else max(tolerance, way.floor())


def _refine(way: Way) -> None:
    """Solve at smaller spacings until the tolerance is reached, a limit, or what rounding leaves."""
    tolerance, aim = way.target.tolerance, _aim(way)
    if worth_higher_degree(way, aim):
        way.further["degree"] = HIGHER_DEGREE
        for run in way.runs[-2:]:
            way.run("pilot", run.spacing)
    answers = 0
    while not _accepted(way, aim) and answers <= MOST_CORRECTIONS and not errors_stay(way):
        here, limit = way.last.spacing, finest_spacing(way)
        goal, farthest = max(_foretold(way, aim), limit), max(here / MOST_FACTOR, limit)
        if here / goal > WORTH_COMPANION:
            _run(way, "companion", max(math.sqrt(goal * here), MOST_FACTOR * goal, farthest))
            continue
        goal = max(goal, farthest)
        if here / goal < (NO_FINER if tolerance is None else TELLING_RATIO):
            break
        answers += 1
        _run(way, "answer" if answers == 1 else "correction", goal)


def _accepted(way: Way, aim: float) -> bool:
    """Return whether the estimate is below what is aimed at.

    Never where pieces with one value each are so large that they alone may leave more: no estimate sees their errors.
    Where the solution alone tells nothing, also if errors fall more slowly than it takes them to: so they do while a
    layer is about as wide as a spacing. Two that tell the same and know nothing of each other need no such caution.
    """
    if way.last.solution.discretized.diagnosis().unresolved_share > aim**2:
        return False
    first = len(_known(way)) < 2
    accepted = (FIRST_ACCEPTED_SHARE if first else ACCEPTED_SHARE)[way.target.norm] * aim
    if way.last.estimate is not None and way.last.estimate.slow:
        accepted *= SLOW_SHARE
    if not math.isnan(way.expected):
        return way.error <= accepted
    prior = _prior(way)
    slower = (UNTOLD_FACTOR**prior - 1) / (UNTOLD_FACTOR ** min(order(way), prior) - 1)
    at_first, later = EIGENVALUE_SHARES if isinstance(way.last.solution, EigenRecord) else UNTOLD_SHARES
    return bool(way.error * slower <= accepted * (at_first if first else later))


def pilots(way: Way, tolerance: float | None) -> None:
    """See what the steps in time leave of the first solution, and solve at the next spacing."""
    if way.look_at_steps():
        way.run("pilot", way.last.spacing)
    way.run("pilot", way.last.spacing / _first_factor(way, tolerance))
    check_memory(way)


def _first_factor(way: Way, tolerance: float | None) -> float:
    """Return how many times finer the second solve is: near to the goal that the first one alone lets expect."""
    if math.isnan(way.expected):
        return UNTOLD_FACTOR
    if tolerance is None:
        return FIRST_MOST_FACTOR
    factor = (way.expected / (FIRST_AIMED_SHARE * tolerance)) ** (1 / FIRST_ORDER)
    return float(min(max(factor, FIRST_LEAST_FACTOR), FIRST_MOST_FACTOR))


def errors_stay(way: Way) -> bool:
    """Return whether smaller spacings no longer help.

    Either the error has risen, and is what linear solves may leave: their residuals are known as they are, rounding
    included, which grows as the spacing falls. Or none of the last three errors is below one before, nor do they fall.
    """
    known = _known(way)[-4:]
    spacings, errors = [run.spacing for run in known], [run.error(way.target.norm) for run in known]
    if len(known) < 2 or known[-1] is not way.last or spacings[-2] < TELLING_RATIO * spacings[-1]:
        return False
    left = RESIDUAL_FACTOR * way.last.solution.report.residual
    return errors[-2] <= errors[-1] <= left or (len(known) == 4 and errors[0] <= min(errors) and errors[1] <= errors[3])


def _run(way: Way, purpose: Purpose, spacing: float) -> None:
    way.run(purpose, spacing, expected_seconds(way, spacing))


def _foretold(way: Way, aim: float) -> float:
    """Return the spacing at which the error is expected to be below ``aim``; zero where none is asked for."""
    here = way.last.spacing
    if aim == 0:
        return 0.0
    if _accepted(way, aim):
        return here
    known = _known(way)
    if not known:  # no mode was seen
        return here / math.sqrt(2)
    p, last = order(way), known[-1]
    error = last.error(way.target.norm) * (here / last.spacing) ** p
    return float(here / max((error / (AIMED_SHARE * aim)) ** (1 / p), LEAST_FACTOR))


def order(way: Way) -> float:
    """Return the order at which the error is taken to fall: the mean of that seen and of the form's."""
    seen = prior = _prior(way)
    pair, errors = _two_errors(way)
    if len(pair) == 2 and pair[0].spacing > TELLING_RATIO * pair[1].spacing:
        coarse, fine = (max(error, np.finfo(float).tiny) for error in errors)
        seen = math.log(coarse / fine) / math.log(pair[0].spacing / pair[1].spacing)
    return min(max((seen + prior) / 2, LEAST_ORDER), MOST_SLOW_ORDER if prior < MOST_SLOW_ORDER else MOST_ORDER)


def _two_errors(way: Way) -> tuple[list[Run], list[float]]:
    """Return the last two runs whose errors are known, and these; else those that solutions alone let expect."""
    norm, known = way.target.norm, _known(way)[-2:]
    if len(known) == 2 or math.isnan(way.expected):
        return known, [run.error(norm) - way.in_time for run in known]
    told = way.runs[-2:]
    return told, [run.expected(norm) for run in told]


def _prior(way: Way) -> float:
    """Return the order at which the last estimate takes errors to fall, the form's where there is none."""
    estimate = way.last.estimate
    if estimate is not None:
        return estimate.order
    return way.order or way.last.solution.discretized.diagnosis().order


def _known(way: Way) -> list[Run]:
    """Return the runs of the last one's degree whose error is known, the finest last."""
    return [run for run in way.runs if np.isfinite(run.error(way.target.norm)) and way.alike(run.solution)]
