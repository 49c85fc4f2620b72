"""Warnings where a surface bends more sharply than its band is wide, and where stencils read another sheet."""

from __future__ import annotations

import numpy as np

from cpmkit.errors import place
from cpmkit.forms.collocation.layout import Layout
from cpmkit.forms.collocation.sheets.foot_directions import curvatures

#: Normals that turn by more than this (radians) over one spacing are a sharp bend: on a radius of 3 spacings the
#: solution is off by half a percent of its range.
SHARP_TURN_RADIANS = 1 / 3
#: Sharp turns beside a smaller share of the nodes are no warning, nor are stencils that read another sheet.
SHARP_SHARE, MIXED_SHARE = 5e-3, 1e-3


def has_sharp_bends(layout: Layout) -> bool:
    """Return whether the surface has creases, or bends more sharply than the band is wide."""
    return bool(_sharp_bends(layout, layout.lattice.spacing))


def surface_sentences(layout: Layout, spacing: float | None = None) -> list[str]:
    """Return warnings of sharp bends and mixed sheets, for ``spacing`` where the layout is a coarser rehearsal."""
    target = layout.lattice.spacing if spacing is None else spacing
    # beside a crease stencils read another flank, which is no other sheet
    return _sharp_bends(layout, target) or _mixed_sheets(layout)


def _sharp_bends(layout: Layout, spacing: float) -> list[str]:
    if layout.surface.manifold_dim != layout.surface.dim - 1:
        return []
    places, curvature = curvatures(layout.band)
    sharp = curvature * spacing > SHARP_TURN_RADIANS
    if not len(sharp) or sharp.mean() < SHARP_SHARE:
        return []
    worst = layout.lattice.to_scene(places[[curvature.argmax()]])[0]
    resolved = SHARP_TURN_RADIANS / float(np.quantile(curvature[sharp], 0.9))
    return [
        f"Part of the surface bends more sharply than the band is wide, {sharp.mean():.1%} of it, most near "
        f'{place(worst)}: beside bends and creases the solution is less exact; use form="galerkin", or, for bends, a '
        f"spacing of {resolved:.2g}."
    ]


def _mixed_sheets(layout: Layout) -> list[str]:
    sheets, band = layout.band.sheets, layout.band
    if sheets is None or len(sheets.mixed) <= MIXED_SHARE * band.inner:
        return []
    where = place(layout.lattice.to_scene(band.feet.points[sheets.mixed[:1]])[0])
    return [
        "In places stencils read nodes of a sheet that is not theirs, because no foot on their own was found; a "
        f"smaller spacing narrows the band. These are {len(sheets.mixed) / len(band.nodes):.1%} of the stencils, for "
        f"one near {where}."
    ]
