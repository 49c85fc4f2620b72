"""A run in time: what makes it what it is, where it is, and what tells it from others."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpmkit.families.evolution.between_steps import after_step
from cpmkit.families.evolution.moment import Moment
from cpmkit.families.evolution.schedule import Step
from cpmkit.families.evolution.semidiscrete import SemiDiscrete
from cpmkit.scene.equations_in_time import Evolution
from cpmkit.types import Floats


@dataclass(frozen=True, eq=False)
class RunPlan:
    """What makes a run what it is.

    Attributes
    ----------
    problem : SemiDiscrete
        A and b(t).
    evolution : Evolution
        The equation, its scheme and its step.
    steps : sequence of Step
        From the start to the end.
    start : Moment
        The unknowns at the start.
    """

    problem: SemiDiscrete
    evolution: Evolution
    steps: Sequence[Step]
    start: Moment


@dataclass(frozen=True, eq=False)
class RunState:
    """Where a run is.

    Attributes
    ----------
    done : int
        Steps taken.
    history : tuple of Moment
        The last moments, the latest last.
    frames : tuple of (n, channels) float64
        Values of the frames so far.
    energies : tuple of (channels,) float64
        Of a wave: its energy at each frame, where it has one.
    """

    done: int
    history: tuple[Moment, ...]
    frames: tuple[Floats, ...] = ()
    energies: tuple[Floats, ...] = ()

    def with_frame(self, u: Floats, energy: Floats | None) -> RunState:
        """Return the state with one more frame, and the energy of a wave."""
        energies = self.energies if energy is None else (*self.energies, energy)
        return replace(self, frames=(*self.frames, u), energies=energies)


def describe_run(plan: RunPlan) -> dict[str, Any]:
    """Return what makes a run what it is, as far as it fits a sentence; ``until`` may differ."""
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
        "number of channels": form.channels,
    }


def digest_run(plan: RunPlan, time: float) -> str:
    """Return a digest of the tables, of the start, and of the data at the start and at ``time``."""
    problem, start = plan.problem, plan.start
    tables = [array for group in problem.groups for array in problem.form.fingerprint(group.stiffness)]
    data = [start.u, *([] if start.rate is None else [start.rate]), problem.forcing(start.time), problem.forcing(time)]
    data += [after_step(problem.form, plan.evolution, replace(start, time=when)).u for when in (start.time, time)]
    if problem.reaction is not None:
        data += [problem.reacting(replace(start, u=start.u.copy(), time=when)) for when in (start.time, time)]
    digest = hashlib.blake2b(digest_size=16)
    for array in [*tables, *data]:
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def digest_arrays(arrays: Mapping[str, np.ndarray]) -> str:
    """Return a digest of named arrays: of their names, types, shapes and entries."""
    digest = hashlib.blake2b(digest_size=16)
    for name in sorted(arrays):
        array = np.asarray(arrays[name])
        text = array.dtype.kind == "U"
        digest.update(f"{name} {'text' if text else array.dtype.str} {array.shape};".encode())
        digest.update(str(array).encode() if text else np.ascontiguousarray(array).data)
    return digest.hexdigest()
