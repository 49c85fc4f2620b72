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
    InputError,
    Ints,
    advice_of,
    as_points,
    as_source,
    as_vector,
    check_source,
    edge_limit_of,
    local_minima_of,
    members_of,
    positive,
    shown,
    source_repr,
)
from cpmkit_combinations.wrapper import smooth_surface_of, with_abilities


@dataclass(frozen=True, eq=False)
class Union:
    """All points of several sources. The nearest member gives the closest point of a query.

    Of equally near ones it is a member whose foot is on no edge, then the first.

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

    def with_members(self, numbers: Sequence[int], /) -> Any:
        """Return the union of the members with these ``numbers``, in this order; of one number the member itself."""
        chosen = [self.members[number] for number in numbers]
        return chosen[0] if len(chosen) == 1 else union(members=chosen)

    @property
    def bounds(self) -> Floats:
        """(2, d) corners of the bounding box of the members' boxes."""
        boxes = np.array([member.bounds for member in self.members], dtype=np.float64)
        return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])

    @property
    def exact(self) -> bool:
        """True where all members are exact."""
        return all(member.exact for member in self.members)

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d).

        ``element`` is the number of the member, and ``edge`` the edge number on the member plus its ``first_edges``:
        1000 for each member before it, more for members with more edges; -1 off all edges. Raise InputError if ``x``
        holds NaN or infinity, its shape is not (n, d), or a member numbers an edge beyond its limit.
        """
        x = as_points(x, self.dim)
        # An end that lies in another member is as near as this member, up to rounding, and is no edge there.
        tie = 1e-12 * np.abs(self.bounds).max()
        best = self._as_union_records(0, self.members[0].closest_point(x))
        for number, member in enumerate(self.members[1:], 1):
            feet = self._as_union_records(number, member.closest_point(x))
            level = np.abs(feet.distance - best.distance) <= tie
            one_at_edge = (feet.edge >= 0) != (best.edge >= 0)
            nearer = np.flatnonzero(np.where(level & one_at_edge, best.edge >= 0, feet.distance < best.distance))
            best = best.replace_rows(nearer, feet.take(nearer))
        return best

    @cached_property
    def first_edges(self) -> tuple[int, ...]:
        """The number added to the edge numbers of each member; at last the limit of all edge numbers."""
        return tuple(np.cumsum([0] + [edge_limit_of(member) for member in self.members]).tolist())

    def _as_union_records(self, number: int, feet: ClosestPoints) -> ClosestPoints:
        """Return the records ``feet`` of member ``number`` as records of the union.

        Raise InputError if an edge number reaches the member's limit.
        """
        first, limit = self.first_edges[number : number + 2]
        edge = np.where(feet.edge >= 0, feet.edge + first, -1)
        if edge.max(initial=-1) >= limit:
            raise InputError(
                f"member {number} of a union has an edge with the number {int(feet.edge.max())}, where the limit is "
                f"{limit - first}; a source with more edges states a larger limit as edge_limit."
            )
        doubtful = np.zeros(len(feet), dtype=bool) if feet.doubtful is None else feet.doubtful
        return ClosestPoints(feet.points, feet.distance, edge, np.full(len(feet), number), doubtful=doubtful)

    def _local_minima(self, x: Floats, radius: float, /) -> tuple[Ints, ClosestPoints]:
        """Return rows (k,) of ``x`` (n, d), ascending, and the feet on all members within ``radius``.

        Those of a row are ordered by distance. A member without local minima contributes its closest points. Raise
        InputError if ``x`` holds NaN or infinity, its shape is not (n, d), or ``radius`` is not a number above zero.
        """
        x, radius = as_points(x, self.dim), positive(radius, "radius")
        answers = [local_minima_of(member, x, radius) for member in self.members]
        rows = np.concatenate([member_rows for member_rows, _ in answers])
        feet = ClosestPoints.join([self._as_union_records(number, feet) for number, (_, feet) in enumerate(answers)])
        order = np.lexsort((feet.distance, rows))
        return rows[order], feet.take(order)

    def _directions(self, name: str, feet: ClosestPoints, /) -> Floats:
        """Return unit vectors (n, d) at ``feet`` by the method ``name`` of each row's member.

        Members are queried again, since a record of the union holds the member's number as ``element``. Raise
        InputError if ``feet`` lack it.
        """
        if feet.element is None:
            raise InputError("feet must be records that this union answered: they lack element.")
        vectors = np.empty_like(feet.points)
        for number in np.unique(feet.element):
            rows, member = np.flatnonzero(feet.element == number), self.members[number]
            member_feet = member.closest_point(np.ascontiguousarray(feet.points[rows]))
            vectors[rows] = getattr(member, name)(member_feet)
        return vectors

    _normals = partialmethod(_directions, "normals")
    _facet_normals = partialmethod(_directions, "facet_normals")
    _tangents = partialmethod(_directions, "tangents")
    _leftward = partialmethod(_directions, "leftward")

    def _mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return vertices (v, d) and cells (m, k) of all members' meshes; rows of smaller cells end in -1."""
        meshes = [member.mesh(spacing) for member in self.members]
        corners = max(cells.shape[1] for _, cells in meshes)
        first = np.cumsum([0] + [len(vertices) for vertices, _ in meshes])
        padded = [
            np.pad(cells + start, ((0, 0), (0, corners - cells.shape[1])), constant_values=-1)
            for (_, cells), start in zip(meshes, first, strict=False)
        ]
        return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(padded)

    def _smooth_surface(self) -> Union:
        """Return the union of the smooth surfaces of the members that have one, and of the other members."""
        return replace(self, members=tuple(map(smooth_surface_of, self.members)))

    def _translate(self, offset: Floats, /) -> Union:
        """Return the union of the members moved by ``offset`` (d,)."""
        shift = as_vector(offset, self.dim, "offset")
        return replace(self, members=tuple(member.translate(shift) for member in self.members))

    @property
    def edge_limit(self) -> int:
        """The exclusive upper bound of the union's edge numbers."""
        return self.first_edges[-1]

    def _advice(self, spacing: float, /) -> Advice:
        """Return the warnings of all members at grid ``spacing``, and the largest of their errors.

        A mesh serves for samples if all members' do; feet are counted only if those of all members are finitely many.
        """
        advice = [advice_of(member, spacing) for member in self.members]
        counts = [part.foot_count for part in advice if part.foot_count is not None]
        return Advice(
            max(part.floor for part in advice),
            tuple(text for part in advice for text in part.warnings),
            max(part.floor if part.integral_floor is None else part.integral_floor for part in advice),
            tuple(text for part in advice for text in part.closest_point_warnings),
            all(part.mesh_for_samples for part in advice),
            sum(counts) if len(counts) == len(advice) else None,
        )


def union(*, members: Sequence[ClosestPointSource]) -> Any:
    """Return the union of sources: of disconnected pieces, or of curves, surfaces and solids that touch.

    Where members of different dimensions meet, or are nearer than four spacings, the solution is continuous, but no law
    of the equation determines the flux from one to the other: it depends on the spacing, however small. Solutions and
    explanations name the members, such a solution has no error estimate, and a tolerance, seconds or memory in place of
    a spacing is refused. A union can be drawn or translated if all its members can. It has normals or tangents if
    all have them and their dimensions agree, and local minima if these agree: in a mixed union the solver queries the
    members. It takes no data given by the vertex. Raise InputError if there are no members, or one is no source or lies
    in another space.

    Parameters
    ----------
    members : list of sources or meshes
        In the same space. Members of unions become members of this one. In a scene file a list of tables.

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
    for number, member in enumerate(map(as_source, members)):
        check_source(member, f"member {number}")
        flat += members_of(member)
    dims = sorted({member.dim for member in flat})
    if len(dims) > 1:
        raise InputError("All members must lie in the same space, got some in the plane and some in space.")
    return with_abilities(Union, "union", *flat)(tuple(flat))
