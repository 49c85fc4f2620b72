"""Fields: functions of position with their first two derivatives, whose zeros are level sets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from cpmkit.plugin import Floats, InputError, norms

#: Step of the central differences that replace a missing Hessian, relative to the size of the bounds.
HESSIAN_STEP_SHARE = 1e-5
#: The same for a missing gradient: rounding of phi leaves about 1e-12 of it, and bends of a tenth of the size 1e-11.
GRADIENT_STEP_SHARE = 2e-4


class Field(Protocol):
    """A function phi of points (n, d)."""

    @property
    def dim(self) -> int:
        """Dimension of the space."""

    def value(self, p: Floats) -> Floats:
        """Return phi (n,) at points ``p`` (n, d)."""

    def gradient(self, p: Floats) -> tuple[Floats, Floats]:
        """Return phi (n,) and its gradient (n, d) at points ``p`` (n, d)."""

    def jet(self, p: Floats) -> tuple[Floats, Floats, Floats]:
        """Return phi (n,), its gradient (n, d) and its Hessian (n, d, d) at points ``p`` (n, d)."""


@dataclass(frozen=True)
class FunctionField:
    """Functions that the user wrote.

    Attributes
    ----------
    dim : int
    phi, phi_gradient : callable
        Of points (n, d): they return (n,) and (n, d).
    phi_hessian : callable or None
        Returns (n, d, d). None: fourth-order central differences of the gradient; a Hessian off by 1e-9 costs
        Newton's method nothing, and the foot is decided by the gradient alone.
    step : float
        Of these differences, a length.
    """

    dim: int
    phi: Callable[[Floats], Any]
    phi_gradient: Callable[[Floats], Any]
    phi_hessian: Callable[[Floats], Any] | None
    step: float

    def value(self, p: Floats) -> Floats:
        """Return phi (n,) at points ``p`` (n, d)."""
        return _evaluate(self.phi, "phi", p, ())

    def gradient(self, p: Floats) -> tuple[Floats, Floats]:
        """Return phi (n,) and its gradient (n, d) at points ``p`` (n, d)."""
        return self.value(p), _evaluate(self.phi_gradient, "gradient", p, (self.dim,))

    def jet(self, p: Floats) -> tuple[Floats, Floats, Floats]:
        """Return phi (n,), its gradient (n, d) and its Hessian (n, d, d) at points ``p`` (n, d)."""
        if self.phi_hessian is not None:
            return *self.gradient(p), _evaluate(self.phi_hessian, "hessian", p, (self.dim, self.dim))
        return *self.gradient(p), self._hessian_differences(p)

    def _hessian_differences(self, p: Floats) -> Floats:
        """Return the Hessian (n, d, d) at ``p`` (n, d) by fourth-order differences of the gradient, made symmetric."""
        columns = []
        for axis in np.eye(self.dim):
            near, far = (
                self.gradient(p + k * self.step * axis)[1] - self.gradient(p - k * self.step * axis)[1] for k in (1, 2)
            )
            columns.append((8 * near - far) / (12 * self.step))
        hessian = np.stack(columns, axis=2)
        symmetric: Floats = 0.5 * (hessian + hessian.transpose(0, 2, 1))
        return symmetric


@dataclass(frozen=True)
class Differences:
    """The gradient of a function by fourth-order central differences, where the user wrote none.

    Attributes
    ----------
    phi : callable
        Of points (n, d), returns (n,).
    dim : int
    step : float
        A length.
    """

    phi: Callable[[Floats], Any]
    dim: int
    step: float

    def __call__(self, p: Floats) -> Floats:
        """Return the gradient (n, d) at points ``p`` (n, d)."""
        return self.difference_gradient(p, self.step)

    def difference_gradient(self, p: Floats, step: float) -> Floats:
        """Return the gradient (n, d) at ``p`` (n, d) by fourth-order differences, which reach two lengths ``step``."""
        columns = []
        for axis in np.eye(self.dim):
            near, far = (
                _evaluate(self.phi, "phi", p + k * step * axis, ())
                - _evaluate(self.phi, "phi", p - k * step * axis, ())
                for k in (1, 2)
            )
            columns.append((8 * near - far) / (12 * step))
        return np.stack(columns, axis=1)

    def errors(self, p: Floats) -> Floats:
        """Return (n,) the relative change of the gradient at ``p`` (n, d) if the step is halved; inf if NaN."""
        coarse, finer = self(p), self.difference_gradient(p, self.step / 2)
        with np.errstate(all="ignore"):
            off = norms(coarse - finer) / norms(finer)
        return np.nan_to_num(off, nan=np.inf)


def _evaluate(function: Callable[[Floats], Any], label: str, p: Floats, shape: tuple[int, ...]) -> Floats:
    """Return ``function`` at a copy of points ``p`` (n, d), as float64 of shape (n, *shape).

    Raise InputError, which names ``label``, if it returns another shape or no numbers, or raises TypeError or
    ValueError.
    """
    try:
        values = np.array(function(p.copy()), dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise InputError(f"{label} must return numbers of shape {_format_shape(shape)}: {error}.") from error
    if values.shape != (len(p), *shape):
        raise InputError(
            f"{label} must return shape {_format_shape(shape)} for points (n, {p.shape[1]}), "
            f"got {values.shape} for {len(p)} points."
        )
    return values


def _format_shape(shape: tuple[int, ...]) -> str:
    return f"(n, {', '.join(map(str, shape))})" if shape else "(n,)"


def check_gradient(field: FunctionField, box: Floats) -> None:
    """Compare the user's gradient with differences of phi at 64 random points of ``box`` (2, d).

    Raise InputError if they disagree by a thousandth at more than half of the points: it is not the gradient of phi.
    """
    p = np.random.default_rng(0).uniform(box[0], box[1], (64, field.dim))
    given = field.gradient(p)[1]
    steps = field.step * np.eye(field.dim)
    differences = np.stack([(field.value(p + s) - field.value(p - s)) / (2 * field.step) for s in steps], axis=1)
    with np.errstate(invalid="ignore"):
        off = np.abs(given - differences).max(axis=1) > 1e-3 * np.abs(differences).max(axis=1)
    if off.mean() > 0.5:
        worst = int(np.flatnonzero(off)[0])
        raise InputError(
            f"gradient must be that of phi: at {p[worst].tolist()} it returns {given[worst].tolist()}, "
            f"differences of phi give {differences[worst].tolist()}."
        )
