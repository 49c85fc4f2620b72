"""Sentences on rims that face each other, boundaries beside rims, sides that run together, and branches of curves."""

from __future__ import annotations

from cpmkit.errors import place
from cpmkit.forms.collocation.encounters.facing_rims import BRIDGED, WIDE
from cpmkit.forms.collocation.encounters.tips import sentences
from cpmkit.forms.collocation.layout import Layout


def meetings(layout: Layout, spacing: float | None = None) -> list[str]:
    """Return one sentence for each thing found, judged for ``spacing`` where the layout is a coarser rehearsal."""
    h = layout.lattice.spacing if spacing is None else spacing
    names = [boundary.name for boundary in layout.boundaries.given]
    return [
        *_facing(layout, h),
        *_beside_rims(layout, names, h),
        *sentences(layout.blurs, names, h),
        *_branches(layout),
    ]


def _facing(layout: Layout, spacing: float) -> list[str]:
    found = []
    for one in layout.facing:
        if one.gap > WIDE * spacing:
            continue
        what = f"the manifold faces itself across a gap of {one.gap:.3g}, {one.gap / spacing:.2g} spacings"
        harm = (
            "there the gap is as good as closed"
            if one.gap <= BRIDGED * spacing
            else f"up to {one.leak(spacing):.0%} of the difference between its sides leaks across"
        )
        found.append(
            f"Near {place(one.point)} {what}: {harm}, whatever holds on the rims; a spacing of {one.gap / WIDE:.2g} or "
            "less avoids that."
        )
    return found


def _beside_rims(layout: Layout, names: list[str], spacing: float) -> list[str]:
    return [
        f"Boundary {names[one.boundary]!r} runs {one.width:.2g} from a rim, {one.width / spacing:.2g} spacings, near "
        f"{place(one.points[0])}: the strip between them is filled by what they hold; a spacing of {one.width / 3:.2g} "
        "would resolve it."
        for one in layout.rim_strips
        if not one.on_rim and one.width < spacing
    ]


def _branches(layout: Layout) -> list[str]:
    return [
        f"{one.arms} curves meet at {place(one.point)}, where no law holds: what they bring does not balance "
        "there, and no spacing makes the solution right; end the members before the point and give their ends values."
        for one in layout.junctions
    ]
