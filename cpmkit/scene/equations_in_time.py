"""Equations in time: heat and what is like it, and waves.

``heat`` u_t = div(kappa grad u) - v . grad u - c u + f, ``wave`` u_tt = speed^2 Lap u + f. Time begins at ``t0``, 0
unless given. How the
steps go is in :mod:`cpmkit.families.evolution.schemes`; there is no explicit scheme for heat, whose step would have to
be about the square of the spacing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.runtime.arrays import number, positive, whole
from cpmkit.scene.data import Data, takes_time
from cpmkit.scene.diffusivities import as_diffusivity
from cpmkit.scene.equations import Equation, Terms, TimeFamily, VectorField, check_conservative, check_factor
from cpmkit.scene.pointwise import AfterStep, check_after_step

HEAT_SCHEMES = ("bdf2", "backward-euler", "crank-nicolson")
WAVE_SCHEMES = ("auto", "newmark", "implicit", "leapfrog")
FIRST_ORDER_SCHEMES = ("backward-euler", "euler")
HEAT_STARTS = ("smooth", "plain")
#: More steps than this are a mistake in the unit of time.
MOST_TIME_STEPS = 10_000_000
#: More frames than this, each a whole solution, are a mistake.
MOST_FRAMES = 100_000


class Evolution(Equation[TimeFamily]):
    """What every equation in time tells.

    Attributes
    ----------
    until, step : float
        Time at which the run ends, and its time step.
    t0 : float
        Time at which it begins.
    scheme : str
        How the steps go.
    frames : int or sequence of float
        Times whose solutions are kept.
    after_step : callable, optional
        What is done with the values after each step.
    rest : float, optional
        Rate of change below which the run ends.
    """

    until: float
    step: float
    scheme: str
    frames: int | Sequence[float]
    after_step: AfterStep | None = None
    rest: float | None = None
    t0: float = 0.0
    family: ClassVar[str] = "time"
    #: Beside a multigrid, which steps that are short take no cycle of but the diagonal: of a sphere with 3,400 unknowns
    #: factors are worth it from 40 steps on, with 6,000 from 60, with 10,000 from 260.
    factorise_beside_multigrid: ClassVar[float | None] = 4.0

    @property
    def start_time(self) -> float:
        """Time of the initial data."""
        return self.t0

    @property
    def duration(self) -> float:
        """How long the run lasts."""
        return self.until - self.t0

    def with_scheme(self, explicit_steps: bool) -> Self:
        """Return the same with a scheme named, in a form that takes ``explicit_steps`` or not."""
        del explicit_steps
        return self

    @property
    def frame_times(self) -> tuple[float, ...]:
        """Times of the frames, rising."""
        if isinstance(self.frames, (int, np.integer)):
            return tuple(np.linspace(self.t0, self.until, self.frames + 1).tolist()) if self.frames else ()
        return tuple(sorted({float(time) for time in self.frames}))

    def _check(self, schemes: Sequence[str], coefficients: dict[str, object]) -> None:
        for name, accept in (("t0", number), ("until", number if self.t0 else positive), ("step", positive)):
            object.__setattr__(self, name, accept(getattr(self, name), f"{name} of {self.kind}"))
        if self.until <= self.t0:
            raise InputError(f"until of {self.kind} must be later than t0={self.t0:g}, got {self.until:g}.")
        if self.duration / self.step > MOST_TIME_STEPS:
            raise InputError(
                f"until={self.until:g} with step={self.step:g} of {self.kind} makes {self.duration / self.step:.3g} "
                f"steps; at most {MOST_TIME_STEPS} are accepted, use a longer step."
            )
        if self.scheme not in schemes:
            raise InputError(f"scheme of {self.kind} must be {' or '.join(schemes)}, got {shown(self.scheme)}.")
        for name, given in coefficients.items():
            if callable(given) and takes_time(given):
                raise InputError(
                    f"{name} of {self.kind} must not depend on t, for then every step has a system of its own; f and "
                    "the data of conditions may."
                )
        _check_frames(self.frames, self.t0, self.until, self.kind)
        check_after_step(self.after_step, self.rest, self.kind)


def _check_frames(frames: int | Sequence[float], start: float, until: float, kind: str) -> None:
    accepted = (
        f"frames of {kind} must be a number of equal parts of the time or a list of times from {start:g} to {until:g}, "
        f"at most {MOST_FRAMES} of them"
    )
    try:
        if isinstance(frames, (int, np.integer)):
            whole(frames, "frames", 0, MOST_FRAMES)
            return
        times = [number(time, "a frame") for time in frames]
    except (TypeError, InputError) as error:
        raise InputError(f"{accepted}, got {shown(frames)}.") from error
    if len(times) > MOST_FRAMES or not all(start <= time <= until for time in times):
        raise InputError(f"{accepted}, got {shown(frames)}.")


@dataclass(frozen=True, eq=False)
class Heat(Evolution):
    """u_t = div(kappa grad u) - v . grad u - c u + f, from u = initial at time t0.

    Parameters
    ----------
    initial : number, text, sequence, or callable
        u at the start, as the right-hand side of :class:`~cpmkit.Poisson`.
    until : float
        Time at which the run ends.
    step : float
        Time step; the last one before a frame and before the end is shortened.
    f : number, sequence, or callable
        Source; a callable with a parameter ``t`` that has no default receives the time.
    kappa : number, symmetric tensor, or callable
        Conductivity, as the diffusivity of :class:`~cpmkit.Elliptic`.
    velocity : callable, optional
        v, a function of points (n, d) that returns vectors (n, d) tangential to the manifold.
    c : number or callable
        Rate of decay.
    conservative : bool
        Whether the velocity's term is div(v u), so that what leaves one place arrives at another; in the Galerkin form.
    scheme : str
        ``bdf2``, of second order, damps what the step does not resolve; ``backward-euler``, of first order, damps
        most; ``crank-nicolson``, of second order with the smallest error, does not damp.
    start : str
        Of Crank-Nicolson: ``smooth`` takes the first step as two half steps of backward Euler, ``plain`` does not.
    frames : int or sequence of float
        Times whose solutions are kept: the ends of so many equal parts, with the start, or a list. A step ends at each.
    after_step : callable, optional
        A function of points (p, d), values (p, channels) and, where it has a parameter ``t`` without a default, the
        time, that returns the values (p, channels) from which the run goes on. Where it changes u by as much as a step
        does, as a projection on a target, steps of any scheme are of first order. What adds an amount at each step
        takes ``backward-euler``: BDF2 takes the step before for a rate, and counts the amount one and a half times.
    rest : float, optional
        The run ends when u changes more slowly: root mean square of the change over the step and over that of u, at
        the start or now, whichever is larger; in one over the unit of time. Frames past that time are left out.
    t0 : float
        Time at which the run begins.

    Raises
    ------
    InputError
        If an argument is not what is accepted.

    Examples
    --------
    On a circle the first mode decays like exp(-t).

    >>> import cpmkit as ck
    >>> cooling = ck.Heat(lambda points: points[:, 0], until=1.0, step=0.02)
    >>> solution = ck.solve(ck.Scene(ck.source("analytic.circle"), cooling), spacing=0.1)
    >>> solution.time, solution.steps, solution.evaluate([[1, 0]]).round(2)
    (1.0, 50, array([0.37]))
    """

    initial: Data
    until: float
    step: float
    f: Data = 0.0
    kappa: Data = 1.0
    velocity: VectorField | None = None
    c: Data = 0.0
    scheme: str = "bdf2"
    start: str = "smooth"
    frames: int | Sequence[float] = 0
    conservative: bool = False
    after_step: AfterStep | None = None
    rest: float | None = None
    t0: float = 0.0
    # King et al. (2024), eq. 18.
    kind: ClassVar[str] = "heat"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check(HEAT_SCHEMES, {"kappa": self.kappa, "velocity": self.velocity, "c": self.c})
        object.__setattr__(self, "kappa", as_diffusivity(self.kappa, "kappa of heat"))
        check_factor(self.c, "c of heat")
        check_conservative(self.conservative, self.velocity, "heat")
        if self.start not in HEAT_STARTS:
            raise InputError(f"start of heat must be {' or '.join(HEAT_STARTS)}, got {shown(self.start)}.")

    def terms(self) -> Terms:
        """Return the terms of the spatial part."""
        return Terms(self.f, self.c, self.kappa, self.velocity, self.conservative)

    def data(self) -> list[tuple[str, Data]]:
        """Return what has channels, by the names that errors use."""
        return [("the right-hand side f", self.f), ("the initial data", self.initial)]

    def __str__(self) -> str:
        return f"u_t - {str(self.terms())[1:]}"


@dataclass(frozen=True, eq=False)
class Wave(Evolution):
    """u_tt = speed^2 Lap u + f, from u = initial and u_t = initial_rate at time t0.

    Parameters
    ----------
    initial : number, text, sequence, or callable
        u at the start.
    until : float
        Time at which the run ends.
    step : float
        Time step; the last one before a frame and before the end is shortened.
    initial_rate : number, sequence, or callable
        u_t at the start.
    speed : float
        Of the waves, above zero.
    f : number, sequence, or callable
        Source; a callable with a parameter ``t`` that has no default receives the time.
    scheme : str
        ``auto``: ``newmark`` in the Galerkin form, ``leapfrog`` in the collocation form. ``newmark``, the average
        acceleration, takes any step and keeps the energy; the collocation form has none. ``leapfrog`` takes steps
        below a bound and interpolation of degree 3 or 5; the collocation form alone has it. ``implicit``, second-order
        backward differences, damps waves that the step does not resolve; in the collocation form the step must be
        above a bound.
    frames : int or sequence of float
        As for :class:`Heat`.
    t0 : float
        Time at which the run begins.

    Raises
    ------
    InputError
        If an argument is not what is accepted.

    Examples
    --------
    After one turn of the circle a wave is where it was.

    >>> import cpmkit as ck
    >>> turn = ck.Wave(lambda x: x[:, 0], until=6.283, step=0.03, initial_rate=lambda x: x[:, 1])
    >>> solution = ck.solve(ck.Scene(ck.source("analytic.circle"), turn), spacing=0.1)
    >>> solution.evaluate([[1, 0], [0, 1]]).round(1) + 0.0
    array([1., 0.])
    """

    initial: Data
    until: float
    step: float
    initial_rate: Data = 0.0
    speed: float = 1.0
    f: Data = 0.0
    scheme: str = "auto"
    frames: int | Sequence[float] = 0
    t0: float = 0.0
    kind: ClassVar[str] = "wave"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check(WAVE_SCHEMES, {})
        object.__setattr__(self, "speed", positive(self.speed, "speed of wave"))

    def with_scheme(self, explicit_steps: bool) -> Wave:
        """Return the same with a scheme named: ``auto`` is leapfrog where steps may be explicit, else Newmark's."""
        default = "leapfrog" if explicit_steps else "newmark"
        return replace(self, scheme=default) if self.scheme == "auto" else self

    def terms(self) -> Terms:
        """Return the terms of the spatial part."""
        return Terms(self.f, diffusivity=self.speed * self.speed)

    def data(self) -> list[tuple[str, Data]]:
        """Return what has channels, by the names that errors use."""
        return [
            ("the right-hand side f", self.f),
            ("the initial data", self.initial),
            ("the initial rate", self.initial_rate),
        ]

    def __str__(self) -> str:
        return f"u_tt - {str(self.terms())[1:]}"
