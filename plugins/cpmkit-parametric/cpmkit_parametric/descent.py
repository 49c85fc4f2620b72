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


def minimize_distance(map: UnitMap, domain: Domain, x: Floats, start: Floats, longest: Floats, size: float) -> Descent:
    """Return local minima of |map(s) - x|, one downhill from each start.

    Projected Newton with the Hessian's negative curvatures made positive and steps quartered while the distance grows.
    A Gauss-Newton fallback would stall where the query is near a centre of curvature.

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
        The manifold's, a length by which rounding is judged.
    """
    from cpmkit_parametric.descent_kernels import newton_steps, point_distances

    s = domain.move_off_poles(start)
    converged = np.zeros(len(s), dtype=np.bool_)
    active = np.arange(len(s))
    for _ in range(PARAMETRIC_DESCENT_STEPS):
        if not len(active):
            break
        here, wanted = s[active], x[active]
        p, *derivatives = map.jet(here)
        step, length = newton_steps(p, *derivatives, wanted, here, domain.periodic, longest)
        scale = size + point_distances(p, wanted)
        s[active] = _line_search(map, domain, here, wanted, p, step, size)
        converged[active] = length <= VOUCHED_STEP_SHARE * scale
        active = active[length > LAST_STEP_SHARE * scale]
    return Descent(s, converged)


def _line_search(map: UnitMap, domain: Domain, s: Floats, x: Floats, p: Floats, step: Floats, size: float) -> Floats:
    """Return the parameters (n, m) after ``step`` (n, m) from ``s`` (n, m), or after a quarter of it, and so on.

    The first share counts whose point is, but for rounding, no farther from ``x`` (n, d) than ``p`` (n, d), the point
    at ``s``; after ten shares ``s`` stays. ``size``, that of the manifold, judges rounding.
    """
    from cpmkit_parametric.descent_kernels import is_farther

    trial = domain.advance_parameters(s, step)
    worse = np.flatnonzero(is_farther(map.value(trial), p, x, size))
    if not len(worse):
        return trial
    step = step.copy()
    for _ in range(MOST_BACKTRACKS - 1):
        step[worse] *= 0.25
        trial[worse] = domain.advance_parameters(s[worse], step[worse])
        worse = worse[is_farther(map.value(trial[worse]), p[worse], x[worse], size)]
        if not len(worse):
            return trial
    trial[worse] = s[worse]
    return trial
