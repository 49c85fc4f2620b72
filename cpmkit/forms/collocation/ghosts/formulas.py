"""The one ghost formula: value at a ghost = sum of coefficients * u(points) + factor * data, for every condition.

For ``alpha du/db + beta u = gamma``, with t the ghost's distance from the boundary and s its
distance from the mirror point (CONVENTIONS, Ghosts):

order 2: ``[(alpha - beta s/2) u(mirror) + s gamma] / (alpha + beta s/2)``, and for Dirichlet, with
the mirror at distance ``h = max(t, spacing/2)``, ``-(t/h) u(mirror) + (1 + t/h) g``;
order 1, with u read on the boundary: ``[alpha u + t gamma] / (alpha + beta t)``, for Dirichlet g;
order 3 and 4: the polynomial through the values at points inside that fulfils the condition.

Differs from King et al. (2024), eq. 7 and section 4.3: there h = t, and a ghost on the boundary then
reads itself with weight -1, which no smoother damps.
"""

from __future__ import annotations

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.protocols import Bools, Floats
from cpmkit.scene.laws import Law, OneSided, Value


def mirror_distance(law: Law, t: Floats, spacing: float) -> Floats:
    """Return how far beyond the boundary a second-order ghost at distance ``t`` (n,) reads."""
    return np.maximum(t, 0.5 * spacing) if isinstance(law, Value) else t


def coefficient_and_factor(
    law: OneSided, beta: Floats, t: Floats, s: Floats, first_order: Bools, spacing: float
) -> tuple[Floats, Floats]:
    """Return the coefficient of u(mirror) and the factor of gamma, each (n,).

    Parameters
    ----------
    law : OneSided
        With its alpha.
    beta : (n,) float64
        Its beta at the ghosts' feet.
    t, s : (n,) float64
        Distance of the ghost from the boundary, and from its mirror point.
    first_order : (n,) bool
        Ghosts of order 1.
    spacing : float
        Spacing of the level that owns the ghost.

    Raises
    ------
    ResolutionError
        If the condition feeds the solution more strongly than the spacing can follow.
    """
    if isinstance(law, Value):
        ratio = np.where(first_order, 0.0, t / np.maximum(t, 0.5 * spacing))
        return -ratio, (1.0 + ratio) / beta
    alpha = law.alpha
    first = alpha + beta * t
    second = alpha + 0.5 * beta * s
    divisors = np.where(first_order, first, second) / alpha
    if np.any(divisors <= 0):
        room = spacing / (1.0 - float(divisors.min()))
        raise ResolutionError(
            f"spacing={spacing:g} is too coarse for the Robin condition alpha={alpha:g}, "
            f"beta={float(beta[divisors.argmin()]):g}, which feeds the solution; use {room:.2g} or less."
        )
    coefficient = np.where(first_order, alpha / first, (alpha - 0.5 * beta * s) / second)
    return coefficient, np.where(first_order, t / first, s / second)


def points_inside(law: Law, order: int) -> int:
    """Return at how many points inside a ghost of ``order`` 3 or 4 reads: the degree of its polynomial.

    The slope of a cubic costs an order that its value keeps, so a flux gets one point more.
    """
    return order - 1 if isinstance(law, Value) else order


def polynomial_weights(
    alpha: float, beta: Floats, positions: Floats, at: Floats, spacing: float
) -> tuple[Floats, Floats]:
    """Return the weights (n, k) of values inside and the factor (n,) of gamma in a polynomial's value outside.

    The polynomial has degree k, takes the values at ``-positions``, and fulfils ``alpha p' + beta p = gamma`` at 0.

    Parameters
    ----------
    alpha, beta : float, (n,) float64
        Of the condition.
    positions : (n, k) float64
        Arc lengths from the boundary to the points inside.
    at : (n,) float64
        Arc length from the boundary to the ghost outside.
    spacing : float
        Unit of length in which the small systems are well scaled.
    """
    n, k = positions.shape
    powers = np.arange(k + 1)
    system = np.empty((n, k + 1, k + 1))
    system[:, :k] = (-positions / spacing)[:, :, None] ** powers
    system[:, k] = 0.0
    unit = spacing if alpha else 1.0
    system[:, k, 0] = beta * unit
    if k:
        system[:, k, 1] = alpha * unit / spacing
    value = (at / spacing)[:, None] ** powers
    weights = np.linalg.solve(system.transpose(0, 2, 1), value[:, :, None])[:, :, 0]
    return np.asarray(weights[:, :k]), np.asarray(weights[:, k] * unit)
