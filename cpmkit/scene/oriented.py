"""A boundary as geometry: where it lies in its manifold, and which side of it is left. No lattice is needed for it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.errors import SceneError, shown
from cpmkit.manifold.conormal import axis_and_left
from cpmkit.manifold.local_source import LocalSource, localize
from cpmkit.manifold.tangent_space import outward_conormals
from cpmkit.protocols import Bools, BoundarySet, ClosestPoints, ClosestPointSource, Floats, Ints
from cpmkit.scene.conditions import same_condition, sides_differ
from cpmkit.scene.left import Left, find_left, samplings

#: Of a surface and of a curve, in words.
_DIRECTIONS = ("normals", "tangents")
#: What names the left of a boundary, in words.
_LEFT_NAMED_BY = {
    "left_of": "left is named by left_of",
    "rule": "left is named by a rule alone",
    "nothing": "it has no left, their sign comes back reversed",
}


@dataclass(frozen=True, eq=False)
class OrientedBoundary:
    """A boundary in its manifold, with what tells its left; :meth:`cpmkit.Scene.oriented` keeps one for each.

    Points and vectors are relative to ``left.origin``. Of a point z of the manifold, y = cp_S(cp_C(z)) is the foot on
    the boundary, snapped to the manifold, and z is on the left where (z - y) . v > 0.

    Attributes
    ----------
    boundary : BoundarySet
        As the scene gives it.
    source, surface : LocalSource
        Where the boundary lies, and the manifold.
    dimension : int
        Of the manifold along the boundary.
    left : Left
        What tells its left.
    """

    boundary: BoundarySet
    source: LocalSource
    surface: LocalSource
    dimension: int
    left: Left

    @property
    def has_sides(self) -> bool:
        """True where the boundary cuts the manifold in two locally: it has one dimension less."""
        return self.source.manifold_dim == self.dimension - 1

    @property
    def has_left(self) -> bool:
        """True where the boundary has sides, and which of them is left is the same all along it."""
        return self.has_sides and self.left.known

    def relative_to(self, origin: Floats, source: LocalSource, surface: LocalSource) -> OrientedBoundary:
        """Return the same relative to another origin (d,), from which ``source`` and ``surface`` are seen."""
        return replace(self, source=source, surface=surface, left=self.left.relative_to(origin))

    def feet(self, points: Floats) -> tuple[ClosestPoints, ClosestPoints]:
        """Return the closest points on the boundary of ``points`` (n, d), and the manifold's records of these, y."""
        feet = self.source.closest_point(points)
        return feet, self.surface.closest_point(feet.points)

    def axis_and_left(self, feet: ClosestPoints, on_surface: ClosestPoints, step: float) -> tuple[Floats, Floats]:
        """Return the manifold's normal n (n, d) and the conormal v (n, d) to the left, as :meth:`feet` returns these.

        Of unit length, by differences of ``step`` where the sources have none; where n is not needed, v again.
        """
        return axis_and_left(self.source, self.surface, self.left.signs, on_surface, feet, step)

    def open_ends(self, feet: ClosestPoints, on_surface: ClosestPoints, step: float) -> Bools:
        """Return which feet (n,) lie on an end of the boundary around which the solution goes on.

        Differs from King et al. (2024), eq. 16: an end on a rim parts the manifold, and is none of them.
        Where the manifold ends less than a ``step`` farther on, the boundary meets its rim and parts it.
        """
        end = feet.edge >= 0
        rows = np.flatnonzero(end)
        ahead = outward_conormals(self.source, feet.take(rows), step)
        end[rows] = self.surface.closest_point(on_surface.points[rows] + step * ahead).edge < 0
        return end

    def signed_distance(self, points: Floats, step: float) -> Floats:
        """Return (z - y) . v (n,) of ``points`` z of the manifold, positive on the left.

        King et al. (2024), eq. 11, whose y is cp_C(x).
        NaN where a point has no side: past an open end, and where the boundary has no left.
        """
        if not self.has_left:
            return np.full(len(points), np.nan)
        feet, on = self.feet(points)
        signed = np.sum((points - on.points) * self.axis_and_left(feet, on, step)[1], axis=1)
        return np.where(self.open_ends(feet, on, step), np.nan, signed)

    @property
    def lacking(self) -> str:
        """The directions that the boundary and the manifold do not give, in words; empty where they give all."""
        source, surface, lacking = self.source, self.surface, []
        if self.dimension < surface.dim and not surface.knows_directions(self.dimension):
            lacking.append(f"the manifold has no {_DIRECTIONS[self.dimension == 1]} of its own")
        if source.manifold_dim and not source.knows_directions(source.manifold_dim):
            lacking.append(f"the boundary has no {_DIRECTIONS[source.manifold_dim == 1]} of its own")
        return " and ".join(lacking)

    @property
    def left_description(self) -> str:
        """What names the left, and what is taken by differences; empty where the sources know it by themselves."""
        if not self.has_sides or self.left.named_by == "source":
            return ""
        return f"{self.lacking}: taken by differences, {_LEFT_NAMED_BY[self.left.named_by]}"


def orient(boundary: BoundarySet, surface: ClosestPointSource) -> OrientedBoundary:
    """Return ``boundary`` oriented in a ``surface``, relative to the centre of its own bounds.

    Raises
    ------
    SceneError
        If the boundary is of the wrong dimension, or asks for sides that it has not.
    """
    origin: Floats = np.asarray(boundary.source.bounds, dtype=np.float64).mean(axis=0)
    source, manifold = localize(boundary.source, origin), localize(surface, origin)
    found = np.array([manifold.largest_dim])
    if len({member.manifold_dim for member in manifold.members}) > 1:
        samples, _ = next(samplings(source, manifold))
        found = manifold.dimensions_at(manifold.closest_point(samples.points))
    dimension = dimension_along(boundary.name, source, manifold, found)
    left = find_left(boundary, source, manifold, dimension, origin)
    oriented = OrientedBoundary(boundary, source, manifold, dimension, left)
    _check_sides(oriented)
    return oriented


def dimension_along(name: str, source: LocalSource, surface: LocalSource, dimensions: Ints) -> int:
    """Return the one dimension that a manifold has along a boundary, of those (n,) that it has at points of that.

    Raises
    ------
    SceneError
        If it has several, or one in which a boundary cannot be of the dimension that this one is of.
    """
    if source.manifold_dim is None:
        raise SceneError(f"boundary {name!r} is of mixed dimension; make a boundary of each of its dimensions.")
    if any(member.manifold_dim is None for member in surface.members):
        raise SceneError("boundaries need to know the manifold's dimension, got None; unite sources by `union`.")
    found = np.unique(dimensions)
    if len(found) > 1:
        raise SceneError(
            f"boundary {name!r} runs over pieces of the dimensions {' and '.join(map(str, found))}; part it where "
            "they meet."
        )
    if source.manifold_dim >= found[0]:
        raise SceneError(
            f"boundary {name!r} has dimension {source.manifold_dim}, the manifold {found[0]}; "
            "a boundary is a point on a curve, a point or curve on a surface, or anything of those in a solid."
        )
    return int(found[0])


def _check_sides(oriented: OrientedBoundary) -> None:
    """Refuse conditions that differ between sides that the boundary does not have, or that chance would name."""
    boundary = oriented.boundary
    on_left, on_right = boundary.condition("left"), boundary.condition("right")
    if not oriented.has_sides and not (same_condition(on_left, on_right) and not on_left.couples):
        raise SceneError(
            f"boundary {boundary.name!r} has dimension {oriented.source.manifold_dim} where the manifold has "
            f"{oriented.dimension}, so it has no left and right; give `both`, one of Dirichlet, Neumann or Robin."
        )
    if not oriented.has_sides:
        return
    if not oriented.left.known and (on_left.couples or not same_condition(on_left, on_right)):
        raise SceneError(
            f"boundary {boundary.name!r} has no left side: the "
            f"{'boundary' if not oriented.left.travels else 'manifold'}'s own direction comes back reversed along it; "
            "give one condition for both sides."
        )
    if not sides_differ(on_left, on_right):
        return
    if oriented.left.contradicts_left_of:
        raise SceneError(
            f"boundary {boundary.name!r} has left_of={shown(boundary.left_of)} on its right, as the surface's "
            "own normal and the boundary's own direction have it; leave left_of out, or exchange the conditions."
        )
    if oriented.left.beside is not None:
        lacking = (
            "nothing says which side is left"
            if boundary.left_of is None
            else f"left_of={shown(boundary.left_of)} is on neither side of some piece of it"
        )
        apart = float(np.linalg.norm(np.subtract(*oriented.left.beside)))
        first, second = (_shown_point(point, 0.01 * apart) for point in oriented.left.beside)
        raise SceneError(
            f"boundary {boundary.name!r} has unlike conditions on its sides, and {lacking}: "
            f"{oriented.lacking}; give left_of, a point on the left, here {first} for one side or {second} for the "
            "other."
        )


def _shown_point(point: Floats, accuracy: float) -> str:
    """Return a point in as many digits as the accuracy needs, however far from zero it lies."""
    return str(np.round(point, max(0, 1 - int(np.floor(np.log10(accuracy))))).tolist())
