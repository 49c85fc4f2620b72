"""The kind ``union``: several sources as one, of the same dimension or of mixed ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.errors import InputError
from cpmkit.manifold.abilities import edge_limit_of, feet_of, floor_of, warnings_of, with_abilities
from cpmkit.manifold.answers import check_source
from cpmkit.protocols import (
    Bools,
    ClosestPoints,
    ClosestPointSource,
    Floats,
    HasFeet,
    HasFloor,
    HasLeft,
    HasManyEdges,
    HasMembers,
    HasMesh,
    HasNormals,
    HasTangents,
    HasTranslation,
    HasValues,
    HasWarnings,
    Ints,
    NamesLeft,
)
from cpmkit.runtime.arrays import as_points, as_vector, positive


@dataclass(frozen=True, eq=False)
class Union:
    """All points of several sources. The nearest member answers, of equals the first.

    Attributes
    ----------
    members : tuple of ClosestPointSource
        Not unions themselves.
    """

    members: tuple[Any, ...]

    @property
    def dim(self) -> int:
        """Dimension of the space."""
        return int(self.members[0].dim)

    @property
    def manifold_dim(self) -> int | None:
        """The members' dimension; ``None`` where they differ."""
        dims = {member.manifold_dim for member in self.members}
        return dims.pop() if len(dims) == 1 else None

    @property
    def bounds(self) -> Floats:
        """(2, d) corners of the box around the members' boxes."""
        boxes = np.array([member.bounds for member in self.members], dtype=np.float64)
        return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])

    @property
    def exact(self) -> bool:
        """True where all members are exact."""
        return all(member.exact for member in self.members)

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d).

        ``element`` is the number of the member that answers, and ``edge`` that of its edge on the member plus
        ``first_edges`` of it: 1000 a member before it, more for one that is itself made of several.

        Raises
        ------
        InputError
            If ``x`` holds NaN or infinity, its shape is not (n, d), or a member numbers an edge beyond its limit.
        """
        x = as_points(x, self.dim)
        best = self._of_member(0, self.members[0].closest_point(x))
        for number, member in enumerate(self.members[1:], 1):
            found = self._of_member(number, member.closest_point(x))
            best = _where(found.distance < best.distance, found, best)
        return best

    @cached_property
    def first_edges(self) -> tuple[int, ...]:
        """What is added to the numbers of each member's edges; at last the limit of all."""
        return tuple(np.cumsum([0] + [edge_limit_of(member) for member in self.members]).tolist())

    @property
    def edge_limit(self) -> int:
        """What all numbers of edges are below."""
        return self.first_edges[-1]

    def _of_member(self, number: int, feet: ClosestPoints) -> ClosestPoints:
        first, limit = self.first_edges[number : number + 2]
        edge = np.where(feet.edge >= 0, feet.edge + first, -1)
        if edge.max(initial=-1) >= limit:
            raise InputError(
                f"member {number} of a union numbers an edge {int(feet.edge.max())}, and there is room below "
                f"{limit - first} before the next member's; a source with more edges says so by edge_limit."
            )
        return ClosestPoints(feet.points, feet.distance, edge, np.full(len(feet), number), doubtful=doubtful_of(feet))

    def warnings(self, spacing: float, /) -> Sequence[str]:
        """Return what the members have to say at this spacing."""
        return [sentence for member in self.members for sentence in warnings_of(member, spacing)]

    def floor(self, spacing: float, /) -> float:
        """Return the largest of the members' floors."""
        return max(floor_of(member, spacing) for member in self.members)


def doubtful_of(feet: ClosestPoints) -> Bools:
    """Return which feet (n,) the search could not vouch for; none where it says nothing."""
    return np.zeros(len(feet), dtype=bool) if feet.doubtful is None else feet.doubtful


def _where(chosen: Bools, a: ClosestPoints, b: ClosestPoints) -> ClosestPoints:
    assert a.element is not None
    assert b.element is not None
    return ClosestPoints(
        np.where(chosen[:, None], a.points, b.points),
        np.where(chosen, a.distance, b.distance),
        np.where(chosen, a.edge, b.edge),
        np.where(chosen, a.element, b.element),
        doubtful=np.where(chosen, doubtful_of(a), doubtful_of(b)),
    )


class _WithFeet(Union):
    def feet(self, x: Floats, radius: float, /) -> tuple[Ints, ClosestPoints]:
        """Return the rows (k,) of ``x`` (n, d) and the feet of all members within ``radius``, the nearest first.

        A member that finds no further feet of its own gives its closest points.

        Raises
        ------
        InputError
            If ``x`` holds NaN or infinity, its shape is not (n, d), or ``radius`` is not a number above zero.
        """
        x, radius = as_points(x, self.dim), positive(radius, "radius")
        found = [feet_of(member, x, radius) for member in self.members]
        rows = np.concatenate([at for at, _ in found])
        feet = ClosestPoints.join([self._of_member(number, own) for number, (_, own) in enumerate(found)])
        order = np.lexsort((feet.distance, rows))
        return rows[order], feet.take(order)


class _WithNormals(Union):
    def normals(self, feet: ClosestPoints, /) -> Floats:
        """Return the unit normals (n, d) of the members."""
        return _by_member(self.members, feet, lambda member, own: member.normals(own))


class _WithTangents(Union):
    def tangents(self, feet: ClosestPoints, /) -> Floats:
        """Return the unit tangents (n, d) of the members."""
        return _by_member(self.members, feet, lambda member, own: member.tangents(own))


class _WithLeft(Union):
    def leftward(self, feet: ClosestPoints, /) -> Floats:
        """Return the unit vectors (n, d) to the left of the members."""
        return _by_member(self.members, feet, lambda member, own: member.leftward(own))


class _WithMesh(Union):
    def mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return the members' meshes as one; rows of smaller cells end in -1."""
        meshes = [member.mesh(spacing) for member in self.members]
        corners = max(cells.shape[1] for _, cells in meshes)
        first = np.cumsum([0] + [len(vertices) for vertices, _ in meshes])
        padded = [
            np.pad(cells + start, ((0, 0), (0, corners - cells.shape[1])), constant_values=-1)
            for (_, cells), start in zip(meshes, first, strict=False)
        ]
        return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(padded)


class _WithTranslation(Union):
    def translated(self, offset: Floats, /) -> Union:
        """Return the union of the members moved by ``offset`` (d,)."""
        shift = as_vector(offset, self.dim, "offset")
        return replace(self, members=tuple(member.translated(shift) for member in self.members))


#: What is made of each ability that all members have. Each has at least its closest point to give as a foot.
PASSING = {
    HasFeet: _WithFeet,
    HasNormals: _WithNormals,
    HasTangents: _WithTangents,
    HasLeft: _WithLeft,
    HasMesh: _WithMesh,
    HasTranslation: _WithTranslation,
    HasMembers: True,
    HasManyEdges: True,
    HasWarnings: True,
    HasFloor: True,
    NamesLeft: "one point cannot be left of all members: the solver asks each for its own",
    HasValues: "nothing says which member's rows come first; give data as functions of position",
}
#: Of members of different dimensions these are left out: the solver asks the members.
_ALIKE = (HasFeet, HasNormals, HasTangents, HasLeft)


def _by_member(members: Sequence[Any], feet: ClosestPoints, ask: Callable[[Any, ClosestPoints], Floats]) -> Floats:
    """Ask each member with records of its own: a union's name the member, not the place on it."""
    if feet.element is None:
        raise InputError("feet must be records that this union answered: they lack element.")
    answers = np.empty_like(feet.points)
    for number in np.unique(feet.element):
        rows = np.flatnonzero(feet.element == number)
        answers[rows] = ask(members[number], members[number].closest_point(np.ascontiguousarray(feet.points[rows])))
    return answers


def union(*, members: Sequence[ClosestPointSource]) -> Any:
    """Return the union of sources: of disconnected pieces, or of curves, surfaces and solids that touch.

    Where members of different dimensions meet, the solution is continuous and flows from one to the other. The
    equation there is what the grid makes of it, at the scale of a spacing: no condition at the joint is imposed.
    A union has those abilities that all its members have; normals, tangents and further feet only where the members'
    dimensions agree, for in a mixed union the solver asks the members.

    Parameters
    ----------
    members : list of sources
        In the same space. Members that are unions are taken apart. In a scene file a list of tables.

    Raises
    ------
    InputError
        If there are none, or one is no source or lies in another space.

    Examples
    --------
    >>> import cpmkit as ck
    >>> balls = [ck.source("analytic.sphere", center=[x, 0, 0]) for x in (-2.0, 2.0)]
    >>> ck.source("union", members=balls).closest_point([[0.4, 0, 0]]).element.tolist()
    [1]
    """
    if not isinstance(members, (list, tuple)) or not members:
        raise InputError(f"members must be a list of sources, got {members!r}.")
    flat: list[Any] = []
    for number, member in enumerate(members):
        check_source(member, f"member {number}")
        flat += member.members if isinstance(member, HasMembers) else [member]
    dims = sorted({member.dim for member in flat})
    if len(dims) > 1:
        raise InputError("All members must lie in the same space, got some in the plane and some in space.")
    mixed = len({member.manifold_dim for member in flat}) > 1
    base, left_out = (Union, _ALIKE) if mixed else (_WithFeet, (HasFeet,))
    passing = {ability: how for ability, how in PASSING.items() if ability not in left_out}
    return with_abilities(base, passing, *flat)(tuple(flat))
