"""Where a surface turns more sharply than its band is wide: at creases, and in bends of a finite radius.

The direction from a foot to its node is the normal there. Neighbouring nodes thus tell, without a query, by how much
the surface turns from foot to foot; only at a sample of the places where that is a lot is it asked again, nearer and
nearer, whether the turn happens at one place or over a distance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.forms.collocation.sheets.sheets import has_signed_normals
from cpmkit.grid.band import Band
from cpmkit.manifold.localized import Localized
from cpmkit.manifold.tangent_space import jacobian, normals
from cpmkit.protocols import Bools, ClosestPoints, Floats, Ints

#: A node nearer to its foot than this many spacings does not tell the normal.
TOUCHING = 0.1
#: Neighbours whose normals turn by a larger angle than this (cosine) see different flanks.
FLANKS = 0.2
#: Feet of neighbours farther apart than this many spacings say nothing of the curvature between them.
APART = 2.0
#: A turn (radians) below this is lost in the facets of a mesh and the noise of a cloud.
SMALL_TURN = np.deg2rad(5.0)
#: A turn (radians) above this that remains however near one looks is a crease.
CREASE = np.deg2rad(10.0)
#: So often the stretch in which the surface turns is halved; on one sheet that leaves less than ``NEAREST`` spacings.
HALVINGS, NEAREST = 8, 0.1
#: Step, in spacings, of the differences that give a normal while looking closely.
STEP = 1e-4


def reach_of(dim: int, degree: int) -> float:
    """Return how far from its foot, in spacings, a node of the band may lie: a stencil's node, or one beside it."""
    half = 0.5 * (degree + 1)
    return float(np.sqrt((dim - 1) * half**2 + (1 + half) ** 2))


@dataclass(frozen=True, eq=False)
class Directions:
    """The way from feet to nodes.

    Attributes
    ----------
    unit : (n, d) float64
        Directions; zero where the node lies on its foot.
    length : (n,) float64
        In units of length.
    sound : (n,) bool
        True where the direction is the normal of the surface: not at an edge, nor where the foot is doubtful.
    """

    unit: Floats
    length: Floats
    sound: Bools


def directions(band: Band) -> Directions:
    """Return the directions from the feet of all sites of the band to their nodes."""
    away = band.positions - band.feet.points
    length = np.linalg.norm(away, axis=1)
    sound = (length > TOUCHING * band.spacing) & (band.feet.edge < 0)
    if band.feet.doubtful is not None:
        sound &= ~band.feet.doubtful
    return Directions(away / np.where(length > 0, length, 1.0)[:, None], length, sound)


@dataclass(frozen=True, eq=False)
class Turns:
    """Places where the surface turns.

    Attributes
    ----------
    places : (n, d) float64
        Between the feet of two neighbouring nodes, relative to the lattice's origin.
    before, after : (n, d) float64
        The normals at those feet.
    curvature : (n,) float64
        The turn between them over their distance; infinite at a crease.
    """

    places: Floats
    before: Floats
    after: Floats
    curvature: Floats

    def take(self, rows: Ints | Bools) -> Turns:
        """Return some of the places."""
        return Turns(self.places[rows], self.before[rows], self.after[rows], self.curvature[rows])


def sharp_turns(band: Band, sharper: float) -> Turns:
    """Return where the curvature of the surface is above ``sharper``, as neighbouring nodes of the band see it."""
    away = directions(band)
    one, other = band.neighbours()
    sound = away.sound[one] & away.sound[other]
    one, other = one[sound], other[sound]
    before, after = away.unit[one], away.unit[other]
    chord = np.linalg.norm(band.feet.points[one] - band.feet.points[other], axis=1)
    turn = np.linalg.norm(after - before, axis=1)
    seen = (np.sum(before * after, axis=1) > FLANKS) & (chord < APART * band.spacing)
    seen &= (turn > SMALL_TURN) & (turn > sharper * chord)
    places = 0.5 * (band.feet.points[one[seen]] + band.feet.points[other[seen]])
    with np.errstate(divide="ignore"):
        curvature = turn[seen] / chord[seen]
    return Turns(places, before[seen], after[seen], curvature)


def widest(turns: Turns, side: float) -> Turns:
    """Return one turn for each cell of a grid of this side: between the two normals in it that differ most.

    Around a crease nodes see it from the one flank, the other, or between; only the outermost normals span it.
    """
    order = np.argsort(-turns.curvature, kind="stable")
    cells = np.floor(turns.places[order] / side).astype(np.int64)
    _, first, cell = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    sharpest, cell = turns.take(order[first]), cell.ravel()
    seen, cell = np.concatenate([turns.before[order], turns.after[order]]), np.tile(cell, 2)
    middle = (sharpest.before + sharpest.after)[cell]
    one_side = np.sum(seen * middle, axis=1) > 0  # nodes below the surface see the normal reversed
    seen, cell, middle = seen[one_side], cell[one_side], middle[one_side]
    before = seen[_largest(-np.sum(seen * middle, axis=1), cell)]
    after = seen[_largest(-np.sum(seen * before[cell], axis=1), cell)]
    return Turns(sharpest.places, before, after, sharpest.curvature)


def _largest(score: Floats, group: Ints) -> Ints:
    """Return where ``score`` (n,) is largest in each group, groups ascending."""
    order = np.lexsort((score, group))
    return np.asarray(order[np.searchsorted(group[order], np.arange(group.max() + 1), side="right") - 1])


@dataclass(frozen=True, eq=False)
class Closely:
    """What looking closely at turns found.

    Attributes
    ----------
    angle : (n,) float64
        By how much, in radians, the surface turns within the shortest stretch looked at.
    stretch : (n,) float64
        Its length, in spacings.
    curvature : (n,) float64
        Of the stretch, or, where it is broken by creases, of one about a spacing long.
    along : (n, d) float64
        The direction of the crease, where it is one.
    """

    angle: Floats
    stretch: Floats
    curvature: Floats
    along: Floats

    @property
    def one_sheet(self) -> Bools:
        """(n,) True where the stretch could be halved; between two sheets it cannot."""
        return np.asarray(self.stretch < NEAREST)

    @property
    def creased(self) -> Bools:
        """(n,) True where the turn happens at one place."""
        return np.asarray((self.angle > CREASE) & self.one_sheet)


def look_closely(surface: Localized, turns: Turns, spacing: float) -> Closely:
    """Halve, around each place, the stretch of the surface in which it turns most, and tell what turn is left."""
    away = turns.after - turns.before
    step = 0.5 * spacing * away / np.linalg.norm(away, axis=1, keepdims=True)
    ends = [surface.closest_point(turns.places + sign * step) for sign in (-1, 1)]
    a, b = (end.points for end in ends)
    na, nb = (_normals(surface, end, spacing) for end in ends)
    sign = _sign(na, turns.before)
    signed = not surface.source.exact and has_signed_normals(surface)
    na, nb = sign * na, (sign if signed else _sign(nb, turns.after)) * nb
    whole = _angle(na, nb) / np.linalg.norm(a - b, axis=1)
    for _ in range(HALVINGS):
        middle = surface.closest_point(0.5 * (a + b))
        m, nm = middle.points, _normals(surface, middle, spacing)
        nearer = np.where(np.abs(_along(nm, na)) > np.abs(_along(nm, nb)), na, nb)
        nm = nm * (sign if signed else _sign(nm, nearer))
        first = _along(nm, na) < _along(nm, nb)
        a, na = np.where(first, a, m), np.where(first, na, nm)
        b, nb = np.where(first, m, b), np.where(first, nm, nb)
    angle, stretch = _angle(na, nb), np.linalg.norm(a - b, axis=1)
    curvature = np.where(angle < SMALL_TURN, angle / np.maximum(stretch, STEP * spacing), whole)
    along = np.cross(na, nb) if surface.dim == 3 else np.zeros_like(na)
    length = np.linalg.norm(along, axis=1, keepdims=True)
    return Closely(angle, stretch / spacing, curvature, along / np.where(length > 0, length, 1.0))


def _normals(surface: Localized, feet: ClosestPoints, spacing: float) -> Floats:
    """Return the normals that the closest points obey: by differences where these are exact, else the source's own.

    The normals of a mesh whose nearest points are asked for are those of a smooth surface that it samples.
    """
    if surface.source.exact:
        return np.asarray(np.linalg.eigh(jacobian(surface, feet.points, STEP * spacing))[1][:, :, 0])
    return normals(surface, feet, STEP * spacing)


def _along(one: Floats, other: Floats) -> Floats:
    """Return the scalar products (n, 1)."""
    return np.asarray(np.sum(one * other, axis=1, keepdims=True))


def _sign(vectors: Floats, like: Floats) -> Floats:
    """Return the signs (n, 1) that make vectors most like others."""
    return np.where(_along(vectors, like) < 0, -1.0, 1.0)


def _angle(one: Floats, other: Floats) -> Floats:
    """Return the angles (n,) between unit vectors."""
    return np.asarray(2 * np.arcsin(np.minimum(0.5 * np.linalg.norm(one - other, axis=1), 1.0)))
