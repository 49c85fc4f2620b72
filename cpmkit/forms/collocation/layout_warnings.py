"""Warnings about a layout: features of a scene for which the solution is less accurate."""

from __future__ import annotations

import numpy as np

from cpmkit.errors import place
from cpmkit.forms.collocation.band_layout import Layout
from cpmkit.forms.collocation.sheets.sheets import foot_directions
from cpmkit.forms.collocation.unresolved_geometry.rims_and_junctions import BRIDGED_GAP_SPACINGS, WIDE_GAP_SPACINGS
from cpmkit.manifold.abilities import advice_of
from cpmkit.scene.point_values import small_boundary_warnings
from cpmkit.scene.scene import Scene
from cpmkit.types import SIDES

#: Normals that turn by more than this (radians) over one spacing are a sharp bend: on a radius of 3 spacings the
#: solution is off by half a percent of its range.
SHARP_TURN_RADIANS = 1 / 3
#: Least shares of the nodes with sharp turns, and of the stencils that read another sheet, that give a warning.
SHARP_SHARE, MIXED_SHARE = 5e-3, 1e-3
#: Neighbours whose normals have a smaller cosine than this are on different sheets or flanks; feet of neighbours
#: farther apart than this many spacings do not determine the curvature between them.
SAME_FLANK_COSINE, MOST_CHORD_SPACINGS = 0.2, 2.0
#: Share of the nodes whose closest points are doubtful above which there is a warning.
DOUBTFUL_NODES_SHARE = 1e-4
#: Closest points of neighbouring nodes that lie this many spacings apart have jumped from one part to another: on a
#: surface that the band resolves none do, near a medial axis inside the band some do.
JUMP_SPACINGS = 2.0
#: Share of jumping feet above which there is a warning: Spot with 0.5 percent of them differs from finite elements by 2
#: percent of the range, with 1.1 percent by 18.
JUMP_SHARE = 5e-3
#: A boundary farther off the surface than this many spacings is probably a mistake.
OFF_SURFACE_SPACINGS = 0.5
#: Around a crossing of four different values the solution is off within this many spacings (by the jump; outside twice
#: that it is of order 1 to 2).
DISTURBED_SPACINGS = 4.0
#: Largest share of the difference of the values on both sides of a gap that leaks across two spacings; half of it
#: for each further one (a slit in a sphere: 0.45 at 2, 0.11 at 4, 0.055 at 5 spacings; in the plane a tenth of that).
LEAK_AT_TWO_SPACINGS = 0.45


def layout_warnings(layout: Layout, scene: Scene) -> tuple[str, ...]:
    """Return all warnings about a layout."""
    spacing = layout.lattice.spacing
    advice = advice_of(layout.surface.source, spacing)
    pairs = zip(layout.boundaries.definitions, layout.boundaries.on_lattice, strict=True)
    cutting = [boundary.name for boundary, on_lattice in pairs if on_lattice.has_sides]
    return (
        *advice.warnings,
        *advice.closest_point_warnings,
        *layout.lattice.rounding_warnings(layout.surface.bounds, not layout.surface.shift.any()),
        *_doubtful_feet(layout),
        *_jumping_feet(layout),
        *_first_order_ghosts(layout),
        *_meeting_boundaries(layout),
        *_snapped_boundaries(layout),
        *geometry_warnings(layout, spacing),
        *small_boundary_warnings(scene, cutting, spacing, spacing),
    )


def geometry_warnings(layout: Layout, spacing: float) -> list[str]:
    """Return the warnings about bends, sheets, rims, mixed sides and junctions, for a solve at ``spacing``.

    ``spacing`` is smaller than that of the layout where the layout is a coarser one of a dry run.
    """
    return [
        *(sharp_bends(layout, spacing) or _mixed_sheets(layout)),  # near a crease another sheet may be the other flank
        *_facing_rims(layout, spacing),
        *_rim_strips(layout, spacing),
        *(one.warning(layout.boundaries.definitions[one.boundary].name, spacing) for one in layout.mixed_sides),
        *(
            f"{junction.arms} curves meet at {place(junction.point)}, where no law holds: what they bring does not "
            "balance there, and no spacing makes the solution right; end the members before the point and give their "
            "ends values."
            for junction in layout.junctions
        ),
    ]


# The surface


def sharp_bends(layout: Layout, spacing: float) -> list[str]:
    """Return a warning, in a list, if the surface has creases or bends too sharply for the band; else an empty list."""
    if layout.surface.manifold_dim != layout.surface.dim - 1:
        return []
    band, directions = layout.band, foot_directions(layout.band)
    first, second = band.neighbours()
    chord = np.linalg.norm(band.feet.points[first] - band.feet.points[second], axis=1)
    cosine = np.sum(directions.unit[first] * directions.unit[second], axis=1)
    comparable = directions.reliable[first] & directions.reliable[second] & (cosine > SAME_FLANK_COSINE)
    rows = np.flatnonzero(comparable & (chord < MOST_CHORD_SPACINGS * band.spacing))
    # the turn of the normal over the distance of the feet, or over a spacing where they are nearer, as at a crease
    curvature = np.arccos(np.minimum(cosine[rows], 1.0)) / np.maximum(chord[rows], band.spacing)
    sharp = curvature * spacing > SHARP_TURN_RADIANS
    if not len(sharp) or sharp.mean() < SHARP_SHARE:
        return []
    worst = layout.lattice.to_scene(band.feet.points[[first[rows[curvature.argmax()]]]])[0]
    resolved = SHARP_TURN_RADIANS / float(np.quantile(curvature[sharp], 0.9))
    return [
        f"Part of the surface bends more sharply than the band is wide, {sharp.mean():.1%} of it, most near "
        f'{place(worst)}: beside bends and creases the solution is less exact; use form="galerkin", or, for bends, a '
        f"spacing of {resolved:.2g}."
    ]


def _mixed_sheets(layout: Layout) -> list[str]:
    """Return a warning if many stencils read nodes of another sheet."""
    sheets, band = layout.band.sheets, layout.band
    if sheets is None or len(sheets.mixed) <= MIXED_SHARE * band.inner:
        return []
    where = place(layout.lattice.to_scene(band.feet.points[sheets.mixed[:1]])[0])
    return [
        "In places stencils read nodes of a sheet that is not theirs, because no foot on their own was found; a "
        f"smaller spacing narrows the band. These are {len(sheets.mixed) / len(band.nodes):.1%} of the stencils, for "
        f"one near {where}."
    ]


def _jumping_feet(layout: Layout) -> list[str]:
    """Return a warning if closest points jump between neighbouring nodes and sheets are not separated.

    Sheets are not separated on manifolds other than hypersurfaces, and on request.
    """
    band = layout.band
    if layout.options.own.sheets and layout.surface.manifold_dim == layout.surface.dim - 1:
        return []
    first, second = band.neighbours()
    distance = np.linalg.norm(band.feet.points[first] - band.feet.points[second], axis=1)
    share = int(np.count_nonzero(distance > JUMP_SPACINGS * band.spacing)) / max(len(first), 1)
    if share <= JUMP_SHARE:
        return []
    return [
        f"The closest points of {share:.1%} of neighbouring nodes jump: there the surface bends more sharply, or two "
        "parts of it come nearer to each other, than the band is wide, and the solution may be off by several percent; "
        "a smaller spacing narrows the band."
    ]


def _doubtful_feet(layout: Layout) -> list[str]:
    """Return a warning if the surface marks the closest points of many nodes as doubtful."""
    doubtful = layout.band.feet.doubtful
    if doubtful is None or np.mean(doubtful) <= DOUBTFUL_NODES_SHARE:
        return []
    return [
        f"The surface could not vouch for the closest points of {int(doubtful.sum())} of {len(doubtful)} nodes "
        f"({np.mean(doubtful):.2%}): at folds and creases narrower than the band the solution may be off; "
        "a smaller spacing narrows the band."
    ]


# Boundaries


def _first_order_ghosts(layout: Layout) -> list[str]:
    """Return a warning for each boundary of order 2 some of whose ghosts are of order 1."""
    warnings = []
    for boundary, ghosts in zip(layout.boundaries.definitions, layout.ghosts, strict=True):
        order = min(boundary.condition(side).order or layout.order for side in SIDES)
        count = int(np.count_nonzero(ghosts.orders[: ghosts.unknowns] == 1)) if order > 1 else 0
        if count:
            warnings.append(
                f"{count} of {ghosts.unknowns} ghosts of boundary {boundary.name!r} are of first order, because their "
                "mirror points lie beyond another boundary or past a rim; three spacings between them avoid that."
            )
    return warnings


def _meeting_boundaries(layout: Layout) -> list[str]:
    """Return the warnings about crossings of different values, and about strips narrower than a spacing."""
    names, spacing = [boundary.name for boundary in layout.boundaries.definitions], layout.lattice.spacing
    warnings = []
    for crossing in layout.sector_jumps[:1]:
        more = f" and {len(layout.sector_jumps) - 1} more pairs" if len(layout.sector_jumps) > 1 else ""
        warnings.append(
            f"Boundaries {names[crossing.first]!r} and {names[crossing.second]!r}{more} cross with different values in "
            f"the sectors around, near {place(crossing.point)}: within {DISTURBED_SPACINGS * spacing:.2g} of it the "
            f"solution is off by up to their difference, {crossing.jump:.3g}; beyond twice that it is not disturbed."
        )
    for strip in sorted(layout.strips, key=lambda strip: strip.coincide):
        both, where = f"Boundaries {names[strip.first]!r} and {names[strip.second]!r}", place(strip.point)
        warnings.append(
            f"{both} lie at the same place, near {where}, and hold the same; one of them is enough."
            if strip.coincide
            else f"{both} run side by side, {strip.width / spacing:.2g} spacings apart near {where}: the strip between "
            f"them is filled with their values; a spacing of {strip.width / 3:.2g} would resolve it."
        )
    return warnings


def _snapped_boundaries(layout: Layout) -> list[str]:
    """Return a warning for each boundary that is far off the surface."""
    spacing = layout.lattice.spacing
    return [
        f"Boundary {boundary.name!r} lies up to {on_lattice.gap:.3g} off the surface, {on_lattice.gap / spacing:.2g} "
        "spacings; it was snapped to the closest points."
        for boundary, on_lattice in zip(layout.boundaries.definitions, layout.boundaries.on_lattice, strict=True)
        if on_lattice.gap > OFF_SURFACE_SPACINGS * spacing
    ]


# Rims


def _facing_rims(layout: Layout, spacing: float) -> list[str]:
    """Return a warning for the narrowest gap between rims, if values leak across it."""
    warnings = []
    for rims in (rims for rims in layout.facing_rims if rims.gap <= WIDE_GAP_SPACINGS * spacing):
        width = rims.gap / spacing
        gap = f"the manifold faces itself across a gap of {rims.gap:.3g}, {width:.2g} spacings"
        harm = "there the gap is as good as closed"
        if width > BRIDGED_GAP_SPACINGS:
            leak = LEAK_AT_TWO_SPACINGS * 2.0 ** (2.0 - width)
            harm = f"up to {leak:.0%} of the difference between its sides leaks across"
        warnings.append(
            f"Near {place(rims.point)} {gap}: {harm}, whatever holds on the rims; a spacing of "
            f"{rims.gap / WIDE_GAP_SPACINGS:.2g} or less avoids that."
        )
    return warnings


def _rim_strips(layout: Layout, spacing: float) -> list[str]:
    """Return a warning for each boundary less than a spacing from a rim."""
    names = [boundary.name for boundary in layout.boundaries.definitions]
    return [
        f"Boundary {names[strip.boundary]!r} runs {strip.width:.2g} from a rim, {strip.width / spacing:.2g} spacings, "
        f"near {place(strip.points[0])}: the strip between them is filled with their values; a spacing of "
        f"{strip.width / 3:.2g} would resolve it."
        for strip in layout.rim_strips
        if not strip.on_rim and strip.width < spacing
    ]
