"""Ghosts that continue polynomials through points inside: of order 3 and 4, and those of transmission conditions."""

from __future__ import annotations

import numpy as np

from cpmkit.forms.collocation.boundary.conductivities import conductivities
from cpmkit.forms.collocation.boundary.reading import Datum
from cpmkit.forms.collocation.ghosts.continuation import Continued, Inside, arc_length, continue_rows, points_inwards
from cpmkit.forms.collocation.ghosts.formulas import points_inside, polynomial_weights
from cpmkit.forms.collocation.ghosts.geometry import Crossing, beyond_another
from cpmkit.forms.collocation.ghosts.transmitted import coupled_weights
from cpmkit.grid.lattice import Lattice
from cpmkit.protocols import Bools, Floats, Ints
from cpmkit.scene.laws import Interface, OneSided


def continue_ghosts(crossing: Crossing, lattice: Lattice, orders: Ints) -> tuple[list[Continued], Ints]:
    """Return the ghosts that continue polynomials, and the orders (g,) of all, lower for those without room to do so.

    Without room a ghost of order 3 or 4 becomes one of order 2, and a transmission's one of order 1.
    """
    parts, orders = [], orders.copy()
    for condition, side in crossing.sides():
        law = condition.law
        coupled = isinstance(law, Interface)
        for order in (2, 3, 4) if coupled else (3, 4):
            rows = side[orders[side] == order]
            if not len(rows):
                continue
            count = points_inside(law, order)
            inside, sound = _points(crossing, rows, crossing.direction[rows], count, lattice.spacing)
            if coupled:
                behind, sound_behind = _points(crossing, rows, -crossing.direction[rows], count, lattice.spacing)
                sound &= sound_behind
            orders[rows[~sound]] = 1 if coupled else 2
            if not sound.any():
                continue
            if isinstance(law, Interface):
                parts.append(_couple(crossing, lattice, law, rows[sound], inside.take(sound), behind.take(sound)))
            else:
                parts.append(_continue(crossing, lattice, law, rows[sound], inside.take(sound)))
    return parts, orders


def _points(crossing: Crossing, rows: Ints, direction: Floats, count: int, spacing: float) -> tuple[Inside, Bools]:
    """Return points behind the feet of the ghosts ``rows``, and for which nothing is in their way."""
    foot = crossing.seen.foot[rows]
    own = crossing.sighted[crossing.index]
    inside = points_inwards(own.surface, foot, direction, count, spacing, crossing.start_of(rows))
    reach = 2 * float(np.linalg.norm(inside.points - foot[:, None], axis=2).max())
    blocked = beyond_another(crossing, rows, inside.points[:, -1], reach, spacing)
    return inside, inside.sound & ~blocked & own.has_sides


def _continue(crossing: Crossing, lattice: Lattice, law: OneSided, rows: Ints, inside: Inside) -> Continued:
    where = lattice.to_scene(crossing.seen.foot[rows])
    at = arc_length(crossing.seen.distance[rows], np.linalg.norm(inside.curvature, axis=1))
    return continue_rows(law, rows, where, crossing.what, inside, at, lattice.spacing)


def _couple(
    crossing: Crossing, lattice: Lattice, law: Interface, rows: Ints, inside: Inside, behind: Inside
) -> Continued:
    seen = crossing.seen.take(rows)
    where, carries_left = lattice.to_scene(seen.foot), seen.signed < 0
    materials = conductivities(law, crossing.diffusivity, seen, carries_left, lattice)
    at = arc_length(seen.distance, np.linalg.norm(behind.curvature, axis=1))
    own, carried, jump, flux = coupled_weights(
        law, materials, behind.positions, inside.positions, at, carries_left, lattice.spacing
    )
    ahead, here = polynomial_weights(0.0, np.ones(len(rows)), inside.positions, at, lattice.spacing)
    data = [
        Datum(rows, jump, where, law.jump, f"the jump of {crossing.what}", law),
        Datum(rows, flux, where, law.flux, f"the flux of {crossing.what}", law),
    ]
    return Continued(rows, inside.terms(rows, carried), behind.terms(rows, own), data, here, inside.terms(rows, ahead))
