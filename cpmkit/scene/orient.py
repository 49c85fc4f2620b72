"""From a scene's boundary to an oriented one: of what dimension its manifold is there, and whether it has its sides."""

from __future__ import annotations

import numpy as np

from cpmkit.errors import SceneError, shown
from cpmkit.manifold.local_source import LocalSource, localize
from cpmkit.protocols import BoundarySet, ClosestPointSource, Floats, Ints
from cpmkit.scene.alike import same_condition, sides_differ
from cpmkit.scene.left import find_left
from cpmkit.scene.left_parts import samplings
from cpmkit.scene.oriented import OrientedBoundary


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
    if oriented.left.contradicted:
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
