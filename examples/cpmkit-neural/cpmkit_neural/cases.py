"""Neural fields on which ``cpmkit.testing`` checks the laws: a trained one, and one known in closed form."""

from functools import cache
from pathlib import Path

import numpy as np

from cpmkit.plugin import ConformanceCase, Floats, unit
from cpmkit_neural.field import SineNetwork, read_network
from cpmkit_neural.source import NeuralSurface, neural_surface

SPOT_FILE = Path(__file__).with_name("spot.npz")


def conformance_cases() -> list[ConformanceCase]:
    """Return a case for the cow, and one with samples found without closest points."""
    return [
        ConformanceCase("neural.field", "Spot", spot),
        ConformanceCase("neural.field", "rounded cube", rounded_cube, samples=on_rounded_cube),
    ]


@cache  # the laws ask for the source again and again, and it is a value
def spot() -> NeuralSurface:
    """Return Spot the cow."""
    return neural_surface(*read_network(SPOT_FILE), resolution=64)


@cache
def rounded_cube() -> NeuralSurface:
    """Return the surface cos x + cos y + cos z = 2 around the origin: a network of one layer, written by hand."""
    network = SineNetwork((np.eye(3), -np.ones((3, 1))), (np.full(3, np.pi / 2), np.array([2.0])))
    return neural_surface(network, [[-1.7] * 3, [1.7] * 3], resolution=32)


def on_rounded_cube(rng: np.random.Generator, n: int) -> Floats:
    """Return points (n, 3) of it in random directions, by bisection."""
    direction = unit(rng.normal(size=(n, 3)))
    low, high = np.zeros((n, 1)), np.full((n, 1), 1.6)
    for _ in range(60):
        middle = 0.5 * (low + high)
        inside = np.cos(middle * direction).sum(axis=1, keepdims=True) > 2
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return low * direction
