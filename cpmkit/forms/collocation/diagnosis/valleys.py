"""What limbs side by side cost: parts of a surface that read each other across the valley between them."""

from __future__ import annotations

import numpy as np

from cpmkit.forms.collocation.diagnosis.remainder import WORTH, Remainder
from cpmkit.forms.collocation.layout import Layout

#: Where limbs differ, the largest error is so many times the largest such sum: 0.4 to 4, median 1.5, of capsules 2 to 8
#: spacings thick and half a spacing to 3 apart.
READ = 1.5
#: Limbs so many spacings apart are parted.
PARTED = 3.5


def limbs_of(layout: Layout) -> Remainder | None:
    """Return what limbs side by side cost, None where they are too far apart to be worth telling."""
    limbs = layout.limbs
    error = min(1.0, READ * float(limbs.read.max(initial=0.0)))
    if error < WORTH:
        return None
    worst = int(limbs.read.argmax())
    return Remainder(
        "limbs",
        share=min(1.0, limbs.each * len(limbs.read) / len(layout.band.nodes)),
        typical=float(np.median(limbs.width)),
        worst=float(limbs.width[worst]),
        error=error,
        cure=float(np.quantile(limbs.width, 0.1)) / PARTED,
        place=tuple(layout.lattice.to_scene(limbs.places[[worst]])[0].tolist()),
    )
