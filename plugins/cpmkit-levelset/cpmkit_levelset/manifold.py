"""The common zero set of one or two fields, with the derivatives that Newton's method uses.

One field gives the level set itself; phi and a trimming function together give the edge of an open piece.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cpmkit.plugin import Bools, Floats, dots, norms
from cpmkit_levelset.fields import Field
from cpmkit_levelset.manifold_kernels import correct_points, fill_corrections, fill_local_shapes

#: How often a point is moved by phi / |grad phi| on its way to the surface.
MOST_PROJECTIONS = 12
#: A point is on the surface when the last such move was shorter than this, relative to the size.
ON_SURFACE_SHARE = 1e-13


class LocalShape(NamedTuple):
    """The zero set around points of it: bases and shape operators.

    Attributes
    ----------
    tangents : (n, m, d) float64
        An orthonormal basis of the tangent space, m = d - number of fields.
    bending : (n, m, m) float64
        I + bending is, on the zero set and in that basis, the second derivative of half the squared distance to the
        query.
    force : (n, m) float64
        The tangential part of (query - point), in that basis.
    """

    tangents: Floats
    bending: Floats
    force: Floats


@dataclass(frozen=True)
class ZeroSet:
    """The points at which all ``fields`` vanish.

    Attributes
    ----------
    fields : tuple of one or two Field
        The functions.
    size : float
        The length that tolerances are relative to.
    """

    fields: tuple[Field, ...]
    size: float

    def project(self, p: Floats, reach: float) -> tuple[Floats, Bools]:
        """Return points (n, d) of the zero set near ``p`` (n, d), and (n,) whether the projection converged.

        Stage one of the search: p - phi grad phi / |grad phi|^2 again and again (of two fields, the shortest step after
        which both vanish to first order). It fails where the steps do not end, or lead farther than ``reach``, a
        length, away.
        """
        q, done = p.copy(), np.zeros(len(p), dtype=bool)
        rows = np.arange(len(p))
        for _ in range(MOST_PROJECTIONS):
            values, gradients = self._slopes(q[rows])
            rows = rows[: correct_points(q, done, rows, values, gradients, reach, ON_SURFACE_SHARE * self.size)]
            if not len(rows):
                break
        return q, done & (norms(q - p) <= reach)

    def distance_estimate(self, p: Floats) -> Floats:
        """Return (n,) the length of the first step of :meth:`project`, infinite where there is none."""
        step, length = np.empty(p.shape), np.empty(len(p))
        fill_corrections(*self._slopes(p), step, length)
        return np.where(np.isfinite(length), length, np.inf)

    def local_shape(self, x: Floats, y: Floats) -> LocalShape:
        """Return tangents, curvature and force of the zero set at ``y`` (n, d), seen from the queries ``x`` (n, d)."""
        jets = [field.jet(y) for field in self.fields]
        (n, d), m = y.shape, y.shape[1] - len(jets)
        shape = LocalShape(np.empty((n, m, d)), np.empty((n, m, m)), np.empty((n, m)))
        fill_local_shapes(
            x, y, _stack_arrays([jet[1] for jet in jets]), _stack_arrays([jet[2] for jet in jets]), *shape
        )
        return shape

    def _slopes(self, p: Floats) -> tuple[Floats, Floats]:
        """Return the values (f, n) and the gradients (f, n, d) of the fields."""
        pairs = [field.gradient(p) for field in self.fields]
        return _stack_arrays([pair[0] for pair in pairs]), _stack_arrays([pair[1] for pair in pairs])


def _stack_arrays(arrays: list[Floats]) -> Floats:
    """Stack one or two arrays along a new first axis, contiguously, as the kernels are compiled for."""
    return np.ascontiguousarray(arrays[0])[None] if len(arrays) == 1 else np.ascontiguousarray(np.stack(arrays))


def normal_basis(gradients: list[Floats]) -> list[Floats]:
    """Return orthonormal vectors (n, d), one for each gradient (n, d), that span them; NaN where they do not."""
    first = unit_or_nan(gradients[0])
    if len(gradients) == 1:
        return [first]
    return [first, unit_or_nan(gradients[1] - dots(gradients[1], first)[:, None] * first)]


def unit_or_nan(a: Floats) -> Floats:
    """Return the rows of ``a`` (n, d) scaled to length one; a vanishing row becomes NaN."""
    with np.errstate(all="ignore"):
        return a / norms(a)[:, None]
