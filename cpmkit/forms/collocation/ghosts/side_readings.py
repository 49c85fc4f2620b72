"""Where data that jump across a boundary are read: well inside the side that they belong to.

A curve given by points, or snapped to a mesh, is off the place at which a formula jumps by a share of the spacing.
Nearer than that either side's value may come back, so data are read at points inside and continued to the boundary.
"""

from __future__ import annotations

import numpy as np

from cpmkit.forms.collocation.boundary.row_formula import ExtraPoint, RowFormula
from cpmkit.forms.collocation.boundary.side_view import BoundaryOnLattice, SideView
from cpmkit.forms.collocation.ghosts.geometry import INSIDE_SIDE_SPACINGS, GhostGeometry, beyond_another
from cpmkit.manifold.walking import nearest_on_sheet
from cpmkit.protocols import Bools, ClosestPoints, Floats

#: Data are read at this distance from the boundary, in spacings, and at multiples of it: two points, or three where
#: the conditions are of order 3 or 4. (At 0.25 the Dziuk surface of the studies is a fifth less accurate at 0.1.)
SIDE_READING_SPACINGS = 0.15
#: A point inside whose distance from the boundary is below this share of the intended one has met an edge or a fold.
LEAST_INSIDE_SHARE = 0.75
#: Nodes with feet nearer to a boundary than so many spacings read right-hand sides in the same way.
DOUBTFUL_SIDE_SPACINGS = 0.1


def read_within(geometry: GhostGeometry, order: int) -> RowFormula:
    """Return where the ghosts of a boundary read right-hand sides: at points inside, as if on the boundary.

    Where another boundary or an edge is in the way, or the boundary has no sides, just inside.
    """
    seen, own, spacing = geometry.seen, geometry.own, geometry.spacing
    near = seen.foot + INSIDE_SIDE_SPACINGS * spacing * geometry.direction
    if not own.has_sides or not len(near):
        return RowFormula(near, np.ones(len(near)))
    points, sound = _points_within(own, seen.foot, geometry.start, geometry.direction, order)
    rows = np.flatnonzero(sound)
    reach = 2 * len(points) * SIDE_READING_SPACINGS * spacing
    sound[rows[beyond_another(geometry, rows, points[-1][rows], reach)]] = False
    return _continued_to(near, points, sound, np.zeros(len(near)))


def node_sources(
    feet: Floats, own: BoundaryOnLattice, others: list[BoundaryOnLattice], side_view: SideView, order: int
) -> RowFormula:
    """Return where nodes with ``feet`` (k, d) nearly on a boundary, ``side_view`` by it, read right-hand sides."""
    spacing, sign = own.spacing, np.sign(side_view.signed)[:, None]
    on_boundary = np.abs(side_view.signed)[:, None] < INSIDE_SIDE_SPACINGS * spacing
    near = np.where(on_boundary, feet + sign * INSIDE_SIDE_SPACINGS * spacing * side_view.conormal, feet)
    start = None if own.sheets is None else own.surface.closest_point(side_view.foot)
    points, sound = _points_within(own, side_view.foot, start, sign * side_view.conormal, order)
    for other in others:
        sound &= other.source.closest_point(side_view.foot).distance > 2 * len(points) * SIDE_READING_SPACINGS * spacing
    return _continued_to(near, points, sound, np.abs(side_view.signed) / (SIDE_READING_SPACINGS * spacing))


def _points_within(
    own: BoundaryOnLattice, foot: Floats, start: ClosestPoints | None, direction: Floats, order: int
) -> tuple[list[Floats], Bools]:
    """Return points (n, d) of the surface one behind the other from feet on a boundary, and where there are all."""
    points, sound, step = [], np.ones(len(foot), dtype=bool), SIDE_READING_SPACINGS * own.spacing
    for k in range(1, 3 if order < 3 else 4):
        point = nearest_on_sheet(own.surface, start, foot + k * step * direction, own.spacing)
        sound &= (np.linalg.norm(point.points - foot, axis=1) > LEAST_INSIDE_SHARE * k * step) & (point.edge < 0)
        points.append(point.points)
    return points, sound


def _continued_to(near: Floats, points: list[Floats], sound: Bools, at: Floats) -> RowFormula:
    """Return the polynomial through data at 1, 2, ..., read ``at`` (n,); at ``near`` where points are not sound."""
    rows, count = np.flatnonzero(sound), len(points)
    first, coefficient, terms = near.copy(), np.ones(len(near)), []
    for k in range(1, count + 1):
        others = [j for j in range(1, count + 1) if j != k]
        weight = np.prod([(at[rows] - j) / (k - j) for j in others], axis=0)
        if k == 1:
            first[rows], coefficient[rows] = points[0][rows], weight
        else:
            terms.append(ExtraPoint(rows, points[k - 1][rows], weight))
    return RowFormula(first, coefficient, (), terms)
