"""Exact eigenvalues of -Lap on spheres and tori, for comparison with computed eigenvalues."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats

#: Number of wave numbers around the axis.
WAVE_NUMBERS = 20


def sphere_eigenvalues(count: int, radius: float = 1.0) -> Floats:
    """Return the first eigenvalues (count,) of a sphere, 400 at most: k (k + 1) / radius^2, each 2 k + 1 times."""
    k = np.arange(WAVE_NUMBERS)
    return np.repeat(k * (k + 1) / radius**2, 2 * k + 1)[:count]


def torus_eigenvalues(count: int, major: float = 1.0, minor: float = 0.4, nodes: int = 65) -> Floats:
    """Return the first eigenvalues (count,) of a torus with these radii, ascending, to about 1e-10.

    For each wave number around the axis, they solve a Sturm-Liouville problem in the angle around the tube, which
    trigonometric polynomials on ``nodes`` points, an odd number, discretise.
    """
    from scipy.linalg import eigh

    angle = 2 * np.pi * np.arange(nodes) / nodes
    radius = major + minor * np.cos(angle)
    waves = np.fft.fftfreq(nodes, 1 / nodes)[:, None]
    slope = np.real(np.fft.ifft(1j * waves * np.fft.fft(np.eye(nodes), axis=0), axis=0))
    found = []
    for m in range(WAVE_NUMBERS):
        energy = slope.T @ np.diag(radius / minor) @ slope + np.diag(m**2 * minor / radius)
        values = eigh(energy, np.diag(minor * radius), eigvals_only=True)[: nodes // 3]
        found.append(np.repeat(values, 1 if m == 0 else 2))
    return np.asarray(np.sort(np.concatenate(found))[:count])


def cube_eigenvalues(count: int) -> Floats:
    """Return the first eigenvalues (count,) of the unit cube without flux, 27 at most."""
    waves = np.indices((4, 4, 4)).reshape(3, -1)
    return np.asarray(np.sort(np.pi**2 * np.sum(waves**2, axis=0))[:count])


def ball_eigenvalues(count: int) -> Floats:
    """Return the first eigenvalues (count,) of the unit ball without flux, those below 49.

    They are squares of the extrema of spherical Bessel functions of order l, each 2 l + 1 times.
    """
    from scipy.optimize import brentq
    from scipy.special import spherical_jn

    found, steps = [0.0], np.linspace(0.1, 7.0, 200)
    for order in range(7):
        slopes = spherical_jn(order, steps, derivative=True)
        for k in np.flatnonzero(slopes[:-1] * slopes[1:] < 0):
            root = brentq(lambda x, order=order: spherical_jn(order, x, derivative=True), steps[k], steps[k + 1])
            found += [root**2] * (2 * order + 1)
    return np.sort(found)[:count]
