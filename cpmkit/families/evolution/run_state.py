"""A run in time: its plan, its state, and digests that identify the run of a checkpoint."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpmkit.families.evolution.schedule import History, Moment, Step
from cpmkit.families.evolution.semidiscrete import SemiDiscrete
from cpmkit.forms.contract import Discretized
from cpmkit.scene.equations_in_time import Evolution
from cpmkit.scene.pointwise import apply_after_step
from cpmkit.types import Floats


@dataclass(frozen=True, eq=False)
class RunPlan:
    """The definition of a run.

    Attributes
    ----------
    problem : SemiDiscrete
        The equation discretised in space.
    evolution : Evolution
        The equation, its scheme and its step.
    steps : sequence of Step
        All steps from the start to the end.
    start : Moment
        The unknowns at the start.
    """

    problem: SemiDiscrete
    evolution: Evolution
    steps: Sequence[Step]
    start: Moment


@dataclass(frozen=True, eq=False)
class RunState:
    """The state of a run after some of its steps.

    Attributes
    ----------
    done : int
        Number of steps taken.
    history : tuple of Moment
        The last moments, the latest last.
    frames : tuple of (n, channels) float64
        Values of the unknowns at the frames so far.
    energies : tuple of (channels,) float64
        The energy of a wave at each frame, if it has an energy.
    """

    done: int
    history: tuple[Moment, ...]
    frames: tuple[Floats, ...] = ()
    energies: tuple[Floats, ...] = ()

    def with_frame(self, u: Floats, energy: Floats | None) -> RunState:
        """Return the state with one more frame u (n, channels) and, for a wave, its energy (channels,)."""
        energies = self.energies if energy is None else (*self.energies, energy)
        return replace(self, frames=(*self.frames, u), energies=energies)


def after_step(form: Discretized, evolution: Evolution, moment: Moment) -> Moment:
    """Return a moment with the user's function ``after_step`` applied, or unchanged if there is none."""
    if evolution.after_step is None:
        return moment
    values = form.at_points(moment.u)
    changed = apply_after_step(evolution.after_step, form.points.copy(), values, moment.time)
    if np.array_equal(changed, values):
        return moment
    return replace(moment, u=form.project(changed, moment.u, moment.time))


def rate_of_change(form: Discretized, start: Moment, history: History) -> float:
    """Return the relative change of u in the last step, per unit of time; infinite before the first step.

    The change is a root mean square over the manifold, summed over the channels, relative to the size of u at the start
    or now, whichever is larger.
    """
    if len(history) < 2 or history[-1].length == 0:
        return float("inf")
    now = history[-1].u
    size = max(_rms(form, start.u), _rms(form, now))
    return _rms(form, now - history[-2].u) / (history[-1].length * size) if size > 0 else 0.0


def rest_warning(form: Discretized, evolution: Evolution, start: Moment, history: History) -> list[str]:
    """Return a warning in a list if a run that should have come to rest did not; else []."""
    if evolution.rest is None:
        return []
    rate = rate_of_change(form, start, history)
    if rate < evolution.rest:
        return []
    return [
        f"The run did not come to rest until {evolution.until:g}: u still changes by {rate:.2g} of its size per unit "
        f"of time, and rest={evolution.rest:g} was asked for; use a later `until`."
    ]


def _rms(form: Discretized, u: Floats) -> float:
    """Return the root mean square of u (n, channels) over the manifold, with the channels' squares summed."""
    return float(np.sqrt(max(np.trace(form.inner(u, u)), 0.0)))


def describe_run(plan: RunPlan) -> dict[str, Any]:
    """Return the definition of a run as plain values by names for messages; ``until`` is not part of it."""
    form, evolution = plan.problem.form, plan.evolution
    return {
        "kind": evolution.kind,
        "scheme": evolution.scheme,
        "start": getattr(evolution, "start", ""),
        "step": evolution.step,
        **({"t0": evolution.t0} if evolution.t0 else {}),
        "spacing": form.spacing,
        **{name: value for name, value in form.describe().items() if isinstance(value, (int, float, str))},
        "number of unknowns": form.size,
        "number of channels": form.scene.channels,
    }


def digest_run(plan: RunPlan, time: float) -> str:
    """Return a digest of the operators, the initial values, and the data at the start and at ``time``."""
    problem, start = plan.problem, plan.start
    probe = np.random.default_rng(0).normal(size=(problem.form.size, 1))
    tables = [array for group in problem.groups for array in (group.stiffness.apply(probe), group.stiffness.diagonal)]
    data = [start.u, *([] if start.rate is None else [start.rate]), problem.forcing(start.time), problem.forcing(time)]
    data += [after_step(problem.form, plan.evolution, replace(start, time=when)).u for when in (start.time, time)]
    if problem.reaction is not None:
        data += [problem.reacting(replace(start, u=start.u.copy(), time=when)) for when in (start.time, time)]
    digest = hashlib.blake2b(digest_size=16)
    for array in [*tables, *data]:
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def digest_arrays(arrays: Mapping[str, np.ndarray]) -> str:
    """Return a digest of the names, types, shapes and entries of arrays."""
    digest = hashlib.blake2b(digest_size=16)
    for name in sorted(arrays):
        array = np.asarray(arrays[name])
        text = array.dtype.kind == "U"
        digest.update(f"{name} {'text' if text else array.dtype.str} {array.shape};".encode())
        digest.update(str(array).encode() if text else np.ascontiguousarray(array).data)
    return digest.hexdigest()
