"""Values in a strip between two boundaries nearer than a spacing: no stencil finds room there, so they are filled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cpmkit.forms.collocation.boundary.side_view import SideView
from cpmkit.forms.collocation.encounters.boundaries import STRIP_SPACINGS
from cpmkit.forms.collocation.layout import Layout
from cpmkit.grid.lattice import Lattice
from cpmkit.protocols import SIDES, Bools, BoundarySet, Floats
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.laws import Value


def fill_strips(
    values: Floats, points: Floats, layout: Layout, side_views: Sequence[SideView], time: float | None
) -> None:
    """Set ``values`` (n, channels) at those ``points`` (n, d) that lie in a strip.

    Between two given values the linear interpolant, beside one alone that value: with a strip narrower than a spacing
    the solution is that to first order. Between two fluxes nothing is known, and nothing is changed.
    """
    boundaries, lattice = layout.boundaries.given, layout.lattice
    for strip in layout.strips:
        first, second = side_views[strip.first], side_views[strip.second]
        _, own, other = np.intersect1d(first.rows, second.rows, return_indices=True)
        a, b = first.take(own), second.take(other)
        z = points[a.rows]
        between = np.sum((z - a.foot) * (z - b.foot), axis=1) < 0
        inside = np.flatnonzero(between & (a.distance + b.distance < STRIP_SPACINGS * lattice.spacing))
        a, b = a.take(inside), b.take(inside)
        value_a, fixed_a = _held_values(boundaries[strip.first], a, lattice, values.shape[1], time)
        value_b, fixed_b = _held_values(boundaries[strip.second], b, lattice, values.shape[1], time)
        share = (a.distance / (a.distance + b.distance))[:, None]
        share = np.where(fixed_a[:, None], np.where(fixed_b[:, None], share, 0.0), 1.0)
        filled = (1 - share) * value_a + share * value_b
        known = fixed_a | fixed_b
        values[a.rows[known]] = filled[known]


def _held_values(
    boundary: BoundarySet, side_view: SideView, lattice: Lattice, channels: int, time: float | None
) -> tuple[Floats, Bools]:
    """Return the values (k, channels) that a boundary holds on the sides that the points lie on, and where it does."""
    values, fixed = np.zeros((len(side_view.rows), channels)), np.zeros(len(side_view.rows), dtype=bool)
    for side in SIDES:
        law = boundary.condition(side).law
        rows = np.flatnonzero((side_view.signed > 0) == (side == "left"))
        if isinstance(law, Value) and len(rows):
            where = lattice.to_scene(side_view.foot[rows])
            values[rows] = evaluate_data(law.datum, where, channels, f"boundary {boundary.name!r}", time)
            fixed[rows] = True
    return values, fixed
