"""Diffusivities that depend on the solution u and on the size s of its tangential gradient."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import InputError, SceneError
from cpmkit.protocols import Floats

#: Step of the differences that replace a derivative, as a share of what is varied.
DIFFERENCE_SHARE = 1e-6
#: The tangent conducts at least this share of what the diffusivity does: where a s falls with s, it would not be
#: positive.
LEAST_TANGENT_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class StateDiffusivity:
    """a(u, s, points), with its derivatives.

    Attributes
    ----------
    function : callable
        a of u (k,); or of u and s; or of u, s and points (k, d): returns (k,).
    by_value, by_slope : callable, optional
        Its derivatives with respect to u and to s, of the same arguments; by differences unless given.
    """

    function: Callable[..., Any]
    by_value: Callable[..., Any] | None = None
    by_slope: Callable[..., Any] | None = None
    #: Asked by what may be handed a function of points in its place.
    needs_state: ClassVar[bool] = True

    def __call__(self, points: Floats) -> Floats:
        """Refuse: a is no function of points alone.

        Raises
        ------
        SceneError
            Always.
        """
        del points
        raise SceneError("the diffusivity depends on u, and is not known before u is; use cpmkit.solve.")

    @property
    def of_value(self) -> bool:
        """Whether a may change with u."""
        return self.by_value is not _zero

    def at(self, u: Floats, slopes: Floats, points: Floats) -> Floats:
        """Return a (k,) for u (k,), its tangential gradients (k, d) and points (k, d)."""
        return _called(self.function, u, np.linalg.norm(slopes, axis=1), points, "the diffusivity")

    def tangent(self, u: Floats, slopes: Floats, points: Floats) -> Floats:
        """Return the derivative (k, d, d) of a grad u with respect to grad u: a I + s da/ds e e', e along grad u."""
        a, s = self.at(u, slopes, points), np.linalg.norm(slopes, axis=1)
        if self.by_slope is not None:
            slope = _called(self.by_slope, u, s, points, "the derivative of the diffusivity by the slope")
        else:
            step = DIFFERENCE_SHARE * (s + DIFFERENCE_SHARE * (s.max(initial=0.0) or 1.0))
            ahead, behind = (_called(self.function, u, s + sign * step, points, "the diffusivity") for sign in (1, -1))
            slope = (ahead - behind) / (2 * step)
        along = np.maximum(s * slope, (LEAST_TANGENT_SHARE - 1) * a)
        e = slopes / np.maximum(s, np.finfo(float).tiny)[:, None]
        squares = e[:, :, None] * e[:, None, :]
        return np.asarray(a[:, None, None] * np.eye(slopes.shape[1]) + along[:, None, None] * squares)

    def drift(self, u: Floats, slopes: Floats, points: Floats) -> Floats:
        """Return the derivative (k, d) of a grad u with respect to u."""
        s = np.linalg.norm(slopes, axis=1)
        if self.by_value is not None:
            rate = _called(self.by_value, u, s, points, "the derivative of the diffusivity by u")
        else:
            step = DIFFERENCE_SHARE * np.maximum(np.abs(u), np.abs(u).max(initial=0.0) or 1.0)
            ahead, behind = (_called(self.function, u + sign * step, s, points, "the diffusivity") for sign in (1, -1))
            rate = (ahead - behind) / (2 * step)
        return np.asarray(rate[:, None] * slopes)


def of_slope(function: Callable[[Floats], Floats], derivative: Callable[[Floats], Floats]) -> StateDiffusivity:
    """Return a(s), with its derivative."""
    return StateDiffusivity(_OfSlope(function), _zero, _OfSlope(derivative))


@dataclass(frozen=True, eq=False)
class _OfSlope:
    """A function of s alone, called with u and s."""

    function: Callable[[Floats], Floats]

    def __call__(self, u: Floats, s: Floats) -> Floats:
        return self.function(s) + 0 * u


def _zero(u: Floats) -> Floats:
    return np.zeros_like(u)


def _called(function: Callable[..., Any], u: Floats, s: Floats, points: Floats, what: str) -> Floats:
    """Return what a function of u, s and points, or of the first of them, gives, (k,).

    Raises
    ------
    InputError
        If it is not (k,) finite numbers.
    """
    parameters = inspect.signature(function).parameters.values()
    count = sum(one.default is one.empty and one.kind is not one.VAR_KEYWORD for one in parameters)
    found = np.asarray(function(*(u, s, points)[: min(max(count, 1), 3)]), dtype=np.float64)
    found = np.broadcast_to(found, u.shape) if found.ndim == 0 else found
    if found.shape != u.shape or not np.isfinite(found).all():
        raise InputError(
            f"{what} must return {len(u)} finite numbers for as many values of u, got shape {found.shape}"
            f"{'' if np.isfinite(found).all() else ' with NaN or infinity'}."
        )
    return found
