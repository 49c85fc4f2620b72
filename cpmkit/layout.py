"""The layout of a scene on a lattice: band, edge, boundaries and ghosts; everything that asks for closest points."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from cpmkit.boundary.edge import Reading, read_past_edge
from cpmkit.boundary.ghosts import Ghosts, Sight, build_ghosts
from cpmkit.boundary.prepare import sight
from cpmkit.errors import InputError
from cpmkit.grid.band import Band, build_band
from cpmkit.grid.lattice import Lattice
from cpmkit.grid.stencils import check_degree, reading_radius
from cpmkit.localized import Localized, localize
from cpmkit.protocols import Progress, nothing
from cpmkit.scene import Scene


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the unknowns of a scene are and what their rows read.

    Attributes
    ----------
    lattice : Lattice
        Origin and spacing.
    surface : Localized
        The manifold, relative to the lattice's origin.
    band : Band
        Its nodes and their closest points.
    reading : Reading
        What each node of the band reads, the edge's conditions applied.
    sight : Sight
        The boundaries, and how the band's nodes see them.
    ghosts : sequence of Ghosts
        One a boundary.
    channels : int
        Right-hand sides that are solved together.
    order : int
        Order of the ghosts, 1 or 2.
    """

    lattice: Lattice
    surface: Localized
    band: Band
    reading: Reading
    sight: Sight
    ghosts: Sequence[Ghosts]
    channels: int
    order: int

    @property
    def size(self) -> int:
        """Number of unknowns: inner nodes and ghosts."""
        return self.band.inner + sum(ghosts.unknowns for ghosts in self.ghosts)

    @property
    def queries(self) -> Counter[str]:
        """Closest point queries made so far, by name of what was asked."""
        counted = Counter({"surface": self.surface.queries["points"]})
        for boundary, sighted in zip(self.sight.boundaries, self.sight.sighted, strict=True):
            counted[boundary.name] = sighted.source.queries["points"]
        return counted


def lay_out(
    scene: Scene, spacing: float, *, degree: int = 3, order: int = 2, origin: Any = None, progress: Progress = nothing
) -> Layout:
    """Lay a scene out on a lattice; the parameters are those of :func:`cpmkit.solve`.

    Raises
    ------
    InputError, SceneError, ResolutionError
        If an argument, a boundary or the spacing does not fit.
    """
    check_degree(degree)
    if order not in (1, 2) or isinstance(order, bool):
        raise InputError(f"order must be 1 or 2, got {order!r}.")
    lattice = scene.lattice(spacing, origin)
    surface = localize(scene.surface, lattice.origin)
    band = build_band(surface, lattice.spacing, degree, progress)
    reading = read_past_edge(surface, band, lattice, scene.edge, order, scene.channels)
    seen = _see_boundaries(scene, surface, band, lattice, reading)
    ghosts = []
    for index in range(len(scene.boundaries)):
        ghosts.append(build_ghosts(index, seen, band, lattice, reading, order))
        progress("boundaries", (index + 1) / len(scene.boundaries))
    return Layout(lattice, surface, band, reading, seen, ghosts, scene.channels, order)


def _see_boundaries(scene: Scene, surface: Localized, band: Band, lattice: Lattice, reading: Reading) -> Sight:
    reach = reading_radius(band.dim, band.degree) * band.spacing
    sighted = [sight(boundary, surface, lattice, reach) for boundary in scene.boundaries]
    frames = [one.frame(reading.points, 2 * reach, band.spacing) for one in sighted]
    return Sight(scene.boundaries, sighted, frames)
