"""A scene's boundaries on a lattice: near enough, sampled at its density, and how a band's nodes see them.

Differs from King et al. (2024), section 4, where C lies in S: here C may be off it by its ``gap``, and is snapped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.forms.collocation.boundary.side_view import BoundaryOnLattice, SideView
from cpmkit.forms.collocation.sheets.sheets import Sheets
from cpmkit.grid.band import surface_cells
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.local_source import LocalSource, localize
from cpmkit.protocols import BoundarySet, ClosestPoints, Floats, Ints
from cpmkit.scene.data import Data
from cpmkit.scene.oriented import OrientedBoundary, dimension_along


@dataclass(frozen=True, eq=False)
class BoundariesOnBand:
    """All boundaries of a scene, and how the band's nodes see them.

    Attributes
    ----------
    given : sequence of BoundarySet
        As the scene gives them.
    on_lattice : sequence of BoundaryOnLattice
        As the lattice sees them.
    side_views : sequence of SideView
        How the band's nodes see each boundary.
    behind : (k,) int64
        The nodes past an edge that read their feet, because their mirror points lie beyond a boundary.
    diffusivity : Data
        Of the problem.
    """

    given: Sequence[BoundarySet]
    on_lattice: Sequence[BoundaryOnLattice]
    side_views: Sequence[SideView]
    behind: Ints
    diffusivity: Data = 1.0


def put_on_lattice(
    boundary: BoundarySet,
    surface: LocalSource,
    lattice: Lattice,
    radius: float,
    oriented: Callable[[BoundarySet], OrientedBoundary],
    sheets: Sheets | None = None,
) -> BoundaryOnLattice:
    """Return ``boundary`` as the lattice sees it.

    Parameters
    ----------
    boundary : BoundarySet
        A point or curve of lower dimension than the surface.
    surface : LocalSource
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
    found = oriented(boundary).relative_to(lattice.origin, source, surface)
    surface.queries["points"] += found.left.queries[0]
    source.queries["points"] += found.left.queries[1]
    return BoundaryOnLattice(found, gap, samples, lattice.spacing, sheets)


def _samples(name: str, source: LocalSource, surface: LocalSource, spacing: float) -> Floats:
    """Return points (s, d) of the boundary, about a spacing apart."""
    if source.dim != surface.dim:
        raise SceneError(
            f"boundary {name!r} lies in {source.dim}D, the surface in {surface.dim}D; both must be the same."
        )
    cells = surface_cells(source, spacing, 3)
    return source.closest_point(np.asarray((cells + 0.5) * spacing, dtype=np.float64)).points


def _gap(name: str, on_surface: ClosestPoints, radius: float) -> float:
    """Return how far the boundary is from the surface at most."""
    gap = float(on_surface.distance.max())
    if gap > radius:
        raise SceneError(
            f"boundary {name!r} is up to {gap:.3g} away from the surface, more than the tube's radius "
            f"{radius:.3g}; move it onto the surface, or check its unit of length."
        )
    return gap
