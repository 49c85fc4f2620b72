"""Conditions on one side of a boundary: values, fluxes and what is between, weakly.

Of ``alpha du/db + beta u = gamma``, b the conormal out of the side, with q(u) = a du/db, the penalty B and the local
width w, for each sample of weight s, with e = alpha / a, g = w / (B a), m = e + beta g:

    K += s [ (beta/m) u v  -  (beta g/m) (q(u) v + u q(v))  -  (e g/m) q(u) q(v) ]
    b += s gamma [ v - g q(v) ] / m

It is Nitsche's method for ``u + eps q = gamma / beta``, eps = e / beta, in the form of Juntunen and Stenberg (Math.
Comp. 78, 2009), multiplied out: at alpha = 0 Nitsche's own, for large eps the plain weak form ``K += s (beta/e) u v``,
``b += s (gamma/e) v``, stable in between. Where beta = 0 (a flux), and where alpha and beta are of opposite sign, so
that the condition takes energy, it is the plain weak form.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.types import Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array


#: The penalty: at 20 matrices are definite in all of 12 positions of a lattice, at 15 in 11; with samples clipped at
#: knot planes a ring on a sphere, a sixth of the spacing above one, has eigenvalues below zero at 40 and none at 60.
#: From 40 to 60 errors change by -15 to 1 percent, and iterations do not; from 80 on those beside tips grow.
NITSCHE_PENALTY = 60.0


def one_sided_products(
    alpha: Floats, beta: Floats, a: Floats, weights: Floats, widths: Floats
) -> tuple[list[tuple[Floats, Floats]], Floats]:
    """Return the products that conditions add to the matrix, and by which factors their datum gamma (k,) adds to b.

    Both are factors (k, 1, 2) of u and du/db, as of :mod:`~cpmkit.forms.galerkin.conditions.sample_products`.

    Parameters
    ----------
    alpha, beta : (k,) float64
        Factors of du/db and of u, never both zero.
    a : (k,) float64
        The diffusivity on this side.
    weights, widths : (k,) float64
        The samples' weights s, and the local width w.
    """
    e, g = alpha / a, widths / (NITSCHE_PENALTY * a)
    g = np.where((e * beta > 0) | (alpha == 0), g, 0.0)
    share, none = weights / (e + beta * g), np.zeros(len(a))
    value, flux = side_factors(none + 1, none), side_factors(none, a)
    of_value = side_factors(0.5 * share * beta, -share * beta * g * a)
    return [(value, of_value), (flux, side_factors(none, -0.5 * share * e * g * a))], side_factors(
        share, -share * g * a
    )


def side_factors(*of: Floats) -> Floats:
    """Return the factors (k, s, 2) of u and du/db (k,), side by side."""
    return np.stack(of, axis=1).reshape(len(of[0]), -1, 2)


def scale_rows(factors: Floats, rows: csr_array) -> csr_array:
    """Return ``rows`` (k, n) multiplied by ``factors`` (k,)."""
    product = rows.tocsr(copy=True)
    product.data *= np.repeat(factors, np.diff(product.indptr))
    return product


#: The penalty between two sides, and that on continuations of boundaries past their tips: there zero flux on a slit is
#: read off a third better with half of it.
COUPLING_PENALTY = 40.0
SEAM_PENALTY = 0.5 * COUPLING_PENALTY


def interface_products(
    a: Sequence[Floats], widths: Sequence[Floats], resistance: Floats, weights: Floats, penalty: Floats
) -> tuple[list[tuple[Floats, Floats]], list[Floats]]:
    """Return the products that couplings add to the matrix, and by which factors jump and flux (k,) add to b.

    All are factors (k, 2, 2) of u and du/db on the left and on the right, b out of each side, as of
    :mod:`~cpmkit.forms.galerkin.conditions.sample_products`.

    Parameters
    ----------
    a, widths : two (k,) float64
        The diffusivity and the local width on the left, and on the right.
    resistance, weights, penalty : (k,) float64
        R, zero where u goes on; the samples' weights s; B.
    """
    r = [width / own for width, own in zip(widths, a, strict=True)]
    k = r[0] / (r[0] + r[1])
    g = (r[0] + r[1]) / (2 * penalty)
    share, none = weights / (resistance + g), np.zeros(len(g))
    jump, flux = side_factors(none + 1, none, none - 1, none), side_factors(none, k * a[0], none, (k - 1) * a[1])

    def times(scale: Floats, one: Floats) -> Floats:
        return np.asarray(scale[:, None, None] * one)

    by_jump = times(share, jump) - times(share * g, flux)
    mean = side_factors(weights * (1 - k), none, weights * k, none)
    by_flux = mean + times(0.5 * resistance * (2 * k - 1), by_jump)
    of_jump = times(0.5 * share, jump) - times(share * g, flux)
    return [(jump, of_jump), (flux, times(-0.5 * share * resistance * g, flux))], [by_jump, by_flux]


def inflow_terms(out: Floats, weights: Floats, values: csr_array) -> tuple[csr_array, csr_array]:
    """Return what is added to the matrix (n, n), and by which matrix (n, k) the values given (k,) add to b.

    Parameters
    ----------
    out : (k,) float64
        v . b.
    weights : (k,) float64
        The samples' weights.
    values : csr_array (k, n)
        Rows that read u.
    """
    tested = scale_rows(weights * np.maximum(-out, 0.0), values).T.tocsr()
    return (tested @ values).tocsr(), tested


def advection_jump_terms(
    out: tuple[Floats, Floats], weights: Floats, first: csr_array, second: csr_array
) -> tuple[csr_array, csr_array]:
    """Return the same of two sides whose u differ by the jump (k,), the first less the second.

    Parameters
    ----------
    out : two (k,) float64
        v . b out of each side.
    weights : (k,) float64
        The samples' weights.
    first, second : csr_array (k, n)
        Rows that read u on each side.
    """
    tested = scale_rows(weights * np.maximum(-out[0], 0.0), first) - scale_rows(
        weights * np.maximum(-out[1], 0.0), second
    )
    tested = tested.T.tocsr()
    return (tested @ (first - second)).tocsr(), tested
