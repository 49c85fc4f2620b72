"""The steps of a run in time, and the moments at their ends.

Steps are equal, except for a shorter step before a frame and before the end where the step does not fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.contract import Discretized
from cpmkit.scene.data import call_pointwise
from cpmkit.scene.equations_in_time import Evolution
from cpmkit.types import Floats

if TYPE_CHECKING:
    from cpmkit.families.evolution.semidiscrete import SemiDiscrete

#: Shares of a step up to this are rounding, and no step of their own.
ROUNDED_STEP_SHARE = 1e-9
#: Number of moments that schemes read.
REMEMBERED_MOMENTS = 3


@dataclass(frozen=True)
class Step:
    """One step in time."""

    #: start, end: Times at the ends of the step.
    start: float
    end: float
    length: float  #: ``end - start`` up to rounding; equal steps have equal lengths.
    is_frame: bool  #: Whether the solution at the end is stored.


@dataclass(frozen=True, eq=False)
class Moment:
    """The unknowns at one time."""

    u: Floats  #: (n, channels): values of the unknowns.
    #: (n, channels): for a wave the time derivatives of the unknowns; for leapfrog those half a step before.
    rate: Floats | None
    length: float  #: Length of the step that ends at this time; zero at the start.
    acceleration: Floats | None = None  #: (n, channels): for leapfrog the second derivatives at the start of that step.
    time: float = 0.0  #: The time, as the schedule has it.


History = Sequence[Moment]


def schedule(until: float, step: float, frames: Sequence[float], start: float = 0.0) -> list[Step]:
    """Return the steps of length ``step`` or less from ``start`` to ``until``, with an end at each time of ``frames``.

    Examples
    --------
    >>> [(each.end, each.length) for each in schedule(1.0, 0.4, ())]
    [(0.4, 0.4), (0.8, 0.4), (1.0, 0.2)]
    """
    steps: list[Step] = []
    begin = start
    for stop in sorted({*(time for time in frames if time > start), until}):
        steps += _steps_between(begin, stop, step, stop in frames)
        begin = stop
    return steps


def _steps_between(start: float, stop: float, step: float, is_frame: bool) -> Iterator[Step]:
    """Yield equal steps from ``start`` to ``stop``, the last one shorter if they do not fit.

    ``is_frame`` says whether the solution is stored after the last of them.
    """
    ratio = (stop - start) / step
    whole = int(ratio + ROUNDED_STEP_SHARE)
    rest = round(ratio - whole, 9)  # equal steps share a system
    lengths = [step] * whole + ([rest * step] if rest > ROUNDED_STEP_SHARE else []) or [stop - start]
    times = [start, *(start + number * step for number in range(1, len(lengths))), stop]
    for number, length in enumerate(lengths):
        yield Step(times[number], times[number + 1], length, is_frame and number == len(lengths) - 1)


@dataclass(frozen=True, eq=False)
class RunPlan:
    """The definition of a run."""

    problem: SemiDiscrete  #: The equation discretised in space.
    evolution: Evolution  #: The equation, its scheme and its step.
    steps: Sequence[Step]  #: All steps from the start to the end.
    start: Moment  #: The unknowns at the start.


@dataclass(frozen=True, eq=False)
class RunState:
    """The state of a run after some of its steps."""

    done: int  #: Number of steps taken.
    history: tuple[Moment, ...]  #: The last moments, the latest last.
    frames: tuple[Floats, ...] = ()  #: tuple of (n, channels) float64: values of the unknowns at the frames so far.
    #: tuple of (channels,) float64: the energy of a wave at each frame, if it has an energy.
    energies: tuple[Floats, ...] = ()

    def with_frame(self, u: Floats, energy: Floats | None) -> RunState:
        """Return the state with one more frame u (n, channels) and, for a wave, its energy (channels,)."""
        energies = self.energies if energy is None else (*self.energies, energy)
        return replace(self, frames=(*self.frames, u), energies=energies)


def after_step(form: Discretized, evolution: Evolution, moment: Moment) -> Moment:
    """Return ``moment`` with u changed by ``evolution.after_step``; itself if there is no such function or change."""
    if evolution.after_step is None:
        return moment
    values = form.at_points(moment.u)
    arrays = form.points.copy(), values.copy()
    changed = call_pointwise(evolution.after_step, arrays, values.shape, "after_step", moment.time, least=2)
    if np.array_equal(changed, values):
        return moment
    return replace(moment, u=form.project(changed, moment.u, moment.time))


def rate_of_change(form: Discretized, start: Moment, history: History) -> float:
    """Return the relative change of u in the last step, per unit of time; infinite before the first step.

    The change is a root mean square over the manifold, summed over the channels, relative to the size of u at ``start``
    or now (the last of ``history``), whichever is larger; zero if both are zero.
    """
    if len(history) < 2 or history[-1].length == 0:
        return float("inf")
    now = history[-1].u
    size = max(_rms(form, start.u), _rms(form, now))
    return _rms(form, now - history[-2].u) / (history[-1].length * size) if size > 0 else 0.0


def _rms(form: Discretized, u: Floats) -> float:
    """Return the root mean square of u (n, channels) over the manifold, with the channels' squares summed."""
    return float(np.sqrt(max(np.trace(form.inner(u, u)), 0.0)))
