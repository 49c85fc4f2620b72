"""The optional abilities of a source (a manifold given by closest points): protocols of further methods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from cpmkit.manifold.source import ClosestPoints, ClosestPointSource
from cpmkit.runtime.deprecation import warn_renamed
from cpmkit.types import Bools, Floats, Ints

#: Edge numbers of a source are below this, unless it has an attribute ``edge_limit``.
MOST_EDGES = 1000


@runtime_checkable
class HasNormals(Protocol):
    """A hypersurface that has unit normals of its own, on one side everywhere."""

    def normals(self, feet: ClosestPoints, /) -> Floats:
        """Return unit normals (n, d) at ``feet``, which are n closest points that this source returned."""


@runtime_checkable
class HasCreases(Protocol):
    """A mesh that stands for a smooth surface except in cells with a corner at a crease, where the surface is flat."""

    def facet_normals(self, feet: ClosestPoints, /) -> Floats:
        """Return unit normals (n, d) of the cells that contain ``feet``, where such a cell has a corner at a crease.

        NaN in other cells, at corners off creases, and on edges between such corners: there the surface is smooth.
        """


@runtime_checkable
class HasInside(Protocol):
    """A closed hypersurface that knows on which side a point lies, also near corners where normals do not decide."""

    def closest_point_and_inside(self, x: Floats, /) -> tuple[ClosestPoints, Bools]:
        """Return the closest points of ``x`` (n, d), and whether each of ``x`` lies inside or on it, (n,)."""


@runtime_checkable
class HasTangents(Protocol):
    """A curve that has unit tangents of its own, in its direction of travel."""

    def tangents(self, feet: ClosestPoints, /) -> Floats:
        """Return unit tangents (n, d) at ``feet``; at a corner the bisector of its two tangents."""


@runtime_checkable
class HasLeft(Protocol):
    """A curve in a surface, or a surface in a solid, that has a left side of its own, such as a cut by a function.

    An optional attribute ``left_of``, (d,) or None, is a point on the left, which is used if surfaces have no normals.
    """

    def leftward(self, feet: ClosestPoints, /) -> Floats:
        """Return unit conormals (n, d) at ``feet``: tangent to the surface, perpendicular to the curve, leftward."""


@runtime_checkable
class HasLocalMinima(Protocol):
    """A source that finds a foot on each sheet near a query, not only the closest point."""

    def local_minima(self, x: Floats, radius: float, /) -> tuple[Ints, ClosestPoints]:
        """Return all feet of the rows of ``x`` (n, d) within ``radius``: local minima of the distance on the manifold.

        The first array (k,), ascending, contains for each foot the number of its row of ``x``; the second result is the
        feet. The feet of one row are distinct and ordered by ``distance``; the first is the answer of
        ``closest_point``. Rows without a foot within ``radius`` do not occur.

        Raises
        ------
        InputError
            If ``x`` contains NaN or infinity, its shape is not (n, d), or ``radius`` is not a number above zero.
        """


@runtime_checkable
class HasValues(Protocol):
    """A source with data: one row for each vertex, sample or control point."""

    @property
    def value_count(self) -> int:
        """Number of rows that :meth:`interpolate` expects."""

    def interpolate(self, values: Floats, feet: ClosestPoints, /) -> Floats:
        """Return ``values`` (value_count, ...) interpolated at ``feet``, (n, ...)."""


@runtime_checkable
class HasGivenMesh(Protocol):
    """A source made from a user's mesh, polyline or samples, which may have been welded or repaired since."""

    @property
    def given_mesh(self) -> tuple[Floats, Ints]:
        """The user's vertices (n, d) and cells (m, k): all of them, in their order, also vertices in no cell."""


@runtime_checkable
class HasMesh(Protocol):
    """A source that has a mesh of itself, at any spacing."""

    def mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return vertices (v, d) on the manifold and cells (m, k), vertex numbers, with edges of about ``spacing``.

        ``k`` is 3 for triangles, 2 for segments, 1 for points. For a mixed union it is the largest of these that
        occurs, and rows of smaller cells end in -1. A ``spacing`` that is not positive may raise InputError.
        """


@runtime_checkable
class HasTranslation(Protocol):
    """A source that can be translated exactly, without rounding of its shape.

    The core queries every source relative to the origin of the lattice. A source with this ability keeps its accuracy
    far from zero: at 1e9 a rounded query is off by 1e-7, which the method would amplify by size / spacing. Other
    sources are shifted query by query.
    """

    def translate(self, offset: Floats, /) -> ClosestPointSource:
        """Return the same source moved by ``offset`` (d,), in the scene's unit of length, with the same abilities."""


@runtime_checkable
class HasMembers(Protocol):
    """A union of sources: ``element`` of its closest points is the number of the member that contains the foot."""

    @property
    def members(self) -> Sequence[ClosestPointSource]:
        """The united sources, none of them a union."""

    def with_members(self, numbers: Sequence[int], /) -> ClosestPointSource:
        """Return the union of the members with these ``numbers``, in this order; of one number the member itself."""


@runtime_checkable
class HasSkin(Protocol):
    """A solid that knows the closed hypersurface around it."""

    @property
    def skin(self) -> ClosestPointSource:
        """The boundary of the solid, of one part or more: a closed curve in the plane or closed surface in space."""


@runtime_checkable
class HasFacets(Protocol):
    """A mesh that stands for the smooth surface that it samples, and can also be read as its flat triangles."""

    def read_as_facets(self) -> ClosestPointSource:
        """Return the same mesh read as its flat triangles."""


@runtime_checkable
class HasSmoothSurface(Protocol):
    """A mesh with closest points on its flat triangles that stands for a smooth surface above them."""

    def smooth_surface(self) -> ClosestPointSource:
        """Return the same mesh with closest points on that surface: its triangles, curved by their normals."""


@dataclass(frozen=True)
class Advice:
    """The accuracy of a source, and warnings about solutions on it.

    A source whose parts take long to compute returns a subclass with cached properties in place of these fields.
    """

    #: The error, as a share of the solution's range, that the source alone causes in the form ``collocation``: a mesh,
    #: a cloud or samples on a grid represent a smooth manifold only to some accuracy. 0 by default.
    floor: float = 0.0
    #: One sentence for each property that may spoil a solution: merged or doubtful samples, repairs.
    warnings: tuple[str, ...] = ()
    #: The same error in the form ``galerkin``, whose integrals depend less on errors of normals than closest points of
    #: nodes do. None if it is about ``floor``.
    integral_floor: float | None = None
    #: Further sentences for the form ``collocation``: places, such as creases, near which closest points jump.
    closest_point_warnings: tuple[str, ...] = ()
    #: False if the cells of the source's mesh are points, or too many or too distorted for quadrature.
    mesh_for_samples: bool = True
    #: Number of feet if finitely many points stand for the manifold, as in a cloud; then nothing can be integrated.
    foot_count: int | None = None


@runtime_checkable
class HasAdvice(Protocol):
    """A source that states its accuracy, or warnings about solutions on it."""

    def advice(self, spacing: float, /) -> Advice:
        """Return the advice for solutions on a lattice of this ``spacing``."""


#: All optional abilities.
ABILITIES: tuple[type, ...] = tuple(ability for name, ability in tuple(globals().items()) if name.startswith("Has"))


def members_of(source: ClosestPointSource) -> Sequence[ClosestPointSource]:
    """Return the members of a union; of any other source a tuple of the source alone."""
    return source.members if isinstance(source, HasMembers) else (source,)


def local_minima_of(source: ClosestPointSource, x: Floats, radius: float) -> tuple[Ints, ClosestPoints]:
    """Return the row (k,) of ``x`` (n, d) of each foot on a source within ``radius``, ascending, and these k feet.

    A source with the ability HasLocalMinima gives the feet on all sheets, any other at most the closest point of a row.
    """
    if isinstance(source, HasLocalMinima):
        return source.local_minima(x, radius)
    feet = source.closest_point(x)
    rows = np.flatnonzero(feet.distance <= radius)
    return rows, feet.take(rows)


def advice_of(source: object, spacing: float) -> Advice:
    """Return the advice of ``source`` at ``spacing``; no warnings and a floor of zero if the source gives none."""
    return source.advice(spacing) if isinstance(source, HasAdvice) else Advice()


def warnings_of(source: object, spacing: float) -> tuple[str, ...]:
    """Return the warnings in the advice of ``source`` at ``spacing``."""
    return advice_of(source, spacing).warnings


def integral_floor_of(source: object, spacing: float) -> float:
    """Return the error, as a share of the solution's range, due to ``source`` in the Galerkin form at ``spacing``."""
    advice = advice_of(source, spacing)
    return advice.floor if advice.integral_floor is None else advice.integral_floor


def has_finite_feet(source: ClosestPointSource) -> bool:
    """Return whether ``source``, or a member of it, has finitely many points that stand for a manifold: is a cloud.

    If the advice of a member does not state this, its deprecated attribute ``foot_count`` is read, with a warning.
    """
    size = float(np.ptp(np.asarray(source.bounds, dtype=np.float64), axis=0).max()) or 1.0
    for member in members_of(source):
        if advice_of(member, size).foot_count is not None:
            return True
        if hasattr(member, "foot_count"):
            warn_renamed(f"{type(member).__name__}.foot_count", "Advice.foot_count")
            if member.foot_count is not None:
                return True
    return False


def edge_limit_of(source: object) -> int:
    """Return a number above all edge numbers of ``source``: its attribute ``edge_limit``, else :data:`MOST_EDGES`."""
    return int(getattr(source, "edge_limit", MOST_EDGES))
