"""Warnings about a layout: where a scene leaves the method's safe range."""

from __future__ import annotations

import numpy as np

from cpmkit.errors import place
from cpmkit.forms.collocation.diagnosis.meetings import meeting_sentences
from cpmkit.forms.collocation.diagnosis.sharp_bends import surface_sentences
from cpmkit.forms.collocation.encounters.boundaries import DISTURBED_SPACINGS
from cpmkit.forms.collocation.layout import Layout
from cpmkit.grid.band import Band
from cpmkit.manifold.abilities import advice_of
from cpmkit.protocols import SIDES
from cpmkit.scene.point_values import small_boundary_warnings
from cpmkit.scene.scene import Scene

#: A surface's search may doubt this share of the nodes before it is worth a warning.
DOUBTFUL_NODES_SHARE = 1e-4
#: Closest points of neighbouring nodes that lie this many spacings apart have jumped from one part to another: on a
#: surface that the band resolves none do, near a medial axis inside the band some do.
JUMP_SPACINGS = 2.0
#: A larger share of jumping feet is worth a warning: Spot with 0.5 percent of them differs from finite elements by 2
#: percent of the range, with 1.1 percent by 18.
JUMP_SHARE = 5e-3
#: A curve on a surface smaller than so many spacings has ghosts that read past it.
SMALL_SPACINGS = 1.0
#: A boundary farther off the surface than so many spacings is probably a mistake.
OFF_SURFACE_SPACINGS = 0.5


def layout_warnings(layout: Layout, scene: Scene) -> tuple[str, ...]:
    """Return one sentence for each thing found."""
    advice = advice_of(layout.surface.source, layout.lattice.spacing)
    from_source = (*advice.warnings, *advice.closest_point_warnings)
    rounding = layout.lattice.lost_digits(layout.surface.bounds, not layout.surface.shift.any())
    checks = (_doubtful, surface_sentences, _jumps, _boundaries, _encounters, _gaps, meeting_sentences)
    found = (text for check in checks for text in check(layout))
    seen = zip(layout.boundaries.given, layout.boundaries.on_lattice, strict=True)
    cutting, spacing = [one.name for one, on in seen if on.has_sides], layout.lattice.spacing
    small = small_boundary_warnings(scene, cutting, spacing, SMALL_SPACINGS * spacing)
    return (*from_source, *rounding, *found, *small)


def _encounters(layout: Layout) -> list[str]:
    """Name crossings of different values, and strips too narrow for the grid."""
    names, spacing = [boundary.name for boundary in layout.boundaries.given], layout.lattice.spacing
    sentences = []
    if layout.sector_jumps:
        one = layout.sector_jumps[0]
        where = place(one.point)
        more = f" and {len(layout.sector_jumps) - 1} more pairs" if len(layout.sector_jumps) > 1 else ""
        sentences.append(
            f"Boundaries {names[one.first]!r} and {names[one.second]!r}{more} cross with different values in the "
            f"sectors around, near {where}: within {DISTURBED_SPACINGS * spacing:.2g} of it the solution is off by up "
            f"to their difference, {one.jump:.3g}; beyond twice that it is not disturbed."
        )
    for strip in sorted(layout.strips, key=lambda one: one.coincide):
        both, where = f"Boundaries {names[strip.first]!r} and {names[strip.second]!r}", place(strip.point)
        sentences.append(
            f"{both} lie at the same place, near {where}, and hold the same; one of them is enough."
            if strip.coincide
            else f"{both} run side by side, {strip.width / spacing:.2g} spacings apart near {where}: the strip between "
            f"them is filled by what they hold; a spacing of {strip.width / 3:.2g} would resolve it."
        )
    return sentences


def _gaps(layout: Layout) -> list[str]:
    spacing = layout.lattice.spacing
    return [
        f"Boundary {boundary.name!r} lies up to {sighted.gap:.3g} off the surface, {sighted.gap / spacing:.2g} "
        "spacings; it was snapped to the closest points."
        for boundary, sighted in zip(layout.boundaries.given, layout.boundaries.on_lattice, strict=True)
        if sighted.gap > OFF_SURFACE_SPACINGS * spacing
    ]


def _doubtful(layout: Layout) -> list[str]:
    doubtful = layout.band.feet.doubtful
    if doubtful is None or np.mean(doubtful) <= DOUBTFUL_NODES_SHARE:
        return []
    return [
        f"The surface could not vouch for the closest points of {int(doubtful.sum())} of {len(doubtful)} nodes "
        f"({np.mean(doubtful):.2%}): at folds and creases narrower than the band the solution may be off; "
        "a smaller spacing narrows the band."
    ]


def _jumps(layout: Layout) -> list[str]:
    """Name jumps of closest points where sheets are not separated: of other manifolds, and by the plain method."""
    if layout.options.own.sheets and layout.surface.manifold_dim == layout.surface.dim - 1:
        return []
    share = _jumping_share(layout.band)
    if share <= JUMP_SHARE:
        return []
    return [
        f"The closest points of {share:.1%} of neighbouring nodes jump: there the surface bends more sharply, or two "
        "parts of it come nearer to each other, than the band is wide, and the solution may be off by several percent; "
        "a smaller spacing narrows the band."
    ]


def _jumping_share(band: Band) -> float:
    """Return the share of neighbouring inner nodes whose closest points lie ``JUMP_SPACINGS`` apart or more."""
    first, second = band.neighbours()
    distance = np.linalg.norm(band.feet.points[first] - band.feet.points[second], axis=1)
    return int(np.count_nonzero(distance > JUMP_SPACINGS * band.spacing)) / max(len(first), 1)


def _boundaries(layout: Layout) -> list[str]:
    sentences = []
    for boundary, ghosts in zip(layout.boundaries.given, layout.ghosts, strict=True):
        target = min(boundary.condition(side).order or layout.order for side in SIDES)
        fallen = int(np.count_nonzero(ghosts.orders[: ghosts.unknowns] == 1)) if target > 1 else 0
        if fallen:
            sentences.append(
                f"{fallen} of {ghosts.unknowns} ghosts of boundary {boundary.name!r} are of first order, because their "
                "mirror points lie beyond another boundary or past a rim; three spacings between them avoid that."
            )
    return sentences
