"""The kind ``solid``: the inside of a closed curve in the plane, or of a closed surface in space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.plugin import (
    MOST_EDGES,
    Bools,
    ClosestPoints,
    ClosestPointSource,
    Floats,
    HasInside,
    HasNormals,
    HasTangents,
    InputError,
    Ints,
    as_points,
    as_source,
    check_source,
    positive,
    rectangle,
    source_repr,
)
from cpmkit_combinations.union import Union
from cpmkit_combinations.wrapper import Wrapper, with_abilities

#: Number of points along each side of the box whose closest points are checked for open edges.
EDGE_PROBES = 24


@dataclass(frozen=True, eq=False)
class Solid(Wrapper):
    """The points on and inside a closed hypersurface.

    Attributes
    ----------
    of : ClosestPointSource
        The hypersurface; a union of several closed ones where the solid has holes or several parts.
    outward : tuple of float
        For it or each of its members, 1 where normals point outwards or it knows its inside, -1 where they point
        inwards.
    """

    outward: tuple[float, ...]

    __repr__ = source_repr

    @property
    def manifold_dim(self) -> int:
        """Dimension of the space: a solid has codimension zero."""
        return self.dim

    @property
    def bounds(self) -> Floats:
        """(2, d) corners of the hypersurface's box."""
        return np.asarray(self.of.bounds, dtype=np.float64)

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d): a point inside is its own.

        ``edge`` is -1 inside. Outside it is 0, of a solid enclosed by a union 1000 times the number of the foot's
        member.
        Raise InputError if ``x`` holds NaN or infinity, or its shape is not (n, d).
        """
        x = as_points(x, self.dim)
        feet, inside = self._feet_and_inside(x)
        element = np.zeros(len(x), dtype=np.int64) if feet.element is None else feet.element
        number = MOST_EDGES * element if isinstance(self.of, Union) else np.zeros(len(x), dtype=np.int64)
        return ClosestPoints(
            np.where(inside[:, None], x, feet.points),
            np.where(inside, 0.0, feet.distance),
            np.where(inside, -1, number),
            doubtful=feet.doubtful,
        )

    def _feet_and_inside(self, x: Floats) -> tuple[ClosestPoints, Bools]:
        """Return the closest points of ``x`` (n, d) on the hypersurface, and (n,) whether each is inside the solid.

        Inside is on or inside an odd number of the closed parts.
        """
        if not isinstance(self.of, Union):
            return closest_point_and_inside(self.of, self.outward[0], x)
        odd = np.zeros(len(x), dtype=bool)
        for part, outward in zip(self.of.members, self.outward, strict=True):
            odd ^= closest_point_and_inside(part, outward, x)[1]
        return self.of.closest_point(x), odd

    @property
    def _skin(self) -> ClosestPointSource:
        """The hypersurface, a union where the solid has holes or several parts."""
        hypersurface: ClosestPointSource = self.of
        return hypersurface

    def _mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return vertices and triangles (m, 3) of about ``spacing``: of the inside (2D) or of the boundary (3D)."""
        if self.dim == 3:
            mesh: tuple[Floats, Ints] = self.of.mesh(spacing)
            return mesh
        return fill_area(self, positive(spacing, "spacing"))

    def _translate(self, offset: Floats, /) -> Solid:
        """Return the solid moved by ``offset`` (d,)."""
        return type(self)(self.of.translate(offset), self.outward)

    @property
    def edge_limit(self) -> int:
        """The exclusive upper bound of edge numbers."""
        return MOST_EDGES * (len(self.of.members) if isinstance(self.of, Union) else 1)


def closest_point_and_inside(hypersurface: Any, outward: float, x: Floats) -> tuple[ClosestPoints, Bools]:
    """Return the closest points of ``x`` (n, d) on a hypersurface, and (n,) whether each of ``x`` is on or inside it.

    ``outward`` is 1 where normals point outwards, -1 where inwards, of a hypersurface that does not know its inside.
    """
    if isinstance(hypersurface, HasInside):
        return hypersurface.closest_point_and_inside(x)
    feet = hypersurface.closest_point(x)
    return feet, outward * signed_height(hypersurface, feet, x) <= 0


def signed_height(hypersurface: Any, feet: ClosestPoints, x: Floats) -> Floats:
    """Return the components (n,) of ``x`` (n, d) minus their ``feet`` along the hypersurface's unit normals.

    The normal of a plane curve without normals is its tangent turned to the right.
    """
    if isinstance(hypersurface, HasNormals):
        normals = hypersurface.normals(feet)
    else:
        tangents = hypersurface.tangents(feet)
        normals = np.stack([tangents[:, 1], -tangents[:, 0]], axis=1)
    return np.asarray(np.sum((x - feet.points) * normals, axis=1))


def fill_area(area: ClosestPointSource, spacing: float) -> tuple[Floats, Ints]:
    """Return vertices (v, 2) and triangles (m, 3), with edges of about ``spacing``, that fill a plane area.

    They are the triangles, counterclockwise, of a square lattice with a corner inside, none if no point of it is
    inside; corners outside are moved to the edge, and triangles that have no positive area then are dropped.
    """
    lower, upper = np.asarray(area.bounds, dtype=np.float64)
    points, triangles = rectangle(lower, upper, spacing)
    feet = area.closest_point(points)
    triangles = triangles[(feet.edge < 0)[triangles].any(axis=1)]
    used, triangles = np.unique(triangles, return_inverse=True)
    vertices, triangles = feet.points[used], triangles.reshape(-1, 3)
    p, q, r = (vertices[triangles[:, k]] for k in range(3))
    twice_area = (q - p)[:, 0] * (r - p)[:, 1] - (q - p)[:, 1] * (r - p)[:, 0]
    return vertices, triangles[twice_area > 1e-9 * spacing**2]  # no area: three corners on one straight edge


def solid(*, of: ClosestPointSource) -> Any:
    """Return the inside of a closed hypersurface: a disc, a polygon, a ball, the inside of a mesh.

    Raise InputError if ``of`` is no source or of another dimension, has no normals (in the plane: and no tangents), or
    is open at the closest point of one of the points of a lattice around it.

    Parameters
    ----------
    of : source or mesh
        A closed curve in the plane with normals or tangents, or a closed surface in space with normals, of either
        sign. The solid of a union, or of a mesh of several shells, contains the points that an odd number of them
        encloses, in whatever sense they are wound: a circle inside a circle makes a hole.

    Examples
    --------
    >>> import cpmkit as ck
    >>> disc = ck.source("solid", of=ck.source("analytic.circle", radius=2.0))
    >>> disc.closest_point([[1.0, 0.5], [0.0, 3.0]]).points.tolist()
    [[1.0, 0.5], [0.0, 2.0]]
    """
    of = as_source(of)
    check_source(of, "the boundary of the solid")
    parts = of.members if isinstance(of, Union) else [of]
    outward = tuple(_outward_sign(part) for part in parts)
    return with_abilities(Solid, "solid", of)(of, outward)


def _outward_sign(part: ClosestPointSource) -> float:
    """Return 1.0 if the normals of the closed hypersurface ``part`` point outwards, or it knows its inside, else -1.0.

    Raise InputError if it is no closed hypersurface with normals, or in the plane with tangents.
    """
    if part.manifold_dim != part.dim - 1:
        advice = "unite surfaces, such as a faceted mesh of a box, not solids" if part.manifold_dim == part.dim else ""
        raise InputError(
            f"A solid is enclosed by a closed curve in the plane or a closed surface in space, got a manifold of "
            f"dimension {part.manifold_dim} in {part.dim}D{'; ' if advice else ''}{advice}."
        )
    if not (isinstance(part, HasNormals) or (part.dim == 2 and isinstance(part, HasTangents))):
        raise InputError(
            f"{type(part).__name__} has no normals to distinguish inside and outside; give a source with them."
        )
    lower, upper = np.asarray(part.bounds, dtype=np.float64)
    size = float((upper - lower).max())
    axes = [
        np.linspace(low - 0.1 * size, high + 0.1 * size, EDGE_PROBES) for low, high in zip(lower, upper, strict=True)
    ]
    probes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, part.dim)
    if (part.closest_point(probes).edge >= 0).any():
        raise InputError(f"{type(part).__name__} is open and encloses nothing; give a closed one.")
    if isinstance(part, HasInside):
        return 1.0
    far = (upper + 10 * size)[None]
    return float(np.sign(signed_height(part, part.closest_point(far), far)[0]))
