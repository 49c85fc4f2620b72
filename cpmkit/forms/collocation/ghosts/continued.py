"""Ghosts that continue polynomials through points inside: of order 3 and 4, and those of transmission conditions."""

from __future__ import annotations

import numpy as np

from cpmkit.forms.collocation.ghosts.continuation import (
    Continued,
    Inside,
    arc_length,
    continue_rows,
    points_inside,
    points_inwards,
)
from cpmkit.forms.collocation.ghosts.geometry import GhostGeometry, beyond_another
from cpmkit.forms.collocation.ghosts.transmitted import couple
from cpmkit.protocols import Bools, Floats, Ints
from cpmkit.scene.laws import Interface, Law


def continue_ghosts(geometry: GhostGeometry, law: Law, side: Ints, orders: Ints) -> tuple[list[Continued], Ints]:
    """Return those of the ghosts ``side`` that continue polynomials, and the ``orders`` (k,) of all.

    Without room a ghost of order 3 or 4 becomes one of order 2, and a transmission's one of order 1.
    """
    parts, orders = [], orders.copy()
    for order in (2, 3, 4) if isinstance(law, Interface) else (3, 4):
        chosen = np.flatnonzero(orders == order)
        if not len(chosen):
            continue
        rows, count = side[chosen], points_inside(law, order)
        inside, sound = _points(geometry, rows, geometry.direction[rows], count)
        if isinstance(law, Interface):
            behind, sound_behind = _points(geometry, rows, -geometry.direction[rows], count)
            sound &= sound_behind
            orders[chosen[~sound]] = 1
            if sound.any():
                parts.append(couple(geometry, law, rows[sound], inside.take(sound), behind.take(sound)))
            continue
        orders[chosen[~sound]] = 2
        if sound.any():
            rows, inside = rows[sound], inside.take(sound)
            at = arc_length(geometry.seen.distance[rows], np.linalg.norm(inside.curvature, axis=1))
            where = geometry.at_boundary(rows)
            parts.append(continue_rows(law, rows, where, geometry.what, inside, at, geometry.spacing))
    return parts, orders


def _points(geometry: GhostGeometry, rows: Ints, direction: Floats, count: int) -> tuple[Inside, Bools]:
    """Return points behind the feet of the ghosts ``rows``, and for which nothing is in their way."""
    foot, own = geometry.seen.foot[rows], geometry.own
    start = None if geometry.start is None else geometry.start.take(rows)
    inside = points_inwards(own.surface, foot, direction, count, geometry.spacing, start)
    reach = 2 * float(np.linalg.norm(inside.points - foot[:, None], axis=2).max())
    blocked = beyond_another(geometry, rows, inside.points[:, -1], reach)
    return inside, inside.sound & ~blocked & own.has_sides
