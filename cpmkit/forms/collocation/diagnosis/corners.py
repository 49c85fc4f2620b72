"""Corners of curves in space: found by their tangents, for foot directions there say nothing of how a curve turns."""

from __future__ import annotations

import numpy as np

from cpmkit.forms.collocation.diagnosis.unresolved import TOLD_ERROR_SHARE, UnresolvedFeature
from cpmkit.forms.collocation.layout import Layout
from cpmkit.forms.collocation.sheets.turning import (
    CREASE_TURN_RADIANS,
    HALVED_STRETCH_SPACINGS,
    MOST_CHORD_SPACINGS,
    TURN_HALVINGS,
    TURN_NORMAL_STEP_SPACINGS,
)
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.tangent_space import tangents
from cpmkit.manifold.vectors import dots, norms, unit
from cpmkit.protocols import ClosestPoints, Floats

#: Error, as a share of the range, over the angle in radians of a crease that all of the flux crosses: where the crease
#: runs along an axis of the lattice, and at corners of curves.
ERROR_PER_RADIAN_ALIGNED = 0.2
#: A place is looked at in each cell of so many spacings, from so many spacings on both sides.
CELL_SPACINGS, LOOK_SPACINGS = 0.5, 0.5
#: Feet nearer to each other than this many spacings have no chord: a curve ends there.
LEAST_CHORD_SPACINGS = 0.1


def is_curve_in_space(layout: Layout) -> bool:
    """Tell whether the manifold is a curve in space, where corners are looked for."""
    return layout.surface.manifold_dim == 1 and layout.surface.dim == 3 and layout.order < 4


def corner_feature(layout: Layout) -> UnresolvedFeature | None:
    """Return the corners of a curve in space; None where it has none that matter."""
    h, feet = layout.lattice.spacing, layout.band.feet.points
    places, angles = _corners(layout.surface, *_chords(layout), h)
    error = ERROR_PER_RADIAN_ALIGNED * float(angles.mean()) if len(angles) else 0.0
    if error < TOLD_ERROR_SHARE:
        return None
    from scipy.spatial import cKDTree

    half_stencil = 0.5 * (layout.band.degree + 1) * h
    beside = cKDTree(places).query(feet)[0] < half_stencil
    worst = int(angles.argmax())
    return UnresolvedFeature(
        "crease",
        share=float(beside.mean()),
        typical=float(np.rad2deg(np.median(angles))),
        worst=float(np.rad2deg(angles[worst])),
        error=min(1.0, error),
        cure=None,
        place=tuple(layout.lattice.to_scene(places[[worst]])[0].tolist()),
    )


def _chords(layout: Layout) -> tuple[Floats, Floats]:
    """Return the middle (n, 3) and the direction (n, 3) of one chord between feet in each cell along the curve."""
    band, h = layout.band, layout.lattice.spacing
    first, second = band.neighbours()
    chord = band.feet.points[second] - band.feet.points[first]
    length = norms(chord)
    inside = (band.feet.edge[first] < 0) & (band.feet.edge[second] < 0)
    rows = np.flatnonzero(inside & (length > LEAST_CHORD_SPACINGS * h) & (length < MOST_CHORD_SPACINGS * h))
    middle = 0.5 * (band.feet.points[first[rows]] + band.feet.points[second[rows]])
    cells = np.floor(middle / (CELL_SPACINGS * h)).astype(np.int64)
    kept = np.unique(cells, axis=0, return_index=True)[1]
    return middle[kept], unit(chord[rows[kept]])


def _corners(curve: LocalSource, places: Floats, along: Floats, spacing: float) -> tuple[Floats, Floats]:
    """Return the corners (k, 3) near places (n, 3), and by how much the curve turns there (k,), in radians.

    The stretch of a spacing around each place is halved again and again, towards where it turns more: the turn of a
    smooth curve vanishes so, that of a corner stays.
    """
    ends = [curve.closest_point(places + sign * LOOK_SPACINGS * spacing * along) for sign in (-1, 1)]
    chord = ends[1].points - ends[0].points
    long = norms(chord) > LEAST_CHORD_SPACINGS * spacing
    (a, ta), (b, tb) = ((end.points[long], _tangents(curve, end.take(long), chord[long], spacing)) for end in ends)
    turned = _angles(ta, tb) > CREASE_TURN_RADIANS
    a, b, ta, tb = a[turned], b[turned], ta[turned], tb[turned]
    for _ in range(TURN_HALVINGS if len(a) else 0):
        middle = curve.closest_point(0.5 * (a + b))
        tm = _tangents(curve, middle, b - a, spacing)
        first = (_angles(ta, tm) > _angles(tm, tb))[:, None]
        a, ta = np.where(first, a, middle.points), np.where(first, ta, tm)
        b, tb = np.where(first, middle.points, b), np.where(first, tm, tb)
    angle = _angles(ta, tb)
    corner = (angle > CREASE_TURN_RADIANS) & (norms(b - a) < HALVED_STRETCH_SPACINGS * spacing)
    return 0.5 * (a + b)[corner], angle[corner]


def _tangents(curve: LocalSource, feet: ClosestPoints, along: Floats, spacing: float) -> Floats:
    """Return the tangents (n, 3) at feet, pointing ``along`` (n, 3)."""
    found = tangents(curve, feet, TURN_NORMAL_STEP_SPACINGS * spacing)
    return np.asarray(found * np.where(dots(found, along) < 0, -1.0, 1.0)[:, None])


def _angles(first: Floats, second: Floats) -> Floats:
    return np.asarray(2 * np.arcsin(np.minimum(0.5 * norms(first - second), 1.0)))
