"""The terms of junctions between members of different dimension, in the unknowns of both.

Let u belong to the members of higher dimension and v to those of lower dimension. Where a curve lies on a surface, or a
surface on the boundary of a solid, each side of the junction has the condition ``u + R q = v``: q = a du/db is the flux
out of the side, R the resistance. It is imposed by Nitsche's method as a condition on one side is, with v in place of
the datum (see :mod:`cpmkit.forms.galerkin.conditions.nitsche`). A sample of weight s adds, with g = w / (B a),

    s/(R + g) (u - v)(u' - v') - s g/(R + g) (q (u' - v') + q' (u - v)) - s R g/(R + g) q q'

for test functions u', v': symmetric, zero for constants, and what leaves u arrives in v.

Where a curve meets a surface at a point, u grows like ``-log(distance)``. Let m(u) be the sum of w_i m_i(u), m_i the
mean of u over a circle of radius p_i around the point. The curve's value v is tied to it by
``(m(u) - v)(m(u') - v') / R'``. What flows enters the surface at the circles, so that m of its own potential is that at
the distance exp(L), ``L = sum_ij w_i w_j log max(p_i, p_j)``. With r, the radius of the cross section of the curve,
``R' = R + (L - log r + sum_i w_i^2 C h / p_i) / (2 pi a)`` adds the resistance of the surface between r and exp(L); the
term in C is the error of splines of spacing h at a circle. A radius that the lattice resolves has a single circle. Else
there are two, of radius p and 2p, with the weights 4/3 and -1/3: in the mean of the surface's own u the terms of
curvature and of f - c u, in proportion to p^2, cancel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.errors import SceneError, place
from cpmkit.forms.galerkin.conditions.condition_terms import ConditionTerms
from cpmkit.forms.galerkin.conditions.nitsche import (
    NITSCHE_PENALTY,
    SKIN_PENALTY,
    one_sided_products,
    sum_of_symmetrised_products,
)
from cpmkit.forms.galerkin.form import Galerkin
from cpmkit.manifold.vector_algebra import normal_frames, unit
from cpmkit.types import Floats, Ints, SparseMatrix

#: Samples on the skin of a solid lie on a surface if they are nearer to it than so many spacings.
ON_SPACINGS = 0.1
#: Curves whose radius is at most this share of the spacing have two circles, the smaller one of so many spacings;
#: others have one, with the radius of the curve, at least one spacing.
THIN_SPACINGS, CIRCLE_SPACINGS = 0.5, 1.5
#: The constant C for splines of degree 2 (measured on the sphere with p from 1 to 4 h: .071 to .095).
CIRCLE_EXCESS = 0.08
#: The weights of two circles, and of a single one.
TWO_CIRCLES, ONE_CIRCLE = (4 / 3, -1 / 3), (1.0, 0.0)
#: Number of points of the circle.
CIRCLE_POINTS = 32


@dataclass(frozen=True, eq=False)
class Contact:
    """Samples at which members of higher dimension touch those of lower dimension."""

    rows: Ints  #: (k,): the samples on boundaries of the form of higher dimension.
    lower: SparseMatrix  #: (k, m): evaluates v at these samples.
    resistance: Floats  #: (k,): the resistance R at each sample.


@dataclass(frozen=True, eq=False)
class PointContact:
    """Points where curves meet surfaces."""

    mean: SparseMatrix  #: (k, n): evaluates the means of u over circles around the points.
    lower: SparseMatrix  #: (k, m): evaluates v at the points, inside a curve the mean of both sides.
    nearest: Ints  #: (k,): the nearest samples on the surface.
    #: resistance, radius (k,): the resistance of each junction, and the radius of the curve's cross section.
    resistance: Floats
    radius: Floats
    #: The number of each point at which ends of curves are tied, and the samples of its lips.
    lips: Sequence[tuple[int, Ints]]


def contact_blocks(terms: ConditionTerms, contact: Contact) -> tuple[SparseMatrix, SparseMatrix, SparseMatrix]:
    """Return the blocks (n, n), (n, m) and (m, m) that a ``contact`` adds; ``terms`` are those of higher dimension."""
    rows = contact.rows
    penalty = NITSCHE_PENALTY if terms.samples.normals.shape[1] else SKIN_PENALTY
    a, weights = terms.a[rows], terms.samples.weights[rows]
    widths = terms.widths[rows]
    products, factors = one_sided_products(contact.resistance * a, np.ones(len(rows)), a, weights, widths, penalty)
    upper = sum_of_symmetrised_products(
        [(terms.linear_forms(x, rows), terms.linear_forms(y, rows)) for x, y in products]
    )
    across = -(terms.linear_forms(factors, rows).T @ contact.lower).tocsr()
    return upper, across, _weighted_squares(contact.lower, factors[:, 0, 0])


def _weighted_squares(rows: SparseMatrix, weights: Floats) -> SparseMatrix:
    """Return ``rows' diag(weights) rows`` (m, m), symmetric to the last bit, from rows (k, m) and weights (k,)."""
    from scipy.sparse import diags_array

    half = (rows.T @ diags_array(0.5 * weights) @ rows).tocsr()
    return (half + half.T).tocsr()


def point_contact_blocks(
    contact: PointContact, a: Floats, spacing: float, terms: ConditionTerms
) -> tuple[SparseMatrix, SparseMatrix, SparseMatrix]:
    """Return the blocks (n, n), (n, m), (m, m) that point contacts add; ``a`` (k,) is the diffusivity of the surface.

    Where ends of curves are tied, v is the value that the tie eliminates, ``m(v) - sum q_k / sum G_k``, and 1 / sum G_k
    is added to the resistance (see "Ties" in :mod:`cpmkit.forms.galerkin.conditions.nitsche`): what flows into the
    surface is then no imbalance of the tie. ``terms`` are the conditions of the curves.
    """
    from scipy.sparse import diags_array, vstack

    p, w = circles(contact.radius, spacing)
    own = w[:, 0] ** 2 * np.log(p[:, 0]) + (1 - w[:, 0] ** 2) * np.log(p[:, 1])
    log = own - np.log(contact.radius) + CIRCLE_EXCESS * spacing * (w**2 / p).sum(axis=1)
    resistance, rows = contact.resistance + log / (2 * np.pi * a), [contact.lower[[k]] for k in range(len(a))]
    for k, lips in contact.lips:
        stiffness = NITSCHE_PENALTY * terms.a[lips] / terms.widths[lips]
        factors = np.stack([stiffness, -terms.a[lips]], axis=1)[None] / stiffness.sum()
        rows[k] = terms.linear_forms(factors, *lips[:, None])
        resistance[k] += 1 / stiffness.sum()
    weights, lower = 1 / resistance, vstack(rows, format="csr")
    across = -(contact.mean.T @ diags_array(weights) @ lower).tocsr()
    return _weighted_squares(contact.mean, weights), across, _weighted_squares(lower, weights)


def circles(radius: Floats, spacing: float) -> tuple[Floats, Floats]:
    """Return radii and weights, (k, 2) each, of the circles for curves of ``radius`` (k,), smaller ones first."""
    thin = (radius <= THIN_SPACINGS * spacing)[:, None]
    smaller = np.where(thin, CIRCLE_SPACINGS * spacing, np.maximum(radius, spacing)[:, None])
    return smaller * [1.0, 2.0], np.where(thin, TWO_CIRCLES, ONE_CIRCLE)


def mean_over_circles(form: Galerkin, at: Floats, radius: Floats) -> tuple[SparseMatrix, Ints]:
    """Return the matrix (k, n) of m(u) at points ``at`` (k, d) where curves of ``radius`` (k,) meet a surface.

    Also the nearest samples (k,). The points of a circle have the distance of its radius in space. Raises SceneError if
    a circle leaves the surface.
    """
    from scipy.sparse import csr_array
    from scipy.spatial import cKDTree

    nearest = cKDTree(form.points).query(at)[1]
    tangents = normal_frames(form.sampled.samples.normals_at(nearest)[:, 0])
    angles = 2 * np.pi * (np.arange(CIRCLE_POINTS) + 0.5) / CIRCLE_POINTS
    around = np.cos(angles)[:, None] * tangents[:, :1] + np.sin(angles)[:, None] * tangents[:, 1:]
    total = csr_array((len(at), form.size))
    for p, weight in zip(*(each.T for each in circles(radius, form.spacing)), strict=True):
        offset = around
        for _ in range(2):  # the second time the chords have the length of the radius
            points = at[:, None] + p[:, None, None] * offset
            feet = form.scene.surface.closest_point(points.reshape(-1, at.shape[1]))
            offset = unit(feet.points.reshape(points.shape) - at[:, None])
        past = np.flatnonzero((feet.edge >= 0) & np.repeat(weight != 0, CIRCLE_POINTS))
        if len(past):
            raise SceneError(
                f"a curve meets a surface near {place(at[past[0] // CIRCLE_POINTS])}, nearer to the edge of the "
                f"surface than {p.max():.3g}; use a smaller spacing, or move the junction inside."
            )
        rows = form.evaluation_matrix(feet.points)
        starts = np.arange(0, rows.shape[0] + 1, CIRCLE_POINTS)
        shares = np.repeat(weight / CIRCLE_POINTS, CIRCLE_POINTS), np.arange(rows.shape[0]), starts
        total = total + csr_array(shares, shape=(len(at), rows.shape[0])) @ rows
    return total.tocsr(), np.asarray(nearest, dtype=np.int64)
