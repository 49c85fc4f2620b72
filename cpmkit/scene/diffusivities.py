"""Diffusivities: numbers, tensors, functions of points, and functions of the solution.

A tensor is a symmetric (d, d) array, d lists of d numbers or functions of points, or a function of points (n, d) that
returns (n, d, d). Only its restriction to the tangent space of the manifold is used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import InputError, SceneError, place, shown
from cpmkit.runtime.arrays import positive
from cpmkit.scene.data import DIFFERENCE_SHARE, Data, call_pointwise, central_difference, evaluate_data
from cpmkit.types import Floats

#: Shapes of tensors in the plane and in space.
TENSOR_SHAPES = ((2, 2), (3, 3))
#: Two values whose logarithms differ by less belong to the same material, and are extrapolated to a boundary.
SAME_MATERIAL_LOG_RATIO = 0.4
#: A condition's conductivity may differ by this share from the problem's diffusivity, and by more at this share of the
#: points of a boundary: near other boundaries it may be evaluated in the wrong zone.
DIFFUSIVITY_MISMATCH_SHARE, MISREAD_POINTS_SHARE = 0.01, 0.1


@dataclass(frozen=True)
class TensorOfEntries:
    """A tensor whose entries are numbers or functions of points, row by row."""

    rows: tuple[tuple[Data, ...], ...]

    def __call__(self, points: Floats) -> Floats:
        """Return the tensors (n, d, d) at points (n, d)."""
        return np.stack([evaluate_data(row, points, len(row), "a row of a tensor") for row in self.rows], axis=1)


def as_diffusivity(value: Any, label: str) -> Any:
    """Return a checked diffusivity: a number or function unchanged, a tensor as a read-only (d, d) array or a function.

    Raises InputError if a number is not above zero, a tensor is not 2 by 2 or 3 by 3, or a constant tensor is not
    symmetric or not finite; ``label`` is the name of the diffusivity in the message.
    """
    if callable(value):
        return value
    if np.ndim(np.asarray(value, dtype=object)) == 0:
        positive(value, label)
        return value
    rows = [list(row) if np.ndim(np.asarray(row, dtype=object)) else [row] for row in value]
    if (len(rows), *{len(row) for row in rows}) not in TENSOR_SHAPES:
        raise InputError(
            f"{label} must be a number above zero, a function of points such as ck.VertexData(surface, values), or a "
            f"symmetric tensor of 2 by 2 or 3 by 3 entries, got {shown(value)}."
        )
    entries = TensorOfEntries(tuple(map(tuple, rows)))
    if any(callable(entry) for row in rows for entry in row):
        return entries
    tensor = _symmetric(entries(np.zeros((1, len(rows)))), label)[0]
    tensor.flags.writeable = False
    return tensor


def evaluate_diffusivity(diffusivity: Any, points: Floats, label: str) -> Floats:
    """Return the values of a diffusivity at ``points`` (n, d): numbers (n,), or symmetric tensors (n, d, d).

    It is a number, a (d, d) array or a function; ``label`` is its name in messages. Tensors may be read-only. Raises
    InputError if a value is not finite, the values have other shapes, or a tensor is not symmetric.
    """
    values = diffusivity(points) if callable(diffusivity) else diffusivity
    if np.ndim(values) < 2 or (callable(diffusivity) and np.ndim(values) != 3):
        data: Data = (lambda _: values) if callable(diffusivity) else values
        return evaluate_data(data, points, 1, label)[:, 0]
    n, d = points.shape
    tensors = np.asarray(values, dtype=np.float64)
    if tensors.shape not in ((d, d), (n, d, d)):
        raise InputError(
            f"{label} must be numbers or tensors of shape ({n}, {d}, {d}) at {n} points in {d}D, got {tensors.shape}."
        )
    return np.broadcast_to(_symmetric(tensors, label), (n, d, d))


def mean_diffusivity(diffusivity: Any, points: Floats) -> float:
    """Return the mean of a diffusivity over ``points`` (n, d); for a tensor, the mean of its d eigenvalues."""
    values = evaluate_diffusivity(diffusivity, points, "the diffusivity")
    return float(np.trace(values, axis1=1, axis2=2).mean() / points.shape[1] if values.ndim == 3 else values.mean())


def principal_diffusivities(tensors: Floats, normals: Floats) -> tuple[Floats, Floats]:
    """Return the smallest (n,) and the largest (n,) eigenvalue of diffusivity tensors restricted to the tangent space.

    ``tensors`` (n, d, d) are symmetric, ``normals`` (n, c, d) the orthonormal normals, of which a solid has none.
    """
    if not normals.shape[1]:
        values: Floats = np.asarray(np.linalg.eigvalsh(tensors), dtype=np.float64)
        return values[:, 0], values[:, -1]
    tangent = np.eye(tensors.shape[1]) - np.einsum("nci,ncj->nij", normals, normals)
    restricted = tangent @ tensors @ tangent
    trace = np.trace(restricted, axis1=1, axis2=2)
    squares = np.einsum("nij,nji->n", restricted, restricted)
    if tensors.shape[1] - normals.shape[1] == 1:
        return trace, trace
    root = np.sqrt(np.maximum(2 * squares - trace**2, 0.0))
    return 0.5 * (trace - root), 0.5 * (trace + root)


def _symmetric(tensors: Floats, label: str) -> Floats:
    """Return the symmetric part of ``tensors`` (..., d, d).

    Raises InputError if an entry is not finite, or a tensor is not symmetric to 1e-9 of the largest entry; ``label`` is
    its name in the message.
    """
    if not np.isfinite(tensors).all():
        raise InputError(f"{label} must be finite, got NaN or infinity.")
    transposed = np.swapaxes(tensors, -1, -2)
    off, size = np.abs(tensors - transposed).max(initial=0.0), np.abs(tensors).max(initial=0.0)
    if off > 1e-9 * size:  # more than rounding
        raise InputError(
            f"{label} must be a symmetric tensor, got entries across the diagonal that differ by {off:.3g}; of an "
            "unsymmetric one give the symmetric part, and what the rest carries as a velocity."
        )
    return np.asarray(0.5 * (tensors + transposed))


@dataclass(frozen=True, eq=False)
class StateDiffusivity:
    """A diffusivity a(u, s, points) that depends on u and the norm s of its tangential gradient, with derivatives."""

    function: Callable[..., Any]  #: a of u (k,); or of u and s; or of u, s and points (k, d): returns (k,).
    #: by_value, by_slope: Its derivatives with respect to u and to s, of the same arguments; finite differences by
    #: default.
    by_value: Callable[..., Any] | None = None
    by_slope: Callable[..., Any] | None = None
    #: Distinguishes this diffusivity from functions of points.
    needs_state: ClassVar[bool] = True

    def __call__(self, points: Floats) -> Floats:
        """Raise SceneError, as a is not a function of points alone."""
        del points
        raise SceneError("the diffusivity depends on u, and is not known before u is; use cpmkit.solve.")

    def evaluate(self, u: Floats, slopes: Floats, points: Floats) -> Floats:
        """Return a (k,) at ``points`` (k, d) where u is (k,) and its tangential gradient is ``slopes`` (k, d)."""
        return self._values(self.function, u, np.linalg.norm(slopes, axis=1), points)

    def flux_derivative_by_gradient(self, u: Floats, slopes: Floats, points: Floats) -> Floats:
        """Return the derivative (k, d, d) of a grad u with respect to grad u: the tensors a I + s da/ds e e^T.

        Here s is the norm of grad u, and e = grad u / s, zero where s is zero. The eigenvalue a + s da/ds along e is
        raised to a / 1000 where it is smaller, so that the tensor stays positive. The arguments are those of
        :meth:`evaluate`.
        """
        s = np.linalg.norm(slopes, axis=1)
        a = self._values(self.function, u, s, points)
        if self.by_slope is not None:
            slope = self._values(self.by_slope, u, s, points, " by the slope")
        else:
            step = DIFFERENCE_SHARE * (s + DIFFERENCE_SHARE * (s.max(initial=0.0) or 1.0))
            slope = central_difference(lambda varied: self._values(self.function, u, varied, points), s, step)
        along = np.maximum(s * slope, (1e-3 - 1) * a)
        e = slopes / np.maximum(s, np.finfo(float).tiny)[:, None]
        squares = e[:, :, None] * e[:, None, :]
        return np.asarray(a[:, None, None] * np.eye(slopes.shape[1]) + along[:, None, None] * squares)

    def flux_derivative_by_value(self, u: Floats, slopes: Floats, points: Floats) -> Floats:
        """Return the derivative (k, d) of a grad u with respect to u, da/du grad u; arguments as for `evaluate`."""
        s = np.linalg.norm(slopes, axis=1)
        if self.by_value is not None:
            rate = self._values(self.by_value, u, s, points, " by u")
        else:
            rate = central_difference(lambda varied: self._values(self.function, varied, s, points), u)
        return np.asarray(rate[:, None] * slopes)

    @staticmethod
    def _values(function: Callable[..., Any], u: Floats, s: Floats, points: Floats, derivative: str = "") -> Floats:
        """Return the values (k,) of a function of u (k,), of u and s (k,), or of u, s and ``points`` (k, d).

        ``derivative``, such as " by u", names a derivative in messages. Raises InputError if values are not finite
        numbers (k,).
        """
        label = f"the derivative of the diffusivity{derivative}" if derivative else "the diffusivity"
        return call_pointwise(function, (u, s, points), u.shape, label)


def zero_derivative(u: Floats) -> Floats:
    """Return zero for each value u (k,): the derivative by u of a diffusivity that does not depend on u."""
    return np.zeros_like(u)


def check_conductivity(label: str, side: str, given: Floats, diffusivities: Sequence[Floats], points: Floats) -> None:
    """Raise SceneError if the conductivity ``given`` (n,) on a side of a boundary is not the problem's diffusivity.

    At all but a tenth of the ``points`` (n, d), in the scene's coordinates, it must be within 1 % of one of the
    ``diffusivities`` (n,) read there, the last of which is named in the error, as are ``label`` and ``side``.
    """
    mismatch = np.min([np.abs(given / values - 1) for values in diffusivities], axis=0)
    if np.mean(mismatch > DIFFUSIVITY_MISMATCH_SHARE) > MISREAD_POINTS_SHARE:
        worst = int(mismatch.argmax())
        raise SceneError(
            f"{label} gives the conductivity {given[worst]:.4g} on its {side} near {place(points[worst])}, where the "
            f"problem's diffusivity is {diffusivities[-1][worst]:.4g}; leave `{side}` out, or give the problem that "
            "diffusivity."
        )
