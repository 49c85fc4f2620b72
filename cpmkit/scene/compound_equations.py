"""Equations of eigenvalues, of coupled channels, of fourth order, and of reaction and diffusion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.formulas.expressions import ReactionExpression
from cpmkit.runtime.arrays import number, positive, whole
from cpmkit.scene.conditions import Condition, same_parameter
from cpmkit.scene.data import (
    AfterStep,
    ChannelData,
    Data,
    Reaction,
    ScalarData,
    TensorData,
    is_sequence,
    is_zero,
    read_formula,
)
from cpmkit.scene.equations import EigenFamily, Equation, NotNegative, Terms
from cpmkit.scene.equations_in_time import Evolution


@dataclass(frozen=True, eq=False)
class Coupled(Equation):
    """-div(a grad u_i) + c u_i + sum_j C_ij u_j = f_i: channels that are coupled at each point, in the Galerkin form.

    With C = s n n', n the normal and s large, u is a field of tangential vectors, as
    :func:`cpmkit.applications.vector_field` uses it.

    Parameters
    ----------
    coupling : callable
        C, a function of points (n, d) that returns matrices (n, k, k), also unsymmetric, k the number of channels.
    f : number, sequence or callable
        Right-hand side, of k channels, or one value for all of them.
    diffusivity, c : number or callable
        As for :class:`cpmkit.Elliptic`.
    lumped : bool
        Whether the mass matrix of c u is lumped, as for :class:`cpmkit.ScreenedPoisson`; that of C u is not.

    Raises
    ------
    InputError
        If C is not a function, a diffusivity is a number not above zero, or c is neither a number nor a function.

    Examples
    --------
    Two channels that relax towards each other.

    >>> import cpmkit as ck
    >>> import numpy as np
    >>> tied = ck.Coupled(lambda x: np.tile([[1.0, -1.0], [-1.0, 1.0]], (len(x), 1, 1)), f=[1.0, 0.0], c=1.0)
    >>> ck.solve(ck.Scene(ck.source("analytic.circle"), tied), spacing=0.2).evaluate([[1, 0]]).round(4)
    array([[0.6667, 0.3333]])
    """

    coupling: Callable[..., Any]
    f: Data = 0.0
    diffusivity: TensorData = 1.0
    c: ScalarData = 0.0
    lumped: bool = False
    kind: ClassVar[str] = "coupled"
    family: ClassVar[str] = "coupled"
    #: The channels make one system.
    factorise_up_to: ClassVar[float] = 4.0

    def __post_init__(self) -> None:
        """Check the fields as for any equation; raise InputError if the coupling is not a function."""
        super().__post_init__()
        if not callable(self.coupling):
            raise InputError(
                f"coupling must be a function of points that returns matrices, got {shown(self.coupling)}."
            )


@dataclass(frozen=True, eq=False)
class Eigen(Equation[EigenFamily]):
    """-div(a grad u) + c u = lambda u, with homogeneous conditions: the eigenvalues nearest to ``near``.

    Where a side or an edge has the condition :class:`cpmkit.Steklov`, the equation is ``-div(a grad u) + c u = 0`` and
    lambda is in that condition instead. The solution is a :class:`cpmkit.EigenSolution`.

    Parameters
    ----------
    count : int
        Number of eigenvalues.
    near : float, optional
        Number to which the eigenvalues are nearest; by default the smallest are computed.
    diffusivity, c : number or callable
        As for :class:`cpmkit.Elliptic`.

    Raises
    ------
    InputError
        If the count is not a whole number above zero, ``near`` or c not finite, or the diffusivity not above zero.

    Examples
    --------
    The eigenvalues of the circle are 0, 1, 1, 4, 4, ...

    >>> import cpmkit as ck
    >>> scene = ck.Scene(ck.source("analytic.circle"), ck.Eigen(count=5))
    >>> ck.solve(scene, spacing=0.05).eigenvalues.round(2) + 0.0
    array([0., 1., 1., 4., 4.])
    """

    count: int = 6
    near: float | None = None
    diffusivity: TensorData = 1.0
    c: ScalarData = 0.0
    kind: ClassVar[str] = "eigen"
    family: ClassVar[str] = "eigen"
    #: About sixty solves use one factorisation (sphere, 8,000 unknowns: 10 seconds; with an iterative solver 80).
    factorise_up_to: ClassVar[float] = 80.0
    factorise_beside_multigrid: ClassVar[float | None] = 8.0
    accepted: ClassVar[str] = "use Dirichlet(0), Neumann(0), Robin(alpha, beta, 0) or Steklov()"

    def __post_init__(self) -> None:
        """Check the fields as for any equation; raise InputError if the count or ``near`` is not accepted."""
        super().__post_init__()
        whole(self.count, "count of eigen", 1)
        if self.near is not None:
            number(self.near, "near of eigen")

    def direct_solver_limit(self, multigrid: bool) -> float:
        """Return the largest number of unknowns for the direct solver, as :meth:`Equation.direct_solver_limit` does.

        The limit is 60 with ``near`` and ``multigrid``, since a multigrid solve inside the spectrum takes 20 cycles.
        """
        return 60.0 if multigrid and self.near is not None else super().direct_solver_limit(multigrid)

    def __str__(self) -> str:
        return str(self.terms()).removesuffix("f") + "lambda u"

    def check_conditions(self, conditions: Sequence[tuple[str, Condition]]) -> None:
        """Raise SceneError for the first of ``conditions``, (label, condition), not accepted or with data not zero."""
        super().check_conditions(conditions)
        for label, condition in conditions:
            if not all(is_zero(datum) for _, datum in condition.law.data):
                raise SceneError(f"{label} has data where an eigenvalue problem takes zero alone; {self.accepted}.")


@dataclass(frozen=True, eq=False)
class Biharmonic(Equation):
    """c u + Lap^2 u = f: the bending of a thin plate, on an elastic bed where c is above zero.

    :class:`cpmkit.SimplySupported` prescribes u and Lap u; ``Dirichlet(g)`` is the same with Lap u = 0. ``Neumann(g)``
    prescribes du/db = g and d(Lap u)/db = 0: a plate guided at its edge. A clamped edge, with u and du/db, is not
    available, as it has no condition for Lap u. The solution is a
    :class:`cpmkit.facade.BiharmonicSolution`, which has Lap u too.

    Parameters
    ----------
    f : number, sequence, or callable
        Right-hand side, as for :class:`cpmkit.Poisson`.
    c : float
        Not below zero. Where it is zero and a piece of the manifold has no support, the mean of f must be zero there,
        and the solution has mean zero, as for :class:`cpmkit.Poisson`.

    Raises
    ------
    InputError
        If c is below zero or not a finite number.

    Examples
    --------
    >>> import cpmkit as ck
    >>> scene = ck.Scene(ck.source("analytic.circle"), ck.Biharmonic(lambda points: 2 * points[:, 0]))
    >>> ck.solve(scene, spacing=0.05).evaluate([[1, 0]]).round(3)
    array([1.])
    """

    f: Data
    c: NotNegative = 1.0
    kind: ClassVar[str] = "biharmonic"
    family: ClassVar[str] = "biharmonic"
    #: Its system is complex, and takes four times as long to factorise; iterations are as for a screened problem.
    factorise_up_to: ClassVar[float] = 0.2
    accepted: ClassVar[str] = (
        "a biharmonic problem takes SimplySupported, Dirichlet (with Lap u = 0) and Neumann, and no clamped edge"
    )

    def __str__(self) -> str:
        return f"{f'{self.c:g} u + ' if self.c else ''}Lap^2 u = f"


@dataclass(frozen=True, eq=False)
class ReactionDiffusion(Evolution):
    """u_t = div(kappa grad u) + reaction(u) + f for each channel of u, with u = initial at time t0.

    Diffusion is implicit, the reaction explicit: the step must be shorter than the time scale of the fastest reaction.

    Parameters
    ----------
    initial : sequence, number, or callable
        u at the start: one entry for each channel, or a callable of points (n, d) that returns (n, channels).
    reaction : callable, or text
        Formulas, one for each channel, such as ``["u1*u2 - u1", "-u1*u2"]``; or a function of u (p, channels), of
        points (p, d) if it has a second parameter, and of the time if it has a parameter ``t`` without a default, that
        returns rates (p, channels). Its u are values at points of the manifold, not coefficients.
    kappa : number, callable, or a sequence of one for each channel
        Diffusivities, above zero: numbers, or functions of points (n, d) that return (n,).
    until : float
        End time.
    step : float
        Time step; the last step before a frame and before the end is shortened.
    scheme : str
        ``sbdf2``, of second order: BDF2 with the reaction extrapolated from two steps (Ascher, Ruuth and Wetton 1995);
        ``euler``, of first order.
    f : number, sequence, or callable
        Source, as of :class:`~cpmkit.Heat`.
    frames : int or sequence of float
        As for :class:`~cpmkit.Heat`.
    after_step, rest, t0, capacity
        As for :class:`~cpmkit.Heat`.

    Raises
    ------
    InputError
        If an argument is not accepted.

    Examples
    --------
    On a circle the solution of u_t = Lap u + u (1 - u) tends to 1 if it is positive at the start.

    >>> import cpmkit as ck
    >>> growth = ck.ReactionDiffusion(0.1, lambda u: u * (1 - u), kappa=0.1, until=10.0, step=0.1)
    >>> solution = ck.solve(ck.Scene(ck.source("analytic.circle"), growth), spacing=0.2)
    >>> solution.evaluate([[1, 0]]).round(2)
    array([1.])
    """

    initial: Data
    reaction: Reaction
    kappa: ChannelData
    until: float
    step: float
    scheme: str = "sbdf2"
    f: Data = 0.0
    frames: int | Sequence[float] = 0
    after_step: AfterStep | None = None
    rest: float | None = None
    t0: float = 0.0
    capacity: ScalarData = 1.0
    kind: ClassVar[str] = "reaction-diffusion"
    schemes: ClassVar[tuple[str, ...]] = ("sbdf2", "euler")

    def __post_init__(self) -> None:
        """Replace formulas of the reaction by a function, kappa by a tuple; raise InputError for wrong fields."""
        super().__post_init__()
        texts: Any = self.reaction
        texts = (texts,) if isinstance(texts, str) else texts
        if is_sequence(texts):
            function = read_formula(ReactionExpression, tuple(texts), f"reaction of {self.kind}")
            object.__setattr__(self, "reaction", function)
        if not callable(self.reaction):
            raise InputError(f"reaction of {self.kind} must be a function of u (p, channels), got {shown(texts)}.")
        kappa: Any = self.kappa
        each = tuple(kappa) if not callable(kappa) and np.ndim(np.asarray(kappa, dtype=object)) else (kappa,)
        if not each:
            raise InputError(f"kappa of {self.kind} must be one number or function a channel, got none.")
        for value in each:
            if not callable(value):
                positive(value, f"kappa of {self.kind}")
        object.__setattr__(self, "kappa", each)

    def terms(self) -> Terms:
        """Return the terms of the spatial part of the first channel."""
        return Terms(self.f, diffusivity=self.kappa[0], capacity=self.capacity)

    def terms_of_channels(self, channels: int) -> list[tuple[tuple[int, ...], Terms]]:
        """Return pairs (indices of channels with equal kappa, their spatial terms); all ``channels`` are in a pair."""
        each = self.kappa * channels if len(self.kappa) == 1 else self.kappa
        different: list[Any] = []
        for kappa in each:
            if not any(same_parameter(kappa, other) for other in different):
                different.append(kappa)
        return [
            (tuple(k for k, other in enumerate(each) if same_parameter(other, kappa)), Terms(self.f, diffusivity=kappa))
            for kappa in different
        ]

    def data(self) -> list[tuple[str, Data]]:
        """Return pairs (name in messages, data): f, initial data, kappa, and a zero for each reaction formula."""
        data = [*super().data(), (f"kappa of {self.kind}", list(self.kappa))]
        channels = getattr(self.reaction, "channels", None)  # of formulas
        return [*data, ("the reaction", [0.0] * channels)] if channels is not None else data

    def check_conditions(self, conditions: Sequence[tuple[str, Condition]]) -> None:
        """Raise SceneError for the first of ``conditions`` not accepted, also couplings if channels' kappa differ."""
        super().check_conditions(conditions)
        alike = len(self.terms_of_channels(len(self.kappa))) == 1
        for label, condition in conditions:
            if condition.couples and not alike:
                raise SceneError(
                    f"{label}: {condition.kind!r} takes one kappa for all channels, got {len(self.kappa)} that differ; "
                    "give one number or function, or conditions on each side."
                )

    def __str__(self) -> str:
        each = ", ".join("a function" if callable(value) else f"{value:g}" for value in self.kappa)
        return f"u_t - div(kappa grad u) = reaction(u) + f, kappa = {each}"
