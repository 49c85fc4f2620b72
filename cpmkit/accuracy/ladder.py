"""From an error, a time or a memory that is asked for to a spacing, and to the solution there.

Coarse solves, their unknowns a factor of two apart, tell how the error falls and what solving costs. A spacing is
foretold from both; where it is far away, one solve of twice it is done first, which the answer is then held against.
"""

from __future__ import annotations

import math

import numpy as np

from cpmkit.accuracy.limits import expected_seconds, finest_spacing, first_spacing
from cpmkit.accuracy.trade import Purpose, Status
from cpmkit.accuracy.way import ANSWERS, Way

#: Pilots, their spacings the root of two apart.
PILOTS = 3
#: The spacing is taken for this share of the tolerance.
AIMED_SHARE = 0.75
#: Orders at which errors are taken to fall, at least, at most, and at most where something says that it is slow.
LEAST_ORDER, MOST_ORDER, MOST_SLOW_ORDER = 0.8, 3.0, 1.3
#: Spacings go down by at least and at most so much at a time, and by more than so much not without a companion.
LEAST_FACTOR, MOST_FACTOR, WITHOUT_COMPANION = 1.25, 4.0, 2.1
#: Finer answers than the first, at most.
MOST_CORRECTIONS = 2


def walk(way: Way) -> tuple[Status, float]:
    """Solve until what is asked for is reached; return the status, and the tolerance that was aimed at."""
    pilots(way)
    floor = way.last.solution.discretized.source_error()
    tolerance = way.asked.tolerance
    aim = 0.0 if tolerance is None else max(tolerance, floor)
    answers = 0
    while not way.error <= aim and answers <= MOST_CORRECTIONS:
        here = way.last.spacing
        goal = max(_foretold(way, aim), finest_spacing(way))
        if here / goal < LEAST_FACTOR and (answers or way.error == way.error):
            break
        if here / goal > WITHOUT_COMPANION:
            goal = max(goal, here / MOST_FACTOR)
            between = max(2 * goal, here / MOST_FACTOR)
            _run(way, "companion", between if here / between >= LEAST_FACTOR else here / 2)
            continue
        answers += 1
        _run(way, "answer" if answers == 1 else "correction", goal)
    if way.last.purpose not in ANSWERS and way.answers_differ:
        way.run("answer", way.last.spacing)
    if tolerance is None:
        return "within", aim
    if not way.error <= aim:
        return "not reached", aim
    return ("reached" if aim == tolerance else "floor"), aim


def pilots(way: Way) -> None:
    """Solve at coarse spacings; see what the steps in time leave."""
    way.first(first_spacing(way.scene))
    for _ in range(PILOTS - 1):
        way.run("pilot", way.last.spacing / math.sqrt(2))
    if way.look_at_steps():
        for run in way.runs[-2:]:
            way.run("pilot", run.spacing)


def _run(way: Way, purpose: Purpose, spacing: float) -> None:
    way.run(purpose, spacing, expected_seconds(way, spacing))


def _foretold(way: Way, aim: float) -> float:
    """Return the spacing at which the error is expected to be below ``aim``; zero where none is asked for."""
    here, error = way.last.spacing, way.error
    if aim == 0:
        return 0.0
    if not np.isfinite(error):  # nothing coarser was seen with these steps in time, or no mode was
        return here / math.sqrt(2)
    factor = (error / (AIMED_SHARE * aim)) ** (1 / order(way))
    return float(here / min(max(factor, LEAST_FACTOR), MOST_FACTOR**2))


def order(way: Way) -> float:
    """Return the order at which the error is taken to fall: the mean of that seen and of the form's."""
    form = way.last.solution.discretized
    prior = form.order_of_difference(2.0)
    known = [run for run in way.runs if np.isfinite(run.error(way.asked.norm))][-2:]
    seen = prior
    if len(known) == 2 and known[0].spacing > LEAST_FACTOR * known[1].spacing:
        errors = [max(run.error(way.asked.norm) - way.in_time, np.finfo(float).tiny) for run in known]
        seen = math.log(errors[0] / errors[1]) / math.log(known[0].spacing / known[1].spacing)
    return min(max((seen + prior) / 2, LEAST_ORDER), MOST_SLOW_ORDER if form.slow else MOST_ORDER)
