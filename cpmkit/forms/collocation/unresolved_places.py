"""Places that the spacing does not resolve, and those at boundaries: pairs that cross or run side by side, mixed sides.

The sides of a curve mix around open ends and between the flanks of a sharp tip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np

from cpmkit.errors import place
from cpmkit.forms.collocation.ghosts.ghost_geometry import ALONGSIDE_COSINE, INSIDE_SIDE_SPACINGS
from cpmkit.forms.collocation.side_view import BoundariesOnBand
from cpmkit.grid.lattice import Lattice
from cpmkit.scene.boundary import Boundary
from cpmkit.scene.conditions import same_condition
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.laws import Value
from cpmkit.types import SIDES, Bools, Floats

#: Boundaries nearer than this many spacings enclose a strip too narrow for a stencil; one closes another's open end.
STRIP_SPACINGS = 1.0
#: Boundaries meet where they are within this many spacings, and around a crossing of four different values the solution
#: is off within as many (by the jump; outside twice that it is of order 1 to 2).
DISTURBED_SPACINGS = 4.0
#: Largest share of the difference of the values on both sides of a gap that leaks across two spacings; half of it
#: for each further one (a slit in a sphere: 0.45 at 2, 0.11 at 4, 0.055 at 5 spacings; in the plane a tenth of that).
LEAK_AT_TWO_SPACINGS = 0.45
#: In a gap of at most this many spacings there are hardly any nodes past either rim.
BRIDGED_GAP_SPACINGS = 1.5
#: Hardly any value leaks across a gap of this many spacings: a spacing of the gap over this number resolves it. Rims
#: that face each other along as many spacings form a slit, not the tip of a notch or a small hole.
WIDE_GAP_SPACINGS = 6.0
#: Boundaries nearer to each other or a rim than this many spacings, for curves at so many points, are at one place.
SAME_PLACE_SPACINGS, SAME_PLACE_SAMPLES = 1e-3, 3
#: Data that differ by more than this share of their size are different.
DIFFERENT_DATA_SHARE = 1e-6
#: Conormals at feet of one side face each other below this cosine: the angle is below 45 degrees, or the flanks run
#: side by side. Nodes within this many spacings of the boundary are examined.
FACING_FLANKS_COSINE, FLANK_SEARCH_SPACINGS = -0.7, 1.0


@dataclass(frozen=True, eq=False)
class UnresolvedPlace:
    """A place that the spacing does not resolve."""

    #: "crossing": two boundaries with different values in the sectors around. "strip", "same place": two boundaries
    #: less than a spacing apart, or at one place. "tip", "flanks": an open end with different values on its sides, or
    #: two flanks of one curve that face each other. "gap", "opening": rims that face each other; stencils bridge a gap,
    #: an opening is wider, or a notch or small hole. "rim strip", "on rim": a boundary near a rim or along it.
    kind: str
    boundaries: tuple[int, ...]  #: Numbers of the boundaries.
    point: Floats  #: (d,): the place, in the scene's coordinates.
    #: Width of a strip or gap, distance of flanks; for a crossing the largest difference of the boundaries' values.
    size: float
    more: int = 0  #: Number of further tips of the boundary, or of further pairs that cross.
    reversed: bool = False  #: Whether the left of the first boundary is the right of the second.
    loop: int = -1  #: Number of the rim's loop.

    def warning(self, names: Sequence[str], spacing: float) -> str:
        """Return the warning for a solve at ``spacing``, empty if there is none; ``names`` are those of boundaries."""
        where, width = f"near {place(self.point)}", self.size / spacing
        named = " and ".join(repr(names[number]) for number in self.boundaries)
        if self.kind == "crossing":
            more = f" and {self.more} more pairs" if self.more else ""
            return (
                f"Boundaries {named}{more} cross with different values in the sectors around, {where}: within "
                f"{DISTURBED_SPACINGS * spacing:.2g} of it the solution is off by up to their difference, "
                f"{self.size:.3g}; beyond twice that it is not disturbed."
            )
        if self.kind == "same place":
            return f"Boundaries {named} lie at the same place, {where}, and hold the same; one of them is enough."
        if self.kind == "tip":
            more = f" and at {self.more} more ends" if self.more > 1 else " and at its other end" if self.more else ""
            return (
                f"Boundary {named} ends {where}{more} with different values on its sides: within about a spacing, "
                f"{spacing:.2g}, of the end they run into each other; give both sides one value there, or a smaller "
                "spacing."
            )
        if self.kind == "flanks":
            return (
                f"Boundary {named} comes back to itself {where}, its flanks {self.size:.2g} apart, {width:.2g} "
                "spacings, or less: the values of the other side show between them; a spacing of "
                f"{min(self.size / 3, spacing / 2):.2g} confines that to a shorter piece."
            )
        if self.kind in ("gap", "opening") and width <= WIDE_GAP_SPACINGS:
            leak = LEAK_AT_TWO_SPACINGS * 2.0 ** (2.0 - width)
            harm = f"up to {leak:.0%} of the difference between its sides leaks across"
            return (
                f"N{where[1:]} the manifold faces itself across a gap of {self.size:.3g}, {width:.2g} spacings: "
                f"{harm if width > BRIDGED_GAP_SPACINGS else 'there the gap is as good as closed'}, whatever holds on "
                f"the rims; a spacing of {self.size / WIDE_GAP_SPACINGS:.2g} or less avoids that."
            )
        if self.kind not in ("strip", "rim strip") or width >= STRIP_SPACINGS:
            return ""
        runs = f"Boundary {named} runs {self.size:.2g} from a rim, {width:.2g} spacings, {where}"
        if self.kind == "strip":
            runs = f"Boundaries {named} run side by side, {width:.2g} spacings apart {where}"
        return (
            f"{runs}: the strip between them shows a mixture of their values; a spacing of {self.size / 3:.2g} would "
            "resolve it."
        )


def find_meetings(
    boundaries: BoundariesOnBand, lattice: Lattice, channels: int, time: float | None = None
) -> list[UnresolvedPlace]:
    """Return the first crossing with different values, and all strips and common places, of pairs of boundaries.

    Data of ``channels`` channels are compared at ``time``, None for problems without time. The crossing has the number
    of further pairs that cross. Boundaries without sides are left out.
    """
    crossings: list[UnresolvedPlace] = []
    strips: list[UnresolvedPlace] = []
    with_sides = [number for number, boundary in enumerate(boundaries.on_lattice) if boundary.has_sides]
    thinned = {}
    for number in with_sides:  # one entry for each cell of half a spacing
        view = boundaries.side_views[number]
        cells = np.floor(view.foot / (0.5 * lattice.spacing)).astype(np.int64)
        thinned[number] = view.take(np.sort(np.unique(cells, axis=0, return_index=True)[1]))
    for first, second in combinations(with_sides, 2):
        view, other = thinned[first], boundaries.on_lattice[second]
        seen = other.side_view(view.foot, DISTURBED_SPACINGS * lattice.spacing, lattice.spacing)
        seen = seen.take(~seen.end & ~view.end[seen.rows])
        if not len(seen.rows):
            continue
        feet, distance, signed = view.foot[seen.rows], seen.distance, seen.signed
        along = np.sum(view.conormal[seen.rows] * seen.conormal, axis=1)
        aligned = np.abs(along) > ALONGSIDE_COSINE
        crossing = _crossing_point(feet, signed, aligned, lattice.spacing)
        if crossing is not None:
            point = lattice.to_scene(crossing[None])
            jump = _largest_jump(boundaries.definitions[first], boundaries.definitions[second], point, channels, time)
            if jump > 0:
                crossings.append(UnresolvedPlace("crossing", (first, second), point[0], jump))
        aligned_rows = np.flatnonzero((distance < STRIP_SPACINGS * lattice.spacing) & aligned)
        if len(aligned_rows):
            nearest = aligned_rows[distance[aligned_rows].argmin()]
            point = lattice.to_scene(feet[nearest][None])[0]
            same = np.count_nonzero(aligned & (distance < SAME_PLACE_SPACINGS * lattice.spacing))
            kind = "same place" if same >= min(SAME_PLACE_SAMPLES, len(distance)) else "strip"
            width, reverse = float(distance[nearest]), bool(along[nearest] < 0)
            strips.append(UnresolvedPlace(kind, (first, second), point, width, reversed=reverse))
    return [replace(crossing, more=len(crossings) - 1) for crossing in crossings[:1]] + strips


def _crossing_point(feet: Floats, signed: Floats, aligned: Bools, spacing: float) -> Floats | None:
    """Return the point (d,), relative to the lattice's origin, where a boundary crosses another; None if it does not.

    ``feet`` (n, d) are points of the first, ``signed`` (n,) their signed distances from the second. A point on both
    boundaries counts to both sides, unless they are ``aligned`` (n,) there.
    """
    from scipy.spatial import cKDTree

    on_both = ~aligned & (np.abs(signed) <= INSIDE_SIDE_SPACINGS * spacing)
    left, right = (feet[on_both | (sign * signed > INSIDE_SIDE_SPACINGS * spacing)] for sign in (1, -1))
    if not len(left) or not len(right):
        return None
    apart, partner = cKDTree(left).query(right)
    nearest = int(np.argmin(apart))
    if apart[nearest] > spacing:
        return None
    return np.asarray(0.5 * (right[nearest] + left[partner[nearest]]))


def _largest_jump(first: Boundary, second: Boundary, point: Floats, channels: int, time: float | None) -> float:
    """Return the largest difference of two boundaries' prescribed values at ``point`` (1, d), over the four sectors.

    Zero if they do not differ beyond rounding, or if either prescribes none.
    """
    values: list[list[Floats]] = [[], []]
    for of_boundary, boundary in zip(values, (first, second), strict=True):
        for side in SIDES:
            law = boundary.condition(side).law
            if isinstance(law, Value):
                of_boundary.append(evaluate_data(law.datum, point, channels, f"boundary {boundary.name!r}", time))
    size = max((float(np.abs(value).max()) for of_boundary in values for value in of_boundary), default=0.0)
    worst = max((float(np.abs(a - b).max()) for a, b in product(*values)), default=0.0)
    return worst if worst > DIFFERENT_DATA_SHARE * size else 0.0


def find_mixed_sides(
    boundaries: BoundariesOnBand, lattice: Lattice, channels: int, time: float | None = None
) -> list[UnresolvedPlace]:
    """Return the tips and flanks of boundaries (not points) whose sides have different conditions, at ``time``."""
    places: list[UnresolvedPlace] = []
    for number, (boundary, on_lattice) in enumerate(zip(boundaries.definitions, boundaries.on_lattice, strict=True)):
        alike = same_condition(boundary.condition("left"), boundary.condition("right"))
        if on_lattice.has_sides and on_lattice.oriented.dimension > 1 and not alike:
            places += _find_tips(number, boundaries, lattice, channels, time)
            places += _find_flanks(number, boundaries, lattice)
    return places


def _find_tips(
    number: int, boundaries: BoundariesOnBand, lattice: Lattice, channels: int, time: float | None
) -> list[UnresolvedPlace]:
    """Return one record, or none, of the boundary's open ends at which it prescribes different values on its two sides.

    ``number`` is the boundary's. Ends at another boundary are left out; conditions other than values give no record.
    It has the place of one end and the number of further ones.
    """
    view, boundary, h = boundaries.side_views[number], boundaries.definitions[number], lattice.spacing
    ends = view.foot[view.end]
    if not len(ends):
        return []
    ends = ends[np.unique(np.round(ends / h).astype(np.int64), axis=0, return_index=True)[1]]
    for index, other in enumerate(boundaries.on_lattice):
        if index != number:
            ends = ends[other.source.closest_point(ends).distance > STRIP_SPACINGS * h]
    places = lattice.to_scene(ends)
    left, right = (boundary.condition(side).law for side in SIDES)
    if len(places) and isinstance(left, Value) and isinstance(right, Value):
        values = [evaluate_data(law.datum, places, channels, boundary.name, time) for law in (left, right)]
        jump = np.abs(values[0] - values[1]).max(axis=1)
        places = places[jump > DIFFERENT_DATA_SHARE * np.abs(values).max()]
        if len(places):
            return [UnresolvedPlace("tip", (number,), places[0], 0.0, len(places) - 1)]
    return []


def _find_flanks(number: int, boundaries: BoundariesOnBand, lattice: Lattice) -> list[UnresolvedPlace]:
    """Return a list with the widest place where a boundary faces itself and feet of near nodes jump across, or [].

    ``number`` is the boundary's. The search is among its points nearest to nodes, for any position of the lattice.
    """
    from scipy.spatial import cKDTree

    view, h = boundaries.side_views[number], lattice.spacing
    close = view.take((view.distance < FLANK_SEARCH_SPACINGS * h) & ~view.end)
    if not len(close.rows):
        return []
    first, second = cKDTree(close.foot).query_pairs(2 * FLANK_SEARCH_SPACINGS * h, output_type="ndarray").T
    facing = np.sum(close.conormal[first] * close.conormal[second], axis=1) < FACING_FLANKS_COSINE
    first, second = first[facing], second[facing]
    chord = close.foot[second] - close.foot[first]
    into = [np.sum(chord * close.conormal[first], axis=1), -np.sum(chord * close.conormal[second], axis=1)]
    width = np.linalg.norm(chord, axis=1)
    opposite = (np.sign(into[0]) == np.sign(into[1])) & (np.abs(into).min(axis=0) > 0.5 * width)
    if not opposite.any():
        return []
    first, second, width = first[opposite], second[opposite], width[opposite]
    widest = int(width.argmax())
    middle = 0.5 * (close.foot[first[widest]] + close.foot[second[widest]])
    return [UnresolvedPlace("flanks", (number,), lattice.to_scene(middle[None])[0], float(width[widest]))]
