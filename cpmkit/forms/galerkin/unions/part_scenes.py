"""The scenes of the members of each dimension of a union, with their data, boundaries, edges, and cuts at junctions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from itertools import accumulate
from typing import Any

import numpy as np

from cpmkit.errors import place
from cpmkit.manifold.abilities import edge_limit_of, members_of
from cpmkit.manifold.local_source import largest_dim
from cpmkit.manifold.meetings import Meeting, distinct_places, edges_near, is_near, meetings_of, reaches_edge
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.mesh.mixed_cells import member_dimensions
from cpmkit.scene.boundary import Boundary
from cpmkit.scene.data import is_sequence
from cpmkit.scene.edge_conditions import ByPosition, EdgeConditions, LoopConditions, Part, loops_of_edge
from cpmkit.scene.junction import CONTINUOUS, JunctionSide, junction_of
from cpmkit.scene.laws import Value
from cpmkit.scene.member_data import MemberData
from cpmkit.scene.scene import Scene
from cpmkit.types import Bools, Floats, Ints


def scenes_by_dimension(scene: Scene) -> list[tuple[tuple[int, ...], Scene]]:
    """Return for each dimension, ascending, the numbers of the members of a union and the scene on them.

    A member of lower dimension that lies on one of higher dimension becomes a boundary of that, or a part of its edge,
    with a `JunctionSide`; where a curve meets a surface inside the curve, the curve is cut. Data of the whole scene are
    those of its members.
    """
    members, surface = members_of(scene.surface), scene.surface
    found = []
    for dim in member_dimensions(surface):
        numbers = tuple(k for k, member in enumerate(members) if largest_dim(member) == dim)
        source: Any = surface
        own = source.with_members(numbers)
        boundaries = [each for each in scene.boundaries if scene.oriented(each).dimension == dim]
        boundaries += _cuts(scene, numbers)
        problem = restrict_fields(scene.problem, partial(restrict_data, numbers=numbers, own=own))
        part = Scene(own, problem, boundaries, _edge(scene, numbers))
        found.append((numbers, _with_channels(part, scene.channels)))
    return found


def _with_channels(part: Scene, channels: int) -> Scene:
    """Return a scene of a part with so many ``channels``: data of other parts may have more than its own."""
    vars(part)["channels"] = channels
    return part


def without_edge(part: Scene) -> Scene:
    """Return the scene of a closed ``part`` without the conditions that the edge of other parts has."""
    return _with_channels(Scene(part.surface, part.problem, part.boundaries), part.channels)


def _cuts(scene: Scene, numbers: Sequence[int]) -> list[Boundary]:
    """Return the boundaries at which the members ``numbers`` of one dimension are cut, as others meet them there."""
    members, cuts, places = members_of(scene.surface), {}, [np.zeros((0, scene.surface.dim))]
    for meeting in meetings_of(scene.surface):
        higher, name = members[meeting.higher], f"junction {meeting.lower}"
        is_inside = meeting.how == "within" or (meeting.how == "along" and largest_dim(higher) < higher.dim)
        if meeting.higher in numbers and is_inside:
            resistance = junction_of(scene.junctions, meeting.lower, meeting.higher).resistance
            cuts[name] = Boundary(name, members[meeting.lower], both=JunctionSide(resistance=resistance))
        if meeting.lower in numbers and meeting.how == "points":
            places.append(meeting.places)
    at = distinct_places(np.concatenate(places), scene.surface)
    branches = sum((_branches(members[number], at, scene.surface) for number in numbers), np.zeros(len(at), dtype=int))
    # one branch is an end; three are cut and tied as a junction of curves
    inner = [
        Boundary(f"junction at {place(one)}, {k}", one[None], across=CONTINUOUS)
        for k, one in enumerate(at[branches == 2])
    ]
    return [*cuts.values(), *inner]


def _branches(curve: ClosestPointSource, places: Floats, surface: ClosestPointSource) -> Ints:
    """Return how many branches of a ``curve`` of the union ``surface`` begin at ``places`` (k, d): 1 at its ends."""
    at_end = np.array([bool(edges_near(curve, at[None])) for at in places], dtype=bool)
    return np.where(is_near(curve, places, surface), np.where(at_end, 1, 2), 0)


def _edge(scene: Scene, numbers: Sequence[int]) -> EdgeConditions:
    """Return the conditions on the edge of the union of the members ``numbers``.

    In a table, loops that lie on other members have zero flux unless the scene names them. Ends of curves and rims of
    surfaces that lie in a member of higher dimension have zero flux too, or the value that the edge of that has there.
    """
    ends = _ends_within(scene, numbers)
    if not isinstance(scene.edge, Mapping):
        return {**ends, **dict[Any, Any]({None: scene.edge})} if ends else scene.edge
    edge: dict[Any, Any] = {}
    members, (_, own_starts) = members_of(scene.surface), _first_loops(scene.surface, numbers)
    for meeting in meetings_of(scene.surface):
        divides = meeting.how in ("within", "inside") and meeting.higher in numbers
        for number in () if divides else {meeting.lower, meeting.higher} & {*numbers}:
            loops = edges_near(members[number], meeting.places)
            edge |= {own_starts[numbers.index(number)] + loop: JunctionSide() for loop in loops}
    edge |= ends
    for loop, condition in scene.edge.items():
        own_loop = own_loop_of(scene.surface, numbers, loop)
        if own_loop is not None:
            edge[own_loop] = condition
    return edge


def _ends_within(scene: Scene, numbers: Sequence[int]) -> dict[int, LoopConditions]:
    """Return the conditions at ends and rims of the members ``numbers`` that lie in others, by loops of their union."""
    surface, found = scene.surface, dict[int, LoopConditions]()
    members, (_, own_starts) = members_of(surface), _first_loops(surface, numbers)
    for meeting in meetings_of(surface):
        lower = members[meeting.lower]
        kinds = ("along", "within", "inside") if largest_dim(lower) == 1 else ("within",)
        if meeting.lower in numbers and meeting.how in kinds:
            first, values = own_starts[numbers.index(meeting.lower)], [*_values_on_edge(scene, meeting)]
            for loop, at in edges_near(lower, meeting.places).items():
                parts = [part for part in values if part.where is not None and part.where(at).any()]
                rest: LoopConditions = JunctionSide() if not parts else ByPosition((*parts, Part(JunctionSide())))
                found[first + loop] = parts[0].condition if parts and largest_dim(lower) == 1 else rest
    return found


def _values_on_edge(scene: Scene, meeting: Meeting) -> Iterator[Part]:
    """Yield the values on the edge of the higher member of a ``meeting``, each with its places on rims of the lower."""
    members, number = members_of(scene.surface), meeting.higher
    starts, _ = _first_loops(scene.surface, (number,))

    def holds(points: Floats, loop: int | None, conditions: ByPosition, part: int) -> Bools:
        own_loop = None if loop is None else loop - starts[number]
        is_reached = reaches_edge(members[meeting.lower], members[number], points, own_loop)
        return np.asarray(is_reached & (conditions.part_at(points) == part))

    for loop, conditions in loops_of_edge(scene.edge).items():
        if loop is None or starts[number] <= loop < starts[number + 1]:
            for k, part in enumerate(conditions.parts):
                if isinstance(part.condition.law, Value):
                    yield Part(part.condition, partial(holds, loop=loop, conditions=conditions, part=k))


def own_loop_of(surface: ClosestPointSource, numbers: Sequence[int], loop: int) -> int | None:
    """Return the number in the union of the members ``numbers`` of an edge loop of ``surface``; None if it has none."""
    starts, own_starts = _first_loops(surface, numbers)
    member = int(np.searchsorted(starts, loop, side="right")) - 1
    return int(loop - starts[member] + own_starts[numbers.index(member)]) if member in numbers else None


def loop_of_union(surface: ClosestPointSource, numbers: Sequence[int], own_loop: int) -> int:
    """Return the number on ``surface`` of an edge loop of the union of its members ``numbers``."""
    starts, own_starts = _first_loops(surface, numbers)
    position = min(int(np.searchsorted(own_starts, own_loop, side="right")), len(numbers)) - 1
    return int(own_loop - own_starts[position] + starts[numbers[position]])


def _first_loops(surface: ClosestPointSource, numbers: Sequence[int]) -> tuple[list[int], list[int]]:
    """Return the first numbers of the members' loops, and the end: on ``surface``, and on the union of ``numbers``."""
    limits = [edge_limit_of(member) for member in members_of(surface)]
    return [*accumulate(limits, initial=0)], [*accumulate((limits[number] for number in numbers), initial=0)]


def restrict_data(data: Any, numbers: Sequence[int], own: ClosestPointSource) -> Any:
    """Return ``data`` of a scene on a union for its members ``numbers``, whose union is ``own``."""
    if is_sequence(data) and any(isinstance(each, MemberData) for each in data):
        return type(data)(restrict_data(each, numbers, own) for each in data)
    return data.of_members(numbers, own) if isinstance(data, MemberData) else data


def restrict_fields(instance: Any, restrict: Callable[[Any], Any]) -> Any:
    """Return a dataclass ``instance`` with each field that changes by ``restrict`` replaced by its result."""
    old = {each.name: getattr(instance, each.name) for each in fields(instance) if each.init}
    new = {name: restrict(value) for name, value in old.items()}
    changed = {name: value for name, value in new.items() if value is not old[name]}
    return replace(instance, **changed) if changed else instance
