"""Quasilinear equations -div(a(u, |grad u|) grad u) + c u = f: nonlinear diffusion, p-Laplacian, total variation."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.formulas.expressions import StateExpression
from cpmkit.runtime.arrays import number
from cpmkit.scene.data import Data, ScalarData, evaluate_data, read_formula
from cpmkit.scene.diffusivities import StateDiffusivity, zero_derivative
from cpmkit.scene.equations import Equation, Positive, Terms
from cpmkit.types import Floats

#: Methods of solution: Newton's method, or linear steps with the diffusivity of the previous iterate.
METHODS = ("newton", "lagged")


@dataclass(frozen=True, eq=False)
class QuasilinearEquation(Equation):
    """Base class of equations whose diffusivity depends on u or on its gradient."""

    #: "newton" or "lagged".
    method: str = field(default="newton", kw_only=True)

    def __post_init__(self) -> None:
        """Check the fields as for any equation; raise InputError if the method is not "newton" or "lagged"."""
        super().__post_init__()
        if self.method not in METHODS:
            raise InputError(f"method of {self.kind} must be {' or '.join(METHODS)}, got {shown(self.method)}.")

    #: Whether penalties of a form are proportional to a constant instead of a: then each lagged step
    #: decreases the same energy, which includes the penalties.
    uniform_penalty: ClassVar[bool] = False

    @cached_property
    @abstractmethod
    def diffusivity_of_u(self) -> StateDiffusivity:
        """The diffusivity a(u, s), with its derivatives."""

    def terms(self) -> Terms:
        """Return the terms, whose diffusivity is a ``StateDiffusivity``: a function of u, grad u and points."""
        return replace(super().terms(), diffusivity=self.diffusivity_of_u)

    @property
    def initial_guess(self) -> Data | None:
        """Data from which the iteration starts; None for the solution with diffusivity 1."""
        return None

    @property
    def continuation(self) -> Sequence[QuasilinearEquation]:
        """Equations to solve before this equation, in order, each from the solution of the equation before it."""
        return ()

    def energy(self, slopes: Floats) -> Floats | None:
        """Return the energy density (k,) for tangential gradients ``slopes`` (k, d) of u; None if none is known.

        Its derivative with respect to the gradient is a grad u.
        """
        del slopes
        return None


#: A function of u (n,), of u and s (n,), or of u, s and points (n, d), that returns (n,), or a formula in u and s.
StateFunction = Callable[..., Any] | str


@dataclass(frozen=True, eq=False)
class NonlinearDiffusion(QuasilinearEquation):
    """-div(a(u, s) grad u) + c u = f, ``s = |grad u|``.

    Parameters
    ----------
    diffusivity : callable or text
        a, above zero: a formula such as ``"1 + u**2"``, or a function of u (n,), of u and s (n,), or of u, s and points
        (n, d), that returns (n,).
    f : number or callable
        Right-hand side, as for :class:`~cpmkit.Poisson`; of one channel.
    c : number or callable
        Factor of u.
    by_value, by_slope : callable, optional
        da/du and da/ds, of the same arguments as a; finite differences by default.
    method : str
        ``newton``, with shorter steps where a full one does not reduce the residual; ``lagged``, with the diffusivity
        of the previous iterate.

    Raises
    ------
    InputError
        If the diffusivity is neither a formula nor a function, or the method or c is not accepted.

    Examples
    --------
    On a circle cut at a point, with a = 1 + u, u + u^2 / 2 is linear between the values at the cut.

    >>> import cpmkit as ck
    >>> cut = ck.Boundary("cut", ck.source("analytic.point", at=[1, 0]), left=ck.Dirichlet(1), right=ck.Dirichlet(0))
    >>> better_where_warm = ck.NonlinearDiffusion(lambda u: 1 + u)
    >>> solution = ck.solve(ck.Scene(ck.source("analytic.circle"), better_where_warm, [cut]), spacing=0.05)
    >>> solution.evaluate([[-1, 0]]).round(4)
    array([0.5811])
    """

    diffusivity: StateFunction
    f: Data = 0.0
    c: ScalarData = 0.0
    by_value: StateFunction | None = None
    by_slope: StateFunction | None = None
    kind: ClassVar[str] = "nonlinear-diffusion"

    def __post_init__(self) -> None:
        """Replace formulas by functions; raise InputError if the diffusivity is neither a formula nor a function."""
        super().__post_init__()
        for name in ("diffusivity", "by_value", "by_slope"):
            if isinstance(getattr(self, name), str):
                function = read_formula(StateExpression, getattr(self, name), f"{name} of {self.kind}")
                object.__setattr__(self, name, function)
        if not callable(self.diffusivity):
            raise InputError(
                f"the diffusivity of nonlinear diffusion must be a function of u, got {shown(self.diffusivity)}; use "
                "Elliptic for one that does not depend on u."
            )

    @cached_property
    def diffusivity_of_u(self) -> StateDiffusivity:
        """The diffusivity with its derivatives."""
        functions: Any = (self.diffusivity, self.by_value, self.by_slope)  # formulas were replaced by functions
        return StateDiffusivity(*functions)

    def __str__(self) -> str:
        return str(self.terms()).replace("(a grad u)", "(a(u, |grad u|) grad u)")


@dataclass(frozen=True, eq=False)
class PLaplacian(QuasilinearEquation):
    """-div(a grad u) + c u = f with ``a = (|grad u|^2 + r^2)^((p - 2) / 2)``.

    Parameters
    ----------
    p : float
        At least 1; 2 gives the Laplacian, 1 total variation.
    f, c : number or callable
        As for :class:`~cpmkit.NonlinearDiffusion`.
    regularization : float
        r, a slope above zero and far below those of interest: where u is flat, a would be zero or unbounded.
    method : str
        As for :class:`~cpmkit.NonlinearDiffusion`.

    Raises
    ------
    InputError
        If p is below 1, or another argument is not accepted.
    """

    p: float
    f: Data = 0.0
    c: ScalarData = 0.0
    regularization: Positive = field(kw_only=True)
    kind: ClassVar[str] = "p-laplacian"

    def __post_init__(self) -> None:
        """Check the fields as for any quasilinear equation; raise InputError if p is below 1 or no finite number."""
        super().__post_init__()
        if number(self.p, "p of p-laplacian") < 1:
            raise InputError(f"p of p-laplacian must be at least 1, got {self.p:g}.")

    @cached_property
    def diffusivity_of_u(self) -> StateDiffusivity:
        """The diffusivity (s^2 + r^2)^((p - 2) / 2) with its derivative."""
        return _power_of_slope(self.p, self.regularization)

    @property
    def continuation(self) -> tuple[PLaplacian, ...]:
        """The same equation with p = 4, 5, 6.25, ... below its own; from the Laplacian Newton converges to p = 4."""
        powers = 4.0 * 1.25 ** np.arange(1 + np.log(max(self.p / 4.0, 1)) / np.log(1.25))
        return tuple(replace(self, p=float(p)) for p in powers if p < self.p)

    def energy(self, slopes: Floats) -> Floats:
        """Return the energy density ``(s^2 + r^2)^(p / 2) / p`` (k,), s the norm of ``slopes`` (k, d)."""
        return np.asarray((np.sum(slopes**2, axis=1) + self.regularization**2) ** (self.p / 2) / self.p)

    def __str__(self) -> str:
        return str(self.terms()).replace("(a grad u)", f"(|grad u|^{self.p - 2:g} grad u)")


@dataclass(frozen=True, eq=False)
class TotalVariation(QuasilinearEquation):
    """``c (u - f) = div(grad u / |grad u|)``: f without oscillations, and with its jumps (Rudin, Osher and Fatemi).

    u minimises the integral of ``|grad u| + c (u - f)^2 / 2``, with ``(|grad u|^2 + r^2)^(1/2)`` for ``|grad u|``.
    The smaller c, the fewer details remain: a disc of radius R and height 1 is lowered by about 2 / (c R).

    Parameters
    ----------
    f : number or callable
        The function to denoise.
    c : float
        Above zero, in 1 / (unit of u times unit of length).
    regularization : float
        r, a slope above zero; where u is flatter, it is smoothed as by diffusion.
    method : str
        ``lagged``, whose every step decreases the energy; or ``newton``.

    Raises
    ------
    InputError
        If c or the regularization is not above zero, or the method is not accepted.
    """

    f: Data
    c: Positive
    regularization: Positive
    method: str = field(default="lagged", kw_only=True)
    kind: ClassVar[str] = "total-variation"
    uniform_penalty: ClassVar[bool] = True

    def terms(self) -> Terms:
        """Return the terms, with the right-hand side c f and the diffusivity as a ``StateDiffusivity``."""

        def scaled(points: Floats) -> Floats:
            """Return c f (n, channels) at points (n, d)."""
            return self.c * evaluate_data(self.f, points, None, "the right-hand side f")

        return replace(super().terms(), f=scaled)

    @cached_property
    def diffusivity_of_u(self) -> StateDiffusivity:
        """The diffusivity (s^2 + r^2)^(-1/2) with its derivative."""
        return _power_of_slope(1.0, self.regularization)

    @property
    def initial_guess(self) -> Data:
        """The function f to denoise."""
        return self.f

    def energy(self, slopes: Floats) -> Floats:
        """Return the energy density ``(s^2 + r^2)^(1/2)`` (k,), s the norm of ``slopes`` (k, d)."""
        return np.asarray(np.sqrt(np.sum(slopes**2, axis=1) + self.regularization**2))

    def __str__(self) -> str:
        return f"-div(grad u / |grad u|) + {self.c:g} (u - f) = 0"


def _power_of_slope(p: float, r: float) -> StateDiffusivity:
    """Return the diffusivity ``(s^2 + r^2)^((p - 2) / 2)`` as a function of the slope s, with its derivatives."""
    return StateDiffusivity(partial(_power, p, r), zero_derivative, partial(_derivative_of_power, p, r))


def _power(p: float, r: float, u: Floats, s: Floats) -> Floats:
    """Return ``(s^2 + r^2)^(p / 2 - 1)`` (k,) for s (k,); it does not depend on u."""
    del u
    return np.asarray((s**2 + r**2) ** (p / 2 - 1))


def _derivative_of_power(p: float, r: float, u: Floats, s: Floats) -> Floats:
    """Return the derivative (k,) of ``(s^2 + r^2)^(p / 2 - 1)`` with respect to s (k,)."""
    return (p - 2) * s * _power(p - 2, r, u, s)
