"""From an error, a time or a memory that is asked for to a spacing, and to the solution there.

Two coarse solves tell how large the error is and what solving costs. A spacing is foretold from both; where it is far
away, one solve of twice it is done first, which tells how the error falls, and which the answer is then held against.
"""

from __future__ import annotations

import math

import numpy as np

from cpmkit.accuracy.knobs import HIGHER_DEGREE, worth_higher_degree
from cpmkit.accuracy.limits import check_memory, expected_seconds, finest_spacing, first_spacing
from cpmkit.accuracy.trade import Purpose, Status
from cpmkit.accuracy.way import Run, Way

#: The spacing is taken for this share of the tolerance, and a solution whose estimate is below that is accepted: with
#: these and the factors below benchmarks/trade.py took less time in all than with others, for less surplus of accuracy.
AIMED_SHARE, ACCEPTED_SHARE = 0.83, 0.92
#: The same where no coarser error is known, so that nothing tells whether errors fall yet as they should.
FIRST_SHARE, FIRST_TOLD_SHARE = 0.6, 0.7
#: The same where the solution alone says that its error is more than so many times the tolerance.
DOUBTED_SHARE, DOUBTED_FACTOR = 0.75, 2.0
#: Orders at which errors are taken to fall, at least, at most, and at most where something says that it is slow.
LEAST_ORDER, MOST_ORDER, MOST_SLOW_ORDER = 0.8, 3.0, 1.3
#: Spacings go down by at least so much at a time, for less tells little and costs nearly as much again, and at most so
#: much, so that each error is known: no whole number, by which lattices would have nodes in common. A goal that is not
#: much farther than that is tried at once.
LEAST_FACTOR, MOST_FACTOR, WORTH_COMPANION = 1.45, 2.2, 2.75
#: A limit nearer than this is as good as reached where no tolerance is asked for.
NO_FINER = 1.2
#: A time is kept to within this factor.
LATE = 1.5
#: Spacings nearer to each other than this tell neither an order nor an error.
TELLING_RATIO = 1.35
#: Finer answers than the first, at most.
MOST_CORRECTIONS = 2


def walk(way: Way) -> tuple[Status, float]:
    """Solve until what is asked for is reached; return the status, and the tolerance that was aimed at."""
    pilots(way)
    floor = way.last.solution.discretized.source_error()
    tolerance = way.asked.tolerance
    aim = 0.0 if tolerance is None else max(tolerance, floor)
    if worth_higher_degree(way, aim):
        way.further["degree"] = HIGHER_DEGREE
        for run in way.runs[-2:]:
            way.run("pilot", run.spacing)
    answers = 0
    while not _accepted(way, aim) and answers <= MOST_CORRECTIONS:
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
    if tolerance is None:
        late = way.asked.seconds is not None and way.elapsed > LATE * way.asked.seconds
        return ("not reached" if late else "within"), aim
    if not _accepted(way, aim):
        return "not reached", aim
    return ("reached" if aim == tolerance else "floor"), aim


def _accepted(way: Way, aim: float) -> bool:
    """Return whether the estimate is below what is aimed at, also where errors fall more slowly than it takes them to.

    So they do while a layer is about as wide as a spacing. They need not be looked at where the solution alone says the
    same: two that know nothing of each other. Where it contradicts, the estimate has to be smaller.
    """
    expected = way.last.expected(way.asked.norm)
    told = expected <= aim
    first = FIRST_TOLD_SHARE if told else FIRST_SHARE
    later = DOUBTED_SHARE if expected > DOUBTED_FACTOR * aim else ACCEPTED_SHARE
    share = later if len(_known(way)) > 1 else first
    if told:
        return way.error <= share * aim
    prior = _prior(way)
    slower = (MOST_FACTOR**prior - 1) / (MOST_FACTOR ** min(order(way), prior) - 1)
    return bool(way.error * slower <= share * aim)


def pilots(way: Way) -> None:
    """Solve at coarse spacings; see what the steps in time leave."""
    way.first(first_spacing(way.scene))
    if way.look_at_steps():
        way.run("pilot", way.last.spacing)
    way.run("pilot", way.last.spacing / MOST_FACTOR)
    check_memory(way)


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
    error = last.error(way.asked.norm) * (here / last.spacing) ** p
    return float(here / max((error / (AIMED_SHARE * aim)) ** (1 / p), LEAST_FACTOR))


def order(way: Way) -> float:
    """Return the order at which the error is taken to fall: the mean of that seen and of the form's."""
    seen = prior = _prior(way)
    known = _known(way)[-2:]
    if len(known) == 2 and known[0].spacing > TELLING_RATIO * known[1].spacing:
        errors = [max(run.error(way.asked.norm) - way.in_time, np.finfo(float).tiny) for run in known]
        seen = math.log(errors[0] / errors[1]) / math.log(known[0].spacing / known[1].spacing)
    return min(max((seen + prior) / 2, LEAST_ORDER), MOST_SLOW_ORDER if prior < MOST_SLOW_ORDER else MOST_ORDER)


def _prior(way: Way) -> float:
    """Return the order at which the last estimate takes errors to fall, the form's where there is none."""
    estimate = way.last.estimate
    if estimate is not None:
        return estimate.order
    return way.order or way.last.solution.discretized.order_of_difference(2.0)


def _known(way: Way) -> list[Run]:
    """Return the runs of the last one's degree whose error is known, the finest last."""
    return [run for run in way.runs if np.isfinite(run.error(way.asked.norm)) and way.alike(run.solution)]
