"""What the ghosts of a boundary read: at mirror points, at points behind them, or on both sides of a transmission."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cpmkit.forms.collocation.boundary.conductivities import conductivities
from cpmkit.forms.collocation.boundary.frame import Frame
from cpmkit.forms.collocation.boundary.reading import Datum, Reading, Term
from cpmkit.forms.collocation.boundary.side_readings import WITHIN, read_within
from cpmkit.forms.collocation.ghosts.continuation import continued, continued_sources
from cpmkit.forms.collocation.ghosts.continued import continue_ghosts
from cpmkit.forms.collocation.ghosts.formulas import coefficient_and_factor, mirror_distance
from cpmkit.forms.collocation.ghosts.geometry import Crossing, beyond_another
from cpmkit.forms.collocation.ghosts.transmitted import transmission_weights
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.walking import nearest_from
from cpmkit.protocols import Bools, ClosestPoints, Floats, Ints
from cpmkit.scene.laws import Interface, OneSided, beta_at


@dataclass(frozen=True, eq=False)
class GhostReading:
    """What ghosts read, where their right-hand sides are read, how they see the boundaries, and their orders.

    ``behind`` (g,) is how far behind the boundary those read that read at one point, over where data are; NaN else.
    """

    reading: Reading
    sources: Reading
    frames: Sequence[Frame]
    orders: Ints
    behind: Floats


def ghost_reading(crossing: Crossing, lattice: Lattice, order: int, radius: float) -> GhostReading:
    """Return what the ghosts of a boundary read, edges aside; stencils look ``radius`` far for boundaries."""
    spacing, count = lattice.spacing, len(crossing.seen.rows)
    asked = np.empty(count, dtype=np.int64)
    for condition, rows in crossing.sides():
        asked[rows] = condition.order or order
    asked[crossing.apart] = np.minimum(asked[crossing.apart], 2)
    parts, orders = continue_ghosts(crossing, lattice, asked)
    alone = np.ones(count, dtype=bool)
    for part in parts:
        alone[part.rows] = False
    plain, own_terms, orders = _plain(crossing, lattice, alone, orders)
    reading = continued(plain, parts)
    own_terms += [term for part in parts for term in part.own_terms]

    def located(term: Term, own_side: bool) -> Term:
        frames = crossing.frames(term.rows, term.points, radius, spacing, own_side)
        return replace(term, own=crossing.index, frames=frames)

    terms = [located(term, False) for term in reading.terms] + [located(term, True) for term in own_terms]
    inside = read_within(crossing, spacing, order)
    frames = crossing.frames(np.arange(count), reading.points, radius, spacing)
    behind = np.linalg.norm(reading.points - crossing.seen.foot, axis=1) / (WITHIN * spacing)
    behind[~alone] = np.nan
    return GhostReading(replace(reading, terms=terms), continued_sources(inside, parts), frames, orders, behind)


def _plain(crossing: Crossing, lattice: Lattice, alone: Bools, orders: Ints) -> tuple[Reading, list[Term], Ints]:
    """Return what the ghosts ``alone`` read at one point, or a transmission's at two, and the orders of all."""
    mirror, feet, orders = _mirrors(crossing, orders, alone, lattice.spacing)
    coefficient = np.zeros(len(alone))
    data: list[Datum] = []
    own_terms: list[Term] = []
    for condition, side in crossing.sides():
        law, rows = condition.law, side[alone[side]]
        if isinstance(law, Interface) and len(rows):
            coefficient[rows], added, own_term = _transmitted(crossing, lattice, law, rows, mirror)
            own_terms.append(own_term)
            data += added
        elif not isinstance(law, Interface):
            coefficient[rows], added = _mirrored(crossing, lattice, law, rows, mirror, orders)
            data += added
    return Reading(mirror, coefficient, data, feet=feet), own_terms, orders


def _mirrored(
    crossing: Crossing, lattice: Lattice, law: OneSided, rows: Ints, mirror: Floats, orders: Ints
) -> tuple[Floats, list[Datum]]:
    """Return the coefficients (k,) of the ghosts ``rows`` of order 1 or 2, and their data."""
    where = lattice.to_scene(crossing.seen.foot[rows])
    s = np.linalg.norm(crossing.foot_point[rows] - mirror[rows], axis=1)
    t, first = crossing.seen.distance[rows], orders[rows] == 1
    beta = beta_at(law, where, crossing.what)
    coefficient, factor = coefficient_and_factor(law, beta, t, s, first, lattice.spacing)
    return coefficient, [Datum(rows, factor, where, law.datum, crossing.what, law)]


def _transmitted(
    crossing: Crossing, lattice: Lattice, law: Interface, rows: Ints, mirror: Floats
) -> tuple[Floats, list[Datum], Term]:
    """Return the coefficients (k,) of u(mirror), the data, and the term that reads where the ghosts stand."""
    where = lattice.to_scene(crossing.seen.foot[rows])
    s = np.linalg.norm(crossing.foot_point[rows] - mirror[rows], axis=1)
    seen = crossing.seen.take(rows)
    carries_left = seen.signed < 0
    materials = conductivities(law, crossing.diffusivity, seen, carries_left, lattice)
    own, carried, jump, flux = transmission_weights(law, *materials, s, carries_left)
    data = [
        Datum(rows, jump, where, law.jump, f"the jump of {crossing.what}", law),
        Datum(rows, flux, where, law.flux, f"the flux of {crossing.what}", law),
    ]
    feet = None if crossing.own_feet is None else crossing.own_feet.take(rows)
    return carried, data, Term(rows, crossing.foot_point[rows], own, feet=feet)


def _mirrors(
    crossing: Crossing, orders: Ints, alone: Bools, spacing: float
) -> tuple[Floats, ClosestPoints | None, Ints]:
    """Return the points (g, d) that ghosts read alone, and the orders, 1 where the mirror cannot be read.

    With the points come their records where several sheets share the band.

    A transmission's ghosts have no other reading than the mirror's, whatever lies between.
    """
    seen, orders, h = crossing.seen, orders.copy(), np.empty(len(alone))
    for condition, rows in crossing.sides():
        h[rows] = mirror_distance(condition.law, seen.distance[rows], spacing)
    coupled = crossing.boundaries[crossing.index].condition("left").couples
    mirror, feet = seen.foot.copy(), crossing.start
    second = np.flatnonzero(alone & ((orders == 2) | coupled))
    if len(second):
        ahead = seen.foot[second] + h[second, None] * crossing.direction[second]
        own = crossing.sighted[crossing.index]
        reached = nearest_from(own.surface, crossing.start_of(second), ahead, spacing)
        if not coupled:
            beyond = beyond_another(crossing, second, reached.points, 2 * float(h.max()), spacing)
            orders[second[beyond]] = 1
            second, reached = second[~beyond], reached.take(~beyond)
        mirror[second] = reached.points
        feet = None if feet is None else feet.replaced(second, reached)
    return mirror, feet, orders
