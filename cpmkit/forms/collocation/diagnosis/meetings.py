"""Sentences on rims that face each other, boundaries beside rims, sides that run together, and branches of curves."""

from __future__ import annotations

from cpmkit.errors import place
from cpmkit.forms.collocation.encounters.facing_rims import BRIDGED_GAP_SPACINGS, WIDE_GAP_SPACINGS
from cpmkit.forms.collocation.encounters.tips import blur_sentence
from cpmkit.forms.collocation.layout import Layout


def meeting_sentences(layout: Layout, spacing: float | None = None) -> list[str]:
    """Return one sentence for each thing found, judged for ``spacing`` where the layout is a coarser rehearsal."""
    h = layout.lattice.spacing if spacing is None else spacing
    names = [boundary.name for boundary in layout.boundaries.given]
    return [
        *_facing_rim_sentences(layout, h),
        *_rim_strip_sentences(layout, names, h),
        *(blur_sentence(one, names[one.boundary], h) for one in layout.blurs),
        *_junction_sentences(layout),
    ]


def _facing_rim_sentences(layout: Layout, spacing: float) -> list[str]:
    sentences = []
    for rims in layout.facing:
        if rims.gap > WIDE_GAP_SPACINGS * spacing:
            continue
        what = f"the manifold faces itself across a gap of {rims.gap:.3g}, {rims.gap / spacing:.2g} spacings"
        harm = (
            "there the gap is as good as closed"
            if rims.gap <= BRIDGED_GAP_SPACINGS * spacing
            else f"up to {rims.leak(spacing):.0%} of the difference between its sides leaks across"
        )
        sentences.append(
            f"Near {place(rims.point)} {what}: {harm}, whatever holds on the rims; a spacing of "
            f"{rims.gap / WIDE_GAP_SPACINGS:.2g} or less avoids that."
        )
    return sentences


def _rim_strip_sentences(layout: Layout, names: list[str], spacing: float) -> list[str]:
    return [
        f"Boundary {names[strip.boundary]!r} runs {strip.width:.2g} from a rim, {strip.width / spacing:.2g} spacings, "
        f"near {place(strip.points[0])}: the strip between them is filled by what they hold; a spacing of "
        f"{strip.width / 3:.2g} would resolve it."
        for strip in layout.rim_strips
        if not strip.on_rim and strip.width < spacing
    ]


def _junction_sentences(layout: Layout) -> list[str]:
    return [
        f"{junction.arms} curves meet at {place(junction.point)}, where no law holds: what they bring does not balance "
        "there, and no spacing makes the solution right; end the members before the point and give their ends values."
        for junction in layout.junctions
    ]
