"""Right-hand sides that are functionals: known by their values for test functions, not at points."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.runtime.arrays import as_points, number
from cpmkit.scene.data import Data, Functional, takes_time
from cpmkit.types import Floats


class TestsFunctionals(Protocol):
    """The members of a form that functionals use to compute their load vectors."""

    @property
    def scene(self) -> Any:
        """The scene, whose ``channels`` is the number of right-hand sides that are solved together."""

    @property
    def points(self) -> Floats:
        """The points (p, d) at which the form has values; not to be written to."""

    def load(self, f: Data, time: float | None = None) -> Floats:
        """Return the integrals (n, channels) of f, at ``time`` if it depends on it, times each test function."""

    def rows(self, points: Floats) -> Any:
        """Return the matrix (k, n) of the values of the test functions at the closest points of ``points`` (k, d)."""

    def gradient_load(self, values: Floats) -> Floats:
        """Return the integrals (n,) of a vector field times the gradient of each test function.

        The field is ``values`` (p, d) at the form's points.
        """


class TestedRightSide(Functional, ABC):
    """A right-hand side that is the sum of a functional and a function ``beside`` of points."""

    beside: Data

    @property
    def takes_time(self) -> bool:
        """True if the function ``beside`` depends on the time."""
        return takes_time(self.beside)

    @abstractmethod
    def values(self, form: TestsFunctionals) -> Floats:
        """Return the values (n, channels) of the functional alone for each test function, without ``beside``."""

    def loads(self, form: TestsFunctionals, time: float | None = None) -> Floats:
        """Return the load vectors (n, channels) of the sum of the functional and the function ``beside``."""
        is_zero = isinstance(self.beside, (int, float)) and self.beside == 0
        return self.values(form) if is_zero else form.load(self.beside, time) + self.values(form)


@dataclass(frozen=True, eq=False)
class PointSource(TestedRightSide):
    """Point sources: f = sum strength_k delta(x - at_k) + beside.

    The load of a spline is its value at the point, so that the total and the first and second moments are exact. The
    solution converges at the usual order away from the points; at a point of a surface the exact solution is unbounded.

    Parameters
    ----------
    at : (k, d) or (d,) array
        Points on or near the manifold, in the scene's coordinates.
    strength : number, (k,) or (k, channels) array
        Inflow at each point; in equations with time, for one unit of time.
    beside : number, sequence or callable
        A function of points that is added to f.

    Raises
    ------
    InputError
        If points or strengths are not finite numbers of these shapes.

    Examples
    --------
    On a circle the solution of -u'' + u = delta is cosh(pi - s) / (2 sinh(pi)).

    >>> import cpmkit as ck
    >>> source = ck.PointSource([[1.0, 0.0]], 2.0)
    >>> scene = ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(source))
    >>> round(float(ck.solve(scene, spacing=0.1).evaluate([[-1, 0]])[0]), 4)
    0.0866
    """

    at: Any
    strength: Any = 1.0
    beside: Data = 0.0

    def __post_init__(self) -> None:
        """Convert ``at`` to points (k, d) and ``strength`` to an array (k, channels), and check them."""
        at = np.asarray(self.at, dtype=np.float64)
        points = as_points(at[None] if at.ndim == 1 else at, at.shape[-1] if at.ndim else 0)
        try:
            strength = np.array(self.strength, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(f"strength of a point source must be numbers, got {shown(self.strength)}.") from error
        if strength.ndim > 2 or not np.isfinite(strength).all() or strength.shape[:1] not in ((), (len(points),)):
            raise InputError(
                f"strength of a point source must be one finite number, or one row for each of the {len(points)} "
                f"points, got shape {strength.shape}."
            )
        strength = np.broadcast_to(strength, (len(points),)) if strength.ndim == 0 else strength
        object.__setattr__(self, "at", points)
        object.__setattr__(self, "strength", strength[:, None] if strength.ndim == 1 else strength)

    @property
    def channels(self) -> int:
        """Number of channels of the strengths."""
        return int(self.strength.shape[1])

    def values(self, form: TestsFunctionals) -> Floats:
        """Return for each test function the sum (n, channels) over the points of its value times the strength."""
        loads = np.asarray(form.rows(self.at).T @ self.strength)
        return loads if loads.shape[1] == form.scene.channels else np.repeat(loads, form.scene.channels, axis=1)


@dataclass(frozen=True, eq=False)
class Divergence(TestedRightSide):
    """f = scale div(X) + beside in weak form, -scale sum X . grad phi, so that X is not differentiated.

    A Neumann condition, also the default zero flux, then prescribes du/db + scale X . b (for -Lap u = f).

    Parameters
    ----------
    of : callable
        X, a function of points (n, d) that returns vectors (n, d); its normal part is ignored.
    scale : float
        Factor of the divergence.
    beside : number, sequence or callable
        A function of points that is added to f.

    Examples
    --------
    On the unit circle the divergence of the tangential part of (0, y) is cos 2 s, and u is cos(2 s) / 5.

    >>> import cpmkit as ck
    >>> field = ck.Divergence(lambda p: p * [0.0, 1.0])
    >>> scene = ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(field, c=1.0))
    >>> ck.solve(scene, spacing=0.1).evaluate([[1, 0], [0, 1]]).round(3)
    array([ 0.2, -0.2])
    """

    of: Callable[[Floats], Any]
    scale: float = 1.0
    beside: Data = 0.0

    def __post_init__(self) -> None:
        if not callable(self.of):
            raise InputError(f"a divergence is that of a function of points, got {shown(self.of)}.")
        object.__setattr__(self, "scale", number(self.scale, "scale of a divergence"))

    @property
    def channels(self) -> int:
        """Number of channels, one."""
        return 1

    def __neg__(self) -> Divergence:
        return self * -1.0

    def __mul__(self, factor: float) -> Divergence:
        beside = self.beside
        if callable(beside) or isinstance(beside, Functional) or np.any(np.asarray(beside, dtype=object)):
            raise InputError("a divergence with a function beside it is not multiplied; give its scale.")
        return replace(self, scale=self.scale * number(factor, "a factor of a divergence"))

    __rmul__ = __mul__

    def values(self, form: TestsFunctionals) -> Floats:
        """Return -scale times the integral of X . grad phi for each test function phi, repeated for all channels."""
        points = form.points
        is_field = getattr(self.of, "points", None) is points  # any other function may write to its argument
        values = np.asarray(self.of(points if is_field else points.copy()), dtype=np.float64)
        if values.shape != points.shape or not np.isfinite(values).all():
            raise InputError(
                f"the field of a divergence must return finite vectors {points.shape} at {len(points)} points, got "
                f"shape {values.shape}."
            )
        return np.repeat(-self.scale * form.gradient_load(values)[:, None], form.scene.channels, axis=1)
