"""Choosing a spacing."""

from __future__ import annotations

import numpy as np

from cpmkit.errors import InputError
from cpmkit.grid.band import cell_levels
from cpmkit.manifold.localized import localize
from cpmkit.runtime.arrays import positive
from cpmkit.scene.scene import Scene

#: A suggested spacing gives about this many cells on the manifold, by its dimension.
CELLS = {0: 1, 1: 200, 2: 10_000, 3: 60_000}


def needed_spacing(scene: Scene, spacing: float | None) -> float:
    """Return ``spacing`` if it is one.

    Raises
    ------
    InputError
        If there is none, with a suggestion, or it is not above zero.
    """
    if spacing is None:
        raise InputError(
            "spacing is needed, in the scene's unit of length; "
            f"for this surface try spacing={suggest_spacing(scene):g}."
        )
    return positive(spacing, "spacing")


def suggest_spacing(scene: Scene) -> float:
    """Return a spacing, rounded to two digits, at which the scene is quick to solve and its shape is seen."""
    surface = localize(scene.surface, np.zeros(scene.surface.dim))
    bounds = surface.bounds
    manifold_dim = surface.largest_dim
    size = float((bounds[1] - bounds[0]).max()) or 1.0
    trial = size / 16
    count = next(len(blocks) for side, blocks in cell_levels(surface, trial, 0.0) if side == 1)
    spacing = trial * (count / CELLS[manifold_dim]) ** (1 / max(manifold_dim, 1))
    return float(f"{spacing:.2g}")
