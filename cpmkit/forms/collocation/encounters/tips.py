"""Where a curve's two sides are not told apart: around open ends, between flanks of a sharp tip, on short rings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.errors import place
from cpmkit.forms.collocation.boundary.on_band import BoundariesOnBand
from cpmkit.forms.collocation.encounters.boundaries import DIFFERENT_DATA_SHARE
from cpmkit.grid.lattice import Lattice
from cpmkit.protocols import Floats
from cpmkit.scene.conditions import same_condition
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.laws import Value

#: An end this many spacings from another boundary is closed by it.
CLOSED_END_SPACINGS = 0.5
#: Conormals at feet of one side face each other below this cosine: the angle is below 45
#: degrees, or the flanks run side by side.
FACING_FLANKS_COSINE = -0.7
#: Nodes within so many spacings of the boundary are looked at.
TIP_SEARCH_SPACINGS = 1.0
#: The conormals of a ring around a limb have a mean at least this long; those of a loop on a flat place cancel.
LEAST_MEAN_CONORMAL = 0.7
#: Rings of so many spacings tell their sides apart (around a finger of a hand: 0.53 of the jump leaks at 7.5, 0.002 at
#: 11 spacings).
LEAST_RING_SPACINGS = 10.0


@dataclass(frozen=True, eq=False)
class Blur:
    """A place where the two sides of a boundary mix.

    Attributes
    ----------
    kind : "tip", "flanks" or "ring"
        An open end with different values on its sides; flanks of one curve that face each other; a short closed curve
        around a limb.
    boundary : int
        Its number.
    point : (d,) float64
        In the scene's coordinates.
    size : float
        Of flanks their distance, of a ring its length; 0 of a tip.
    more : int
        How many more such places the boundary has.
    """

    kind: str
    boundary: int
    point: Floats
    size: float
    more: int = 0


def find_blurs(boundaries: BoundariesOnBand, lattice: Lattice, channels: int, time: float | None = None) -> list[Blur]:
    """Return where the sides of boundaries with unlike sides are not told apart."""
    found: list[Blur] = []
    for number, (boundary, one) in enumerate(zip(boundaries.given, boundaries.on_lattice, strict=True)):
        alike = same_condition(boundary.condition("left"), boundary.condition("right"))
        if one.has_sides and one.oriented.dimension > 1 and not alike:
            found += _tips(number, boundaries, lattice, channels, time)
            found += _flanks(number, boundaries, lattice)
            found += _ring(number, boundaries, lattice)
    return found


def _tips(number: int, boundaries: BoundariesOnBand, lattice: Lattice, channels: int, time: float | None) -> list[Blur]:
    view, boundary, h = boundaries.side_views[number], boundaries.given[number], lattice.spacing
    ends = view.foot[view.end]
    if not len(ends):
        return []
    ends = ends[np.unique(np.round(ends / h).astype(np.int64), axis=0, return_index=True)[1]]
    for other, one in enumerate(boundaries.on_lattice):
        if other != number:
            ends = ends[one.source.closest_point(ends).distance > CLOSED_END_SPACINGS * h]
    places = lattice.to_scene(ends)
    left, right = (boundary.condition(side).law for side in ("left", "right"))
    if len(places) and isinstance(left, Value) and isinstance(right, Value):
        values = [evaluate_data(condition.datum, places, channels, boundary.name, time) for condition in (left, right)]
        apart = np.abs(values[0] - values[1]).max(axis=1)
        places = places[apart > DIFFERENT_DATA_SHARE * np.abs(values).max()]
        if len(places):
            return [Blur("tip", number, places[0], 0.0, len(places) - 1)]
    return []


def _flanks(number: int, boundaries: BoundariesOnBand, lattice: Lattice) -> list[Blur]:
    """Find where a boundary faces itself: there the feet of neighbouring nodes jump from flank to flank.

    Looked for among feet of the boundary, at whatever place of the lattice it lies.
    """
    from scipy.spatial import cKDTree

    view, h = boundaries.side_views[number], lattice.spacing
    near = view.take((view.distance < TIP_SEARCH_SPACINGS * h) & ~view.end)
    if not len(near.rows):
        return []
    first, second = cKDTree(near.foot).query_pairs(2 * TIP_SEARCH_SPACINGS * h, output_type="ndarray").T
    facing = np.sum(near.conormal[first] * near.conormal[second], axis=1) < FACING_FLANKS_COSINE
    first, second = first[facing], second[facing]
    chord = near.foot[second] - near.foot[first]
    into = [np.sum(chord * near.conormal[first], axis=1), -np.sum(chord * near.conormal[second], axis=1)]
    width = np.linalg.norm(chord, axis=1)
    opposite = (np.sign(into[0]) == np.sign(into[1])) & (np.abs(into).min(axis=0) > 0.5 * width)
    if not opposite.any():
        return []
    first, second, width = first[opposite], second[opposite], width[opposite]
    widest = int(width.argmax())
    middle = 0.5 * (near.foot[first[widest]] + near.foot[second[widest]])
    return [Blur("flanks", number, lattice.to_scene(middle[None])[0], float(width[widest]))]


def _ring(number: int, boundaries: BoundariesOnBand, lattice: Lattice) -> list[Blur]:
    one, view = boundaries.on_lattice[number], boundaries.side_views[number]
    if one.source.manifold_dim != 1 or one.oriented.dimension != 2 or not len(view.rows) or view.end.any():
        return []
    samples = one.samples
    if (one.source.closest_point(samples).edge >= 0).any():
        return []
    centre = samples.mean(axis=0)
    length = 2 * np.pi * float(np.linalg.norm(samples - centre, axis=1).mean())
    around = np.linalg.norm(view.conormal.mean(axis=0)) >= LEAST_MEAN_CONORMAL
    if length >= LEAST_RING_SPACINGS * lattice.spacing or not around:
        return []
    return [Blur("ring", number, lattice.to_scene(centre[None])[0], length)]


def blur_sentence(blur: Blur, name: str, spacing: float) -> str:
    """Return what a reader of the solution should know of it."""
    where = f"near {place(blur.point)}"
    if blur.kind == "tip":
        more = f" and at {blur.more} more ends" if blur.more > 1 else " and at its other end" if blur.more else ""
        return (
            f"Boundary {name!r} ends {where}{more} with different values on its sides: within about a spacing, "
            f"{spacing:.2g}, of the end they run into each other; give both sides one value there, or a smaller "
            "spacing."
        )
    if blur.kind == "flanks":
        return (
            f"Boundary {name!r} comes back to itself {where}, its flanks {blur.size:.2g} apart, "
            f"{blur.size / spacing:.2g} spacings, or less: the values of the other side show between them; a spacing "
            f"of {min(blur.size / 3, spacing / 2):.2g} confines that to a shorter piece."
        )
    return (
        f"Boundary {name!r} is a closed curve of {blur.size / spacing:.2g} spacings around a limb {where}: its two "
        f"sides are not told apart; a spacing of {blur.size / LEAST_RING_SPACINGS:.2g} does."
    )
