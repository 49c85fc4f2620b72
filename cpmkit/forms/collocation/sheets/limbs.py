"""Limbs side by side: parts of a surface that point the same way across a valley, and count as one sheet.

The tops of two parallel fingers have one normal, and their chord is at right angles to it, however deep the valley
between them: what tells sheets apart sees flanks that face each other, and not these. Neighbouring nodes on both sides
of the middle of the valley have their feet on either limb; the closest point of the middle of the chord between those
tells, at a sample of them, whether the surface follows the chord or lies far below it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.forms.collocation.selection import Centres, Unknowns
from cpmkit.forms.collocation.sheets.sheets import same_sheet
from cpmkit.forms.collocation.sheets.turning import foot_directions
from cpmkit.grid.band import Band
from cpmkit.grid.stencils import stencil_cells, stencil_nodes, tensor_weights
from cpmkit.manifold.local_source import LocalSource
from cpmkit.protocols import Bools, Floats, Ints

#: Feet of neighbouring nodes farther apart than so many spacings may lie on two limbs, if the surface is concave there.
LONG_CHORD_SPACINGS = 1.5
#: Number of such pairs that are examined, spread over the surface.
PAIR_SAMPLE = 512
#: The surface leaves a chord if the chord's middle is farther from it than this multiple of the sagitta of an arc with
#: the same turn, plus so many spacings.
FOLLOWED_ARC_FACTOR, FOLLOWED_SLACK_SPACINGS = 1.5, 0.25
#: Radius (spacings) around the feet of such pairs in which stencils are examined, and how many of these;
BESIDE_PAIR_SPACINGS, STENCIL_SAMPLE = 1.5, 2000
#: stencils whose weights on nodes nearer to the other limb sum up to more than this are suspects, of which so many are
#: checked by queries.
DISTURBED_WEIGHT, ASKED_STENCILS = 3e-3, 128


@dataclass(frozen=True, eq=False)
class Limbs:
    """Stencils that read another limb beside their own.

    Attributes
    ----------
    places : (n, d) float64
        Where they are centred, relative to the lattice's origin.
    width : (n,) float64
        Of the valley between the limbs there.
    foreign_weight : (n,) float64
        The sum of the sizes of the weights with which they read the other limb, above ``DISTURBED_WEIGHT``.
    stencils_each : float
        How many stencils of the band each of these represents.
    """

    places: Floats
    width: Floats
    foreign_weight: Floats
    stencils_each: float


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Feet (n, d) on both sides of valleys, each pair twice, and the width (n,) of the valleys."""

    here: Floats
    there: Floats
    width: Floats


def find_limbs(surface: LocalSource, band: Band) -> Limbs:
    """Return where stencils read another limb across a valley."""
    pairs = _pairs_across_valleys(surface, band)
    if not len(pairs.here):
        return Limbs(pairs.here, pairs.width, pairs.width, 0.0)
    return _stencils_across_valleys(surface, band, pairs)


def _pairs_across_valleys(surface: LocalSource, band: Band) -> _Pairs:
    """Return pairs of feet of neighbouring nodes that lie on two limbs and count as one sheet."""
    h, away, (first, second) = band.spacing, foot_directions(band), band.neighbours()
    chord = band.feet.points[second] - band.feet.points[first]
    kept = away.sound[first] & away.sound[second] & (np.sum(chord**2, axis=1) > (LONG_CHORD_SPACINGS * h) ** 2)
    kept &= np.sum(chord * (away.unit[second] - away.unit[first]), axis=1) < 0
    first, second = first[kept], second[kept]
    y, z, n, m = band.feet.points[first], band.feet.points[second], away.unit[first], away.unit[second]
    rows = np.flatnonzero(same_sheet(y, n, z, m, h, True))  # both nodes are in the valley: normals have a sign
    rows = _one_per_cell(rows, 0.5 * (y[rows] + z[rows]) / h)
    y, z, n, m = y[rows], z[rows], n[rows], m[rows]
    distances = _distances_from_middles(surface, y, z)
    on_two_limbs = _surface_leaves_chord(distances, y, n, z, m, h)
    y, z, width = y[on_two_limbs], z[on_two_limbs], 2 * distances[on_two_limbs]
    return _Pairs(np.concatenate([y, z]), np.concatenate([z, y]), np.tile(width, 2))


def _distances_from_middles(surface: LocalSource, y: Floats, z: Floats) -> Floats:
    """Return how far the surface is from the middles of chords (n,)."""
    middle = 0.5 * (y + z)
    return np.asarray(np.linalg.norm(surface.closest_point(middle).points - middle, axis=1))


def _surface_leaves_chord(distances: Floats, y: Floats, n: Floats, z: Floats, m: Floats, spacing: float) -> Bools:
    """Tell which chords the surface leaves, farther than an arc with the normals n and m (n, d) at its ends would."""
    turn = 2 * np.arcsin(np.minimum(0.5 * np.linalg.norm(n - m, axis=1), 1.0))
    arc = 0.5 * np.linalg.norm(z - y, axis=1) * np.tan(0.25 * turn)
    return np.asarray(distances > FOLLOWED_ARC_FACTOR * arc + FOLLOWED_SLACK_SPACINGS * spacing)


def _one_per_cell(rows: Ints, places: Floats) -> Ints:
    """Return at most ``PAIR_SAMPLE`` of the rows, one in each unit cell that holds ``places`` (n, d) of them."""
    if not len(rows):
        return rows
    rows = rows[np.unique(np.floor(places).astype(np.int64), axis=0, return_index=True)[1]]
    return _evenly_chosen(rows, PAIR_SAMPLE)


def _evenly_chosen(rows: Ints, count: int) -> Ints:
    """Return ``count`` of the rows, or all if there are fewer."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, count).astype(np.int64))] if len(rows) else rows


def _stencils_across_valleys(surface: LocalSource, band: Band, pairs: _Pairs) -> Limbs:
    """Return the stencils near the pairs that read nodes with feet on the other limb, and by how much."""
    from scipy.spatial import cKDTree

    feet, h = band.feet.points, band.spacing
    distance, pair = cKDTree(pairs.here).query(feet, distance_upper_bound=BESIDE_PAIR_SPACINGS * h)
    beside = np.flatnonzero(np.isfinite(distance))
    rows = _evenly_chosen(beside, STENCIL_SAMPLE)
    cells, fractions = stencil_cells(feet[rows], h, band.degree)
    columns = Unknowns(band).select(Centres.of_nodes(band, rows), stencil_nodes(band, cells)).astype(np.int64)
    z, own_limb, other_limb = feet[columns], pairs.here[pair[rows]][:, None], pairs.there[pair[rows]][:, None]
    beyond = np.linalg.norm(z - other_limb, axis=-1) < np.linalg.norm(z - own_limb, axis=-1)
    weights = np.abs(tensor_weights(fractions, band.degree))
    suspects = np.flatnonzero(np.sum(weights * beyond, axis=1) > DISTURBED_WEIGHT)
    target = _evenly_chosen(suspects, ASKED_STENCILS)
    beyond = beyond[target] & _on_another_limb(surface, band, rows[target], columns[target], beyond[target])
    read = np.sum(weights[target] * beyond, axis=1)
    kept = read > DISTURBED_WEIGHT
    chosen, each = rows[target[kept]], len(beside) / len(rows) * len(suspects) / max(len(target), 1)
    return Limbs(feet[chosen], pairs.width[pair[chosen]], read[kept], each)


def _on_another_limb(surface: LocalSource, band: Band, rows: Ints, columns: Ints, beyond: Bools) -> Bools:
    """Return which nodes ``beyond`` the valley's middle the surface does not reach along the chord."""
    feet, away = band.feet.points, foot_directions(band).unit
    k, column = np.nonzero(beyond)
    y, z = rows[k], columns[k, column]
    leaves = np.zeros_like(beyond)
    distances = _distances_from_middles(surface, feet[y], feet[z])
    n, m = away[y], away[z]
    m = np.where(np.sum(n * m, axis=1, keepdims=True) < 0, -m, m)
    leaves[k, column] = _surface_leaves_chord(distances, feet[y], n, feet[z], m, band.spacing)
    return leaves
