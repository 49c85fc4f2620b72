"""The one ghost formula: value at a ghost = coefficient * u(mirror) + datum, for every condition.

For ``alpha du/db + beta u = gamma``, with t the ghost's distance from the boundary and s its
distance from the mirror point (CONVENTIONS, Ghosts):

order 2: ``[(alpha - beta s/2) u(mirror) + s gamma] / (alpha + beta s/2)``, and for Dirichlet, with
the mirror at distance ``h = max(t, spacing/2)``, ``-(t/h) u(mirror) + (1 + t/h) g``;
order 1, with u read on the boundary: ``[alpha u + t gamma] / (alpha + beta t)``, for Dirichlet g.

Differs from King et al. (2024), eq. 7 and section 4.3: there h = t, and a ghost on the boundary then
reads itself with weight -1, which no smoother damps.
"""

from __future__ import annotations

import numpy as np

from cpmkit.conditions import Condition
from cpmkit.errors import ResolutionError
from cpmkit.protocols import Bools, Floats


def is_dirichlet(condition: Condition) -> bool:
    """Tell whether the condition fixes the value itself."""
    return condition.alpha == 0.0


def mirror_distance(condition: Condition, t: Floats, spacing: float) -> Floats:
    """Return how far beyond the boundary a second-order ghost at distance ``t`` (n,) reads."""
    return np.maximum(t, 0.5 * spacing) if is_dirichlet(condition) else t


def coefficient_and_factor(
    condition: Condition, t: Floats, s: Floats, first_order: Bools, spacing: float
) -> tuple[Floats, Floats]:
    """Return the coefficient of u(mirror) and the factor of gamma, each (n,).

    Parameters
    ----------
    condition : Condition
        With its alpha and beta.
    t, s : (n,) float64
        Distance of the ghost from the boundary, and from its mirror point.
    first_order : (n,) bool
        Ghosts of order 1.
    spacing : float
        Spacing of the level that owns the ghost.
    """
    alpha, beta = condition.alpha, condition.beta
    if is_dirichlet(condition):
        ratio = np.where(first_order, 0.0, t / np.maximum(t, 0.5 * spacing))
        return -ratio, (1.0 + ratio) / beta
    first = alpha + beta * t
    second = alpha + 0.5 * beta * s
    divisors = np.where(first_order, first, second) / alpha
    if np.any(divisors <= 0):
        room = spacing / (1.0 - float(divisors.min()))
        raise ResolutionError(
            f"spacing={spacing:g} is too coarse for the Robin condition alpha={alpha:g}, beta={beta:g}, which feeds "
            f"the solution; use {room:.2g} or less."
        )
    coefficient = np.where(first_order, alpha / first, (alpha - 0.5 * beta * s) / second)
    return coefficient, np.where(first_order, t / first, s / second)
