"""From a scene's boundary to one that the lattice can work with: sampled at its density, and near enough.

Differs from King et al. (2024), section 4, where C lies in S: here C may be off it by its ``gap``, and is snapped.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.forms.collocation.boundary.frame import Sighted
from cpmkit.forms.collocation.sheets.sheets import Sheets
from cpmkit.grid.band import surface_cells
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.localized import Localized, localize
from cpmkit.protocols import BoundarySet, ClosestPoints, Floats
from cpmkit.scene.orient import dimension_along
from cpmkit.scene.oriented import OrientedBoundary


def sight(
    boundary: BoundarySet,
    surface: Localized,
    lattice: Lattice,
    radius: float,
    oriented: Callable[[BoundarySet], OrientedBoundary],
    sheets: Sheets | None = None,
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
    oriented : callable
        Of a boundary: :meth:`cpmkit.Scene.oriented`, which keeps what it found. Asked once the boundary lies well.
    sheets : Sheets, optional
        Where the manifold has several in one band.

    Raises
    ------
    SceneError
        If the boundary is of the wrong dimension, too far from the surface, or asks for sides that it has not.
    """
    source = localize(boundary.source, lattice.origin)
    samples = _samples(boundary.name, source, surface, lattice.spacing)
    on = surface.closest_point(samples)
    dimension_along(boundary.name, source, surface, surface.dimensions_at(on))
    gap = _gap(boundary.name, on, radius)
    found = oriented(boundary).seen_from(lattice.origin, source, surface)
    surface.queries["points"] += found.left.queries[0]
    source.queries["points"] += found.left.queries[1]
    return Sighted(found, gap, samples, lattice.spacing, sheets)


def _samples(name: str, source: Localized, surface: Localized, spacing: float) -> Floats:
    """Return points (s, d) of the boundary, about a spacing apart."""
    if source.dim != surface.dim:
        raise SceneError(
            f"boundary {name!r} lies in {source.dim}D, the surface in {surface.dim}D; both must be the same."
        )
    cells = surface_cells(source, spacing, 3)
    return source.closest_point(np.asarray((cells + 0.5) * spacing, dtype=np.float64)).points


def _gap(name: str, on: ClosestPoints, radius: float) -> float:
    """Return how far the boundary is from the surface at most."""
    gap = float(on.distance.max())
    if gap > radius:
        raise SceneError(
            f"boundary {name!r} is up to {gap:.3g} away from the surface, more than the tube's radius "
            f"{radius:.3g}; move it onto the surface, or check its unit of length."
        )
    return gap
