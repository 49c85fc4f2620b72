"""From a scene's boundary to one that the lattice can work with: checked, sampled, oriented."""

from __future__ import annotations

import numpy as np

from cpmkit.boundary.frame import Sighted
from cpmkit.boundary.orientation import AS_GIVEN, Orientation, carry
from cpmkit.boundary.tangent_space import normals, tangents
from cpmkit.errors import SceneError
from cpmkit.grid.band import surface_cells
from cpmkit.grid.lattice import Lattice
from cpmkit.localized import Localized, localize
from cpmkit.protocols import BoundarySet, Floats


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
    _check_dimensions(boundary.name, source, surface)
    samples = _samples(source, lattice.spacing)
    _check_distance(boundary.name, surface, samples, radius)
    sighted = Sighted(source, surface, AS_GIVEN, _along(source, samples, lattice.spacing, boundary.name))
    one_condition = boundary.condition("left") is boundary.condition("right")
    if one_condition:
        return sighted
    if not sighted.has_sides:
        raise SceneError(f"boundary {boundary.name!r} is a point on a surface and has no left and right; give `both`.")
    across = _across(surface, samples, lattice.spacing, boundary.name)
    sighted = Sighted(source, surface, across, sighted.along)
    return _turned(sighted, boundary, lattice) if across is not AS_GIVEN else sighted


def _check_dimensions(name: str, source: Localized, surface: Localized) -> None:
    if source.dim != surface.dim:
        raise SceneError(
            f"boundary {name!r} lies in {source.dim}D, the surface in {surface.dim}D; both must be the same."
        )
    if source.manifold_dim is None or surface.manifold_dim is None or source.manifold_dim < surface.manifold_dim:
        return
    raise SceneError(
        f"boundary {name!r} has dimension {source.manifold_dim}, the manifold {surface.manifold_dim}; "
        "a boundary is a point on a curve, or a point or curve on a surface."
    )


def _samples(source: Localized, spacing: float) -> Floats:
    """Return points (s, d) of the boundary, about a spacing apart."""
    cells = surface_cells(source, spacing, 3)
    return source.closest_point(np.asarray((cells + 0.5) * spacing, dtype=np.float64)).points


def _check_distance(name: str, surface: Localized, samples: Floats, radius: float) -> None:
    distance = surface.closest_point(samples).distance.max()
    if distance > radius:
        raise SceneError(
            f"boundary {name!r} is up to {distance:.3g} away from the surface, more than the tube's radius "
            f"{radius:.3g}; move it onto the surface, or check its unit of length."
        )


def _along(source: Localized, samples: Floats, spacing: float, name: str) -> Orientation:
    if source.manifold_dim != 1 or source.has_tangents:
        return AS_GIVEN
    return carry(samples, tangents(source, source.closest_point(samples), 0.5 * spacing), spacing, name)


def _across(surface: Localized, samples: Floats, spacing: float, name: str) -> Orientation:
    on = surface.closest_point(samples)
    if surface.manifold_dim == 1:
        return AS_GIVEN if surface.has_tangents else carry(samples, tangents(surface, on, 0.5 * spacing), spacing, name)
    return AS_GIVEN if surface.has_normals else carry(samples, normals(surface, on, 0.5 * spacing), spacing, name)


def _turned(sighted: Sighted, boundary: BoundarySet, lattice: Lattice) -> Sighted:
    """Return ``sighted`` with its sign chosen such that the boundary's ``left_of`` is on the left."""
    if boundary.left_of is None:
        return sighted
    point = sighted.surface.closest_point(lattice.to_local(np.atleast_2d(boundary.left_of))).points
    if sighted.frame(point, np.inf, lattice.spacing).signed[0] > 0:
        return sighted
    return Sighted(sighted.source, sighted.surface, sighted.across.reversed(), sighted.along)
