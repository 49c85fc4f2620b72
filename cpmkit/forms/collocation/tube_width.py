"""Whether the wide tube of fourth order stays within the manifold's reach."""

from __future__ import annotations

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.forms.collocation.sheets.twins import separate_sheets
from cpmkit.grid.band import Band
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.local_source import LocalSource

#: Where feet of neighbouring nodes are so many spacings apart, the tube is as wide as the manifold's reach.
MOST_STRETCH_SPACINGS = 2.5
#: This share of the neighbours may be stretched so, for a cap's corner is rounded.
STRETCHED_PAIRS_SHARE = 1e-3


def check_reach(surface: LocalSource, band: Band) -> None:
    """Refuse fourth order where its tube does not fit.

    Closest points of neighbouring nodes are apart by ``R / (R - distance)`` spacings where the manifold has the radius
    of curvature R: they tell, without another query, how near the tube comes to where they are no longer smooth.

    Raises
    ------
    ResolutionError
        If the source is not exact, or the tube is too wide for it.
    """
    if not surface.source.exact:
        raise ResolutionError(
            "order=4 needs a source whose closest points are exact and smooth; this one stands for a smooth manifold "
            "only to its own accuracy, use order=2."
        )
    share = stretched_share(band, MOST_STRETCH_SPACINGS)
    if share > STRETCHED_PAIRS_SHARE:
        raise ResolutionError(
            "order=4 needs a tube that is narrower than the manifold's radius of curvature: at "
            f"spacing={band.spacing:g} {share:.1%} of neighbouring nodes have closest points more than "
            f"{MOST_STRETCH_SPACINGS:g} spacings apart; use a smaller spacing, or order=2."
        )


def check_one_sheet(surface: LocalSource, band: Band, lattice: Lattice) -> None:
    """Refuse fourth order where several sheets share the band, which it does not part.

    Raises
    ------
    ResolutionError
        Naming a place.
    """
    parted = separate_sheets(surface, band)
    if parted is not band:
        foot = ", ".join(f"{x:.3g}" for x in lattice.to_scene(parted.feet.points[[parted.first_twin]])[0])
        raise ResolutionError(
            f"order=4 parts no sheets, and at spacing={band.spacing:g} several of the manifold share its tube, near "
            f"({foot}); use a smaller spacing, or order=2."
        )


def stretched_share(band: Band, apart: float) -> float:
    """Return the share of neighbouring inner nodes whose closest points lie more than ``apart`` spacings apart."""
    first, second = band.neighbours()
    distance = np.linalg.norm(band.feet.points[first] - band.feet.points[second], axis=1)
    return int(np.count_nonzero(distance > apart * band.spacing)) / max(len(first), 1)
