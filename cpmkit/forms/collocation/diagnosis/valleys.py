"""What limbs side by side cost: parts of a surface that read each other across the valley between them."""

from __future__ import annotations

import numpy as np

from cpmkit.forms.collocation.diagnosis.unresolved import TOLD_ERROR_SHARE, UnresolvedFeature
from cpmkit.forms.collocation.layout import Layout

#: Where limbs differ, the largest error over the largest sum of weights on the other limb: 0.4 to 4, median 1.5, of
#: capsules 2 to 8 spacings thick and half a spacing to 3 apart.
ERROR_PER_WEIGHT = 1.5
#: Limbs at least so many spacings apart are separated.
SEPARATE_LIMBS_SPACINGS = 3.5


def limb_feature(layout: Layout) -> UnresolvedFeature | None:
    """Return the error that limbs side by side cause as a feature, None below the reporting threshold."""
    limbs = layout.limbs
    error = min(1.0, ERROR_PER_WEIGHT * float(limbs.foreign_weight.max(initial=0.0)))
    if error < TOLD_ERROR_SHARE:
        return None
    worst = int(limbs.foreign_weight.argmax())
    return UnresolvedFeature(
        "limbs",
        share=min(1.0, limbs.stencils_each * len(limbs.foreign_weight) / len(layout.band.nodes)),
        typical=float(np.median(limbs.width)),
        worst=float(limbs.width[worst]),
        error=error,
        cure=float(np.quantile(limbs.width, 0.1)) / SEPARATE_LIMBS_SPACINGS,
        place=tuple(layout.lattice.to_scene(limbs.places[[worst]])[0].tolist()),
    )
