"""Where two boundaries cross with different data, or run side by side nearer than the grid can see."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from cpmkit.forms.collocation.boundary.on_band import BoundariesOnBand
from cpmkit.forms.collocation.boundary.side_view import BoundaryOnLattice, SideView
from cpmkit.forms.collocation.ghosts.geometry import ALONGSIDE_COSINE, INSIDE_SIDE_SPACINGS
from cpmkit.grid.lattice import Lattice
from cpmkit.protocols import SIDES, Bools, BoundarySet, Floats
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.laws import Value

#: Around a crossing of four different values the solution is off within so many spacings (by the jump; outside twice
#: that it is of order 1 to 2).
DISTURBED_SPACINGS = 4.0
#: Pairs of boundaries within so many spacings are examined.
ENCOUNTER_SPACINGS = 4.0
#: Boundaries nearer than this many spacings enclose a strip in which no stencil finds room.
STRIP_SPACINGS = 1.0
#: Boundaries nearer than this many spacings, at so many places of curves, are at the same place.
SAME_PLACE_SPACINGS, SAME_PLACE_SAMPLES = 1e-3, 3
#: Data that differ by more than this share of their size are different.
DIFFERENT_DATA_SHARE = 1e-6


@dataclass(frozen=True, eq=False)
class SectorJump:
    """Two boundaries that cross with different data in the sectors around.

    Attributes
    ----------
    first, second : int
        Numbers of the boundaries.
    point : (d,) float64
        Where, in the scene's coordinates.
    jump : float
        The largest difference of the two boundaries' values in one sector.
    """

    first: int
    second: int
    point: Floats
    jump: float


@dataclass(frozen=True, eq=False)
class Strip:
    """Two boundaries that run side by side, nearer than a spacing.

    Attributes
    ----------
    first, second : int
        Numbers of the boundaries.
    point : (d,) float64
        Where they are nearest, in the scene's coordinates.
    width : float
        Their least distance.
    coincide : bool
        True where they are at the same place.
    reversed : bool
        True where the left of one is on the right of the other.
    """

    first: int
    second: int
    point: Floats
    width: float
    coincide: bool = False
    reversed: bool = False


def find_encounters(
    boundaries: BoundariesOnBand, lattice: Lattice, channels: int, time: float | None = None
) -> tuple[list[SectorJump], list[Strip]]:
    """Return the crossings with different data, and the strips, of all pairs of boundaries with sides."""
    crossings: list[SectorJump] = []
    strips: list[Strip] = []
    with_sides = [number for number, one in enumerate(boundaries.on_lattice) if one.has_sides]
    thinned = {number: _thinned(boundaries.side_views[number], lattice.spacing) for number in with_sides}
    for first, second in combinations(with_sides, 2):
        met = _feet_beside(boundaries.on_lattice[second], thinned[first], lattice.spacing)
        if met is None:
            continue
        feet, distance, signed, along = met
        aligned = np.abs(along) > ALONGSIDE_COSINE
        crossing = _crossing_point(feet, signed, aligned, lattice.spacing)
        if crossing is not None:
            point = lattice.to_scene(crossing[None])
            jump = _largest_jump(boundaries.given[first], boundaries.given[second], point, channels, time)
            if jump > 0:
                crossings.append(SectorJump(first, second, point[0], jump))
        beside = np.flatnonzero((distance < STRIP_SPACINGS * lattice.spacing) & aligned)
        if len(beside):
            nearest = beside[distance[beside].argmin()]
            point = lattice.to_scene(feet[nearest][None])[0]
            same = np.count_nonzero(aligned & (distance < SAME_PLACE_SPACINGS * lattice.spacing))
            coincide = bool(same >= min(SAME_PLACE_SAMPLES, len(distance)))
            strips.append(Strip(first, second, point, float(distance[nearest]), coincide, bool(along[nearest] < 0)))
    return crossings, strips


def _thinned(view: SideView, spacing: float) -> SideView:
    """Return one entry of a view for each cell of half a spacing that its feet lie in."""
    _, first = np.unique(np.floor(view.foot / (0.5 * spacing)).astype(np.int64), axis=0, return_index=True)
    return view.take(np.sort(first))


def _feet_beside(
    other: BoundaryOnLattice, side_view: SideView, spacing: float
) -> tuple[Floats, Floats, Floats, Floats] | None:
    """Return points of one boundary near another: feet (k, d), distance, signed distance, cosine of the conormals."""
    other_frame = other.side_view(side_view.foot, ENCOUNTER_SPACINGS * spacing, spacing)
    inside = ~other_frame.end & ~side_view.end[other_frame.rows]
    if not inside.any():
        return None
    rows = other_frame.rows[inside]
    along = np.sum(side_view.conormal[rows] * other_frame.conormal[inside], axis=1)
    return side_view.foot[rows], other_frame.distance[inside], other_frame.signed[inside], along


def _crossing_point(feet: Floats, signed: Floats, aligned: Bools, spacing: float) -> Floats | None:
    """Return where the points ``feet`` of a boundary go over to the other side of one; None where they do not.

    A point on both, where they are not ``aligned``, counts to both sides.
    """
    from scipy.spatial import cKDTree

    on = ~aligned & (np.abs(signed) <= INSIDE_SIDE_SPACINGS * spacing)
    left, right = (feet[on | (sign * signed > INSIDE_SIDE_SPACINGS * spacing)] for sign in (1, -1))
    if not len(left) or not len(right):
        return None
    apart, partner = (np.asarray(found) for found in cKDTree(left).query(right))
    nearest = int(apart.argmin())
    if apart[nearest] > spacing:
        return None
    return np.asarray(0.5 * (right[nearest] + left[partner[nearest]]))


def _largest_jump(first: BoundarySet, second: BoundarySet, point: Floats, channels: int, time: float | None) -> float:
    """Return the largest difference, in one of the four sectors, of the values that two boundaries hold there."""
    values: list[list[Floats]] = [[], []]
    for held, boundary in zip(values, (first, second), strict=True):
        for side in SIDES:
            law = boundary.condition(side).law
            if isinstance(law, Value):
                held.append(evaluate_data(law.datum, point, channels, f"boundary {boundary.name!r}", time))
    size = max((float(np.abs(value).max()) for held in values for value in held), default=0.0)
    worst = max((float(np.abs(a - b).max()) for a, b in product(*values)), default=0.0)
    return worst if worst > DIFFERENT_DATA_SHARE * size else 0.0
