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
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.tangent_space import jacobian, normals
from cpmkit.protocols import Bools, ClosestPoints, Floats, Ints, Rows

#: A node nearer to its foot than this many spacings does not tell the normal.
ON_FOOT_SPACINGS = 0.1
#: Neighbours whose normals have a smaller cosine than this see different flanks.
SAME_FLANK_COSINE = 0.2
#: Feet of neighbours farther apart than so many spacings do not determine the curvature between them.
MOST_CHORD_SPACINGS = 2.0
#: Smaller turns (radians) cannot be told from the facets of a mesh or the noise of a cloud.
SMALL_TURN_RADIANS = np.deg2rad(5.0)
#: A larger turn (radians) that remains under bisection is a crease.
CREASE_TURN_RADIANS = np.deg2rad(10.0)
#: So often the stretch in which the surface turns is halved; on one sheet that leaves less than
#: ``HALVED_STRETCH_SPACINGS`` spacings.
TURN_HALVINGS, HALVED_STRETCH_SPACINGS = 8, 0.1
#: Step (spacings) of the differences that give normals during bisection.
TURN_NORMAL_STEP_SPACINGS = 1e-4


def foot_reach_spacings(dim: int, degree: int) -> float:
    """Return how far from its foot, in spacings, a node of the band may lie: a stencil's node, or one beside it."""
    half = 0.5 * (degree + 1)
    return float(np.sqrt((dim - 1) * half**2 + (1 + half) ** 2))


@dataclass(frozen=True, eq=False)
class FootDirections:
    """Directions and distances from feet to their nodes.

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


def foot_directions(band: Band) -> FootDirections:
    """Return the directions from the feet of all sites of the band to their nodes."""
    away = band.positions - band.feet.points
    length = np.linalg.norm(away, axis=1)
    sound = (length > ON_FOOT_SPACINGS * band.spacing) & (band.feet.edge < 0)
    if band.feet.doubtful is not None:
        sound &= ~band.feet.doubtful
    return FootDirections(away / np.where(length > 0, length, 1.0)[:, None], length, sound)


@dataclass(frozen=True, eq=False)
class Turns(Rows):
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


def sharp_turns(band: Band, sharper: float) -> Turns:
    """Return where the curvature of the surface is above ``sharper``, as neighbouring nodes of the band see it."""
    away = foot_directions(band)
    first, second = band.neighbours()
    sound = away.sound[first] & away.sound[second]
    first, second = first[sound], second[sound]
    before, after = away.unit[first], away.unit[second]
    chord = np.linalg.norm(band.feet.points[first] - band.feet.points[second], axis=1)
    turn = np.linalg.norm(after - before, axis=1)
    sharp = (np.sum(before * after, axis=1) > SAME_FLANK_COSINE) & (chord < MOST_CHORD_SPACINGS * band.spacing)
    sharp &= (turn > SMALL_TURN_RADIANS) & (turn > sharper * chord)
    places = 0.5 * (band.feet.points[first[sharp]] + band.feet.points[second[sharp]])
    with np.errstate(divide="ignore"):
        curvature = turn[sharp] / chord[sharp]
    return Turns(places, before[sharp], after[sharp], curvature)


def strongest_per_cell(turns: Turns, side: float) -> Turns:
    """Return one turn for each cell of a grid of this side: between the two normals in it that differ most.

    Around a crease nodes see it from the one flank, the other, or between; only the outermost normals span it.
    """
    order = np.argsort(-turns.curvature, kind="stable")
    cells = np.floor(turns.places[order] / side).astype(np.int64)
    _, first, cell = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    sharpest, cell = turns.take(order[first]), cell.ravel()
    outermost, cell = np.concatenate([turns.before[order], turns.after[order]]), np.tile(cell, 2)
    middle = (sharpest.before + sharpest.after)[cell]
    one_side = np.sum(outermost * middle, axis=1) > 0  # nodes below the surface see the normal reversed
    outermost, cell, middle = outermost[one_side], cell[one_side], middle[one_side]
    before = outermost[_largest(-np.sum(outermost * middle, axis=1), cell)]
    after = outermost[_largest(-np.sum(outermost * before[cell], axis=1), cell)]
    return Turns(sharpest.places, before, after, sharpest.curvature)


def _largest(score: Floats, group: Ints) -> Ints:
    """Return where ``score`` (n,) is largest in each group, groups ascending."""
    order = np.lexsort((score, group))
    return np.asarray(order[np.searchsorted(group[order], np.arange(group.max() + 1), side="right") - 1])


@dataclass(frozen=True, eq=False)
class TurnProfile:
    """Turns after bisection.

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
        return np.asarray(self.stretch < HALVED_STRETCH_SPACINGS)

    @property
    def creased(self) -> Bools:
        """(n,) True where the turn happens at one place."""
        return np.asarray((self.angle > CREASE_TURN_RADIANS) & self.one_sheet)


def bisect_turns(surface: LocalSource, turns: Turns, spacing: float) -> TurnProfile:
    """Bisect, around each place, the stretch in which the surface turns most, and return the turn that remains."""
    away = turns.after - turns.before
    step = 0.5 * spacing * away / np.linalg.norm(away, axis=1, keepdims=True)
    ends = [surface.closest_point(turns.places + sign * step) for sign in (-1, 1)]
    a, b = (end.points for end in ends)
    na, nb = (_normals(surface, end, spacing) for end in ends)
    sign = _signs_like(na, turns.before)
    signed = not surface.source.exact and has_signed_normals(surface)
    na, nb = sign * na, (sign if signed else _signs_like(nb, turns.after)) * nb
    whole = _angles_between(na, nb) / np.linalg.norm(a - b, axis=1)
    for _ in range(TURN_HALVINGS):
        middle = surface.closest_point(0.5 * (a + b))
        m, nm = middle.points, _normals(surface, middle, spacing)
        nearer = np.where(np.abs(_scalar_products(nm, na)) > np.abs(_scalar_products(nm, nb)), na, nb)
        nm = nm * (sign if signed else _signs_like(nm, nearer))
        first = _scalar_products(nm, na) < _scalar_products(nm, nb)
        a, na = np.where(first, a, m), np.where(first, na, nm)
        b, nb = np.where(first, m, b), np.where(first, nm, nb)
    angle, stretch = _angles_between(na, nb), np.linalg.norm(a - b, axis=1)
    curvature = np.where(
        angle < SMALL_TURN_RADIANS, angle / np.maximum(stretch, TURN_NORMAL_STEP_SPACINGS * spacing), whole
    )
    along = np.cross(na, nb) if surface.dim == 3 else np.zeros_like(na)
    length = np.linalg.norm(along, axis=1, keepdims=True)
    return TurnProfile(angle, stretch / spacing, curvature, along / np.where(length > 0, length, 1.0))


def _normals(surface: LocalSource, feet: ClosestPoints, spacing: float) -> Floats:
    """Return the normals that the closest points obey: by differences where these are exact, else the source's own.

    The normals of a mesh whose nearest points are asked for are those of a smooth surface that it samples.
    """
    if surface.source.exact:
        return np.asarray(
            np.linalg.eigh(jacobian(surface, feet.points, TURN_NORMAL_STEP_SPACINGS * spacing))[1][:, :, 0]
        )
    return normals(surface, feet, TURN_NORMAL_STEP_SPACINGS * spacing)


def _scalar_products(first: Floats, second: Floats) -> Floats:
    """Return the scalar products (n, 1)."""
    return np.asarray(np.sum(first * second, axis=1, keepdims=True))


def _signs_like(vectors: Floats, like: Floats) -> Floats:
    """Return the signs (n, 1) that make vectors most like others."""
    return np.where(_scalar_products(vectors, like) < 0, -1.0, 1.0)


def _angles_between(first: Floats, second: Floats) -> Floats:
    """Return the angles (n,) between unit vectors."""
    return np.asarray(2 * np.arcsin(np.minimum(0.5 * np.linalg.norm(first - second, axis=1), 1.0)))
