"""A scene with another equation, or with other data in its conditions; what tables were made for stays as it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from cpmkit.errors import SceneError, shown
from cpmkit.scene.alike import same_condition
from cpmkit.scene.boundary import Boundary
from cpmkit.scene.condition import Condition
from cpmkit.scene.conditions import as_conditions
from cpmkit.scene.edge import as_edge, parts_of_edge, shape_of_edge
from cpmkit.scene.equations import Equation
from cpmkit.scene.laws import Interface, Law, Mixed, Nonlinear
from cpmkit.scene.scene import Scene

#: The word under which the data of the edge are given.
EDGE = "edge"


def restated(scene: Scene, problem: Equation | None, data: Mapping[str, Any] | None) -> Scene:
    """Return the scene with another ``problem`` and other ``data``; see :meth:`cpmkit.preparing.Prepared.solve`.

    Raises
    ------
    SceneError
        If a name is no boundary's, or a condition differs in more than its data.
    """
    if problem is None and not data:
        return scene
    data = dict(data or {})
    boundaries = [
        _with_data(boundary, data.pop(boundary.name)) if boundary.name in data else boundary
        for boundary in scene.boundaries
    ]
    edge = _edge_with_data(scene.edge, data.pop(EDGE)) if EDGE in data else scene.edge
    if data:
        names = [EDGE, *(repr(boundary.name) for boundary in scene.boundaries)]
        raise SceneError(f"data are given for {next(iter(data))!r}; the scene has {', '.join(names)}.")
    return replace(scene, problem=problem or scene.problem, boundaries=boundaries, edge=edge)


def _with_data(boundary: Any, given: Any) -> Boundary:
    if not isinstance(boundary, Boundary):
        raise SceneError(
            f"boundary {boundary.name!r} is no cpmkit.Boundary, and takes no other data; use cpmkit.solve."
        )
    sides = {side: getattr(boundary, side) for side in ("both", "left", "right", "across")}
    held = {side: one for side, one in sides.items() if one is not None}
    new = given if isinstance(given, Mapping) else dict.fromkeys([*held][:1], given)
    new = as_conditions(new)
    if set(new) != set(held):
        raise SceneError(
            f"boundary {boundary.name!r} holds conditions on {' and '.join(held)}, got {' and '.join(new)}; give data "
            "for the same."
        )
    for side, one in new.items():
        _check_same(held[side], one, f"boundary {boundary.name!r}, {side},")
    if "left" in held and same_condition(*held.values()) != same_condition(*new.values()):
        count = "one condition" if same_condition(*held.values()) else "two conditions"
        raise SceneError(f"boundary {boundary.name!r} has {count} for its sides in the tables; use cpmkit.solve.")
    return replace(boundary, **new)


def _edge_with_data(edge: Any, given: Any) -> Any:
    given = as_edge(given)
    if shape_of_edge(edge) != shape_of_edge(given):
        raise SceneError(
            "data of the edge must be one condition, or one for each of its loops or parts, as the scene has them, "
            "and each part where it is."
        )
    if isinstance(edge, Mapping):
        given = {loop: given[loop] for loop in edge}
    for (old, _), (new, _) in zip(parts_of_edge(edge), parts_of_edge(given), strict=True):
        _check_same(old.condition, new.condition, "the edge")
    return given


def _check_same(old: Condition, new: Any, what: str) -> None:
    """Refuse a condition of another kind than the tables hold, or with other factors.

    Raises
    ------
    SceneError
        In one sentence.
    """
    if not isinstance(new, Condition) or old.order != new.order or not _same_but_data(old.law, new.law):
        raise SceneError(
            f"{what} is {old.kind} in the tables, got {shown(getattr(new, 'kind', new))}: only data may differ, not "
            "the kind, its factors or its order; use cpmkit.solve."
        )


def _same_but_data(old: Law, new: Law) -> bool:
    if type(old) is not type(new):
        return False
    if isinstance(old, Interface) and isinstance(new, Interface):
        return (old.resistance, old.left, old.right) == (new.resistance, new.left, new.right)
    if isinstance(old, Mixed) and isinstance(new, Mixed):
        return (old.alpha, old.beta) == (new.alpha, new.beta)
    return not isinstance(old, Nonlinear)
