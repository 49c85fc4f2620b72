"""Smooth functions of space and rigid motions, of which exact solutions on curves and surfaces are made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Waves:
    """The function ``shift + sum_j a_j sin(w_j . x + b_j)`` of x (n, d).

    Parameters
    ----------
    amplitudes, phases : tuple of float
        a and b.
    waves : tuple of tuple of float
        One row w a term, of length d.
    shift : float
    """

    amplitudes: tuple[float, ...]
    waves: tuple[tuple[float, ...], ...]
    phases: tuple[float, ...]
    shift: float = 0.0

    def _angles(self, x: Any) -> Any:
        return np.atleast_2d(x) @ np.array(self.waves).T + np.array(self.phases)

    def value(self, x: Any) -> Any:
        """Return u (n,)."""
        return self.shift + np.sin(self._angles(x)) @ np.array(self.amplitudes)

    def gradient(self, x: Any) -> Any:
        """Return the gradient (n, d)."""
        return (np.cos(self._angles(x)) * np.array(self.amplitudes)) @ np.array(self.waves)

    def hessian(self, x: Any) -> Any:
        """Return second derivatives (n, d, d)."""
        w = np.array(self.waves)
        return np.einsum("nj,jk,jl->nkl", -np.sin(self._angles(x)) * np.array(self.amplitudes), w, w)


@dataclass(frozen=True)
class Linear:
    """The function ``w . x``."""

    way: tuple[float, ...]

    def value(self, x: Any) -> Any:
        """Return u (n,)."""
        return np.asarray(x) @ np.array(self.way)

    def gradient(self, x: Any) -> Any:
        """Return the gradient (n, d)."""
        return np.tile(self.way, (len(x), 1))

    def hessian(self, x: Any) -> Any:
        """Return second derivatives, zero."""
        return np.zeros((len(x), len(self.way), len(self.way)))


@dataclass(frozen=True)
class BoxModes:
    """The function ``height (cos pi x + cos pi y + cos pi z)``, whose slopes vanish across the edges of [-1, 1]^3."""

    height: float

    def value(self, x: Any) -> Any:
        """Return u (n,)."""
        return self.height * np.cos(np.pi * x).sum(axis=1)

    def gradient(self, x: Any) -> Any:
        """Return the gradient (n, 3)."""
        return -self.height * np.pi * np.sin(np.pi * x)

    def hessian(self, x: Any) -> Any:
        """Return second derivatives (n, 3, 3)."""
        return -self.height * np.pi**2 * np.cos(np.pi * x)[:, :, None] * np.eye(3)


@dataclass(frozen=True)
class Sum:
    """The sum of two functions."""

    first: Any
    second: Any

    def value(self, x: Any) -> Any:
        """Return u (n,)."""
        return self.first.value(x) + self.second.value(x)

    def gradient(self, x: Any) -> Any:
        """Return the gradient (n, d)."""
        return self.first.gradient(x) + self.second.gradient(x)

    def hessian(self, x: Any) -> Any:
        """Return second derivatives (n, d, d)."""
        return self.first.hessian(x) + self.second.hessian(x)


@dataclass(frozen=True)
class Place:
    """The similarity ``x = translation + scale * rotation @ y``; ``turn`` is a rotation vector, an angle in the plane.

    Parameters
    ----------
    turn : tuple of float
        Of length 3 in space and 1 in the plane.
    translation : tuple of float
    scale : float
    """

    turn: tuple[float, ...]
    translation: tuple[float, ...]
    scale: float = 1.0

    @property
    def matrix(self) -> Any:
        """The rotation (d, d)."""
        if len(self.turn) == 3:
            return Rotation.from_rotvec(self.turn).as_matrix()
        cos, sin = np.cos(self.turn[0]), np.sin(self.turn[0])
        return np.array([[cos, -sin], [sin, cos]])

    def world(self, y: Any) -> Any:
        """Return points (n, d) of the scene, from local ones."""
        return np.asarray(y) @ (self.scale * self.matrix.T) + np.array(self.translation)

    def local(self, x: Any) -> Any:
        """Return local points (n, d)."""
        return (np.asarray(x) - np.array(self.translation)) @ self.matrix / self.scale

    def direction(self, v: Any) -> Any:
        """Return directions (n, d) of the scene, from local ones."""
        return np.asarray(v) @ self.matrix.T

    @property
    def keys(self) -> dict[str, Any]:
        """The keys of a source that is moved so."""
        turn = list(self.turn) if len(self.turn) == 3 else self.turn[0]
        return {"rotation": turn, "translation": list(self.translation), "scale": self.scale}
