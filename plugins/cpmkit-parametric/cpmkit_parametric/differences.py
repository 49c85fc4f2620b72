"""Derivatives of a callable that gives none: differences of nine values, exact for polynomials of degree 8."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.plugin import Bools, Floats

#: Step as a share of the range: for features of a 50th of the range, truncation and rounding are both about 1e-13.
PARAMETER_STEP_SHARE = 1e-3
DIFFERENCE_REACH = 4
DIFFERENCE_OFFSETS = np.arange(-DIFFERENCE_REACH, DIFFERENCE_REACH + 1.0)
#: Row k holds the coefficient of s^k of the nine Lagrange polynomials.
DIFFERENCE_COEFFICIENTS = np.linalg.inv(np.vander(DIFFERENCE_OFFSETS, increasing=True))


@dataclass(frozen=True, eq=False)
class Differences:
    """Derivatives of ``function`` by central differences, moved inwards where a bound is near.

    First derivatives are those of the interpolant at the parameter itself. Second derivatives, which
    only steer the search, are those at the centre of the nine values.

    Attributes
    ----------
    function : callable
        Of the parameters' columns; returns (n, d).
    lower, upper : (m,) float64
        The range.
    periodic : (m,) bool
        Parameters whose nine values may lie beyond the range, by at most 0.4 percent of it.
    """

    function: Callable[..., Any]
    lower: Floats
    upper: Floats
    periodic: Bools

    def __call__(self, *columns: Floats) -> Sequence[Floats]:
        """Return x', x'' or x_u, x_v, x_uu, x_uv, x_vv, each (n, d), at the parameters ``columns``, each (n,)."""
        t = np.stack(columns, axis=1)
        step = PARAMETER_STEP_SHARE * (self.upper - self.lower)
        inside = np.clip(t, self.lower + DIFFERENCE_REACH * step, self.upper - DIFFERENCE_REACH * step)
        centre = np.where(self.periodic, t, inside)
        along = [self._values_along(t, k, centre[:, k], step[k]) for k in range(t.shape[1])]
        first = [
            np.einsum("nk,nkd->nd", _first_weights((t[:, k] - centre[:, k]) / step[k]), values) / step[k]
            for k, values in enumerate(along)
        ]
        second = [
            self._second_derivative(centre, np.eye(t.shape[1])[k] * step) / step[k] ** 2 for k in range(t.shape[1])
        ]
        if len(second) == 2:
            both = self._second_derivative(centre, step) / np.prod(step)
            ratio = step[0] / step[1]
            second.insert(1, 0.5 * (both - ratio * second[0] - second[1] / ratio))
        return [*first, *second]

    def _values_along(self, t: Floats, k: int, centre: Floats, step: float) -> Floats:
        """Return nine values (n, 9, d) near ``t`` (n, m) along parameter k, ``step`` apart about ``centre`` (n,)."""
        nodes = np.repeat(t[:, None], len(DIFFERENCE_OFFSETS), axis=1)
        nodes[:, :, k] = centre[:, None] + step * DIFFERENCE_OFFSETS
        return self._evaluate(nodes)

    def _second_derivative(self, centre: Floats, direction: Floats) -> Floats:
        """Return the second derivative (n, d) at ``centre`` (n, m) by multiples of the step ``direction`` (m,)."""
        values = self._evaluate(centre[:, None] + DIFFERENCE_OFFSETS[:, None] * direction)
        return np.asarray(2 * np.einsum("k,nkd->nd", DIFFERENCE_COEFFICIENTS[2], values))

    def _evaluate(self, nodes: Floats) -> Floats:
        values = np.asarray(self.function(*nodes.reshape(-1, nodes.shape[-1]).T), dtype=np.float64)
        return np.asarray(values.reshape(*nodes.shape[:-1], values.shape[-1]))


def _first_weights(s: Floats) -> Floats:
    """Return the weights (n, 9) of the interpolant's derivative by steps, at ``s`` (n,) steps from the centre."""
    powers = np.zeros((len(s), len(DIFFERENCE_OFFSETS)))
    powers[:, 1] = 1.0
    for k in range(2, len(DIFFERENCE_OFFSETS)):
        powers[:, k] = k / (k - 1) * powers[:, k - 1] * s
    return np.asarray(np.einsum("np,pk->nk", powers, DIFFERENCE_COEFFICIENTS))
