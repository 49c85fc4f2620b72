"""The terms of junctions between members of different dimension, in the unknowns of both.

Let u belong to the members of higher dimension and v to those of lower dimension. Where a curve lies on a surface, or a
surface on the boundary of a solid, each side of the junction has the condition ``u + R q = v``: q = a du/db is the flux
out of the side, R the resistance. It is imposed by Nitsche's method as a condition on one side is, with v in place of
the datum (see :mod:`cpmkit.forms.galerkin.conditions.nitsche`). A sample of weight s adds, with g = w / (B a),

    s/(R + g) (u - v)(u' - v') - s g/(R + g) (q (u' - v') + q' (u - v)) - s R g/(R + g) q q'

for test functions u', v': symmetric, zero for constants, and what leaves u arrives in v.

Where a curve meets a surface at a point, or lies in a solid in space, u grows like ``-log(distance)`` there, and the
radius r of the curve's cross section decides what flows. Let m(u) be the mean of u over a disc of radius s around the
point, in a solid perpendicular to the curve, with the density ``f = (1 - t)(alpha + beta t)`` in t, the square of the
distance over s. f has the mean 1, and the mean of t f is that on the circle of radius r: for functions without a source
m is the mean over this circle, up to terms of order s^4. The curve's value v is tied to m(u) by
``(m(u) - v)(m(u') - v') / R'``, per length in a solid. What flows enters over the disc with the same density, so that m
of its own potential is that at the distance exp(L), ``L = 2 int f F log(distance) dt`` with F the integral of f from 0
to t. ``R' = R + (L - log r) / (2 pi a)`` adds the resistance between r and exp(L). A density that the lattice resolves
makes this independent of the position of its nodes; sources on a single circle do not.

A velocity w flows out of u through a junction at the speed ``w . b``. Where it flows in, u is that of the junction:
``s max(-w . b, 0) (u - v) u'`` is added, as where a value is given, unless a resistance lets u jump. In conservative
form, what w carries out of u enters v, and what it carries into u leaves v; likewise m(u) and the value at the end of
a curve that meets a surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.forms.galerkin.conditions.condition_terms import ConditionTerms
from cpmkit.forms.galerkin.conditions.nitsche import (
    NITSCHE_PENALTY,
    SKIN_PENALTY,
    one_sided_products,
)
from cpmkit.types import Floats, Ints, SparseMatrix

#: Samples on the skin of a solid lie on a surface if they are nearer to it than so many spacings.
ON_SPACINGS = 0.1


@dataclass(frozen=True, eq=False)
class Contact:
    """Samples at which members of higher dimension touch those of lower dimension."""

    rows: Ints  #: (k,): the samples on boundaries of the form of higher dimension.
    lower: SparseMatrix  #: (k, m): evaluates v at these samples.
    resistance: Floats  #: (k,): the resistance R at each sample.


@dataclass(frozen=True, eq=False)
class DiscContact:
    """Points where curves meet surfaces, or quadrature points of curves in solids."""

    mean: SparseMatrix  #: (k, n): evaluates the means of u over discs around the points.
    lower: SparseMatrix  #: (k, m): evaluates v at the points, inside a curve the mean of both sides.
    nearest: Ints  #: (k,): the nearest samples on the surface or in the solid.
    resistance: Floats  #: (k,): the resistance R of each junction.
    spread: Floats  #: (k,): L - log r.
    weights: Floats  #: (k,): lengths of the curve, 1 where it meets a surface.
    #: The number of each point at which ends of curves are tied, and the samples of its lips.
    lips: Sequence[tuple[int, Ints]] = ()
    branches: Sequence[Ints] = ()  #: The samples of the curves' branches at each point where they meet a surface.


def contact_blocks(terms: ConditionTerms, contact: Contact) -> tuple[SparseMatrix, SparseMatrix, SparseMatrix]:
    """Return the blocks (n, n), (n, m) and (m, m) that a ``contact`` adds; ``terms`` are those of higher dimension."""
    rows = contact.rows
    penalty = NITSCHE_PENALTY if terms.samples.normals.shape[1] else SKIN_PENALTY
    a, weights = terms.a[rows], terms.samples.weights[rows]
    widths = terms.widths[rows]
    products, factors = one_sided_products(contact.resistance * a, np.ones(len(rows)), a, weights, widths, penalty)
    upper = terms.sum_of_products(products, rows)
    across = -(terms.linear_forms(factors, rows).T @ contact.lower).tocsr()
    return upper, across, _weighted_squares(contact.lower, factors[:, 0, 0])


def advection_blocks(
    terms: ConditionTerms, contact: Contact, conservative: bool
) -> tuple[SparseMatrix, SparseMatrix, SparseMatrix, SparseMatrix]:
    """Return what a velocity adds at a ``contact`` to the blocks (n, n), (n, m), (m, n) and (m, m) of u and v.

    ``terms`` are those of higher dimension, ``conservative`` is whether the equation has div(w u).
    """
    assert terms.outward_speed is not None
    upper, lower = terms.values[contact.rows], contact.lower
    speed = terms.samples.weights[contact.rows] * terms.outward_speed[contact.rows]
    inflow = np.where(contact.resistance == 0, np.maximum(-speed, 0.0), 0.0)
    entering, leaving = conservative * (speed + inflow), conservative * inflow
    return (
        _product(upper, inflow, upper),
        _product(upper, -inflow, lower),
        _product(lower, -entering, upper),
        _product(lower, leaving, lower),
    )


def _product(tested: SparseMatrix, weights: Floats, read: SparseMatrix) -> SparseMatrix:
    """Return ``tested' diag(weights) read`` (n, m) from matrices (k, n) and (k, m)."""
    from scipy.sparse import diags_array

    return (tested.T @ diags_array(weights) @ read).tocsr()


def _weighted_squares(rows: SparseMatrix, weights: Floats) -> SparseMatrix:
    """Return ``rows' diag(weights) rows`` (m, m), symmetric to the last bit, from rows (k, m) and weights (k,)."""
    from scipy.sparse import diags_array

    half = (rows.T @ diags_array(0.5 * weights) @ rows).tocsr()
    return (half + half.T).tocsr()


def disc_contact_blocks(
    contact: DiscContact, a: Floats, terms: ConditionTerms, conservative: bool
) -> tuple[SparseMatrix, SparseMatrix, SparseMatrix, SparseMatrix]:
    """Return the blocks (n, n), (n, m), (m, n) and (m, m) that a contact adds, where u and v have n and m unknowns.

    ``a`` (k,) is the diffusivity around the points, ``terms`` are the conditions of the curves, ``conservative`` is
    whether the equation has div(w u). Where ends of curves are tied, v is the value that the tie eliminates,
    ``m(v) - sum q_k / sum G_k``, and 1 / sum G_k is added to the resistance (see "Ties" in
    :mod:`cpmkit.forms.galerkin.conditions.nitsche`): what flows into the surface is then no imbalance of the tie.
    """
    from scipy.sparse import diags_array, vstack

    resistance, lower = contact.resistance + contact.spread / (2 * np.pi * a), contact.lower
    for k, lips in contact.lips:
        stiffness = NITSCHE_PENALTY * terms.a[lips] / terms.widths[lips]
        factors = np.stack([stiffness, -terms.a[lips]], axis=1)[None] / stiffness.sum()
        lower = vstack([lower[:k], terms.linear_forms(factors, *lips[:, None]), lower[k + 1 :]], format="csr")
        resistance[k] += 1 / stiffness.sum()
    weights = contact.weights / resistance
    upper, below = _weighted_squares(contact.mean, weights), _weighted_squares(lower, weights)
    across = -(contact.mean.T @ diags_array(weights) @ lower).tocsr()
    if not conservative or not len(contact.branches):
        return upper, across, across.T, below
    flow, share = _advected(terms, contact.branches), contact.resistance / resistance
    return (
        upper,
        across - _product(contact.mean, share, flow),
        across.T,
        below - _product(lower, 1 - share, flow),
    )


def _advected(terms: ConditionTerms, branches: Sequence[Ints]) -> SparseMatrix:
    """Return the matrix (k, m) of what the velocity takes out of curves at k points, where they end or go on.

    ``branches`` are the samples at each point. Where a curve goes on, one branch takes what another brings.
    """
    from scipy.sparse import csr_array, vstack

    assert terms.outward_speed is not None
    rows = []
    for at in branches:
        speed = terms.outward_speed[at]
        out = np.maximum(speed, 0.0)
        if len(at) > 1:
            speed = out * (1 - (out - speed).sum() / max(out.sum(), np.finfo(float).tiny))
        rows.append(csr_array(speed[None] @ terms.values[at]))
    return vstack(rows, format="csr")
