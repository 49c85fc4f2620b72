"""Equations in time: diffusion with advection and reaction, and waves.

``heat`` u_t = div(kappa grad u) - v . grad u - c u + f, ``wave`` u_tt = speed^2 Lap u + f, from the time ``t0`` on.
Time stepping is in :mod:`cpmkit.families.evolution.stepping`; there is no explicit scheme for heat, whose step would be
of the order of the square of the spacing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.runtime.arrays import number, positive, whole
from cpmkit.scene.data import AfterStep, Data, ScalarData, TensorData, takes_time
from cpmkit.scene.equations import Equation, Positive, Terms, TimeFamily, VectorField

#: Time stepping schemes of first order.
FIRST_ORDER_SCHEMES = ("backward-euler", "euler")
#: More steps are refused as a mistake in the unit of time.
MAX_TIME_STEPS = 10_000_000
#: More frames, each a whole solution in memory, are refused.
MAX_FRAMES = 100_000


class Evolution(Equation[TimeFamily]):
    """Base class of equations in time."""

    until: float  #: End time.
    step: float  #: Time step.
    scheme: str  #: Name of the time stepping scheme.
    schemes: ClassVar[tuple[str, ...]]  #: The accepted names.
    frames: int | Sequence[float]  #: Times of stored solutions, or the number of equal intervals between them.
    after_step: AfterStep | None = None  #: Function that changes the values after each step.
    rest: float | None = None  #: Relative change in a unit of time below which the run ends.
    t0: float = 0.0  #: Start time.
    family: ClassVar[str] = "time"
    #: With multigrid, or the diagonal for short steps, factors are faster on a sphere with 3,400 unknowns from 40 steps
    #: on, with 6,000 from 60, with 10,000 from 260.
    factorise_beside_multigrid: ClassVar[float | None] = 4.0

    @property
    def duration(self) -> float:
        """Length of the run in time."""
        return self.until - self.t0

    def with_scheme(self, explicit_steps: bool) -> Self:
        """Return the equation unchanged; :class:`Wave` replaces "auto" by whether the form takes explicit steps."""
        del explicit_steps
        return self

    @cached_property
    def frame_times(self) -> tuple[float, ...]:
        """Times of the frames in ascending order, with the start if ``frames`` is a number of intervals; () for zero.

        Raises InputError if it is neither such a number nor a list of times of the run, or there are over 100,000.
        """
        accepted = (
            f"frames of {self.kind} must be a number of equal parts of the time or a list of times from {self.t0:g} to "
            f"{self.until:g}, at most {MAX_FRAMES} of them"
        )
        try:
            if isinstance(self.frames, (int, np.integer)):
                count = whole(self.frames, "frames", 0, MAX_FRAMES)
                return tuple(np.linspace(self.t0, self.until, count + 1).tolist()) if count else ()
            times = sorted({number(time, "a frame") for time in self.frames})
        except (TypeError, InputError) as error:
            raise InputError(f"{accepted}, got {shown(self.frames)}.") from error
        if len(times) > MAX_FRAMES or not all(self.t0 <= time <= self.until for time in times):
            raise InputError(f"{accepted}, got {shown(self.frames)}.")
        return tuple(times)

    def __post_init__(self) -> None:
        """Convert times to floats; raise InputError for wrong fields, or if a coefficient depends on t."""
        super().__post_init__()
        for name, accept in (("t0", number), ("until", number if self.t0 else positive), ("step", positive)):
            object.__setattr__(self, name, accept(getattr(self, name), f"{name} of {self.kind}"))
        if self.until <= self.t0:
            raise InputError(f"until of {self.kind} must be later than t0={self.t0:g}, got {self.until:g}.")
        if self.duration / self.step > MAX_TIME_STEPS:
            raise InputError(
                f"until={self.until:g} with step={self.step:g} of {self.kind} makes {self.duration / self.step:.3g} "
                f"steps; at most {MAX_TIME_STEPS} are accepted, use a longer step."
            )
        if self.scheme not in self.schemes:
            raise InputError(f"scheme of {self.kind} must be {' or '.join(self.schemes)}, got {shown(self.scheme)}.")
        for name in ("kappa", "c", "velocity", "capacity"):
            if takes_time(getattr(self, name, None)):
                raise InputError(
                    f"{name} of {self.kind} must not depend on t, for then every step has a system of its own; f and "
                    "the data of conditions may."
                )
        assert self.frame_times is not None  # checks the frames
        if self.after_step is not None and not callable(self.after_step):
            raise InputError(
                f"after_step of {self.kind} must be a function of points (p, d) and values (p, channels), got "
                f"{shown(self.after_step)}."
            )
        if self.rest is not None:
            positive(self.rest, f"rest of {self.kind}")


@dataclass(frozen=True, eq=False)
class Heat(Evolution):
    """b u_t = div(kappa grad u) - v . grad u - c u + f with u = initial at time t0 and the capacity b, by default 1.

    Parameters
    ----------
    initial : number, text, sequence, or callable
        u at the start; as the right-hand side of :class:`~cpmkit.Poisson`.
    until : float
        End time.
    step : float
        Time step; the last step before a frame and before the end is shortened.
    f : number, sequence, or callable
        Source; a callable with a parameter ``t`` without a default receives the time.
    kappa : number, symmetric tensor, or callable
        Conductivity, as the diffusivity of :class:`~cpmkit.Elliptic`.
    velocity : callable, optional
        v, a function of points (n, d) that returns vectors (n, d) tangential to the manifold.
    c : number or callable
        Rate of decay.
    conservative : bool
        Whether the advection term is div(v u), which conserves the integral of u; in the Galerkin form.
    scheme : str
        ``bdf2``, of second order, damps modes that the step does not resolve; ``backward-euler``, of first order, damps
        them most; ``crank-nicolson``, of second order with the smallest error, does not damp them.
    start : str
        First step of Crank-Nicolson: ``smooth`` takes two half steps of backward Euler instead, ``plain`` does not.
    frames : int or sequence of float
        Times at which solutions are stored: a list, or the number of equal intervals whose ends are stored, with the
        start. A step ends at each.
    after_step : callable, optional
        A function of points (p, d), values (p, channels) and, where it has a parameter ``t`` without a default, the
        time, that returns the values (p, channels) from which the run continues. Where it changes u by as much as a
        step does, such as a projection onto a target, any scheme is of first order. Use ``backward-euler`` with a
        function that adds an amount at each step: BDF2 would count the amount one and a half times.
    rest : float, optional
        The run ends when u changes more slowly: the root mean square of the change of a step, over the step and over
        the root mean square of u at the start or now, whichever is larger. Later frames are left out.
    t0 : float
        Start time.
    capacity : number or callable
        The capacity b, above zero; in the Galerkin form. The integral of b u changes only by f, c and what flows out.

    Raises
    ------
    InputError
        If an argument is not accepted.

    Examples
    --------
    On a circle the first mode decays as exp(-t).

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
    kappa: TensorData = 1.0
    velocity: VectorField | None = None
    c: ScalarData = 0.0
    scheme: str = "bdf2"
    start: str = "smooth"
    frames: int | Sequence[float] = 0
    conservative: bool = False
    after_step: AfterStep | None = None
    rest: float | None = None
    t0: float = 0.0
    capacity: ScalarData = 1.0
    # King et al. (2024), eq. 18.
    kind: ClassVar[str] = "heat"
    schemes: ClassVar[tuple[str, ...]] = ("bdf2", "backward-euler", "crank-nicolson")

    def __post_init__(self) -> None:
        """Check the fields as for any equation in time; raise InputError if ``start`` is not accepted."""
        super().__post_init__()
        if self.start not in ("smooth", "plain"):
            raise InputError(f"start of heat must be smooth or plain, got {shown(self.start)}.")

    def __str__(self) -> str:
        factor = "" if self.capacity == 1 else "capacity "
        return f"{factor}u_t - {str(self.terms())[1:]}"


@dataclass(frozen=True, eq=False)
class Wave(Evolution):
    """u_tt = speed^2 Lap u + f with u = initial and u_t = initial_rate at time t0.

    Parameters
    ----------
    initial : number, text, sequence, or callable
        u at the start.
    until : float
        End time.
    step : float
        Time step; the last step before a frame and before the end is shortened.
    initial_rate : number, sequence, or callable
        u_t at the start.
    speed : float
        Wave speed, above zero.
    f : number, sequence, or callable
        Source; a callable with a parameter ``t`` without a default receives the time.
    scheme : str
        ``auto``: ``newmark`` in the Galerkin form, ``leapfrog`` in the collocation form. ``newmark``, the average
        acceleration method, is stable for any step and conserves the energy. ``leapfrog`` is stable for steps
        below a bound, with interpolation of degree 3 or 5, and belongs to the collocation form. ``implicit``,
        second-order backward differences, damps waves that the step does not resolve; in the collocation form the step
        must be above a bound.
    frames : int or sequence of float
        As for :class:`Heat`.
    t0 : float
        Start time.

    Raises
    ------
    InputError
        If an argument is not accepted.

    Examples
    --------
    After one turn around the circle a wave is at its first place.

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
    speed: Positive = 1.0
    f: Data = 0.0
    scheme: str = "auto"
    frames: int | Sequence[float] = 0
    t0: float = 0.0
    kind: ClassVar[str] = "wave"
    schemes: ClassVar[tuple[str, ...]] = ("auto", "newmark", "implicit", "leapfrog")

    def with_scheme(self, explicit_steps: bool) -> Wave:
        """Return the equation with scheme "auto" replaced: leapfrog if the form takes explicit steps, else Newmark."""
        default = "leapfrog" if explicit_steps else "newmark"
        return replace(self, scheme=default) if self.scheme == "auto" else self

    def terms(self) -> Terms:
        """Return the terms of the spatial part -speed^2 Lap u = f."""
        return Terms(self.f, diffusivity=self.speed * self.speed)

    def __str__(self) -> str:
        return f"u_tt - {str(self.terms())[1:]}"
