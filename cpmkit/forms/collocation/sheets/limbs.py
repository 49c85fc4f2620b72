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
from cpmkit.forms.collocation.sheets.turning import directions
from cpmkit.grid.band import Band
from cpmkit.grid.stencils import stencil_cells, stencil_nodes, tensor_weights
from cpmkit.manifold.localized import Localized
from cpmkit.protocols import Bools, Floats, Ints

#: Feet of neighbouring nodes more spacings apart than this, on a surface that is hollow there, may be on two limbs.
LONG = 1.5
#: So many pairs of them are looked at, spread over the surface.
SAMPLE = 512
#: The surface does not follow a chord whose middle is off it by more than so many times what that of an arc with the
#: same turn is, and so many spacings.
FOLLOWED, SLACK = 1.5, 0.25
#: Of the stencils within so many spacings of a foot of such a pair, this many are looked at,
BESIDE, STENCILS = 1.5, 2000
#: and of those that read more than this share of nodes nearer to the other limb, so many are asked whether it is one.
DISTURBED, ASKED = 3e-3, 128


@dataclass(frozen=True, eq=False)
class Limbs:
    """Stencils that read another limb beside their own.

    Attributes
    ----------
    places : (n, d) float64
        Where they are centred, relative to the lattice's origin.
    width : (n,) float64
        Of the valley between the limbs there.
    read : (n,) float64
        The sum of the sizes of the weights with which they read the other limb, above ``DISTURBED``.
    each : float
        So many stencils of the band each of them stands for.
    """

    places: Floats
    width: Floats
    read: Floats
    each: float


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Feet (n, d) on both sides of valleys, each pair twice, and the width (n,) of the valleys."""

    here: Floats
    there: Floats
    width: Floats


def limbs_side_by_side(surface: Localized, band: Band) -> Limbs:
    """Return where stencils read another limb across a valley."""
    pairs = _pairs(surface, band)
    if not len(pairs.here):
        return Limbs(pairs.here, pairs.width, pairs.width, 0.0)
    return _readings(surface, band, pairs)


def _pairs(surface: Localized, band: Band) -> _Pairs:
    """Return pairs of feet of neighbouring nodes that lie on two limbs and count as one sheet."""
    h, away, (one, other) = band.spacing, directions(band), band.neighbours()
    chord = band.feet.points[other] - band.feet.points[one]
    kept = away.sound[one] & away.sound[other] & (np.sum(chord**2, axis=1) > (LONG * h) ** 2)
    kept &= np.sum(chord * (away.unit[other] - away.unit[one]), axis=1) < 0
    one, other = one[kept], other[kept]
    y, z, n, m = band.feet.points[one], band.feet.points[other], away.unit[one], away.unit[other]
    rows = np.flatnonzero(same_sheet(y, n, z, m, h, True))  # both nodes are in the valley: normals have a sign
    rows = _spread(rows, 0.5 * (y[rows] + z[rows]) / h)
    y, z, n, m = y[rows], z[rows], n[rows], m[rows]
    off = _off(surface, y, z)
    apart = _left(off, y, n, z, m, h)
    y, z, width = y[apart], z[apart], 2 * off[apart]
    return _Pairs(np.concatenate([y, z]), np.concatenate([z, y]), np.tile(width, 2))


def _off(surface: Localized, y: Floats, z: Floats) -> Floats:
    """Return how far the surface is from the middles of chords (n,)."""
    middle = 0.5 * (y + z)
    return np.asarray(np.linalg.norm(surface.closest_point(middle).points - middle, axis=1))


def _left(off: Floats, y: Floats, n: Floats, z: Floats, m: Floats, spacing: float) -> Bools:
    """Tell which chords the surface leaves, farther than an arc with the normals n and m (n, d) at its ends would."""
    turn = 2 * np.arcsin(np.minimum(0.5 * np.linalg.norm(n - m, axis=1), 1.0))
    arc = 0.5 * np.linalg.norm(z - y, axis=1) * np.tan(0.25 * turn)
    return np.asarray(off > FOLLOWED * arc + SLACK * spacing)


def _spread(rows: Ints, places: Floats) -> Ints:
    """Return at most ``SAMPLE`` of the rows, one in each unit cell that holds ``places`` (n, d) of them."""
    if not len(rows):
        return rows
    rows = rows[np.unique(np.floor(places).astype(np.int64), axis=0, return_index=True)[1]]
    return _some(rows, SAMPLE)


def _some(rows: Ints, count: int) -> Ints:
    """Return ``count`` of the rows, or all if there are fewer."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, count).astype(np.int64))] if len(rows) else rows


def _readings(surface: Localized, band: Band, pairs: _Pairs) -> Limbs:
    """Return what stencils beside the pairs read of nodes that have their feet on the other limb."""
    from scipy.spatial import cKDTree

    feet, h = band.feet.points, band.spacing
    distance, pair = cKDTree(pairs.here).query(feet, distance_upper_bound=BESIDE * h)
    beside = np.flatnonzero(np.isfinite(distance))
    rows = _some(beside, STENCILS)
    cells, fractions = stencil_cells(feet[rows], h, band.degree)
    columns = Unknowns(band).select(Centres.of_nodes(band, rows), stencil_nodes(band, cells)).astype(np.int64)
    z, own, other = feet[columns], pairs.here[pair[rows]][:, None], pairs.there[pair[rows]][:, None]
    beyond = np.linalg.norm(z - other, axis=-1) < np.linalg.norm(z - own, axis=-1)
    weights = np.abs(tensor_weights(fractions, band.degree))
    suspects = np.flatnonzero(np.sum(weights * beyond, axis=1) > DISTURBED)
    asked = _some(suspects, ASKED)
    beyond = beyond[asked] & _on_another_limb(surface, band, rows[asked], columns[asked], beyond[asked])
    read = np.sum(weights[asked] * beyond, axis=1)
    kept = read > DISTURBED
    where, each = rows[asked[kept]], len(beside) / len(rows) * len(suspects) / max(len(asked), 1)
    return Limbs(feet[where], pairs.width[pair[where]], read[kept], each)


def _on_another_limb(surface: Localized, band: Band, rows: Ints, columns: Ints, beyond: Bools) -> Bools:
    """Tell which of the nodes ``beyond`` the middle that stencils read the surface does not lead to."""
    feet, away = band.feet.points, directions(band).unit
    k, column = np.nonzero(beyond)
    y, z = rows[k], columns[k, column]
    left = np.zeros_like(beyond)
    off = _off(surface, feet[y], feet[z])
    n, m = away[y], away[z]
    m = np.where(np.sum(n * m, axis=1, keepdims=True) < 0, -m, m)
    left[k, column] = _left(off, feet[y], n, feet[z], m, band.spacing)
    return left
