"""Maps from parameters to space, with first and second derivatives, evaluated a batch at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from cpmkit.plugin import Floats, InputError
from cpmkit_parametric.formulas import Jet, symmetric_derivatives

#: Samples by which arcs of a curve are measured, and lines along each parameter by which a surface is.
ARC_LENGTH_SAMPLES, GRID_LINES = 1025, 129


class Map(Protocol):
    """x(t) for t in ``count`` parameters, in ``dim`` coordinates."""

    @property
    def dim(self) -> int:
        """Number d of coordinates."""

    @property
    def count(self) -> int:
        """Number m of parameters."""

    def value(self, t: Floats, /) -> Floats:
        """Return the points (n, d) at parameters (n, m)."""

    def jet(self, t: Floats, /) -> Jet:
        """Return points (n, d), derivatives (n, m, d) and second derivatives (n, m, m, d) at ``t`` (n, m)."""


@dataclass(frozen=True, eq=False)
class CallableMap:
    """A map given by a function of the parameters' columns, with derivatives given or by differences.

    Attributes
    ----------
    dim, count : int
        Number of coordinates and of parameters.
    function : callable
        ``function(t)`` or ``function(u, v)`` of arrays (n,) returns (n, d).
    derivatives : callable
        Returns (x', x'') at t, or (x_u, x_v, x_uu, x_uv, x_vv) at (u, v), each (n, d).
    """

    dim: int
    count: int
    function: Callable[..., Any]
    derivatives: Callable[..., Sequence[Any]]

    def value(self, t: Floats, /) -> Floats:
        """Return the points (n, d) at parameters (n, m)."""
        with np.errstate(all="ignore"):
            return as_coordinates(self.function(*t.T), len(t), self.dim, "x")

    def jet(self, t: Floats, /) -> Jet:
        """Return points (n, d), derivatives (n, m, d) and second derivatives (n, m, m, d) at ``t`` (n, m).

        Raise InputError if ``derivatives`` returns another number of arrays, or it or the function another shape.
        """
        wanted = self.count + self.count * (self.count + 1) // 2
        with np.errstate(all="ignore"):
            derivatives = list(self.derivatives(*t.T))
        if len(derivatives) != wanted:
            names = {2: "x', x''", 5: "x_u, x_v, x_uu, x_uv, x_vv"}[wanted]
            raise InputError(f"derivatives must return the {wanted} arrays {names}, got {len(derivatives)}.")
        parts = [as_coordinates(part, len(t), self.dim, "derivatives") for part in derivatives]
        upper = np.stack(parts[self.count :], axis=1)
        return self.value(t), np.stack(parts[: self.count], axis=1), symmetric_derivatives(upper, self.count)


def as_coordinates(values: Any, n: int, dim: int | None, label: str) -> Floats:
    """Return a callable's result as (n, dim) float64, for None of any d; raise InputError if it has another shape."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{label} must return an array of numbers (n, d), got {type(values).__name__}.") from error
    if array.ndim != 2 or len(array) != n or (dim is not None and array.shape[1] != dim):
        raise InputError(f"{label} must return shape ({n}, {dim or 'd'}) for {n} parameters, got {array.shape}.")
    return array


@dataclass(frozen=True, eq=False)
class UnitMap:
    """A map restated on the parameters [0, 1]^m: every tolerance and step is then a share of the range.

    Attributes
    ----------
    map : Map
        In the user's parameters.
    lower, upper : (m,) float64
        The range.
    """

    map: Map
    lower: Floats
    upper: Floats

    @property
    def dim(self) -> int:
        """Number d of coordinates."""
        return self.map.dim

    @property
    def count(self) -> int:
        """Number m of parameters."""
        return self.map.count

    @cached_property
    def arc_lengths(self) -> tuple[Floats, Floats]:
        """1025 unit parameters of a curve, 0 to 1, and the lengths of its arcs up to there."""
        s = np.linspace(0, 1, ARC_LENGTH_SAMPLES)
        steps = np.linalg.norm(np.diff(self.value(s[:, None]), axis=0), axis=1)
        return s, np.concatenate([[0.0], np.cumsum(steps)])

    @cached_property
    def largest_speeds(self) -> tuple[float, ...]:
        """The largest |x_u| and |x_v| of a surface, lengths per unit parameter, on a grid of 129 by 129 points."""
        s = np.linspace(0, 1, GRID_LINES)
        u, v = np.meshgrid(s, s, indexing="ij")
        points = self.value(np.stack([u.ravel(), v.ravel()], axis=1)).reshape(GRID_LINES, GRID_LINES, -1)
        steps = [np.linalg.norm(np.diff(points, axis=axis), axis=-1).max() for axis in (0, 1)]
        return tuple(float((GRID_LINES - 1) * step) for step in steps)

    def user_parameters(self, s: Floats, /) -> Floats:
        """Return the user's parameters (n, m) of unit parameters ``s`` (n, m); a bound is met exactly."""
        from cpmkit_parametric import unit_kernels

        found: Floats = unit_kernels.user_parameters(s, self.lower, self.upper)
        return found

    def unit_parameters(self, t: Floats, /) -> Floats:
        """Return the unit parameters (n, m) of the user's ``t`` (n, m)."""
        return np.asarray((t - self.lower) / (self.upper - self.lower))

    def value(self, s: Floats, /) -> Floats:
        """Return the points (n, d) at unit parameters (n, m)."""
        return self.map.value(self.user_parameters(s))

    def jet(self, s: Floats, /) -> Jet:
        """Return points (n, d), derivatives (n, m, d), (n, m, m, d) by unit parameters ``s``; these 0 if not finite."""
        from cpmkit_parametric import unit_kernels

        p, J, H = self.map.jet(self.user_parameters(s))
        return p, *unit_kernels.scale_derivatives(J, H, self.upper - self.lower)
