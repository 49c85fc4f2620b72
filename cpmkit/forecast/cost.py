"""Counting what a scene needs at a spacing, from rehearsals on coarser lattices.

Nodes of an m-dimensional manifold grow like ``a / h^m + b / h^(m - 1)`` when the spacing h shrinks (the
second term: edges, boundary curves, curvature), and two coarse layouts give a and b. Closest point
queries are a sum of such terms and a constant, none of them negative, and three layouts give it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cpmkit.forecast.growth import growth_through
from cpmkit.forms.collocation.diagnosis.meetings import meeting_sentences
from cpmkit.forms.collocation.diagnosis.refusals import check_layout
from cpmkit.forms.collocation.diagnosis.sharp_bends import surface_sentences
from cpmkit.forms.collocation.layout import Layout, lay_out
from cpmkit.forms.collocation.options import CollocationOptions
from cpmkit.forms.options import Options
from cpmkit.grid.band import cell_levels, nodes_of_blocks
from cpmkit.grid.fitting import check_fits
from cpmkit.grid.lattice import COARSEST_BAND_SHARE, lattice_of
from cpmkit.grid.stencils import base_offset
from cpmkit.manifold.local_source import largest_dim, localize
from cpmkit.protocols import Progress, no_progress
from cpmkit.scene.scene import Scene

#: A rehearsal has at most about this many cells on the manifold.
REHEARSED_CELLS = 12_000
#: So many feet are asked again.
PROBED_FEET = 1000
#: Name of the count of closest point queries, and beginning of its parts' names.
QUERIES_KEY = "queries"


@dataclass(frozen=True)
class Counts:
    """What a layout holds.

    Attributes
    ----------
    values : mapping
        Counts by name.
    exact : bool
        True where it was laid out at the spacing itself.
    gaps : tuple of float
        By how much each boundary was snapped to the manifold.
    lefts : tuple of str
        What names the left of each boundary, where its sources do not; else empty.
    noise : float
        How far feet move when they are asked again, at most.
    told : tuple of str
        Sentences on sharp bends, rims, ends and branches, as far as the layout shows them.
    """

    values: Mapping[str, float]
    exact: bool
    gaps: tuple[float, ...]
    lefts: tuple[str, ...]
    noise: float
    told: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> int:
        return round(self.values[name])


def predict(scene: Scene, options: Options[CollocationOptions], progress: Progress = no_progress) -> Counts:
    """Return the counts of ``scene``; ``progress`` is told of the stage "rehearsal"."""
    progress("rehearsal", 0.0)
    spacing = options.spacing
    finest = _rehearsal_spacing(scene, spacing, options.own.degree)
    progress("rehearsal", 0.1)
    layout = lay_out(scene, replace(options, spacing=finest))
    if finest == spacing:
        check_layout(layout, scene)
    fine = _counts_of(layout)
    seen = (
        tuple(one.gap for one in layout.boundaries.on_lattice),
        tuple(one.oriented.left_description for one in layout.boundaries.on_lattice),
        _query_noise(layout),
        (*surface_sentences(layout, spacing), *meeting_sentences(layout, spacing)),
    )
    progress("rehearsal", 0.7 if finest != spacing else 1.0)
    if finest == spacing:
        return Counts(_with_summed_queries(fine), True, *seen)
    spacings = [finest, 2 * finest, 4 * finest]
    rehearsed = [fine, *(_counts_of(lay_out(scene, replace(options, spacing=one))) for one in spacings[1:])]
    progress("rehearsal", 1.0)
    m = largest_dim(scene.surface)
    dims = {f"{QUERIES_KEY} surface": m}
    dims |= {f"{QUERIES_KEY} {boundary.name}": boundary.source.manifold_dim or 1 for boundary in scene.boundaries}
    told = {}
    for name in fine:
        fit = _sum_of_powers if name in dims else _leading_terms
        told[name] = fit(spacings, [counts[name] for counts in rehearsed], spacing, dims.get(name, m))
    return Counts(_with_summed_queries(told), False, *seen)


def _rehearsal_spacing(scene: Scene, spacing: float, degree: int) -> float:
    """Return the spacing times the smallest power of two whose layout is small.

    Raises
    ------
    ResolutionError
        If the spacing itself would need more memory than the machine has.
    """
    lattice = lattice_of(scene.surface, spacing, coarsest=COARSEST_BAND_SHARE)
    surface = localize(scene.surface, lattice.origin)
    levels = cell_levels(surface, lattice.spacing, base_offset(degree))
    side, blocks = next((side, len(blocks)) for side, blocks in levels if side == 1 or len(blocks) > REHEARSED_CELLS)
    m = surface.largest_dim
    unknowns = nodes_of_blocks(blocks, side, surface.dim, m, degree)
    check_fits(surface, unknowns, spacing, degree, excess=1.0 if side == 1 else 4.0)
    return lattice.spacing * side


def _query_noise(layout: Layout) -> float:
    """Return how far the feet of a few nodes move when their closest points are asked for."""
    nodes = np.linspace(0, len(layout.band.nodes) - 1, PROBED_FEET).astype(np.int64)
    feet = layout.band.feet.take(np.unique(nodes))
    if feet.doubtful is not None:
        feet = feet.take(~feet.doubtful)
    again = layout.surface.closest_point(feet.points).points
    return float(np.linalg.norm(again - feet.points, axis=1).max(initial=0.0))


def _counts_of(layout: Layout) -> dict[str, float]:
    counts = {
        "inner": layout.band.inner,
        "twins": layout.band.inner - layout.band.first_twin,
        "nodes": len(layout.band.nodes),
        "rows": layout.numbering.rows,
        "unknowns": layout.numbering.unknowns,
        "past edge": int(np.count_nonzero(layout.band.feet.edge >= 0)),
    }
    for number, ghosts in enumerate(layout.ghosts):
        counts[f"ghosts {number}"] = ghosts.unknowns
    for name, queries in layout.queries.items():
        counts[f"{QUERIES_KEY} {name}"] = queries
    return {name: float(value) for name, value in counts.items()}


def _with_summed_queries(counts: Mapping[str, float]) -> dict[str, float]:
    """Return the counts with the queries of all sources as one."""
    queries = sum(value for name, value in counts.items() if name.startswith(QUERIES_KEY))
    return {**{name: value for name, value in counts.items() if not name.startswith(QUERIES_KEY)}, QUERIES_KEY: queries}


def _leading_terms(spacings: list[float], counts: list[float], spacing: float, m: int) -> float:
    """Fit ``count = a / h^m + b / h^(m - 1)`` to the two finest counts, and read it at ``spacing``."""
    (h, wide, *_), (fine, coarse, *_) = spacings, counts
    return max(growth_through((h, fine), (wide, coarse), m).at(spacing), 0.0)


def _sum_of_powers(spacings: list[float], counts: list[float], spacing: float, m: int) -> float:
    """Fit ``count = a / h^m + ... + c``, no term negative, to all counts, and read it at ``spacing``."""
    from scipy.optimize import nnls

    if not all(counts):
        return 0.0
    powers = np.arange(m, -1, -1)
    relative = np.array([[(spacing / h) ** p for p in powers] for h in spacings]) / np.array(counts)[:, None]
    terms, _ = nnls(relative, np.ones(len(counts)))
    return float(terms.sum())
