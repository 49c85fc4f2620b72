"""Counting what a scene needs at a spacing, from rehearsals on coarser lattices.

A count on an m-dimensional manifold grows like ``a / h^m + b / h^(m - 1)`` when the spacing h shrinks (the
second term: edges, boundary curves, curvature). Two coarse layouts give a and b for every count.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit import memory
from cpmkit.grid.band import cell_levels, nodes_of_blocks
from cpmkit.grid.stencils import base_offset, check_degree
from cpmkit.layout import Layout, lay_out
from cpmkit.localized import localize
from cpmkit.scene import Scene

#: A rehearsal has at most about this many cells on the manifold.
REHEARSED_CELLS = 12_000


@dataclass(frozen=True)
class Counts:
    """What a layout holds, by name; ``exact`` where it was laid out at the spacing itself."""

    values: Mapping[str, float]
    exact: bool

    def __getitem__(self, name: str) -> int:
        return round(self.values[name])


def count(scene: Scene, spacing: float, **options: Any) -> Counts:
    """Return the counts of ``scene`` at ``spacing``."""
    coarse = _rehearsal_spacing(scene, spacing, options.get("degree", 3))
    fine = lay_out(scene, coarse, **options)
    if coarse == spacing:
        return Counts(_counts(fine), True)
    coarser = lay_out(scene, 2 * coarse, **options)
    return Counts(_extrapolate(_counts(fine), _counts(coarser), coarse, spacing, manifold_dim(scene)), False)


def manifold_dim(scene: Scene) -> int:
    """Return the dimension with which counts grow: the manifold's, or the space's where it is mixed."""
    return scene.surface.dim if scene.surface.manifold_dim is None else scene.surface.manifold_dim


def _rehearsal_spacing(scene: Scene, spacing: float, degree: int) -> float:
    """Return the spacing times the smallest power of two whose layout is small.

    Raises
    ------
    ResolutionError
        If the spacing itself would need more memory than the machine has.
    """
    lattice = scene.lattice(spacing)
    surface = localize(scene.surface, lattice.origin)
    levels = cell_levels(surface, lattice.spacing, base_offset(check_degree(degree)))
    side, blocks = next((side, len(blocks)) for side, blocks in levels if side == 1 or len(blocks) > REHEARSED_CELLS)
    m = manifold_dim(scene)
    memory.check_fits(nodes_of_blocks(blocks, side, surface.dim, m, degree), surface.dim, m, degree, spacing)
    return lattice.spacing * side


def _counts(layout: Layout) -> dict[str, float]:
    rows = len(layout.band.nodes) + sum(len(ghosts.nodes) for ghosts in layout.ghosts)
    counts = {
        "inner": layout.band.inner,
        "nodes": len(layout.band.nodes),
        "rows": rows,
        "unknowns": layout.size,
        "past edge": int(np.count_nonzero(layout.band.feet.edge >= 0)),
        "queries": sum(layout.queries.values()),
    }
    for number, ghosts in enumerate(layout.ghosts):
        counts[f"ghosts {number}"] = ghosts.unknowns
    return {name: float(value) for name, value in counts.items()}


def _extrapolate(
    fine: Mapping[str, float], coarse: Mapping[str, float], coarse_spacing: float, spacing: float, dim: int
) -> dict[str, float]:
    """Fit ``count h^m = a + b h`` to counts at ``coarse_spacing`` and twice that, and read it at ``spacing``."""
    result = {}
    for name, value in fine.items():
        at_fine = value * coarse_spacing**dim
        at_coarse = coarse[name] * (2 * coarse_spacing) ** dim
        slope = (at_coarse - at_fine) / coarse_spacing
        # A count that the coarse lattices blur (pieces in one band) may fit a line that dips too low.
        line = max(at_fine + slope * (spacing - coarse_spacing), 0.0)
        result[name] = line / spacing**dim
    return result
