"""Ghosts of a transmission condition, whose values depend on both sides through the jumps of value and flux.

With A the side of a ghost's node and B the side whose solution it continues, ``u_A - u_B = jump + R (mean flow)``
and ``k_A u_A' - k_B u_B' = -flux`` at the boundary, derivatives along the arc from B to A. A ghost of order 2 reads
points at one and two spacings on each side; where there is no room for them, it is of order 1 and reads its own node
and its mirror point.
King et al. (2024), section 8, leaves such conditions open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.errors import InputError
from cpmkit.forms.collocation.ghosts.ghost_geometry import GhostGeometry, is_beyond_other_boundary, points_at_two_steps
from cpmkit.forms.collocation.row_formula import BoundaryData, ExtraPoint, extrapolation_weights
from cpmkit.forms.collocation.side_view import SideView
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.vector_algebra import norms
from cpmkit.scene.data import Data, evaluate_data
from cpmkit.scene.diffusivities import SAME_MATERIAL_LOG_RATIO, check_conductivity
from cpmkit.scene.laws import Interface
from cpmkit.types import Bools, Floats, Ints

#: A diffusivity is read at these distances from the boundary, in spacings: a curve that is snapped to the surface
#: is nearer than that to the place where the materials meet.
READ_BESIDE_SPACINGS = (0.25, 0.5)


@dataclass(frozen=True, eq=False)
class CoupledGhosts:
    """Ghosts of order 2 of a transmission."""

    rows: Ints  #: (k,): the numbers of the ghosts among those of the boundary.
    #: terms_beyond, own_terms: Points that the ghosts read on the side that they continue, and on that of their nodes.
    terms_beyond: list[ExtraPoint]
    own_terms: list[ExtraPoint]
    data: list[BoundaryData]  #: The jumps of value and flux.
    source_factor: Floats  #: (k,): factor of a right-hand side read at the boundary.
    source_terms: list[ExtraPoint]  #: Further points at which the right-hand side is read.


def second_order_ghosts(geometry: GhostGeometry, law: Interface, rows: Ints) -> CoupledGhosts | None:
    """Return those of the ghosts ``rows`` with room for two points on each side of the boundary; None if none has."""
    (inside, has_room), (behind, has_room_behind) = (_points_on_side(geometry, rows, sign) for sign in (1.0, -1.0))
    chosen = np.flatnonzero(has_room & has_room_behind)
    if not len(chosen):
        return None
    rows, seen = rows[chosen], geometry.seen.take(rows[chosen])
    inside, behind = ([on.take(chosen) for on in points] for points in (inside, behind))
    beyond_at, own_at = (np.stack([norms(on.points - seen.foot) for on in points], 1) for points in (inside, behind))
    materials = conductivities(law, geometry.boundaries.diffusivity, seen, geometry.lattice)
    own, beyond, jump, flux = second_order_weights(
        law, materials, own_at, beyond_at, seen.distance, seen.signed < 0, geometry.spacing
    )
    nodes = np.concatenate([np.zeros((len(rows), 1)), -beyond_at], axis=1)
    source_weights = extrapolation_weights(nodes, seen.distance)
    return CoupledGhosts(
        rows,
        _extra_points(rows, inside, beyond),
        _extra_points(rows, behind, own),
        _jumps(geometry, law, rows, jump, flux),
        source_weights[:, 0],
        _extra_points(rows, inside, source_weights[:, 1:]),
    )


def _points_on_side(geometry: GhostGeometry, rows: Ints, sign: float) -> tuple[list[ClosestPoints], Bools]:
    """Return k points one spacing and k two spacings from the boundary, and whether (k,) the ghosts ``rows`` read both.

    ``sign`` is 1 for points beyond the boundary and -1 for those on the ghosts' own side.
    """
    boundary, spacing = geometry.boundary, geometry.spacing
    start = None if geometry.start is None else geometry.start.take(rows)
    points, complete = points_at_two_steps(
        boundary, geometry.seen.foot[rows], start, sign * geometry.direction[rows], spacing
    )
    blocked = is_beyond_other_boundary(geometry, rows, points[-1].points, 2 * len(points) * spacing)
    return points, complete & ~blocked & boundary.has_sides


def _extra_points(rows: Ints, points: list[ClosestPoints], weights: Floats) -> list[ExtraPoint]:
    """Return the ``points`` as further points that ``rows`` (k,) read with ``weights`` (k, 2)."""
    return [ExtraPoint(rows, on.points, weights[:, j], feet=on) for j, on in enumerate(points)]


def first_order_ghosts(
    geometry: GhostGeometry, law: Interface, rows: Ints
) -> tuple[Floats, list[BoundaryData], ExtraPoint]:
    """Return weights (k,) of u(mirror) in the ghosts ``rows`` (k,), their data, and the terms of u at their nodes."""
    seen = geometry.seen.take(rows)
    s = norms(geometry.foot_point[rows] - geometry.mirror.points[rows])
    materials = conductivities(law, geometry.boundaries.diffusivity, seen, geometry.lattice)
    own, mirror, jump, flux = first_order_weights(law, *materials, s, seen.signed < 0)
    feet = None if geometry.own_feet is None else geometry.own_feet.take(rows)
    return mirror, _jumps(geometry, law, rows, jump, flux), ExtraPoint(rows, geometry.foot_point[rows], own, feet=feet)


def _jumps(geometry: GhostGeometry, law: Interface, rows: Ints, jump: Floats, flux: Floats) -> list[BoundaryData]:
    """Return the jump and the flux of ``law`` as data of the ghosts ``rows`` (k,), with factors ``jump``, ``flux``."""
    points = geometry.boundary_points(rows)
    return [
        BoundaryData(rows, jump, points, law.jump, geometry.name, law, "jump"),
        BoundaryData(rows, flux, points, law.flux, geometry.name, law, "flux"),
    ]


def first_order_weights(
    law: Interface, k_own: Floats, k_beyond: Floats, s: Floats, continues_left: Bools
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the weights (n,) of u at the ghost's node, of u(mirror), of the jump and of the flux, in this order.

    Values and slopes at the boundary are replaced by means and differences of the four values at a ghost's node and its
    mirror point, a distance ``s`` (n,) apart, two of which are ghosts. ``k_own`` and ``k_beyond`` (n,) are the
    conductivities on the node's own side and on the side that the ghost continues: the left where ``continues_left``.
    Where second derivatives on the two sides differ, the error of ghosts is of order ``s^2``, of the flux ``s``.
    """
    contact = 2 * law.resistance * k_own * k_beyond
    if law.resistance == 0:
        divisor, own, mirror, flux = k_own + k_beyond, 2 * k_own, k_beyond - k_own, s
    else:
        divisor = s * (k_own + k_beyond) + contact
        own, mirror, flux = 2 * s * k_own, s * (k_beyond - k_own) + contact, s * s
    own = own / divisor
    sign = np.where(continues_left, -1.0, 1.0)
    return own, mirror / divisor, -own * sign, flux / divisor + own * 0.5 * law.resistance


def second_order_weights(
    law: Interface,
    materials: tuple[Floats, Floats],
    own: Floats,
    beyond: Floats,
    at: Floats,
    continues_left: Bools,
    spacing: float,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the weights (n, k) on the ghost's own side and beyond, and the factors (n,) of the jump and the flux.

    On each side a polynomial of degree k interpolates the k values; two conditions at the boundary determine the rest.

    ``law``: the law, with its resistance.
    ``materials`` two (n,) float64: conductivities on the ghost's own side, and on the side that it continues.
    ``own``, ``beyond`` (n, k): distances, above zero, of the points on these sides from the boundary.
    ``at`` (n,): distance of the ghost from the boundary.
    ``continues_left`` (n,): whether the ghost continues the left side.
    ``spacing``: unit of length in which the small systems are well scaled.
    """
    n, k = own.shape
    powers, size = np.arange(k + 1), k + 1
    k_own, k_beyond = materials
    system = np.zeros((n, 2 * size, 2 * size))
    system[:, :k, :size] = (own / spacing)[:, :, None] ** powers
    system[:, k : 2 * k, size:] = (-beyond / spacing)[:, :, None] ** powers
    half = 0.5 * law.resistance / spacing
    unit = 1.0 / (1.0 + half * (k_own + k_beyond))  # rows of similar size for any resistance
    system[:, 2 * k, 0], system[:, 2 * k, size] = unit, -unit
    system[:, 2 * k, 1], system[:, 2 * k, size + 1] = -half * k_own * unit, -half * k_beyond * unit
    largest = np.maximum(k_own, k_beyond)
    system[:, 2 * k + 1, 1], system[:, 2 * k + 1, size + 1] = k_own / largest, -k_beyond / largest
    value = np.zeros((n, 2 * size, 1))
    value[:, size:, 0] = (at / spacing)[:, None] ** powers
    weights = np.linalg.solve(system.transpose(0, 2, 1), value)[:, :, 0]
    jump = np.where(continues_left, -1.0, 1.0) * unit * weights[:, 2 * k]
    return weights[:, :k], weights[:, k : 2 * k], jump, -spacing / largest * weights[:, 2 * k + 1]


def conductivities(law: Interface, diffusivity: Data, side_view: SideView, lattice: Lattice) -> tuple[Floats, Floats]:
    """Return the conductivities (n,) on the side of the ghosts' nodes, and on the side that the ghosts continue.

    Conductivities are given by the condition, or else the problem's ``diffusivity``, at boundary points of
    ``side_view``.
    Raises InputError if one is not positive.
    """
    left, right = (
        _boundary_conductivity(diffusivity if data is None else data, side_view, sign, lattice)
        for data, sign in ((law.left, 1.0), (law.right, -1.0))
    )
    continues_left = side_view.signed < 0
    return np.where(continues_left, right, left), np.where(continues_left, left, right)


def check_conductivities(name: str, law: Interface, diffusivity: Data, side_view: SideView, lattice: Lattice) -> None:
    """Raise SceneError if a transmission's conductivities differ from the problem's ``diffusivity`` beside it.

    ``name`` is the boundary's name in the error, ``side_view`` has the points of the boundary where they are compared.
    """
    for side, data, sign in (("left", law.left, 1.0), ("right", law.right, -1.0)):
        if data is None or not len(side_view.rows):
            continue
        conductivity = _boundary_conductivity(data, side_view, sign, lattice)
        accepted = [_conductivity(diffusivity, side_view, sign * share, lattice) for share in READ_BESIDE_SPACINGS]
        accepted.append(_boundary_conductivity(diffusivity, side_view, sign, lattice))
        check_conductivity(name, side, conductivity, accepted, lattice.to_scene(side_view.foot))


def _boundary_conductivity(data: Data, side_view: SideView, sign: float, lattice: Lattice) -> Floats:
    """Return the conductivity ``data`` (n,) at the boundary, from the left (``sign`` 1) or the right (-1).

    A function is extrapolated, of second order where it is smooth on that side; numbers are the same everywhere.
    """
    if not callable(data):
        return _conductivity(data, side_view, 0.0, lattice)
    first, second = (np.log(_conductivity(data, side_view, sign * share, lattice)) for share in READ_BESIDE_SPACINGS)
    return np.asarray(np.exp(np.where(np.abs(first - second) < SAME_MATERIAL_LOG_RATIO, 2 * first - second, second)))


def _conductivity(data: Data, side_view: SideView, share: float, lattice: Lattice) -> Floats:
    """Return a conductivity (n,) ``share`` spacings left of the boundary, right of it if ``share`` is negative.

    Raises InputError if it is not positive.
    """
    points = lattice.to_scene(side_view.foot + share * lattice.spacing * side_view.conormal)
    values = evaluate_data(data, points, 1, "a conductivity of Transmission, or the diffusivity,")[:, 0]
    if np.any(values <= 0):
        raise InputError(f"the diffusivity must be above zero, got {values.min():g}.")
    return values
