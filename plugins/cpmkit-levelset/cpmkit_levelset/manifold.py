"""The common zero set of one or two fields, with what Newton's method needs to know of it at a point.

One field gives the level set itself; phi and a trimming function together give the edge of an open piece.
Sums are written out by components, so that a point's answer never depends on the batch it is asked in.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cpmkit.plugin import Bools, Floats, dots, norms
from cpmkit_levelset.fields import Field

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
        Seen from the query the squared distance bends like I plus this.
    force : (n, m) float64
        The tangential part of (query - point), in that basis.
    """

    tangents: Floats
    bending: Floats
    force: Floats


@dataclass(frozen=True)
class ZeroSet:
    """Where all ``fields`` vanish.

    Attributes
    ----------
    fields : tuple of one or two Field
    size : float
        The length that tolerances are relative to.
    """

    fields: tuple[Field, ...]
    size: float

    def project(self, p: Floats, reach: float) -> tuple[Floats, Bools]:
        """Return points (n, d) of the zero set near ``p``, and where that succeeded.

        Stage one of the search: p - phi grad phi / |grad phi|^2 again and again (of two fields, the shortest step
        that kills both to first order). It fails where the steps do not end, or lead farther than ``reach`` away.
        """
        q, done = p.copy(), np.zeros(len(p), dtype=bool)
        rows = np.arange(len(p))
        for _ in range(MOST_PROJECTIONS):
            step = self._correction(q[rows])
            length = norms(step)
            fine = length <= reach  # False for NaN
            q[rows[fine]] -= step[fine]
            ended = length <= ON_SURFACE_SHARE * self.size
            done[rows[ended]] = True
            rows = rows[fine & ~ended]
            if not len(rows):
                break
        return q, done & (norms(q - p) <= reach)

    def distance_estimate(self, p: Floats) -> Floats:
        """Return (n,) the length of the first step of :meth:`project`, infinite where there is none."""
        length = norms(self._correction(p))
        return np.where(np.isfinite(length), length, np.inf)

    def shape(self, x: Floats, y: Floats) -> LocalShape:
        """Return how the zero set lies at ``y`` (n, d), seen from the queries ``x`` (n, d)."""
        jets = [field.jet(y) for field in self.fields]
        gradients = [jet[1] for jet in jets]
        tangents = tangent_basis(gradients)
        across = x - y
        with np.errstate(all="ignore"):
            multipliers = _combination(gradients, [dots(across, g) for g in gradients])
            hessian = sum(m[:, None, None] * jet[2] for m, jet in zip(multipliers, jets, strict=True))
            bending = np.einsum("nai,nij,nbj->nab", tangents, hessian, tangents, optimize=False)
            force = np.einsum("nai,ni->na", tangents, across, optimize=False)
        return LocalShape(tangents, bending, force)

    def _correction(self, p: Floats) -> Floats:
        pairs = [field.gradient(p) for field in self.fields]
        gradients = [pair[1] for pair in pairs]
        with np.errstate(all="ignore"):
            weights = _combination(gradients, [pair[0] for pair in pairs])
            step: Floats = sum((w[:, None] * g for w, g in zip(weights, gradients, strict=True)), np.zeros_like(p))
        return step


def _combination(gradients: list[Floats], values: list[Floats]) -> list[Floats]:
    """Return weights w (n,), one a field, such that v = sum w_k grad_k has grad_k . v = values_k."""
    if len(gradients) == 1:
        (g,), (value,) = gradients, values
        return [value / dots(g, g)]
    (g, h), (first, second) = gradients, values
    a, b, c = dots(g, g), dots(g, h), dots(h, h)
    determinant = a * c - b * b
    return [(c * first - b * second) / determinant, (a * second - b * first) / determinant]


def tangent_basis(gradients: list[Floats]) -> Floats:
    """Return (n, m, d) orthonormal vectors at right angles to the gradients (n, d)."""
    n, d = gradients[0].shape
    with np.errstate(all="ignore"):
        if d == 2 and len(gradients) == 2:
            return np.empty((n, 0, d))
        if d == 2:
            x, y = unit_or_nan(gradients[0]).T
            return np.stack([-y, x], axis=1)[:, None]
        if len(gradients) == 2:
            return unit_or_nan(cross(*gradients))[:, None]
        normal = unit_or_nan(gradients[0])
        helper = np.zeros_like(normal)
        helper[np.arange(n), np.abs(normal).argmin(axis=1)] = 1.0
        first = unit_or_nan(cross(normal, helper))
        return np.stack([first, cross(normal, first)], axis=1)


def normal_basis(gradients: list[Floats]) -> list[Floats]:
    """Return orthonormal vectors (n, d), one a gradient, that span the gradients (n, d)."""
    first = unit_or_nan(gradients[0])
    if len(gradients) == 1:
        return [first]
    return [first, unit_or_nan(gradients[1] - dots(gradients[1], first)[:, None] * first)]


def unit_or_nan(a: Floats) -> Floats:
    """Return the rows scaled to length one; a vanishing row becomes NaN."""
    with np.errstate(all="ignore"):
        return a / norms(a)[:, None]


def cross(a: Floats, b: Floats) -> Floats:
    """Return the cross products (n, 3) of the rows."""
    x, y, z = a.T
    u, v, w = b.T
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=1)
