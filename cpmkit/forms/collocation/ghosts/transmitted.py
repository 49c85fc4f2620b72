"""Ghosts of a transmission condition: both sides' values, coupled by the jumps of value and flux.

With A the side on which a ghost stands and B the one that it carries, ``u_A - u_B = jump + R (mean flow)`` and
``k_A u_A' - k_B u_B' = -flux`` at the boundary, derivatives along the arc from B to A.
"""

from __future__ import annotations

import numpy as np

from cpmkit.forms.collocation.boundary.conductivities import conductivities
from cpmkit.forms.collocation.boundary.row_formula import BoundaryData, ExtraPoint
from cpmkit.forms.collocation.ghosts.continuation import Continued, Inside, arc_length, polynomial_weights
from cpmkit.forms.collocation.ghosts.geometry import GhostGeometry
from cpmkit.protocols import Bools, Floats, Ints
from cpmkit.scene.laws import Interface


def transmitted(geometry: GhostGeometry, law: Interface, rows: Ints) -> tuple[Floats, list[BoundaryData], ExtraPoint]:
    """Return how ghosts of order 1 read: the factors (k,) of u(mirror), the data, and u where they stand."""
    seen = geometry.seen.take(rows)
    s = np.linalg.norm(geometry.foot_point[rows] - geometry.mirror.points[rows], axis=1)
    materials = conductivities(law, geometry.boundaries.diffusivity, seen, seen.signed < 0, geometry.lattice)
    own, carried, jump, flux = transmission_weights(law, *materials, s, seen.signed < 0)
    feet = None if geometry.own_feet is None else geometry.own_feet.take(rows)
    return carried, _data(geometry, law, rows, jump, flux), ExtraPoint(rows, geometry.foot_point[rows], own, feet=feet)


def couple(geometry: GhostGeometry, law: Interface, rows: Ints, inside: Inside, behind: Inside) -> Continued:
    """Return what the ghosts ``rows`` read at points on the side that they carry, ``inside``, and on their own."""
    seen, spacing = geometry.seen.take(rows), geometry.spacing
    materials = conductivities(law, geometry.boundaries.diffusivity, seen, seen.signed < 0, geometry.lattice)
    at = arc_length(seen.distance, np.linalg.norm(behind.curvature, axis=1))
    own, carried, jump, flux = coupled_weights(
        law, materials, behind.positions, inside.positions, at, seen.signed < 0, spacing
    )
    ahead, here = polynomial_weights(0.0, np.ones(len(rows)), inside.positions, at, spacing)
    data = _data(geometry, law, rows, jump, flux)
    return Continued(rows, inside.terms(rows, carried), behind.terms(rows, own), data, here, inside.terms(rows, ahead))


def _data(geometry: GhostGeometry, law: Interface, rows: Ints, jump: Floats, flux: Floats) -> list[BoundaryData]:
    where, what = geometry.at_boundary(rows), geometry.what
    return [
        BoundaryData(rows, jump, where, law.jump, f"the jump of {what}", law),
        BoundaryData(rows, flux, where, law.flux, f"the flux of {what}", law),
    ]


def transmission_weights(
    law: Interface, k_own: Floats, k_carried: Floats, s: Floats, carries_left: Bools
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return how ghosts of order 1 read: the factors (n,) of u where they stand, of u(mirror), jump and flux.

    ``k_own`` and ``k_carried`` (n,) are the conductivities on the sides where they stand and that they carry.
    Means and differences of the four values at a ghost and its mirror point, a distance s apart, two of them ghosts,
    replace values and slopes. Where the second derivatives on the two sides differ, the ghosts are off by ``s^2``,
    and the flux by one order less.
    """
    contact = 2 * law.resistance * k_own * k_carried
    if law.resistance == 0:
        divisor, own, mirror, flux = k_own + k_carried, 2 * k_own, k_carried - k_own, s
    else:
        divisor = s * (k_own + k_carried) + contact
        own, mirror, flux = 2 * s * k_own, s * (k_carried - k_own) + contact, s * s
    own = own / divisor
    sign = np.where(carries_left, -1.0, 1.0)
    return own, mirror / divisor, -own * sign, flux / divisor + own * 0.5 * law.resistance


def coupled_weights(
    law: Interface,
    conductivities: tuple[Floats, Floats],
    own: Floats,
    carried: Floats,
    at: Floats,
    carries_left: Bools,
    spacing: float,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return how ghosts read: weights (n, k) on their own side, and beyond, and the factors (n,) of jump and flux.

    On each side a polynomial of degree k through the values there; the conditions hold between them at the boundary.

    Parameters
    ----------
    law : Interface
        With its resistance.
    conductivities : two (n,) float64
        On the ghost's own side, and on the side that it carries.
    own, carried : (n, k) float64
        Arc lengths from the boundary to the points on the ghost's own side, and on the side that it carries.
    at : (n,) float64
        Arc length from the boundary to the ghost.
    carries_left : (n,) bool
        Which ghosts carry the left side.
    spacing : float
        Unit of length in which the small systems are well scaled.
    """
    n, k = own.shape
    powers, size = np.arange(k + 1), k + 1
    k_own, k_carried = conductivities
    system = np.zeros((n, 2 * size, 2 * size))
    system[:, :k, :size] = (own / spacing)[:, :, None] ** powers
    system[:, k : 2 * k, size:] = (-carried / spacing)[:, :, None] ** powers
    half = 0.5 * law.resistance / spacing
    unit = 1.0 / (1.0 + half * (k_own + k_carried))  # rows alike in size, however large the resistance
    system[:, 2 * k, 0], system[:, 2 * k, size] = unit, -unit
    system[:, 2 * k, 1], system[:, 2 * k, size + 1] = -half * k_own * unit, -half * k_carried * unit
    largest = np.maximum(k_own, k_carried)
    system[:, 2 * k + 1, 1], system[:, 2 * k + 1, size + 1] = k_own / largest, -k_carried / largest
    value = np.zeros((n, 2 * size, 1))
    value[:, size:, 0] = (at / spacing)[:, None] ** powers
    weights = np.linalg.solve(system.transpose(0, 2, 1), value)[:, :, 0]
    jump = np.where(carries_left, -1.0, 1.0) * unit * weights[:, 2 * k]
    return weights[:, :k], weights[:, k : 2 * k], jump, -spacing / largest * weights[:, 2 * k + 1]
