"""From a scene's boundary to one that the lattice can work with: checked, sampled, oriented."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpmkit.errors import SceneError, shown
from cpmkit.forms.collocation.boundary.frame import Sighted
from cpmkit.grid.band import surface_cells
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.localized import Localized, localize
from cpmkit.protocols import BoundarySet, ClosestPoints, Floats
from cpmkit.scene.alike import alike, sides_differ
from cpmkit.scene.left import Left


def sight(
    boundary: BoundarySet,
    surface: Localized,
    lattice: Lattice,
    radius: float,
    find_left: Callable[[BoundarySet, int], Left],
) -> Sighted:
    """Return ``boundary`` as the lattice sees it.

    Parameters
    ----------
    boundary : BoundarySet
        A point or curve of lower dimension than the surface.
    surface : Localized
        The manifold.
    lattice : Lattice
        Its origin and spacing.
    radius : float
        How far the boundary may be from the surface: the radius of the tube.
    find_left : callable
        Of a boundary and the manifold's dimension there; :meth:`cpmkit.Scene.left` keeps what it found.

    Raises
    ------
    SceneError
        If the boundary is of the wrong dimension, too far from the surface, or asks for sides that it has not.
    """
    source = localize(boundary.source, lattice.origin)
    samples = _samples(boundary.name, source, surface, lattice.spacing)
    on = surface.closest_point(samples)
    dimension = _dimension(boundary.name, source, surface, on)
    gap = _gap(boundary.name, on, radius)
    left = find_left(boundary, dimension)
    surface.queries["points"] += left.queries[0]
    source.queries["points"] += left.queries[1]
    sighted = Sighted(source, surface, left.seen_from(lattice.origin), dimension, gap, samples, lattice.spacing)
    _check_sides(boundary, sighted)
    return sighted


def _check_sides(boundary: BoundarySet, sighted: Sighted) -> None:
    """Refuse conditions that differ between sides that the boundary does not have, or that chance would name."""
    on_left, on_right = boundary.condition("left"), boundary.condition("right")
    if not sighted.has_sides and not (alike(on_left, on_right) and not on_left.couples):
        raise SceneError(
            f"boundary {boundary.name!r} has dimension {sighted.source.manifold_dim} where the manifold has "
            f"{sighted.dimension}, so it has no left and right; give `both`, one of Dirichlet, Neumann or Robin."
        )
    if not sighted.has_sides:
        return
    if not sighted.named.known and (on_left.couples or not alike(on_left, on_right)):
        raise SceneError(
            f"boundary {boundary.name!r} has no left side: the "
            f"{'boundary' if not sighted.named.travels else 'manifold'}'s own direction comes back reversed along it; "
            "give one condition for both sides."
        )
    if not sides_differ(on_left, on_right):
        return
    if sighted.named.contradicted:
        raise SceneError(
            f"boundary {boundary.name!r} has left_of={shown(boundary.left_of)} on its right, as the surface's "
            "own normal and the boundary's own direction have it; leave left_of out, or exchange the conditions."
        )
    if sighted.named.beside is not None:
        apart = float(np.linalg.norm(np.subtract(*sighted.named.beside)))
        one, other = (_shown_point(point, 0.01 * apart) for point in sighted.named.beside)
        raise SceneError(
            f"boundary {boundary.name!r} has unlike conditions on its sides, and {_silent(boundary)}: "
            f"{sighted.missing}; give left_of, a point on the left, here {one} for one side or {other} for the other."
        )


def _silent(boundary: BoundarySet) -> str:
    if boundary.left_of is None:
        return "nothing says which side is left"
    return f"left_of={shown(boundary.left_of)} is on neither side of some piece of it"


def _shown_point(point: Floats, accuracy: float) -> str:
    """Return a point in as many digits as the accuracy needs, however far from zero it lies."""
    return str(np.round(point, max(0, 1 - int(np.floor(np.log10(accuracy))))).tolist())


def _samples(name: str, source: Localized, surface: Localized, spacing: float) -> Floats:
    """Return points (s, d) of the boundary, about a spacing apart."""
    if source.dim != surface.dim:
        raise SceneError(
            f"boundary {name!r} lies in {source.dim}D, the surface in {surface.dim}D; both must be the same."
        )
    cells = surface_cells(source, spacing, 3)
    return source.closest_point(np.asarray((cells + 0.5) * spacing, dtype=np.float64)).points


def _dimension(name: str, source: Localized, surface: Localized, on: ClosestPoints) -> int:
    """Return the dimension that the manifold has all along the boundary."""
    if source.manifold_dim is None:
        raise SceneError(f"boundary {name!r} is of mixed dimension; make a boundary of each of its dimensions.")
    if any(member.manifold_dim is None for member in surface.members):
        raise SceneError("boundaries need to know the manifold's dimension, got None; unite sources by `union`.")
    found = np.unique(surface.dimensions_at(on))
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


def _gap(name: str, on: ClosestPoints, radius: float) -> float:
    """Return how far the boundary is from the surface at most."""
    gap = float(on.distance.max())
    if gap > radius:
        raise SceneError(
            f"boundary {name!r} is up to {gap:.3g} away from the surface, more than the tube's radius "
            f"{radius:.3g}; move it onto the surface, or check its unit of length."
        )
    return gap
