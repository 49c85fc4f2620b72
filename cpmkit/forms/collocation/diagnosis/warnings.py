"""What a reader of a solution should know: where the scene leaves the method's safe range."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from cpmkit.errors import place
from cpmkit.forms.collocation.diagnosis.meetings import meetings
from cpmkit.forms.collocation.diagnosis.survey import remaining, surveyed
from cpmkit.forms.collocation.encounters.boundaries import DISTURBED
from cpmkit.forms.collocation.layout import Layout
from cpmkit.forms.collocation.tube_width import share_stretched
from cpmkit.manifold.abilities import advice_of
from cpmkit.protocols import SIDES
from cpmkit.scene.laws import Mixed, Value

#: A surface's search may doubt this share of the nodes before it is worth a warning.
DOUBTFUL_SHARE = 1e-4
#: Closest points of neighbouring nodes that lie this many spacings apart have jumped from one part to another.
JUMP = 2.0
#: So many jumps are worth a warning: Spot with 0.5 percent of them differs from finite elements by 2 percent of the
#: range, with 1.1 percent by 18.
JUMP_SHARE = 5e-3
#: A boundary that lies more spacings off the surface than this was hardly meant to.
FAR_OFF = 0.5


def warnings_of(layout: Layout, missed: float = 0.0) -> tuple[str, ...]:
    """Return one sentence for each thing found.

    ``missed`` is the share of its range by which a solution's mean was off: where bends, creases and limbs are to be
    expected to cost less, they are told to cost that (of 28 solutions on real meshes the larger of the two was within
    three times of the largest error 23 times, that of the bends alone 15).
    """
    own = advice_of(layout.surface.source, layout.lattice.spacing).warnings
    far = layout.lattice.lost_digits(layout.surface.bounds, not layout.surface.shift.any())
    checks = (_doubtful, partial(_sheets, missed=missed), _boundaries, _encounters, _gaps, _pins, meetings)
    return (*own, *far, *(text for check in checks for text in check(layout)))


def _encounters(layout: Layout) -> list[str]:
    """Name crossings of different values, and strips too narrow for the grid."""
    names, spacing = [boundary.name for boundary in layout.boundaries.given], layout.lattice.spacing
    found = []
    if layout.crossings:
        one = layout.crossings[0]
        where = place(one.point)
        more = f" and {len(layout.crossings) - 1} more pairs" if len(layout.crossings) > 1 else ""
        found.append(
            f"Boundaries {names[one.first]!r} and {names[one.second]!r}{more} cross with different values in the "
            f"sectors around, near {where}: within {DISTURBED * spacing:.2g} of it the solution is off by up to "
            f"their difference, {one.jump:.3g}; beyond twice that it is not disturbed."
        )
    found += [
        f"Boundaries {names[one.first]!r} and {names[one.second]!r} run side by side, {one.width / spacing:.2g} "
        f"spacings apart near {place(one.point)}: the strip between them is filled by what "
        f"they hold; a spacing of {one.width / 3:.2g} would resolve it."
        for one in layout.strips
        if not one.coincide
    ]
    found += [
        f"Boundaries {names[one.first]!r} and {names[one.second]!r} lie at the same place, near "
        f"{place(one.point)}, and hold the same; one of them is enough."
        for one in layout.strips
        if one.coincide
    ]
    return found


def _gaps(layout: Layout) -> list[str]:
    spacing = layout.lattice.spacing
    return [
        f"Boundary {boundary.name!r} lies up to {seen.gap:.3g} off the surface, {seen.gap / spacing:.2g} spacings; it "
        "was snapped to the closest points."
        for boundary, seen in zip(layout.boundaries.given, layout.boundaries.on_lattice, strict=True)
        if seen.gap > FAR_OFF * spacing
    ]


def _pins(layout: Layout) -> list[str]:
    """Name points on a surface that hold a value beside other values: the continuous problem does not feel them."""
    boundaries = layout.boundaries.given
    valued = [one for one in boundaries if any(isinstance(one.condition(side).law, (Value, Mixed)) for side in SIDES)]
    thin = {one.name for one, seen in zip(boundaries, layout.boundaries.on_lattice, strict=True) if not seen.has_sides}
    pins = [one.name for one in valued if one.name in thin]
    if not pins or len(valued) < 2:
        return []
    return [
        f"Boundary {', '.join(map(repr, pins))}: a point of a surface, or a point or curve of a solid, is too small "
        "for the equation to feel a value there beside other conditions; what comes out depends on the spacing, use a "
        "small circle or a thin tube instead."
    ]


def _doubtful(layout: Layout) -> list[str]:
    doubtful = layout.band.feet.doubtful
    if doubtful is None or np.mean(doubtful) <= DOUBTFUL_SHARE:
        return []
    return [
        f"The surface could not vouch for the closest points of {int(doubtful.sum())} of {len(doubtful)} nodes "
        f"({np.mean(doubtful):.2%}): at folds and creases narrower than the band the solution may be off; "
        "a smaller spacing narrows the band."
    ]


def share_of_jumps(layout: Layout) -> float:
    """Return the share of neighbouring inner nodes whose closest points lie more than two spacings apart.

    On a surface that the band resolves there are none; near a medial axis inside the band there are.
    """
    return share_stretched(layout.band, JUMP)


def _sheets(layout: Layout, missed: float) -> list[str]:
    """Name what parting the sheets left; where it is not looked for, places where sheets or flanks may mix."""
    if surveyed(layout):
        found = remaining(layout)
        sentences = [replace(one, error=max(one.error, min(missed, 1.0))).sentence for one in found]
        if (
            layout.options.own.sheets == "unfolded"
            and layout.surface.source.exact
            and any(one.kind == "crease" for one in found)
        ):
            sentences.append(
                "Unfolding goes astray at creases of exact closest points, whose nodes outside have their feet on the "
                "crease itself; use closest points that are smooth, or sheets=True."
            )
        return sentences
    share = share_of_jumps(layout)
    if share <= JUMP_SHARE:
        return []
    return [
        f"The closest points of {share:.1%} of neighbouring nodes jump: there the surface bends more sharply, or two "
        "parts of it come nearer to each other, than the band is wide, and the solution may be off by several percent; "
        "a smaller spacing narrows the band."
    ]


def _boundaries(layout: Layout) -> list[str]:
    found = []
    for boundary, ghosts in zip(layout.boundaries.given, layout.ghosts, strict=True):
        asked = min(boundary.condition(side).order or layout.order for side in SIDES)
        fallen = int(np.count_nonzero(ghosts.orders[: ghosts.unknowns] == 1)) if asked > 1 else 0
        if fallen:
            found.append(
                f"{fallen} of {ghosts.unknowns} ghosts of boundary {boundary.name!r} are of first order, because their "
                "mirror points lie beyond another boundary or past a rim; three spacings between them avoid that."
            )
    return found
