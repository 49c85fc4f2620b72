"""A network phi(x) of sine layers: its value, gradient and Hessian, exact to round-off."""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.plugin import Floats, InputError

#: The six second derivatives in space: xx, xy, xz, yy, yz, zz.
HESSIAN_ROW, HESSIAN_COLUMN = np.triu_indices(3)


@dataclass(frozen=True, eq=False)
class SineNetwork:
    """phi(x) = h_m W_m + b_m, where h_0 = x and h_(k+1) = sin(h_k W_k + b_k).

    Attributes
    ----------
    weights : tuple of (inputs, outputs) float64
        W: the first has three inputs, the last has one output.
    biases : tuple of (outputs,) float64
        b.
    """

    weights: tuple[Floats, ...]
    biases: tuple[Floats, ...]

    def value(self, x: Floats) -> Floats:
        """Return phi (n,) at points (n, 3)."""
        value: Floats = self._jet(x, 1)[0]
        return value

    def gradient(self, x: Floats) -> tuple[Floats, Floats]:
        """Return phi (n,) and its gradient (n, 3)."""
        jet = self._jet(x, 4)
        return jet[0], jet[1:4].T

    def hessian(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Return phi (n,), its gradient (n, 3) and its Hessian (n, 3, 3)."""
        jet = self._jet(x, 10)
        hessian = np.empty((len(x), 3, 3))
        hessian[:, HESSIAN_ROW, HESSIAN_COLUMN] = hessian[:, HESSIAN_COLUMN, HESSIAN_ROW] = jet[4:].T
        return jet[0], jet[1:4].T, hessian

    def _jet(self, x: Floats, count: int) -> Floats:
        """Return (count, n) the first 1, 4 or 10 of: phi, its first derivatives, its second derivatives."""
        jet = np.zeros((count, len(x), 3))
        jet[0] = x
        if count > 1:
            jet[1:4] = np.eye(3)[:, None]
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            if k:
                jet = _sine(jet)
            jet = (jet.reshape(-1, len(weight)) @ weight).reshape(count, len(x), len(bias))
            jet[0] += bias
        return jet[:, :, 0]


def _sine(jet: Floats) -> Floats:
    """Return sin(jet) by the chain rule: (sin a)_ij = cos(a) a_ij - sin(a) a_i a_j."""
    half = np.tan(0.5 * jet[0])  # many times faster in NumPy than sin and cos
    share = 1 / (1 + half**2)
    sine, cosine = 2 * half * share, (1 - half**2) * share
    first = jet[1:4]
    result: Floats = cosine * jet
    result[0] = sine
    for k, i, j in zip(range(4, len(jet)), HESSIAN_ROW, HESSIAN_COLUMN, strict=False):
        result[k] -= sine * first[i] * first[j]
    return result


def read_network(file: str | Path) -> tuple[SineNetwork, Any]:
    """Return the network in a NumPy archive, and its array ``bounds``, or None if it has none.

    Raises
    ------
    InputError
        If the file is no such archive, or its weights and biases do not fit together.
    """
    try:
        with np.load(file, allow_pickle=False) as archive:
            arrays = {name: np.asarray(archive[name], dtype=np.float64) for name in archive.files}
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"{file} must be an .npz archive of numbers, as train.py writes it: {error}") from error
    layers = range(sum(name.startswith("weight") for name in arrays))
    weights = tuple(arrays.get(f"weight{k}", np.empty(0)) for k in layers)
    biases = tuple(arrays.get(f"bias{k}", np.empty(0)) for k in layers)
    shapes = [weight.shape for weight in weights]
    if not _fit(shapes, [bias.shape for bias in biases]):
        raise InputError(
            f"{file} must hold weight0, bias0, weight1, ... that lead from 3 coordinates to 1 value; "
            f"its weights have the shapes {shapes}."
        )
    return SineNetwork(weights, biases), arrays.get("bounds")


def _fit(weights: list[tuple[int, ...]], biases: list[tuple[int, ...]]) -> bool:
    """Return whether layers of these shapes can follow each other, from three numbers to one."""
    return (
        bool(weights)
        and all(len(shape) == 2 for shape in weights)
        and all(before[1] == after[0] for before, after in pairwise(weights))
        and biases == [shape[1:] for shape in weights]
        and (weights[0][0], weights[-1][1]) == (3, 1)
    )
