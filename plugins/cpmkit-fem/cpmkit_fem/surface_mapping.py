"""Triangles in the plane or in space for scikit-fem, whose own mappings want square Jacobians.

This module alone imports scikit-fem; it is imported where matrices are assembled.
"""

from __future__ import annotations

import numpy as np
from skfem.mapping import Mapping

from cpmkit.plugin import Floats, Ints


class SurfaceMapping(Mapping):  # type: ignore[misc]  # scikit-fem ships types that strict checks refuse
    """The affine map of the reference triangle onto each triangle of a mesh.

    Every Jacobian J (d, 2) is split into Q R with orthonormal columns Q: R is the triangle unfolded into
    the plane. ``R^-1 Q'`` is then the pseudo-inverse, so gradients come out tangential, and ``det R``
    twice the area. Unlike the metric J'J it does not square the condition number of thin triangles.

    Parameters
    ----------
    points : (d, v) float64
        Vertices, d = 2 or 3, in scikit-fem's layout.
    triangles : (3, m) int
    """

    def __init__(self, points: Floats, triangles: Ints) -> None:
        self.dim = 2
        self._corner = points[:, triangles[0]]
        first, second = (points[:, triangles[k]] - self._corner for k in (1, 2))
        self._jacobian = np.stack([first, second], axis=1)
        self._determinant, self._inverse = _unfold(first, second)

    def F(self, X: Floats, tind: Ints | None = None) -> Floats:
        """Return the images (d, m, q) of the reference points ``X`` (2, q)."""
        pick = slice(None) if tind is None else tind
        images: Floats = self._corner[:, pick, None] + np.einsum("aim,iq->amq", self._jacobian[:, :, pick], X)
        return images

    def DF(self, X: Floats, tind: Ints | None = None) -> Floats:
        """Return the Jacobians (d, 2, m, q)."""
        return _at_points(self._jacobian, X, tind)

    def detDF(self, X: Floats, tind: Ints | None = None) -> Floats:
        """Return the factors of area (m, q)."""
        return _at_points(self._determinant, X, tind)

    def invDF(self, X: Floats, tind: Ints | None = None) -> Floats:
        """Return the pseudo-inverses (2, d, m, q) of the Jacobians."""
        return _at_points(self._inverse, X, tind)


def _unfold(first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Return det R (m,) and R^-1 Q' (2, d, m) of the Jacobians with the columns ``first`` and ``second`` (d, m)."""
    along = np.linalg.norm(first, axis=0)
    axis = first / along
    shear = np.sum(axis * second, axis=0)
    height = second - shear * axis
    height -= np.sum(axis * height, axis=0) * axis  # once more: thin triangles lose the right angle at first
    across = np.linalg.norm(height, axis=0)
    normal = height / across
    inverse = np.stack([(axis - (shear / across) * normal) / along, normal / across])
    return along * across, inverse


def _at_points(constant: Floats, X: Floats, tind: Ints | None) -> Floats:
    """Return an array (..., m), constant on each triangle, at the reference points: (..., m, q)."""
    picked = constant if tind is None else constant[..., tind]
    return np.broadcast_to(picked[..., None], (*picked.shape, X.shape[-1]))
