"""The test whether two points of a surface are connected along it near their chord: bisection."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.meshing.contouring.contour_nodes import NORMAL_NOISES
from cpmkit.types import Bools, Floats

#: A chord is flat if its sine with the tangent spaces at its ends is at most this: arcs up to about 10 degrees.
FLAT_SINE = 0.1
#: And if the normals at its ends have at least this cosine.
FLAT_COSINE = 0.8
#: Points between two sheets that meet in a crease lie on the surface up to this share of their chord.
CREASE_DISTANCE = 0.1
#: A bisection stops where the gap grows to this multiple of the first gap, or shrinks to no less than this share in a
#: round: the two points then lie on different sheets.
GROWN_GAP, STUCK_GAP = 1.2, 0.97
#: A midpoint of an edge farther than this share of the edge from the manifold lies beside a crease: the edge stays
#: straight there.
CREASE_SHARE = 0.15


def chord_is_flat(a: Floats, b: Floats, normal_a: Floats, normal_b: Floats, position_error: float) -> Bools:
    """Return which chords (n,) from ``a`` to ``b`` (n, 3) lie in the tangent planes at both ends.

    A normal of zero is unknown. The ends are known up to ``position_error``.
    """
    chord = b - a
    sine = 0.5 * (np.abs(dots(chord, normal_a)) + np.abs(dots(chord, normal_b)))
    unknown = (normal_a == 0).all(axis=1) | (normal_b == 0).all(axis=1)
    same_direction = np.abs(dots(normal_a, normal_b)) > FLAT_COSINE
    return np.asarray((sine <= FLAT_SINE * norms(chord) + position_error) & (same_direction | unknown))


def connected_on_surface(
    source: LocalSource,
    a: Floats,
    b: Floats,
    normal_a: Floats,
    normal_b: Floats,
    position_error: float,
    box: tuple[Floats, Floats],
) -> Bools:
    """Return which pairs (n,) of points ``a`` and ``b`` (n, 3) of a surface are connected along it inside boxes.

    They are connected if the chord is flat, and if a crease between them lies on the surface and passes the box; a
    crease elsewhere connects them in another box. Otherwise the chord is bisected: the closest point of its midpoint
    replaces one end, so that the half that is not flat, or the longer half, is left. At a crease the gap shrinks to
    zero, between two sheets it does not.

    Parameters
    ----------
    source : LocalSource
    a, b : (n, 3) float64
    normal_a, normal_b : (n, 3) float64
        Unit normals at ``a`` and ``b``, of either sign.
    position_error : float
        The length up to which the points are known.
    box : ((n, 3), (n, 3)) float64
        The lowest and the highest corner of each box.
    """
    connected = chord_is_flat(a, b, normal_a, normal_b, position_error)
    rows = np.flatnonzero(~connected)
    creased, crease = _connected_over_crease(source, a[rows], b[rows], normal_a[rows], normal_b[rows], position_error)
    connected[rows] = creased & _line_meets_box(
        crease, np.cross(normal_a[rows], normal_b[rows]), box[0][rows], box[1][rows]
    )
    rows = rows[~creased]
    a, b, normal_a, normal_b = (np.array(values[rows]) for values in (a, b, normal_a, normal_b))
    first_gap = gap = norms(b - a)
    for _ in range(40):  # a limit; gaps close or stick before
        if not len(rows):
            break
        middle = 0.5 * (a + b)
        closest = source.closest_point(middle).points
        away = middle - closest
        has_normal = norms(away) > np.maximum(1e-3 * first_gap, NORMAL_NOISES * source.noise)
        normal = np.where(has_normal[:, None], unit(away), 0.0)
        to_a, to_b = norms(closest - a), norms(b - closest)
        flat_a = chord_is_flat(a, closest, normal_a, normal, position_error)
        flat_b = chord_is_flat(closest, b, normal, normal_b, position_error)
        first_half = np.where(flat_a == flat_b, to_a >= to_b, flat_b)
        keep_a = first_half[:, None]
        a, normal_a = np.where(keep_a, a, closest), np.where(keep_a, normal_a, normal)
        b, normal_b = np.where(keep_a, closest, b), np.where(keep_a, normal, normal_b)
        new_gap = np.where(first_half, to_a, to_b)
        closed = (flat_a & flat_b) | (new_gap < np.maximum(0.05 * first_gap, 6.0 * source.noise))
        connected[rows[closed]] = True
        go = ~closed & (new_gap <= GROWN_GAP * first_gap) & (new_gap <= STUCK_GAP * gap)
        rows, first_gap, gap = rows[go], first_gap[go], new_gap[go]
        a, b, normal_a, normal_b = a[go], b[go], normal_a[go], normal_b[go]
    return connected


def _connected_over_crease(
    source: LocalSource, a: Floats, b: Floats, normal_a: Floats, normal_b: Floats, position_error: float
) -> tuple[Bools, Floats]:
    """Return whether the tangent planes at ``a`` and ``b`` (n, 3) meet in a crease, (n,), and the crease point (n, 3).

    The point of the planes' common line nearest to the chord's middle must lie on the surface, and so must the middles
    of the two chords from it to ``a`` and ``b``.
    """
    connected = np.zeros(len(a), dtype=bool)
    middle, length, cosine = 0.5 * (a + b), norms(b - a), dots(normal_a, normal_b)
    height_a, height_b = dots(normal_a, a - middle), dots(normal_b, b - middle)
    with np.errstate(all="ignore"):
        share = 1 / (1 - cosine**2)
        along_a, along_b = share * (height_a - cosine * height_b), share * (height_b - cosine * height_a)
        crease = middle + along_a[:, None] * normal_a + along_b[:, None] * normal_b
        crease_is_close = norms(crease - middle) < 1.5 * length
    known = (normal_a != 0).any(axis=1) & (normal_b != 0).any(axis=1)
    rows = np.flatnonzero(known & crease_is_close & (1 - cosine**2 > 0.3**2))
    a, b, normal_a, normal_b, length = a[rows], b[rows], normal_a[rows], normal_b[rows], length[rows]
    closest = source.closest_point(crease[rows]).points
    meets = norms(closest - crease[rows]) <= CREASE_DISTANCE * length + position_error
    for end, normal in ((a, normal_a), (b, normal_b)):
        rise = np.abs(dots(closest - end, normal))
        meets &= rise <= FLAT_SINE * norms(closest - end) + position_error
    crease[rows] = closest
    rows, a, b, closest = rows[meets], a[meets], b[meets], closest[meets]
    middles = [0.5 * (end + closest) for end in (a, b)]
    on_surface = source.closest_point(np.concatenate(middles)).points.reshape(2, -1, 3)
    connected[rows] = True
    for end, half, projected in zip((a, b), middles, on_surface, strict=True):
        connected[rows] &= norms(projected - half) <= CREASE_DISTANCE * norms(closest - end) + position_error
    return connected, crease


def _line_meets_box(point: Floats, along: Floats, low: Floats, high: Floats) -> Bools:
    """Return which lines (n,), through ``point`` in direction ``along`` (n, 3), meet boxes from ``low`` to ``high``."""
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (low - point) / along, (high - point) / along
    enters = np.where(along == 0, np.where(low <= point, -np.inf, np.inf), np.minimum(first, second)).max(axis=1)
    leaves = np.where(along == 0, np.where(point <= high, np.inf, -np.inf), np.maximum(first, second)).min(axis=1)
    return np.asarray(enters <= leaves)
