"""Data that vary within a spacing: a form evaluates them at points about a spacing apart and misses the variation.

Half the mean squared difference of values at two points, as a function of their distance r, is A + B r^2 for small r
(the variogram). A, the "nugget", is the mean square of the variation within a spacing: zero for resolved data.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from cpmkit.errors import CpmkitError
from cpmkit.forms.contract import Discretized
from cpmkit.scene.data import Functional, evaluate_data
from cpmkit.scene.diffusivities import evaluate_diffusivity
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats

#: Points at which data are compared: so many runs of so many consecutive points.
RUNS, RUN_LENGTH = 24, 128
#: Neighbours of a point, within so many spacings; points nearer than the last count once, as nodes may share them.
NEIGHBOURS, NEIGHBOUR_SPACINGS, SAME_SPACINGS = 6, 0.75, 0.05
#: Data are unresolved where the root of A is more than this share of their root mean square. Of sin(k x) on circles and
#: spheres it is below .1 up to k h = 1, .1 to .3 at 3, from .2 on at 6 and .85 to 1.1 from 20 on, in both forms; of a
#: step on the unit sphere at h = .2 it is .06.
UNRESOLVED_NUGGET = 0.2
#: Data are rounding where they change by so many times their size when their points move by this share of a spacing, in
#: a direction along which no boundary runs.
ROUNDING_CHANGE, MOVED_SPACINGS, MOVED = 100.0, 1e-9, (0.37, 0.59, 0.43)


class DataAtPoints(NamedTuple):
    """Data of a scene, their label in warnings, and points (k, d) at which a form reads them."""

    label: str
    data: Any
    points: Floats


def unresolved_data(form: Discretized, conditions: Iterable[DataAtPoints], spacing: float | None = None) -> list[str]:
    """Return a list with a warning for each of a scene's data that varies within a spacing.

    ``form``: the form, at some of whose points the data of the equation are read.
    ``conditions``: the data of the conditions.
    ``spacing``: spacing of the finest lattice; by default that of the form.
    """
    width = form.spacing if spacing is None else spacing
    return [text for data in _all_data(form, conditions) for text in _warnings(form.scene, data, width)]


def nugget(values: Floats, points: Floats, spacing: float) -> float:
    """Return sqrt(A) over the root mean square of ``values`` (k, channels) at ``points`` (k, d), A being the nugget.

    A is fitted to the differences between neighbours within 3/4 of a spacing. The largest ratio of all channels is
    returned; zero where there are too few neighbours.
    """
    from scipy.spatial import cKDTree

    radius = NEIGHBOUR_SPACINGS * spacing
    cells = np.round((points - points.min(axis=0)) / (SAME_SPACINGS * spacing)).astype(np.int64)
    distinct = np.unique(cells, axis=0, return_index=True)[1]
    points, values = points[distinct], values[distinct]
    distance, number = cKDTree(points).query(points, NEIGHBOURS + 1, distance_upper_bound=radius)
    first, column = np.nonzero(np.isfinite(distance) & (distance > 0))
    if len(first) < NEIGHBOURS:
        return 0.0
    r, second = distance[first, column] / radius, number[first, column]
    halves = 0.5 * (values[first] - values[second]) ** 2
    constant = np.linalg.lstsq(np.stack([np.ones_like(r), r**2], axis=1), halves, rcond=None)[0][0]
    size = np.mean(values**2, axis=0)
    share = np.divide(np.maximum(constant, 0.0), size, out=np.zeros_like(size), where=size > 0)
    return float(np.sqrt(share.max()))


def _all_data(form: Discretized, conditions: Iterable[DataAtPoints]) -> Iterator[DataAtPoints]:
    """Yield the data of the equation and of the conditions, each at some of the points at which the form reads them."""
    terms, points = form.scene.problem.terms(), form.points
    points = points[_rows_in_runs(len(points))]
    yield DataAtPoints("the right-hand side f", terms.f, points)
    yield DataAtPoints("the factor c", terms.c, points)
    yield DataAtPoints("the diffusivity", terms.diffusivity, points)
    for condition in conditions:
        yield condition._replace(points=condition.points[_rows_in_runs(len(condition.points))])


def _rows_in_runs(count: int) -> Any:
    """Return the integers (k,) from 0 below ``count``; if these are many, evenly spread runs of consecutive ones."""
    if count <= RUNS * RUN_LENGTH:
        return np.arange(count)
    starts = np.linspace(0, count - RUN_LENGTH, RUNS).astype(np.int64)
    return np.unique(starts[:, None] + np.arange(RUN_LENGTH))


def _warnings(scene: Scene, data: DataAtPoints, spacing: float) -> Iterator[str]:
    """Yield one warning if data vary within ``spacing``, unless their values are rounding errors alone; else none."""
    values = _values(scene, data)
    share = 0.0 if values is None else nugget(values, data.points, spacing)
    if share > UNRESOLVED_NUGGET and not _is_rounding(scene, data, values, spacing):
        yield (
            f"{data.label[0].upper()}{data.label[1:]} varies within a spacing, by about {min(share, 1.0):.0%} of its "
            f"size: at spacing={spacing:g} it is read at too few points to resolve it, and the solution may be off by "
            "as much as its own size; use a spacing of a third of its shortest wave or less, or give its mean over a "
            "spacing."
        )


def _is_rounding(scene: Scene, data: DataAtPoints, values: Any, spacing: float) -> bool:
    """Return whether data with ``values`` (k, channels) are zero up to rounding, as ``x`` is on a side at x = 0.

    They are if moving their points by a tiny share of ``spacing`` changes them by many times their size.
    """
    step = MOVED_SPACINGS * spacing * np.array(MOVED)[: data.points.shape[1]]
    moved = _values(scene, data._replace(points=data.points + step))
    return moved is not None and float(np.abs(moved - values).max()) > ROUNDING_CHANGE * float(np.abs(values).max())


def _values(scene: Scene, data: DataAtPoints) -> Floats | None:
    """Return the values (k, channels) of data at their points; None if they are no function of points alone."""
    function, entries = data.data, data.data if isinstance(data.data, (list, tuple)) else (data.data,)
    fixed = isinstance(function, Functional) or getattr(function, "needs_state", False) or hasattr(function, "form")
    if fixed or not any(map(callable, entries)) or not len(data.points):
        return None
    try:
        if data.label == "the diffusivity":
            return evaluate_diffusivity(function, data.points, data.label).reshape(len(data.points), -1)
        return evaluate_data(function, data.points, None, data.label, scene.problem.start_time)
    except CpmkitError:  # of a function known at all the form's points alone; other errors are raised where it is used
        return None
