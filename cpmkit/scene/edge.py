"""What holds on the edge of a manifold: one condition, one for each loop, or conditions by position along it."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.manifold.local_source import LocalSource
from cpmkit.protocols import ClosestPointSource, Floats, Ints
from cpmkit.scene.by_position import ByPosition, Part, Where, is_by_position, parts_of
from cpmkit.scene.condition import Condition
from cpmkit.scene.conditions import as_condition
from cpmkit.scene.data import Data

#: Where on an edge a datum can be asked is sought from so many points an axis, from before the bounds to past them.
ASKED_PER_AXIS, PAST_BOUNDS_SHARE = 7, 0.25
#: What holds on an edge or a loop of it: one condition, or some by position.
LoopConditions = Condition | ByPosition
#: What holds on the edge of a manifold: the same for all of it, or for each loop, by its number.
EdgeConditions = LoopConditions | Mapping[int, LoopConditions]
#: What may be given for an edge or a loop of it.
GivenEdge = LoopConditions | Data | list[Condition | tuple[Condition | Data, Where]]


def as_edge(given: Any) -> Any:
    """Return what is given for an edge as a scene keeps it; what is no condition comes back as it is.

    Raises
    ------
    SceneError
        If parts by position are not what they should be.
    """
    if isinstance(given, Mapping):
        return {loop: as_edge(one) for loop, one in given.items()}
    if isinstance(given, ByPosition):
        return given
    return parts_of(given) if is_by_position(given) else as_condition(given)


def conditions_of_edge(edge: EdgeConditions) -> list[Condition]:
    """Return all conditions of an edge."""
    return [part.condition for part, _ in parts_of_edge(edge)]


def parts_of_edge(edge: EdgeConditions) -> list[tuple[Part, ByPosition | None]]:
    """Return all conditions of an edge as parts, each with those beside which it holds where there are any."""
    found: list[tuple[Part, ByPosition | None]] = []
    for one in edge.values() if isinstance(edge, Mapping) else [edge]:
        found += [(part, one) for part in one.parts] if isinstance(one, ByPosition) else [(Part(one), None)]
    return found


def shape_of_edge(edge: EdgeConditions) -> Any:
    """Return which loops an edge has conditions for, and where parts of it hold: what data alone do not change."""
    if isinstance(edge, Mapping):
        return {loop: shape_of_edge(one) for loop, one in edge.items()}
    return tuple(part.where for part in edge.parts) if isinstance(edge, ByPosition) else None


def by_position(edge: EdgeConditions) -> list[ByPosition]:
    """Return what of an edge goes by position."""
    held = edge.values() if isinstance(edge, Mapping) else [edge]
    return [one for one in held if isinstance(one, ByPosition)]


def conditions_along(edge: EdgeConditions, loops: Ints, points: Floats) -> list[tuple[Condition, Ints]]:
    """Return each condition with the rows at which it holds.

    Parameters
    ----------
    edge : EdgeConditions
        Of a scene.
    loops : (n,) int64
        The loop of the edge that each point lies on.
    points : (n, d) float64
        In the scene's coordinates.

    Raises
    ------
    SceneError
        If a loop is not in the table, or no part holds at a point.
    """
    found: list[tuple[Condition, Ints]] = []
    for loop in np.unique(loops).tolist() if isinstance(edge, Mapping) else [None]:
        rows = np.arange(len(points)) if loop is None else np.flatnonzero(loops == loop)
        one: Any = edge if loop is None else _of_loop(edge, loop)
        if isinstance(one, ByPosition):
            found += [(condition, rows[own]) for condition, own in one.along(points[rows])]
        else:
            found.append((one, rows))
    return [(condition, rows) for condition, rows in found if len(rows)]


def check_parts_met(edge: EdgeConditions, met: list[Condition]) -> None:
    """Refuse parts by position that hold at no point of the edge.

    Raises
    ------
    SceneError
        In one sentence.
    """
    known = {id(one) for one in met}
    for number, part in ((k, part) for one in by_position(edge) for k, part in enumerate(one.parts)):
        if id(part.condition) not in known:
            raise SceneError(
                f"part {number} of `edge`, {part.told}, holds at no point of the edge that this spacing sees; correct "
                "`where`, use a smaller spacing, or leave the part out."
            )


def edge_condition(edge: EdgeConditions, loop: int) -> Condition:
    """Return the condition of edge ``loop``.

    Raises
    ------
    SceneError
        If the edge is a table and the loop is not in it, or conditions go by position; :func:`conditions_along` tells
        which hold where.
    """
    one = _of_loop(edge, loop)
    if isinstance(one, ByPosition):
        raise SceneError("`edge` gives conditions by position, where one for a whole loop is needed.")
    return one


def _of_loop(edge: EdgeConditions, loop: int) -> LoopConditions:
    if not isinstance(edge, Mapping):
        return edge
    if loop not in edge:
        raise SceneError(
            f"the surface has an edge loop {loop} for which `edge` gives no condition; it has {sorted(edge)}."
        )
    return edge[loop]


def place_on_edge(source: ClosestPointSource, part: Part, beside: ByPosition | None) -> Floats:
    """Return a point (1, d) of the edge of ``source`` at which the data of a part of it can be asked.

    One where the part holds, if such a point is seen from around the bounds; data may be undefined elsewhere.
    """
    bounds = np.asarray(source.bounds, dtype=np.float64)
    centre, reach = bounds.mean(axis=0), np.ptp(bounds, axis=0)
    places = [bounds.T]
    if beside is not None:
        shares = np.linspace(-PAST_BOUNDS_SHARE, 1 + PAST_BOUNDS_SHARE, ASKED_PER_AXIS)
        places.append((bounds[0] + shares[:, None] * reach).T)
    target = np.array([*(point for one in places for point in product(*one)), centre])
    feet = LocalSource(source, np.zeros(source.dim)).closest_point(target)
    on = np.flatnonzero(feet.edge >= 0)
    if beside is not None and len(on):
        own = on[beside.number_at(feet.points[on]) == beside.parts.index(part)]
        on = own if len(own) else on
    return feet.points[[on[0] if len(on) else 0]]
