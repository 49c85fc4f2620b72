"""Equations whose diffusivity depends on the solution: -div(a(u, |grad u|) grad u) + c u = f, and two known kinds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.formulas.expressions import StateExpression
from cpmkit.protocols import Floats
from cpmkit.runtime.arrays import number, positive
from cpmkit.scene.data import Data, evaluate_data, read_formula
from cpmkit.scene.diffusivities import StateDiffusivity, slope_diffusivity
from cpmkit.scene.equations import Equation, Terms, check_factor

#: How the equations are solved: by tangents, or with the diffusivity of the step before.
METHODS = ("newton", "lagged")
#: The p from which on a p-Laplacian is approached by others, and the ratio of the p of one to that of the next.
FIRST_POWER, POWER_RATIO = 4.0, 1.25


@dataclass(frozen=True, eq=False)
class QuasilinearEquation(Equation):
    """What equations tell whose diffusivity depends on u."""

    #: "newton" or "lagged".
    method: str = field(default="newton", kw_only=True)

    def _check_method(self) -> None:
        if self.method not in METHODS:
            raise InputError(f"method of {self.kind} must be {' or '.join(METHODS)}, got {shown(self.method)}.")

    #: Whether terms of a form's own, such as penalties, are in units of one number, and not of a: then the steps of
    #: a lagged diffusivity lessen one energy, theirs included.
    uniform_penalty: ClassVar[bool] = False

    @property
    def diffusivity_of_u(self) -> StateDiffusivity:
        """What a is, with its derivatives."""
        found: StateDiffusivity = self.terms().diffusivity
        return found

    @property
    def initial_guess(self) -> Data | None:
        """Data that the iteration starts at; None for the solution with the diffusivity 1."""
        return None

    @property
    def continuation(self) -> Sequence[QuasilinearEquation]:
        """Equations nearer to a linear one, whose solutions are starts: each for the next, the last one for this."""
        return ()

    def energy(self, slopes: Floats) -> Floats | None:
        """Return the density (k,) whose derivative by the slope (k, d) is a grad u; None where none is known."""
        del slopes
        return None


@dataclass(frozen=True, eq=False)
class NonlinearDiffusion(QuasilinearEquation):
    """-div(a(u, s) grad u) + c u = f, ``s = |grad u|``.

    Parameters
    ----------
    diffusivity : callable or text
        a, above zero: a formula such as ``"1 + u**2"``, or a function of u (n,), of u and s (n,), or of u, s and points
        (n, d) that returns (n,).
    f : number or callable
        Right-hand side, as for :class:`~cpmkit.Poisson`; of one channel.
    c : number or callable
        Factor of u.
    by_value, by_slope : callable, optional
        da/du and da/ds, of the same arguments as a; by differences unless given.
    method : str
        ``newton``, with shorter steps where a whole one does not bring it nearer; ``lagged``, which takes the
        diffusivity of the step before.

    Raises
    ------
    InputError
        If the diffusivity is no function, or the method or c not what is accepted.

    Examples
    --------
    On a circle cut at a point, with a = 1 + u: then u + u^2 / 2 is linear between the values at the cut.

    >>> import cpmkit as ck
    >>> cut = ck.Boundary("cut", ck.source("analytic.point", at=[1, 0]), left=ck.Dirichlet(1), right=ck.Dirichlet(0))
    >>> better_where_warm = ck.NonlinearDiffusion(lambda u: 1 + u)
    >>> solution = ck.solve(ck.Scene(ck.source("analytic.circle"), better_where_warm, [cut]), spacing=0.05)
    >>> solution.evaluate([[-1, 0]]).round(4)
    array([0.5811])
    """

    diffusivity: Callable[..., Any] | str
    f: Data = 0.0
    c: Data = 0.0
    by_value: Callable[..., Any] | str | None = None
    by_slope: Callable[..., Any] | str | None = None
    kind: ClassVar[str] = "nonlinear-diffusion"

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("diffusivity", "by_value", "by_slope"):
            if isinstance(getattr(self, name), str):
                made = read_formula(StateExpression, getattr(self, name), f"{name} of {self.kind}")
                object.__setattr__(self, name, made)
        if not callable(self.diffusivity):
            raise InputError(
                f"the diffusivity of nonlinear diffusion must be a function of u, got {shown(self.diffusivity)}; use "
                "Elliptic for one that does not depend on u."
            )
        check_factor(self.c, "c of nonlinear diffusion")
        self._check_method()

    def terms(self) -> Terms:
        """Return the terms; the diffusivity is known with u only."""
        return Terms(self.f, self.c, self._law)

    @cached_property
    def _law(self) -> StateDiffusivity:
        found: Any = (self.diffusivity, self.by_value, self.by_slope)  # functions, formulas made so
        return StateDiffusivity(*found)

    def __str__(self) -> str:
        return str(self.terms()).replace("(a grad u)", "(a(u, |grad u|) grad u)")


@dataclass(frozen=True, eq=False)
class PLaplacian(QuasilinearEquation):
    """-div(a grad u) + c u = f with ``a = (|grad u|^2 + r^2)^((p - 2) / 2)``.

    Parameters
    ----------
    p : float
        At least 1; 2 is the Laplacian, 1 total variation.
    f, c : number or callable
        As for :class:`~cpmkit.NonlinearDiffusion`.
    regularization : float
        r, a slope above zero, far below those that matter: where u is flat, a would be zero or without bound.
    method : str
        As for :class:`~cpmkit.NonlinearDiffusion`.

    Raises
    ------
    InputError
        If p is below 1, or another argument not what is accepted.
    """

    p: float
    f: Data = 0.0
    c: Data = 0.0
    regularization: float = field(kw_only=True)
    kind: ClassVar[str] = "p-laplacian"

    def __post_init__(self) -> None:
        super().__post_init__()
        if number(self.p, "p of a p-Laplacian") < 1:
            raise InputError(f"p of a p-Laplacian must be at least 1, got {self.p:g}.")
        positive(self.regularization, "regularization of a p-Laplacian")
        check_factor(self.c, "c of a p-Laplacian")
        self._check_method()

    def terms(self) -> Terms:
        """Return the terms; the diffusivity is known with u only."""
        return Terms(self.f, self.c, self._law)

    @cached_property
    def _law(self) -> StateDiffusivity:
        return power_of_slope(self.p, self.regularization)

    @property
    def continuation(self) -> tuple[PLaplacian, ...]:
        """The same with smaller p, from 4 on: Newton's method from the solution of the Laplacian leads no farther."""
        powers = FIRST_POWER * POWER_RATIO ** np.arange(1 + np.log(max(self.p / FIRST_POWER, 1)) / np.log(POWER_RATIO))
        return tuple(replace(self, p=float(p)) for p in powers if p < self.p)

    def energy(self, slopes: Floats) -> Floats:
        """Return ``(s^2 + r^2)^(p / 2) / p``."""
        return np.asarray((np.sum(slopes**2, axis=1) + self.regularization**2) ** (self.p / 2) / self.p)

    def __str__(self) -> str:
        return str(self.terms()).replace("(a grad u)", f"(|grad u|^{self.p - 2:g} grad u)")


@dataclass(frozen=True, eq=False)
class TotalVariation(QuasilinearEquation):
    """``c (u - f) = div(grad u / |grad u|)``: f without what swings, and with its jumps.

    The minimum of the integral of ``|grad u| + c (u - f)^2 / 2``, with ``(|grad u|^2 + r^2)^(1/2)`` for ``|grad u|``.
    The smaller c, the fewer details stay: a disc of radius R is lowered by about 2 / (c R) of a unit.

    Parameters
    ----------
    f : number or callable
        What is to be cleaned.
    c : float
        Above zero, in one over a unit of u and of length.
    regularization : float
        r, a slope above zero; what is flatter is smoothed as by heat.
    method : str
        ``lagged``, in which the energy falls in every step; ``newton``.

    Raises
    ------
    InputError
        If c or the regularization are not above zero, or the method not what is accepted.
    """

    f: Data
    c: float
    regularization: float
    method: str = field(default="lagged", kw_only=True)
    kind: ClassVar[str] = "total-variation"
    uniform_penalty: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        positive(self.c, "c of total variation")
        positive(self.regularization, "regularization of total variation")
        self._check_method()

    def terms(self) -> Terms:
        """Return the terms; the diffusivity is known with u only."""
        return Terms(_Scaled(self.f, self.c), float(self.c), self._law)

    @cached_property
    def _law(self) -> StateDiffusivity:
        return power_of_slope(1.0, self.regularization)

    @property
    def initial_guess(self) -> Data:
        """F, which is to be cleaned."""
        return self.f

    def energy(self, slopes: Floats) -> Floats:
        """Return ``(s^2 + r^2)^(1/2)``."""
        return np.asarray(np.sqrt(np.sum(slopes**2, axis=1) + self.regularization**2))

    def __str__(self) -> str:
        return f"-div(grad u / |grad u|) + {self.c:g} (u - f) = 0"


@dataclass(frozen=True, eq=False)
class _Scaled:
    """Data times a number."""

    given: Data
    factor: float
    takes_time: ClassVar[bool] = False

    def __call__(self, points: Floats) -> Floats:
        return self.factor * evaluate_data(self.given, points, None, "the right-hand side f")


def power_of_slope(p: float, r: float) -> StateDiffusivity:
    """Return ``(s^2 + r^2)^((p - 2) / 2)``."""
    return slope_diffusivity(partial(_power, p, r), partial(_slope_of_power, p, r))


def _power(p: float, r: float, s: Floats) -> Floats:
    return np.asarray((s**2 + r**2) ** (p / 2 - 1))


def _slope_of_power(p: float, r: float, s: Floats) -> Floats:
    return np.asarray((p - 2) * s * (s**2 + r**2) ** (p / 2 - 2))


def check_one_channel(channels: int) -> None:
    """Refuse several channels.

    Raises
    ------
    SceneError
        If there are several.
    """
    if channels > 1:
        raise SceneError(f"a diffusivity that depends on u takes one channel, the scene has {channels}.")
