"""Detection of jumps of data along a line that is no boundary: no cell is cut there, and errors stop falling.

Values a spacing apart do not distinguish a jump from a steep slope. As data are functions, the distance of two
neighbours with different values is halved along the manifold: their difference falls at a slope, but not at a jump.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpmkit.manifold.abilities import members_of
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.scene.scene import Scene
from cpmkit.types import Bools, Floats, Ints

#: Data are compared at so many points, spread over those of the form, each with so many nearest ones.
COMPARED_POINTS, NEIGHBOURS = 3_000, 6
#: Data jump if their difference stays above this share of their root mean square while the distance is halved so often.
#: So many pairs of neighbours are halved, those with the largest differences.
JUMP_SHARE, HALVINGS, FOLLOWED_PAIRS = 0.2, 14, 64
#: A halved distance is at most this share of the distance before; if it is longer, the points are on two sheets.
HALVED_SHARE = 0.75
#: A jump nearer to a boundary than this, in spacings, is at the boundary.
BOUNDARY_SPACINGS = 0.1
#: A jump is at a crease where the manifold within so many spacings deviates from a plane by more than this share.
CREASE_SPACINGS, CREASE_SHARE = 0.1, 0.1


def find_jump(
    scene: Scene, function: Callable[[Floats], Floats | None], points: Floats, spacing: float
) -> Floats | None:
    """Return a point (d,) of the manifold at which data jump and no boundary or crease lies; None without one.

    ``function`` returns the data (k, channels) at points (k, d), or None if it refuses the points; ``points`` (n, d)
    are the places at which a form with this ``spacing`` evaluates the data.
    """
    rows = np.linspace(0, len(points) - 1, COMPARED_POINTS).astype(np.int64)
    points = points[np.unique(rows)] if len(points) > COMPARED_POINTS else points
    values = function(points)
    if values is None:
        return None
    size = np.sqrt(np.mean(values**2, axis=0))
    size[size == 0] = np.inf
    pairs = _followed_pairs(points, values / size)
    pairs = pairs[_on_one_member(scene.surface, points[pairs])]
    ends, at_ends = points[pairs], values[pairs] / size  # (m, 2, d) and (m, 2, channels)
    for _ in range(HALVINGS):
        differ = _differs(at_ends)
        ends, at_ends = ends[differ], at_ends[differ]
        if not len(ends):
            return None
        middle = scene.surface.closest_point(ends.mean(axis=1)).points
        at_middle = function(middle)
        if at_middle is None:
            return None
        ends, at_ends = _halve(ends, at_ends, middle, at_middle / size)
    places = ends[_differs(at_ends), 0]
    for boundary in scene.boundaries:
        if len(places):
            places = places[boundary.source.closest_point(places).distance > BOUNDARY_SPACINGS * spacing]
    return next((place for place in places if not _is_creased(scene.surface, place, CREASE_SPACINGS * spacing)), None)


def _followed_pairs(points: Floats, scaled: Floats) -> Ints:
    """Return the rows (m, 2) of neighbours among ``points`` whose values ``scaled`` (n, channels) differ most."""
    from scipy.spatial import cKDTree

    number = cKDTree(points).query(points, min(NEIGHBOURS + 1, len(points)))[1].reshape(len(points), -1)
    pairs = np.stack([np.repeat(number[:, 0], number.shape[1] - 1), number[:, 1:].ravel()], axis=1)
    difference = np.abs(scaled[pairs[:, 0]] - scaled[pairs[:, 1]]).max(axis=1, initial=0.0)
    return pairs[np.argsort(-difference)[:FOLLOWED_PAIRS]]


def _differs(at_ends: Floats) -> Bools:
    """Return whether (m,) the scaled values (m, 2, channels) at the ends of pairs differ by more than `JUMP_SHARE`."""
    return np.asarray(np.abs(at_ends[:, 0] - at_ends[:, 1]).max(axis=1, initial=0.0) > JUMP_SHARE)


def _halve(ends: Floats, at_ends: Floats, middle: Floats, at_middle: Floats) -> tuple[Floats, Floats]:
    """Return the ends (m, 2, d), and values, of the halves with larger differences, without pairs on two sheets."""
    change = np.abs(at_ends - at_middle[:, None]).max(axis=2)
    rows, moved = np.arange(len(ends)), np.argmin(change, axis=1)  # the end with the value of the middle moves there
    halves, at_halves = ends.copy(), at_ends.copy()
    halves[rows, moved], at_halves[rows, moved] = middle, at_middle
    lengths = [np.linalg.norm(each[:, 0] - each[:, 1], axis=1) for each in (ends, halves)]
    kept = lengths[1] <= HALVED_SHARE * lengths[0]
    return halves[kept], at_halves[kept]


def _on_one_member(surface: ClosestPointSource, ends: Floats) -> Bools:
    """Return whether (m,) both points of each pair (m, 2, d) lie on one member of a union; True for other sources."""
    if len(members_of(surface)) == 1:
        return np.ones(len(ends), dtype=bool)
    first, second = (surface.closest_point(np.ascontiguousarray(ends[:, k])).element for k in range(2))
    return np.ones(len(ends), dtype=bool) if first is None or second is None else first == second


def _is_creased(surface: ClosestPointSource, place: Floats, radius: float) -> bool:
    """Return whether the manifold is creased at ``place`` (d,): closest points around it lie in no plane or line."""
    steps = radius * np.eye(len(place))
    around = surface.closest_point(place + np.concatenate([steps, -steps])).points
    sizes = np.linalg.svd(around - around.mean(axis=0), compute_uv=False)
    across = np.sqrt(np.sum(sizes[surface.manifold_dim or 0 :] ** 2) / len(around))
    return bool(across > CREASE_SHARE * radius)
