"""The layout of a scene on a lattice: band, edge, boundaries and ghosts; everything that asks for closest points."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cpmkit.forms.collocation.boundary.on_band import BoundariesOnBand, put_on_lattice
from cpmkit.forms.collocation.boundary.row_formula import RowFormula
from cpmkit.forms.collocation.encounters.beside_rims import RimStrip, find_rim_strips
from cpmkit.forms.collocation.encounters.boundaries import SectorJump, Strip, find_encounters
from cpmkit.forms.collocation.encounters.facing_rims import FacingRims, find_facing_rims
from cpmkit.forms.collocation.encounters.junctions import Junction, find_junctions
from cpmkit.forms.collocation.encounters.tips import Blur, find_blurs
from cpmkit.forms.collocation.ghosts.edge import read_at_feet, read_past_edge
from cpmkit.forms.collocation.ghosts.geometry import node_sources
from cpmkit.forms.collocation.ghosts.ghosts import Ghosts, build_ghosts
from cpmkit.forms.collocation.ghosts.past_rim import mirrors_cut_off
from cpmkit.forms.collocation.numbering import Numbering
from cpmkit.forms.collocation.options import CollocationOptions
from cpmkit.forms.collocation.selection import Unknowns
from cpmkit.forms.collocation.sheets.twins import separate_sheets
from cpmkit.forms.options import Options
from cpmkit.grid.band import Band, build_band
from cpmkit.grid.lattice import COARSEST_BAND_SHARE, Lattice, lattice_of
from cpmkit.grid.stencils import reading_radius
from cpmkit.manifold.local_source import LocalSource, localize
from cpmkit.protocols import Ints, Progress, no_progress
from cpmkit.scene.scene import Scene

#: Nodes with feet nearer to a boundary than so many spacings read right-hand sides well inside their side.
DOUBTFUL_SIDE_SPACINGS = 0.1


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the unknowns of a scene are and what their rows read.

    Attributes
    ----------
    options : Options
        What makes the same layout of a like scene: the origin is the lattice's.
    lattice : Lattice
        Origin and spacing.
    surface : LocalSource
        The manifold, relative to the lattice's origin.
    band : Band
        Its nodes and their closest points.
    formula : RowFormula
        What each node of the band reads, the edge's conditions applied.
    sources : RowFormula
        Where each node reads right-hand sides.
    boundaries : BoundariesOnBand
        The boundaries, and how the band's nodes see them.
    ghosts : sequence of Ghosts
        One a boundary.
    channels : int
        Right-hand sides that are solved together.
    sector_jumps, strips : sequences of SectorJump and Strip
        Where boundaries cross with different data, or run side by side nearer than a spacing.
    rim_strips : sequence of RimStrip
        Boundaries beside a rim or on it.
    facing : sequence of FacingRims
        The narrowest gap between rims.
    blurs : sequence of Blur
        Where the sides of a boundary are not told apart.
    junctions : sequence of Junction
        Where three curves or more meet.
    """

    options: Options[CollocationOptions]
    lattice: Lattice
    surface: LocalSource
    band: Band
    formula: RowFormula
    sources: RowFormula
    boundaries: BoundariesOnBand
    ghosts: Sequence[Ghosts]
    channels: int
    sector_jumps: Sequence[SectorJump] = ()
    strips: Sequence[Strip] = ()
    rim_strips: Sequence[RimStrip] = ()
    facing: Sequence[FacingRims] = ()
    blurs: Sequence[Blur] = ()
    junctions: Sequence[Junction] = ()

    @cached_property
    def unknowns(self) -> Unknowns:
        """What stencils read: the band's inner nodes, and the ghosts of each boundary."""
        return Unknowns(self.band, self.ghosts)

    @property
    def order(self) -> int:
        """Order of the conditions, 1 or 2."""
        return self.options.own.order

    @property
    def numbering(self) -> Numbering:
        """The numbers of rows of E and of unknowns."""
        return self.unknowns.numbering

    @property
    def queries(self) -> Counter[str]:
        """Closest point queries made so far, by name of what was asked."""
        counted = Counter({"surface": self.surface.queries["points"]})
        for boundary, on_lattice in zip(self.boundaries.given, self.boundaries.on_lattice, strict=True):
            counted[boundary.name] = on_lattice.source.queries["points"]
        return counted


def lay_out(scene: Scene, options: Options[CollocationOptions], progress: Progress = no_progress) -> Layout:
    """Lay a scene out on a lattice.

    Raises
    ------
    InputError, SceneError, ResolutionError
        If the lattice's origin, a boundary or the spacing does not fit.
    """
    order = options.own.order
    lattice = lattice_of(scene.surface, options.spacing, options.origin, COARSEST_BAND_SHARE)
    options = replace(options, origin=lattice.origin)
    surface = localize(scene.surface, lattice.origin)
    band = build_band(surface, lattice.spacing, options.own.degree, progress)
    if options.own.sheets:
        band = separate_sheets(surface, band)
    past = read_past_edge(surface, band, lattice, scene.edge, order)
    sight, past = _see_boundaries(scene, surface, band, lattice, past)
    ghosts: list[Ghosts] = []
    for index in range(len(scene.boundaries)):
        ghosts.append(build_ghosts(index, sight, band, lattice, past, order))
        progress("boundaries", (index + 1) / len(scene.boundaries))
    sources = _node_sources(sight, band)
    layout = Layout(options, lattice, surface, band, past, sources, sight, ghosts, scene.channels)
    return _with_encounters(layout, scene.problem.start_time)


def _with_encounters(layout: Layout, time: float | None) -> Layout:
    """Return the layout with the encounters of its boundaries, rims and curves."""
    sight, lattice, band = layout.boundaries, layout.lattice, layout.band
    beside = find_rim_strips(sight.on_lattice, layout.surface, band)
    facing = find_facing_rims(layout.surface, band)
    branches = find_junctions(layout.surface, band)
    layout = replace(
        layout,
        rim_strips=[replace(one, points=lattice.to_scene(one.points)) for one in beside],
        facing=[replace(rims, point=lattice.to_scene(rims.point[None])[0]) for rims in facing],
        junctions=[replace(junction, point=lattice.to_scene(junction.point[None])[0]) for junction in branches],
    )
    return _compared(layout, time)


def _compared(layout: Layout, time: float | None) -> Layout:
    """Return the layout with what the data of boundaries that meet do to each other."""
    seen, lattice, channels = layout.boundaries, layout.lattice, layout.channels
    crossings, strips = find_encounters(seen, lattice, channels, time)
    return replace(layout, sector_jumps=crossings, strips=strips, blurs=find_blurs(seen, lattice, channels, time))


def with_data_of(layout: Layout, scene: Scene) -> Layout:
    """Return the layout of a scene that differs in its equation and its data alone."""
    seen = replace(layout.boundaries, given=scene.boundaries)
    return _compared(replace(layout, boundaries=seen, channels=scene.channels), scene.problem.start_time)


def _node_sources(boundaries: BoundariesOnBand, band: Band) -> RowFormula:
    """Return where the nodes read right-hand sides, those nearly on a boundary inside the side that they count to."""
    sources = RowFormula(band.feet.points, np.ones(len(band.nodes)))
    for number, view in enumerate(boundaries.side_views):
        close = (np.abs(view.signed) < DOUBTFUL_SIDE_SPACINGS * band.spacing) & ~view.end
        close &= band.feet.edge[view.rows] < 0
        if close.any():
            near_frame = view.take(close)
            others = [one for other, one in enumerate(boundaries.on_lattice) if other != number]
            feet = sources.points[near_frame.rows]
            read = node_sources(feet, boundaries.on_lattice[number], others, near_frame)
            sources = _with_rows(sources, near_frame.rows, read)
    return sources


def _with_rows(reading: RowFormula, rows: Ints, other: RowFormula) -> RowFormula:
    """Return a reading with ``rows`` read as the other says, whose rows count those."""
    points, coefficient = reading.points.copy(), reading.coefficient.copy()
    points[rows], coefficient[rows] = other.points, other.coefficient
    return RowFormula(
        points, coefficient, (), [*reading.terms, *(replace(term, rows=rows[term.rows]) for term in other.terms)]
    )


def _see_boundaries(
    scene: Scene, surface: LocalSource, band: Band, lattice: Lattice, past: RowFormula
) -> tuple[BoundariesOnBand, RowFormula]:
    """Return how the nodes see the boundaries, and what they read where one keeps them from their mirror points."""
    # King et al. (2024), section 4.6: boundaries are looked for within twice the reach.
    reach = reading_radius(band.dim, band.degree) * band.spacing
    on_lattice = [
        put_on_lattice(boundary, surface, lattice, reach, scene.oriented, band.sheets) for boundary in scene.boundaries
    ]
    uncoupled = [one for one in on_lattice if not one.oriented.boundary.condition("left").couples]
    behind = mirrors_cut_off(uncoupled, band, past, 2 * reach)
    past = read_at_feet(surface, band, lattice, scene.edge, past, behind)
    side_views = [one.side_view(past.points, 2 * reach, band.spacing) for one in on_lattice]
    return BoundariesOnBand(scene.boundaries, on_lattice, side_views, behind, scene.problem.terms().diffusivity), past
