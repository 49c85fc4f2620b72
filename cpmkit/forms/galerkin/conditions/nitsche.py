"""Weak terms of conditions at samples: on one side, across a boundary, and for advection.

**One side.** The condition is ``alpha du/db + beta u = gamma``, with b the conormal out of the side. Let q(u) be
a du/db, B the penalty, w the local width, e = alpha / a, g = w / (B a) and m = e + beta g. A sample of weight s adds to
the matrix, K in the formulas, and to the load, b in the formulas:

    K += s [ (beta/m) u v  -  (beta g/m) (q(u) v + u q(v))  -  (e g/m) q(u) q(v) ]
    b += s gamma [ v - g q(v) ] / m

It is Nitsche's method for ``u + eps q = gamma / beta``, eps = e / beta, in the form of Juntunen and Stenberg (Math.
Comp. 78, 2009), multiplied out: Nitsche's original method at alpha = 0, the plain weak form ``K += s (beta/e) u v``,
``b += s (gamma/e) v`` for large eps, and stable in between. Where beta = 0 (a flux), and where alpha and beta have
opposite signs, so that the term in the energy is negative, the plain weak form is used.

**Both sides.** These terms are for transmission with resistance, jump and flux, and for the continuations of boundaries
past their tips. Let b be the conormal from side 1 (left) to side 2, q_i = a_i du_i/db, [u] = u_1 - u_2, r_i = w_i /
a_i, k_1 = r_1/(r_1 + r_2), k_2 = 1 - k_1, q(u) = k_1 q_1 + k_2 q_2, <v> = k_2 v_1 + k_1 v_2, g = (r_1 + r_2) / (2 B):

    [u] + eps q = D,    q_1 - q_2 = F
    K += s [ [u][v]/(eps + g) - g/(eps + g) (q(u)[v] + [u] q(v)) - eps g/(eps + g) q(u) q(v) ]
    b += s [ F <v> + D ([v] - g q(v)) / (eps + g) ]

The law of a scene is ``u_1 - u_2 = jump + R flow`` with the mean flow of -q_1 and -q_2, and q = (q_1 + q_2)/2 +
(k_1 - k_2) F/2; so eps = R and D = jump + R (k_1 - k_2) F/2. Arithmetic means of fluxes, or ``[u][v]`` alone, do not
converge where a_1 and a_2 differ much.

**Advection.** Where v . b < 0, ``|v . b| (u - g) phi`` is added on that side, with g the prescribed value, or the value
on the other side plus or minus the jump: upwinding, as in discontinuous Galerkin methods. At outflow nothing is added;
a layer that the spacing does not resolve is then omitted instead of causing oscillations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.types import Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: The dimensionless penalty B on one side. At 20 matrices are definite for all 12 positions of a lattice, at 15 for
#: 11; with samples clipped at knot planes a ring on a sphere, a sixth of the spacing above one, has eigenvalues below
#: zero at 40 and none at 60. From 40 to 60 errors change by -15 to 1 percent, and iterations do not; from 80 on errors
#: beside tips grow.
NITSCHE_PENALTY = 60.0
#: The dimensionless penalty B between two sides, and on continuations of boundaries past their tips: with half the
#: penalty there the error for zero flux on a slit is a third smaller.
COUPLING_PENALTY, TIP_PENALTY = 40.0, 20.0


def one_sided_products(
    alpha: Floats, beta: Floats, a: Floats, weights: Floats, widths: Floats
) -> tuple[list[tuple[Floats, Floats]], Floats]:
    """Return the products that conditions on one side add to the matrix, and the factors of their data in the load.

    A product is a pair of linear forms; forms and load are given by factors (k, 1, 2) of u and du/db at k samples, see
    :mod:`~cpmkit.forms.galerkin.conditions.sample_products`.

    Parameters
    ----------
    alpha, beta : (k,) float64
        Factors of du/db and of u in the conditions, never both zero.
    a : (k,) float64
        The diffusivity on this side.
    weights, widths : (k,) float64
        The weights s of the samples, and the local width w.
    """
    e, g = alpha / a, widths / (NITSCHE_PENALTY * a)
    g = np.where((e * beta > 0) | (alpha == 0), g, 0.0)
    share, zero = weights / (e + beta * g), np.zeros(len(a))
    value, flux = side_factors(zero + 1, zero), side_factors(zero, a)
    with_value = side_factors(0.5 * share * beta, -share * beta * g * a)
    with_flux = side_factors(zero, -0.5 * share * e * g * a)
    return [(value, with_value), (flux, with_flux)], side_factors(share, -share * g * a)


def interface_products(
    a: Sequence[Floats], widths: Sequence[Floats], resistance: Floats, weights: Floats, penalty: Floats
) -> tuple[list[tuple[Floats, Floats]], list[Floats]]:
    """Return the products that couplings add to the matrix, and the factors of jump and flux (k,) in the load.

    All are factors (k, 2, 2) of u and du/db on the left and on the right, with b out of each side.

    Parameters
    ----------
    a, widths : two (k,) float64
        The diffusivity and the local width on the left, and on the right.
    resistance, weights, penalty : (k,) float64
        The resistance R, zero where u is continuous; the weights s of the samples; the penalty B.
    """
    r = [width / diffusivity for width, diffusivity in zip(widths, a, strict=True)]
    k = r[0] / (r[0] + r[1])
    g = (r[0] + r[1]) / (2 * penalty)
    share, zero = weights / (resistance + g), np.zeros(len(g))
    jump = side_factors(zero + 1, zero, zero - 1, zero)
    flux = side_factors(zero, k * a[0], zero, (k - 1) * a[1])

    def times(scale: Floats, factors: Floats) -> Floats:
        return np.asarray(scale[:, None, None] * factors)

    by_jump = times(share, jump) - times(share * g, flux)
    mean = side_factors(weights * (1 - k), zero, weights * k, zero)
    by_flux = mean + times(0.5 * resistance * (2 * k - 1), by_jump)
    with_jump = times(0.5 * share, jump) - times(share * g, flux)
    with_flux = times(-0.5 * share * resistance * g, flux)
    return [(jump, with_jump), (flux, with_flux)], [by_jump, by_flux]


def inflow_terms(outward_speed: Floats, weights: Floats, values: csr_array) -> tuple[csr_array, csr_array]:
    """Return the inflow terms of the matrix (n, n), and the matrix (n, k) that maps prescribed values to the load.

    Parameters
    ----------
    outward_speed : (k,) float64
        v . b, with b the conormal out of the side.
    weights : (k,) float64
        The weights of the samples.
    values : csr_array (k, n)
        Evaluates u at the samples.
    """
    tested = scale_rows(weights * np.maximum(-outward_speed, 0.0), values).T.tocsr()
    return (tested @ values).tocsr(), tested


def advection_jump_terms(
    outward_speeds: tuple[Floats, Floats], weights: Floats, left: csr_array, right: csr_array
) -> tuple[csr_array, csr_array]:
    """Return the upwind terms (n, n) of advection across a boundary, and the matrix (n, k) that maps jumps to the load.

    A jump is the value of u on the left less that on the right.

    Parameters
    ----------
    outward_speeds : two (k,) float64
        v . b with b out of the left side, and out of the right side.
    weights : (k,) float64
        The weights of the samples.
    left, right : csr_array (k, n)
        Evaluate u at the samples on each side.
    """
    tested = scale_rows(weights * np.maximum(-outward_speeds[0], 0.0), left)
    tested = tested - scale_rows(weights * np.maximum(-outward_speeds[1], 0.0), right)
    tested = tested.T.tocsr()
    return (tested @ (left - right)).tocsr(), tested


def side_factors(*factors: Floats) -> Floats:
    """Return the array (k, sides, 2) of ``factors`` (k,), given for u and du/db on one side after the other."""
    return np.stack(factors, axis=1).reshape(len(factors[0]), -1, 2)


def scale_rows(factors: Floats, rows: csr_array) -> csr_array:
    """Return the matrix ``rows`` (k, n) with each row multiplied by its entry of ``factors`` (k,)."""
    product = rows.tocsr(copy=True)
    product.data *= np.repeat(factors, np.diff(product.indptr))
    return product
