"""Diffusivities that are tensors: u flows more easily along some directions than along others.

A tensor is given as a symmetric (d, d) array, as d lists of d numbers or functions of points, or as a function of
points (n, d) that returns (n, d, d). Only its part between tangents of the manifold counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.protocols import Floats
from cpmkit.runtime.arrays import positive
from cpmkit.scene.data import Data, evaluate_data

#: Shapes of tensors.
TENSOR_SHAPES = ((2, 2), (3, 3))
#: Entries across the diagonal may differ by this share of the largest: they were computed one by one.
UNSYMMETRIC_SHARE = 1e-9


@dataclass(frozen=True)
class TensorOfEntries:
    """A tensor whose entries are numbers or functions of points, row by row."""

    rows: tuple[tuple[Data, ...], ...]

    def __call__(self, points: Floats) -> Floats:
        """Return the tensors (n, d, d) at points (n, d)."""
        entries = [evaluate_data(list(row), points, len(row), "a row of a tensor") for row in self.rows]
        return np.stack(entries, axis=1)


def diffusivity_of(given: Any, what: str) -> Any:
    """Return a diffusivity as equations keep it: a number, a (d, d) array, or a function of points.

    Raises
    ------
    InputError
        If a number is not above zero, or a tensor not square, symmetric and finite.
    """
    if callable(given):
        return given
    if not isinstance(given, (list, tuple, np.ndarray)) or np.ndim(np.asarray(given, dtype=object)) == 0:
        positive(given, what)
        return given
    rows = [list(row) if isinstance(row, (list, tuple, np.ndarray)) else [row] for row in given]
    if (len(rows), *{len(row) for row in rows}) not in TENSOR_SHAPES:
        raise InputError(
            f"{what} must be a number above zero, a function of points such as ck.VertexData(surface, values), or a "
            f"symmetric tensor of 2 by 2 or 3 by 3 entries, got {shown(given)}."
        )
    if any(callable(entry) for row in rows for entry in row):
        return TensorOfEntries(tuple(map(tuple, rows)))
    constant = TensorOfEntries(tuple(map(tuple, rows)))(np.zeros((1, len(rows))))
    tensor = _symmetric(constant, what)[0]
    tensor.flags.writeable = False
    return tensor


def is_tensor(diffusivity: Any, points: Floats) -> bool:
    """Tell whether a diffusivity is a tensor; a function of points is asked for its value at ``points`` (n, d)."""
    if getattr(diffusivity, "needs_state", False):
        return False
    return bool(np.ndim(diffusivity(points) if callable(diffusivity) else diffusivity) > 1 + callable(diffusivity))


def evaluate_diffusivity(diffusivity: Any, points: Floats, what: str) -> Floats:
    """Return a diffusivity at ``points`` (n, d): (n,) numbers or (n, d, d) symmetric tensors.

    Raises
    ------
    InputError
        If it is not finite, of another shape, or a tensor is not symmetric.
    """
    values = diffusivity(points) if callable(diffusivity) else diffusivity
    if np.ndim(values) < 2 or (callable(diffusivity) and np.ndim(values) != 3):
        known: Data = (lambda _: values) if callable(diffusivity) else values
        return evaluate_data(known, points, 1, what)[:, 0]
    n, d = points.shape
    tensors = np.asarray(values, dtype=np.float64)
    if tensors.shape not in ((d, d), (n, d, d)):
        raise InputError(
            f"{what} must be numbers or tensors of shape ({n}, {d}, {d}) at {n} points in {d}D, got {tensors.shape}."
        )
    return np.broadcast_to(_symmetric(tensors, what), (n, d, d))


def size_of(diffusivity: Any, points: Floats) -> float:
    """Return the mean of a diffusivity over ``points`` (n, d), of a tensor that of its eigenvalues."""
    values = evaluate_diffusivity(diffusivity, points, "the diffusivity")
    return float(np.trace(values, axis1=1, axis2=2).mean() / points.shape[1] if values.ndim == 3 else values.mean())


def principal_values(tensors: Floats, normals: Floats) -> tuple[Floats, Floats]:
    """Return the smallest and the largest eigenvalue (n,) of tensors between tangents.

    Parameters
    ----------
    tensors : (n, d, d) float64
        Symmetric.
    normals : (n, c, d) float64
        Orthonormal; of a curve or a surface.
    """
    tangent = np.eye(tensors.shape[1]) - np.einsum("nci,ncj->nij", normals, normals)
    seen = tangent @ tensors @ tangent
    trace, squares = np.trace(seen, axis1=1, axis2=2), np.einsum("nij,nji->n", seen, seen)
    if tensors.shape[1] - normals.shape[1] == 1:
        return trace, trace
    root = np.sqrt(np.maximum(2 * squares - trace**2, 0.0))
    return 0.5 * (trace - root), 0.5 * (trace + root)


def _symmetric(tensors: Floats, what: str) -> Floats:
    """Return the tensors (..., d, d), made symmetric to the last bit."""
    if not np.isfinite(tensors).all():
        raise InputError(f"{what} must be finite, got NaN or infinity.")
    across: Sequence[int] = (*range(tensors.ndim - 2), -1, -2)
    turned = np.transpose(tensors, [axis % tensors.ndim for axis in across])
    off, size = np.abs(tensors - turned).max(initial=0.0), np.abs(tensors).max(initial=0.0)
    if off > UNSYMMETRIC_SHARE * size:
        raise InputError(
            f"{what} must be a symmetric tensor, got entries across the diagonal that differ by {off:.3g}; of an "
            "unsymmetric one give the symmetric part, and what the rest carries as a velocity."
        )
    return np.asarray(0.5 * (tensors + turned))
