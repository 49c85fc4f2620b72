"""Warnings about a layout: features of a scene for which the solution is less accurate."""

from __future__ import annotations

import numpy as np

from cpmkit.errors import place
from cpmkit.forms.collocation.band_layout import Layout
from cpmkit.forms.collocation.sheets.sheets import foot_directions
from cpmkit.manifold.abilities import advice_of
from cpmkit.scene.point_values import small_boundary_warnings
from cpmkit.scene.scene import Scene

#: Normals that turn by more than this (radians) over one spacing are a sharp bend: on a radius of 3 spacings the
#: solution is off by half a percent of its range.
SHARP_TURN_RADIANS = 1 / 3
#: Least shares of the nodes with sharp turns, and of the stencils that read another sheet, that give a warning.
SHARP_SHARE, MIXED_SHARE = 5e-3, 1e-3
#: Neighbours whose normals have a smaller cosine than this are on different sheets or flanks; feet of neighbours
#: farther apart than this many spacings do not determine the curvature between them.
SAME_FLANK_COSINE, MOST_CHORD_SPACINGS = 0.2, 2.0
#: A boundary farther off the surface than this many spacings is probably a mistake.
OFF_SURFACE_SPACINGS = 0.5


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
        *_snapped_boundaries(layout),
        *geometry_warnings(layout, spacing),
        *small_boundary_warnings(scene, cutting, spacing, spacing),
    )


def geometry_warnings(layout: Layout, spacing: float) -> list[str]:
    """Return the warnings about bends, sheets, rims and boundaries that meet, for a solve at ``spacing``.

    ``spacing`` is smaller than that of the layout where the layout is a coarser one of a dry run.
    """
    names = [boundary.name for boundary in layout.boundaries.definitions]
    places = (one.warning(names, spacing) for one in (*layout.rims, *layout.meetings))
    # near a crease another sheet may be the other flank
    return [*(sharp_bends(layout, spacing) or _mixed_sheets(layout)), *filter(None, places)]


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


# Boundaries


def _snapped_boundaries(layout: Layout) -> list[str]:
    """Return a warning for each boundary that is far off the surface."""
    spacing = layout.lattice.spacing
    return [
        f"Boundary {boundary.name!r} lies up to {on_lattice.gap:.3g} off the surface, {on_lattice.gap / spacing:.2g} "
        "spacings; it was snapped to the closest points."
        for boundary, on_lattice in zip(layout.boundaries.definitions, layout.boundaries.on_lattice, strict=True)
        if on_lattice.gap > OFF_SURFACE_SPACINGS * spacing
    ]
