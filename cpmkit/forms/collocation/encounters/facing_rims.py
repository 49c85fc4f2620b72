"""Rims that face each other across a gap: stencils of one read nodes whose closest points lie on the other.

Nodes past a rim hold the condition there only where they are nearer to it than to anything else. Across a gap of a
spacing or two hardly any are, and values leak from one side to the other as if the gap were bridged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.grid.band import Band
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.tangent_space import outward_conormals
from cpmkit.protocols import Bools, Floats, Ints

#: Half widths of gaps (spacings) that are tested ahead of a rim; wider gaps hardly leak.
HALF_GAPS_SPACINGS = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0)
#: One foot of a rim is looked at for each cell of so many spacings.
RIM_SAMPLE_SPACINGS = 1.5
#: Least cosines: of the conormal with the direction to a foot ahead, and of that foot with what it faces.
AHEAD_COSINE, FACING_COSINE = 0.5, 0.8
#: Sources nearer than this many spacings touch.
TOUCHING_SOURCES_SPACINGS = 1e-3
#: Step, in spacings, of the differences that give a conormal: across a narrower gap they would see the other rim. Feet
#: nearer to the rim are on it.
GAP_CONORMAL_STEP_SPACINGS = 0.005
#: Number of bisections towards the middle of a gap.
GAP_HALVINGS = 12
#: Across gaps of so many spacings a rim has hardly a node of its own.
BRIDGED_GAP_SPACINGS = 1.5
#: Rims that face each other so narrowly along so many spacings are those of a slit, not a notch's tip or a small hole.
SLIT_LENGTH_SPACINGS = 6.0
#: The share of the difference of the values on both sides that leaks at most across two spacings; half of it for each
#: further one (a slit in a sphere: 0.45 at 2, 0.11 at 4, 0.055 at 5 spacings; in the plane a tenth of that).
LEAK_AT_TWO_SPACINGS = 0.45
#: A gap of so many spacings leaks next to nothing: the spacing that would do is this share of it.
WIDE_GAP_SPACINGS = 6.0


@dataclass(frozen=True, eq=False)
class FacingRims:
    """Where a rim faces another part of the manifold, or itself, across the narrowest gap.

    Attributes
    ----------
    point : (d,) float64
        In the gap, in the scene's coordinates.
    gap : float
        Its width.
    local : bool
        True where it is not bridged, or only at the tip of a notch or around a small hole.
    """

    point: Floats
    gap: float
    local: bool

    def leak(self, spacing: float) -> float:
        """Return about the share of the difference of both sides that leaks across at most."""
        width = self.gap / spacing
        return 1.0 if width <= BRIDGED_GAP_SPACINGS else LEAK_AT_TWO_SPACINGS * 2.0 ** (2.0 - width)


def find_facing_rims(surface: LocalSource, band: Band) -> tuple[FacingRims, ...]:
    """Return the narrowest gap that a rim of the manifold faces, relative to the lattice's origin; () if there is none.

    One that is bridged, and no mere notch, comes first. Nothing is asked for where the manifold has no rim; the
    queries grow with the length of the rims.
    """
    past = np.flatnonzero(band.feet.edge >= 0)
    if not len(past):
        return ()
    rim, outward, loop = _thinned(surface, band, past)
    far = np.full(len(rim), HALF_GAPS_SPACINGS[-1] * band.spacing)
    facing = _faces_another(surface, rim, outward, far, band.spacing)[0]
    found, middle, across = _look_ahead(surface, rim[facing], outward[facing], band.spacing)
    if not len(found):
        return ()
    found = np.flatnonzero(facing)[found]
    gap = np.linalg.norm(across - rim[found], axis=1)
    bridged = np.flatnonzero(gap <= BRIDGED_GAP_SPACINGS * band.spacing)
    if surface.largest_dim > 1 and len(bridged):
        bridged = bridged[_on_long_stretch(rim[found[bridged]], loop[found[bridged]], band.spacing)]
    chosen = bridged[gap[bridged].argmin()] if len(bridged) else gap.argmin()
    return (FacingRims(middle[chosen], float(gap[chosen]), not len(bridged)),)


def _thinned(surface: LocalSource, band: Band, past: Ints) -> tuple[Floats, Floats, Ints]:
    """Return one foot (k, d) of the rims for each cell, the outward conormals there, and the loops."""
    h, away = band.spacing, band.positions[past] - band.feet.points[past]
    length = np.linalg.norm(away, axis=1)
    cells = np.floor(band.feet.points[past] / (RIM_SAMPLE_SPACINGS * h)).astype(np.int64)
    order = np.argsort(-length, kind="stable")  # the farthest node tells the direction best
    labelled = np.column_stack([cells, band.feet.edge[past]])[order]
    chosen = order[np.unique(labelled, axis=0, return_index=True)[1]]
    feet, away, length = band.feet.take(past[chosen]), away[chosen], length[chosen]
    outward = away / np.maximum(length, GAP_CONORMAL_STEP_SPACINGS * h)[:, None]
    flat = np.flatnonzero((surface.dimensions_at(feet) < surface.dim) | (length < GAP_CONORMAL_STEP_SPACINGS * h))
    outward[flat] = outward_conormals(surface, feet.take(flat), GAP_CONORMAL_STEP_SPACINGS * h)
    return feet.points, outward, feet.edge


def _look_ahead(surface: LocalSource, rim: Floats, outward: Floats, spacing: float) -> tuple[Ints, Floats, Floats]:
    """Return which feet of a rim face something, the middles (k, d) of the gaps, and the points beyond them."""
    near, far = np.zeros(len(rim)), np.full(len(rim), np.inf)
    for step in HALF_GAPS_SPACINGS:
        waiting = np.flatnonzero(np.isinf(far))
        ahead = np.full(len(waiting), step * spacing)
        hit = _faces_another(surface, rim[waiting], outward[waiting], ahead, spacing)[0]
        far[waiting[hit]], near[waiting[~hit]] = step * spacing, step * spacing
    found = np.flatnonzero(np.isfinite(far))
    start, b, low, high = rim[found], outward[found], near[found], far[found]
    for _ in range(GAP_HALVINGS):
        middle = 0.5 * (low + high)
        hit = _faces_another(surface, start, b, middle, spacing)[0]
        low, high = np.where(hit, low, middle), np.where(hit, middle, high)
    across = _faces_another(surface, start, b, high, spacing)[1]
    middle_point = start + high[:, None] * b
    back, chord = middle_point - across, start - across
    width = np.linalg.norm(chord, axis=1)
    opposite = np.sum(back * chord, axis=1) > FACING_COSINE * np.linalg.norm(back, axis=1) * width
    kept = opposite & (width > TOUCHING_SOURCES_SPACINGS * spacing)
    return found[kept], middle_point[kept], across[kept]


def _faces_another(
    surface: LocalSource, start: Floats, outward: Floats, ahead: Floats, spacing: float
) -> tuple[Bools, Floats]:
    """Tell where the closest point of what lies ``ahead`` (k,) of a rim is not on it but ahead; and return it."""
    feet = surface.closest_point(start + ahead[:, None] * outward).points
    away = np.linalg.norm(feet - start, axis=1)
    ahead_of_it = np.sum((feet - start) * outward, axis=1) > AHEAD_COSINE * away
    return ahead_of_it & (away > GAP_CONORMAL_STEP_SPACINGS * spacing), feet


def _on_long_stretch(rim: Floats, loop: Ints, spacing: float) -> Bools:
    """Tell which feet (k, d) of rims are on a stretch of one that is longer than the tip of a notch or a small hole."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    first, second = cKDTree(rim).query_pairs(2 * RIM_SAMPLE_SPACINGS * spacing, output_type="ndarray").T
    same = loop[first] == loop[second]
    graph = csr_array((np.ones(int(same.sum())), (first[same], second[same])), shape=(len(rim), len(rim)))
    count, label = connected_components(graph, directed=False)
    low, high = np.full((count, rim.shape[1]), np.inf), np.full((count, rim.shape[1]), -np.inf)
    np.minimum.at(low, label, rim)
    np.maximum.at(high, label, rim)
    return np.asarray(np.linalg.norm(high - low, axis=1)[label] >= SLIT_LENGTH_SPACINGS * spacing)
