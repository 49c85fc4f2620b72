"""Functions of position that cut or trim: a plane's signed distance, a formula, or a Python callable."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.plugin import Expression, Floats, InputError, as_vector, dots, shown


@dataclass(frozen=True, eq=False)
class PlaneDistance:
    """The signed distance from the plane through ``point`` (d,), positive where the unit ``normal`` (d,) points."""

    point: Floats
    normal: Floats

    def __call__(self, x: Floats) -> Floats:
        """Return the distances (n,) of points (n, d)."""
        return dots(x - self.point, self.normal)


@dataclass(frozen=True, eq=False)
class PositionFunction:
    """A function of position that is asked in coordinates relative to ``origin``.

    Attributes
    ----------
    function : callable
        Of points (n, d) in the user's coordinates; returns (n,).
    origin : (d,) float64
        Added to what is asked. A plane is moved instead, so that it keeps its accuracy far from zero.
    what : str
        Its name in messages: the key that it was given by.
    """

    function: Callable[[Floats], Any]
    origin: Floats
    what: str

    def __call__(self, y: Floats) -> Floats:
        """Return the values (n,) at points (n, d) relative to the origin.

        Raises
        ------
        InputError
            If the function fails, or does not return one finite number a point.
        """
        values = self.unchecked(y)
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            raise InputError(
                f"{self.what} must be finite on the manifold, got {values[bad[0]]} at "
                f"{(y[bad[0]] + self.origin).tolist()} and {len(bad)} of {len(y)} points."
            )
        return values

    def unchecked(self, y: Floats) -> Floats:
        """Return the values (n,), NaN and infinity among them."""
        try:
            if isinstance(self.function, PlaneDistance):
                return PlaneDistance(self.function.point - self.origin, self.function.normal)(y)
            values = np.asarray(self.function(y + self.origin), dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.what} must return one number a point: {error}") from error
        if values.shape not in ((len(y),), ()):
            raise InputError(f"{self.what} must return shape ({len(y)},) for {len(y)} points, got {values.shape}.")
        return np.broadcast_to(values, (len(y),)).copy()

    def gradient(self, y: Floats, step: float) -> Floats:
        """Return the gradients (n, d) at points (n, d), by differences of fourth order in ``step``."""
        if isinstance(self.function, PlaneDistance):
            return np.tile(self.function.normal, (len(y), 1))
        n, dim = y.shape
        offsets = step * np.array([1.0, -1.0, 2.0, -2.0])[:, None, None] * np.eye(dim)
        around = self.unchecked((y + offsets.reshape(-1, 1, dim)).reshape(-1, dim)).reshape(4, dim, n)
        return np.ascontiguousarray((8 * (around[0] - around[1]) - (around[2] - around[3])).T / (12 * step))

    def variation(self, y: Floats, reach: float) -> Floats:
        """Return (n,) about the most by which the values change within ``reach`` of points (n, d)."""
        n, dim = y.shape
        if isinstance(self.function, PlaneDistance):
            return np.full(n, reach)
        offsets = reach * np.concatenate([np.eye(dim), -np.eye(dim)])
        around = self.unchecked((y + offsets[:, None]).reshape(-1, dim)).reshape(2 * dim, n)
        change = np.abs(around - self.unchecked(y)).max(axis=0)
        return np.where(np.isfinite(change), 2 * np.sqrt(dim) * change, np.inf)


def plane_distance(point: Any, normal: Any, dim: int) -> PlaneDistance:
    """Return the signed distance from a plane, in 2D from a line.

    Raises
    ------
    InputError
        If a vector has another length than ``dim``, is not finite, or the normal is zero.
    """
    base, direction = as_vector(point, dim, "point"), as_vector(normal, dim, "normal")
    if not direction.any():
        raise InputError(f"normal must not be zero, got {shown(normal)}.")
    direction = direction / np.abs(direction).max()
    return PlaneDistance(base, direction / np.linalg.norm(direction))


def position_function(function: Any, dim: int, what: str) -> Callable[[Floats], Any]:
    """Return ``function`` if it can be called, the formula that it spells if it is a string.

    Raises
    ------
    InputError
        If it is neither.
    """
    if isinstance(function, str):
        formula = Expression(function, dim)
        if formula.takes_time:
            raise InputError(f"{what} must not depend on t, got {shown(function)}.")
        return formula
    if isinstance(function, bool) or not callable(function):
        raise InputError(
            f"{what} must be a formula in x, y, z or a function of points (n, {dim}), got {shown(function)}."
        )
    checked: Callable[[Floats], Any] = function
    return checked
