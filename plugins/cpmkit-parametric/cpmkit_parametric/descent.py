"""Damped Newton descent to closest points, for a whole batch at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Bools, Floats
from cpmkit_parametric.domain import Domain
from cpmkit_parametric.maps import UnitMap

PARAMETRIC_DESCENT_STEPS = 60
MOST_BACKTRACKS = 10
#: A step this short, as a share of size and distance, is the last one: Newton's next would be its square.
LAST_STEP_SHARE = 1e-13
#: A descent whose last step is longer is not vouched for.
VOUCHED_STEP_SHARE = 1e-10
#: Least eigenvalue of the modified Hessian, in units of the metric J'J.
LEAST_EIGENVALUE = 1e-6
EPSILON = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class Descent:
    """Where descents ended.

    Attributes
    ----------
    parameters : (n, m) float64
        Unit parameters.
    converged : (n,) bool
        The last step was all but zero.
    """

    parameters: Floats
    converged: Bools


def descend(map: UnitMap, domain: Domain, x: Floats, start: Floats, longest: Floats, size: float) -> Descent:
    """Minimise |map(s) - x| from each start.

    Projected Newton with the Hessian's negative curvatures made positive and steps halved twice while the
    distance grows. A Gauss-Newton fallback would stall where the query is near a centre of curvature.

    Parameters
    ----------
    map, domain : UnitMap, Domain
        The manifold.
    x : (n, d) float64
        Queries.
    start : (n, m) float64
        Unit parameters.
    longest : (m,) float64
        Longest step, in unit parameters.
    size : float
        Of the manifold, by which rounding is judged.
    """
    s = domain.start(start)
    converged = np.zeros(len(s), dtype=np.bool_)
    active = np.arange(len(s))
    for _ in range(PARAMETRIC_DESCENT_STEPS):
        if not len(active):
            break
        step, length, p = _newton(map, domain, s[active], x[active], longest)
        scale = size + np.linalg.norm(p - x[active], axis=1)
        s[active] = _line_search(map, domain, s[active], x[active], p, step, size)
        converged[active] = length <= VOUCHED_STEP_SHARE * scale
        active = active[length > LAST_STEP_SHARE * scale]
    return Descent(s, converged)


def _newton(map: UnitMap, domain: Domain, s: Floats, x: Floats, longest: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the step (n, m), its length in space (n,), and the present points (n, d)."""
    p, J, second = map.jet(s)
    r = p - x
    g = np.einsum("nid,nd->ni", J, r)
    A = np.einsum("nid,njd->nij", J, J)
    H = A + np.einsum("nijd,nd->nij", second, r)
    held = ~domain.periodic & (((s <= 0) & (g > 0)) | ((s >= 1) & (g < 0)))
    g = np.where(held, 0.0, g)
    step = -(_solve_line(A, H, g) if s.shape[1] == 1 else _solve_plane(A, H, g, held))
    step *= 1 / np.maximum(1.0, np.abs(step / longest).max(axis=1))[:, None]
    length = np.linalg.norm(np.einsum("nid,ni->nd", J, step), axis=1)
    return step, length, p


def _solve_line(A: Floats, H: Floats, g: Floats) -> Floats:
    """Return g / |H| (n, 1)."""
    positive = np.maximum(np.abs(H[:, 0]), LEAST_EIGENVALUE * A[:, 0])
    return np.where(positive > 0, g / np.where(positive > 0, positive, 1.0), 0.0)


def _solve_plane(A: Floats, H: Floats, g: Floats, held: Bools) -> Floats:
    """Return the solution (n, 2) of (H + mu A) step = g, mu such that the least eigenvalue relative to A is |itself|.

    A held parameter keeps a row and column of A alone. Where the metric is singular (a pole) it is made regular.
    """
    a, b, c = A[:, 0, 0], np.where(held.any(axis=1), 0.0, A[:, 0, 1]), A[:, 1, 1]
    trace = a + c
    regular = 1e-30 * np.where(trace > 0, trace, 1.0)
    a, c = a + regular, c + regular
    h, k, q = (
        np.where(held[:, 0], a, H[:, 0, 0] + regular),
        np.where(held.any(axis=1), 0.0, H[:, 0, 1]),
        np.where(held[:, 1], c, H[:, 1, 1] + regular),
    )
    metric = a * c - b * b
    half = 0.5 * (c * h - 2 * b * k + a * q) / metric
    spread = np.sqrt(np.maximum(half**2 - (h * q - k * k) / metric, 0.0))
    least = half - spread
    mu = np.where(least < LEAST_EIGENVALUE, np.maximum(np.abs(least), LEAST_EIGENVALUE) - least, 0.0)
    h, k, q = h + mu * a, k + mu * b, q + mu * c
    determinant = h * q - k * k
    solution = np.stack([q * g[:, 0] - k * g[:, 1], h * g[:, 1] - k * g[:, 0]], axis=1)
    return solution / np.where(determinant > 0, determinant, np.inf)[:, None]


def _line_search(map: UnitMap, domain: Domain, s: Floats, x: Floats, p: Floats, step: Floats, size: float) -> Floats:
    """Return the parameters (n, m) after the step, or a fraction of it, by which the distance does not grow."""
    step = step.copy()
    trial = domain.after(s, step)
    worse = np.arange(len(s))
    for _ in range(MOST_BACKTRACKS):
        q = map.value(trial[worse])
        # |q - x|^2 - |p - x|^2 without cancellation
        change = np.einsum("nd,nd->n", q - p[worse], q + p[worse] - 2 * x[worse])
        noise = 8 * EPSILON * size * (np.linalg.norm(p[worse] - x[worse], axis=1) + EPSILON * size)
        worse = worse[~(change <= noise)]
        if not len(worse):
            return trial
        step[worse] *= 0.25
        trial[worse] = domain.after(s[worse], step[worse])
    trial[worse] = s[worse]
    return trial
