"""From a scene's boundary to one that the lattice can work with: checked, sampled, oriented."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.boundary.frame import Sighted
from cpmkit.boundary.orientation import AS_GIVEN, Orientation, carry
from cpmkit.boundary.tangent_space import normals, tangents
from cpmkit.errors import SceneError
from cpmkit.grid.band import surface_cells
from cpmkit.grid.lattice import Lattice
from cpmkit.localized import Localized, localize
from cpmkit.protocols import BoundarySet, ClosestPoints, Floats
from cpmkit.special_conditions import Transmission


def sight(boundary: BoundarySet, surface: Localized, lattice: Lattice, radius: float) -> Sighted:
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

    Raises
    ------
    SceneError
        If the boundary is of the wrong dimension, too far from the surface, or asks for sides that it has not.
    """
    source = localize(boundary.source, lattice.origin)
    samples = _samples(boundary.name, source, surface, lattice.spacing)
    on = surface.closest_point(samples)
    dimension = _dimension(boundary.name, source, surface, on)
    along = _along(source, samples, lattice.spacing, boundary.name)
    gap = _gap(boundary.name, on, radius)
    sighted = Sighted(source, surface, AS_GIVEN, along, dimension, gap, samples, lattice.spacing)
    one_condition = boundary.condition("left") is boundary.condition("right")
    if one_condition and not isinstance(boundary.condition("left"), Transmission):
        return sighted
    if not sighted.has_sides:
        raise SceneError(
            f"boundary {boundary.name!r} has dimension {source.manifold_dim} where the manifold has {dimension}, so it "
            "has no left and right; give `both`, one of Dirichlet, Neumann or Robin."
        )
    across = _across(source, surface, on, dimension, lattice.spacing, boundary.name)
    sighted = replace(sighted, across=across)
    given = across is AS_GIVEN and along is AS_GIVEN
    return sighted if given else _turned(sighted, boundary, lattice)


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


def _along(source: Localized, samples: Floats, spacing: float, name: str) -> Orientation:
    """Return signs for a boundary that does not orient itself: of a curve's tangents, or a surface's normals."""
    if source.manifold_dim == 0 or source.knows_directions(source.manifold_dim or 0):
        return AS_GIVEN
    ask = tangents if source.manifold_dim == 1 else normals
    return carry(samples, ask(source, source.closest_point(samples), 0.5 * spacing), spacing, name)


def _across(
    source: Localized, surface: Localized, on: ClosestPoints, dimension: int, spacing: float, name: str
) -> Orientation:
    """Return signs for a manifold that does not orient itself, along the boundary.

    A solid needs none, nor does a boundary that knows its left.
    """
    if dimension == surface.dim or source.has_left or surface.knows_directions(dimension):
        return AS_GIVEN
    ask = tangents if dimension == 1 else normals
    return carry(on.points, ask(surface, on, 0.5 * spacing), spacing, name)


def _turned(sighted: Sighted, boundary: BoundarySet, lattice: Lattice) -> Sighted:
    """Return ``sighted`` with the sign that its sources leave open chosen such that ``left_of`` is on the left."""
    if boundary.left_of is None:
        return sighted
    point = sighted.surface.closest_point(lattice.to_local(np.atleast_2d(boundary.left_of))).points
    if sighted.frame(point, np.inf, lattice.spacing).signed[0] > 0:
        return sighted
    if sighted.across is not AS_GIVEN:
        return replace(sighted, across=sighted.across.reversed())
    return replace(sighted, along=sighted.along.reversed())
