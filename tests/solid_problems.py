"""A smooth solution in all of the plane or of space, for problems on solids."""

import numpy as np

from cpmkit.types import Floats


def third(x: Floats) -> Floats:
    """Return the third coordinates (n,) of points (n, 3), or .3 for points of the plane."""
    return x[:, 2] if x.shape[1] == 3 else np.full(len(x), 0.3)


def u(x: Floats) -> Floats:
    return np.asarray(x[:, 0] ** 2 * x[:, 1] + np.sin(x[:, 0]) * np.cos(third(x)))


def gradient(x: Floats) -> Floats:
    wave = np.cos(x[:, 0]) * np.cos(third(x)), -np.sin(x[:, 0]) * np.sin(third(x))
    return np.stack([2 * x[:, 0] * x[:, 1] + wave[0], x[:, 0] ** 2, wave[1]], axis=1)[:, : x.shape[1]]


def f(x: Floats) -> Floats:
    """Minus the Laplacian of u, plus u."""
    return np.asarray((x.shape[1] - 1) * np.sin(x[:, 0]) * np.cos(third(x)) - 2 * x[:, 1] + u(x))
