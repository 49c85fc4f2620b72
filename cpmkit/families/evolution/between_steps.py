"""Between two steps: what is done with the values, and whether the run has come to rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.families.evolution.moment import History, Moment
from cpmkit.forms.contract import Discretized
from cpmkit.scene.equations_in_time import Evolution
from cpmkit.scene.pointwise import apply_after_step
from cpmkit.types import Floats


def after_step(form: Discretized, evolution: Evolution, moment: Moment) -> Moment:
    """Return a moment as the function that is called after each step leaves it; the same where it changes nothing."""
    if evolution.after_step is None:
        return moment
    values = form.at_points(moment.u)
    wanted = apply_after_step(evolution.after_step, form.points.copy(), values, moment.time)
    if np.array_equal(wanted, values):
        return moment
    return replace(moment, u=form.project(wanted, moment.u, moment.time))


def rate_of_change(form: Discretized, start: Moment, history: History) -> float:
    """Return by how much of its size u changed in the last step, per unit of time; infinite before the first.

    Sizes are root mean squares over the manifold and all channels; that of u is its size at the start or now.
    """
    if len(history) < 2 or history[-1].length == 0:
        return float("inf")
    now = history[-1].u
    size = max(_size(form, start.u), _size(form, now))
    return _size(form, now - history[-2].u) / (history[-1].length * size) if size > 0 else 0.0


def rest_sentence(form: Discretized, evolution: Evolution, start: Moment, history: History) -> list[str]:
    """Tell that a run did not come to rest where it was to."""
    if evolution.rest is None:
        return []
    rate = rate_of_change(form, start, history)
    if rate < evolution.rest:
        return []
    return [
        f"The run did not come to rest until {evolution.until:g}: u still changes by {rate:.2g} of its size per unit "
        f"of time, and rest={evolution.rest:g} was asked for; use a later `until`."
    ]


def _size(form: Discretized, u: Floats) -> float:
    return float(np.sqrt(max(np.trace(form.inner(u, u)), 0.0)))
