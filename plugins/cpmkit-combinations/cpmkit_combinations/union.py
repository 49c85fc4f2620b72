"""The kind ``union``: several sources as one, of the same dimension or of mixed ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partialmethod
from typing import Any

import numpy as np

from cpmkit.plugin import (
    Advice,
    ClosestPoints,
    ClosestPointSource,
    Floats,
    HasMembers,
    InputError,
    Ints,
    advice_of,
    as_points,
    as_vector,
    check_source,
    edge_limit_of,
    local_minima_of,
    positive,
    shown,
    source_repr,
)
from cpmkit_combinations.wrapper import with_abilities


@dataclass(frozen=True, eq=False)
class Union:
    """All points of several sources. The nearest member answers, of equals the first.

    Attributes
    ----------
    members : tuple of ClosestPointSource
        Not unions themselves.
    """

    members: tuple[Any, ...]

    __repr__ = source_repr

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
            nearer = np.flatnonzero(found.distance < best.distance)
            best = best.replaced(nearer, found.take(nearer))
        return best

    @cached_property
    def first_edges(self) -> tuple[int, ...]:
        """What is added to the numbers of each member's edges; at last the limit of all."""
        return tuple(np.cumsum([0] + [edge_limit_of(member) for member in self.members]).tolist())

    def _of_member(self, number: int, feet: ClosestPoints) -> ClosestPoints:
        first, limit = self.first_edges[number : number + 2]
        edge = np.where(feet.edge >= 0, feet.edge + first, -1)
        if edge.max(initial=-1) >= limit:
            raise InputError(
                f"member {number} of a union numbers an edge {int(feet.edge.max())}, and there is room below "
                f"{limit - first} before the next member's; a source with more edges says so by edge_limit."
            )
        doubtful = np.zeros(len(feet), dtype=bool) if feet.doubtful is None else feet.doubtful
        return ClosestPoints(feet.points, feet.distance, edge, np.full(len(feet), number), doubtful=doubtful)

    def _local_minima(self, x: Floats, radius: float, /) -> tuple[Ints, ClosestPoints]:
        """Return the rows (k,) of ``x`` (n, d) and the feet of all members within ``radius``, the nearest first.

        A member that finds no further feet of its own gives its closest points.

        Raises
        ------
        InputError
            If ``x`` holds NaN or infinity, its shape is not (n, d), or ``radius`` is not a number above zero.
        """
        x, radius = as_points(x, self.dim), positive(radius, "radius")
        found = [local_minima_of(member, x, radius) for member in self.members]
        rows = np.concatenate([at for at, _ in found])
        feet = ClosestPoints.join([self._of_member(number, own) for number, (_, own) in enumerate(found)])
        order = np.lexsort((feet.distance, rows))
        return rows[order], feet.take(order)

    def _directions(self, name: str, feet: ClosestPoints, /) -> Floats:
        """Return the unit vectors (n, d) that the members call ``name``, each asked with records of its own.

        A record of the union names the member, not the place on it.
        """
        if feet.element is None:
            raise InputError("feet must be records that this union answered: they lack element.")
        answers = np.empty_like(feet.points)
        for number in np.unique(feet.element):
            rows, member = np.flatnonzero(feet.element == number), self.members[number]
            own = member.closest_point(np.ascontiguousarray(feet.points[rows]))
            answers[rows] = getattr(member, name)(own)
        return answers

    _normals = partialmethod(_directions, "normals")
    _facet_normals = partialmethod(_directions, "facet_normals")
    _tangents = partialmethod(_directions, "tangents")
    _leftward = partialmethod(_directions, "leftward")

    def _mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return the members' meshes as one; rows of smaller cells end in -1."""
        meshes = [member.mesh(spacing) for member in self.members]
        corners = max(cells.shape[1] for _, cells in meshes)
        first = np.cumsum([0] + [len(vertices) for vertices, _ in meshes])
        padded = [
            np.pad(cells + start, ((0, 0), (0, corners - cells.shape[1])), constant_values=-1)
            for (_, cells), start in zip(meshes, first, strict=False)
        ]
        return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(padded)

    def _translated(self, offset: Floats, /) -> Union:
        """Return the union of the members moved by ``offset`` (d,)."""
        shift = as_vector(offset, self.dim, "offset")
        return replace(self, members=tuple(member.translated(shift) for member in self.members))

    @property
    def _edge_limit(self) -> int:
        """What all numbers of edges are below."""
        return self.first_edges[-1]

    @property
    def _foot_count(self) -> int:
        """How many points the members' feet are among."""
        return sum(member.foot_count for member in self.members)

    def _advice(self, spacing: float, /) -> Advice:
        """Return what all members have to say at this spacing, and the largest of their floors."""
        told = [advice_of(member, spacing) for member in self.members]
        integral = [one.floor if one.integral_floor is None else one.integral_floor for one in told]
        return Advice(
            max(one.floor for one in told),
            tuple(text for one in told for text in one.warnings),
            max(integral),
            tuple(text for one in told for text in one.closest_point_warnings),
        )


def union(*, members: Sequence[ClosestPointSource]) -> Any:
    """Return the union of sources: of disconnected pieces, or of curves, surfaces and solids that touch.

    Where members of different dimensions meet, or are nearer than four spacings, the solution is continuous and flows
    from one to the other, but no law of the equation holds there: how much flows is decided by the spacing, at any
    spacing. Solutions and explanations name the members, such a solution has no error estimate, and a tolerance,
    seconds or memory in place of a spacing is refused.
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
        raise InputError(f"members must be a list of sources, got {shown(members)}.")
    flat: list[Any] = []
    for number, member in enumerate(members):
        check_source(member, f"member {number}")
        flat += member.members if isinstance(member, HasMembers) else [member]
    dims = sorted({member.dim for member in flat})
    if len(dims) > 1:
        raise InputError("All members must lie in the same space, got some in the plane and some in space.")
    return with_abilities(Union, "union", *flat)(tuple(flat))
