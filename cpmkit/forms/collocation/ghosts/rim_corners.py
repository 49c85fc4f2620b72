"""Fluxes at corners of a rim: nodes whose foot is the corner read the flux of each side, as far as they lie beyond it.

A node x past a rim with the foot y and the conormal b reads ``u(2 y - x) + 2 (x - y) . b du/db``. At a corner b jumps,
and a flux that is given at y alone is that of one side. With b_j the conormals beside the corner and
``x - y = sum t_j b_j`` in the tangent space, the last term is ``2 sum t_j du/db_j``, each flux read on its own side.
Differs from King et al. (2024), who have no flux at a rim with corners.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.tangent_space import outward_conormals, unit_normals
from cpmkit.manifold.vector_algebra import norms
from cpmkit.types import Bools, Floats, Ints

#: Sides of a corner are looked for so many spacings beside it, on either side,
BESIDE_SPACINGS = 0.6
#: and by this share of that past the rim: feet of points on it may count as inside.
OUTWARD_SHARE = 0.1
#: Fluxes are read nearer to the corner by this factor, where they are those of its sides and hardly others than there.
READ_SHARE = 0.05
#: A node that lies less far beyond a side, in spacings, is not beyond it.
LEAST_BEYOND_SPACINGS = 1e-9
#: Points of a rim on both sides of a foot that are farther apart than this share of the most have no corner between.
STRAIGHT_SHARE = 0.97
#: Conormals are differences over so many spacings: a corner nearer than that bends them.
CONORMAL_SPACINGS = 0.05
#: Directions of conormals that add less than this share of the strongest one are bends and rounding.
LEAST_SINGULAR_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class RimCorners:
    """Nodes whose feet are corners of a rim.

    Attributes
    ----------
    rows : (k,) int64
        Which of the nodes.
    points : (k, s, d) float64
        Points of the rim on the sides of each corner.
    loops : (k, s) int64
        The loops of the edge that these belong to.
    beyond : (k, s) float64
        How far the node lies beyond each side: these times the conormals there add up to its offset from the corner.
    """

    rows: Ints
    points: Floats
    loops: Ints
    beyond: Floats

    def take(self, chosen: Bools) -> RimCorners:
        """Return the ``chosen`` (k,) nodes."""
        return RimCorners(self.rows[chosen], self.points[chosen], self.loops[chosen], self.beyond[chosen])


def rim_corners(
    surface: LocalSource, feet: ClosestPoints, beyond: Floats, outward: Floats, spacing: float
) -> list[RimCorners]:
    """Return the corners among ``feet`` on a rim, of surfaces and of solids; a curve has none.

    Parameters
    ----------
    surface : LocalSource
        The manifold.
    feet : ClosestPoints
        Of n nodes.
    beyond, outward : (n, d) float64
        The offsets of the nodes from the feet, and the conormals at the feet.
    spacing : float
        Of the lattice.
    """
    dimension = surface.dimensions_at(feet)
    corners = []
    for m in range(2, surface.dim + 1):
        rows = np.flatnonzero(dimension == m)
        if len(rows):
            corners.append(_corners(surface, feet.take(rows), beyond[rows], outward[rows], spacing, rows))
    return [part for part in corners if len(part.rows)]


def _corners(
    surface: LocalSource, feet: ClosestPoints, beyond: Floats, outward: Floats, spacing: float, rows: Ints
) -> RimCorners:
    """Return the corners among feet on parts of one dimension, which are numbered by ``rows``."""
    reach = BESIDE_SPACINGS * spacing
    directions = _along_rim(surface, feet, outward, spacing)
    places = feet.points[:, None] + reach * (directions + OUTWARD_SHARE * outward[:, None])
    sides = surface.closest_point(places.reshape(-1, surface.dim))
    points, loops = sides.points.reshape(places.shape), sides.edge.reshape(len(rows), -1)
    count = places.shape[1]
    half = count // 2
    is_corner = norms(points[:, :half] - points[:, half:]) < 2 * STRAIGHT_SHARE * reach
    chosen = np.flatnonzero(is_corner.any(axis=1) & (loops >= 0).all(axis=1))
    entries = (chosen[:, None] * count + np.arange(count)).ravel()
    conormals = outward_conormals(surface, sides.take(entries), CONORMAL_SPACINGS * spacing)
    conormals = conormals.reshape(len(chosen), *places.shape[1:]) * np.tile(is_corner[chosen], (1, 2))[:, :, None]
    inverse = np.linalg.pinv(conormals.transpose(0, 2, 1), rcond=LEAST_SINGULAR_SHARE)
    shares = np.einsum("nsd,nd->ns", inverse, beyond[chosen])
    shares = np.where(shares > LEAST_BEYOND_SPACINGS * spacing, shares, 0.0)
    offsets = points[chosen] - feet.points[chosen, None] + OUTWARD_SHARE * reach * conormals
    readings = surface.closest_point((feet.points[chosen, None] + READ_SHARE * offsets).reshape(-1, surface.dim))
    return RimCorners(rows[chosen], readings.points.reshape(offsets.shape), loops[chosen], shares)


def _along_rim(surface: LocalSource, feet: ClosestPoints, outward: Floats, spacing: float) -> Floats:
    """Return unit vectors (n, s, d) in the tangent space at right angles to ``outward``, then their opposites.

    On a solid there are three, 120 degrees apart: one may run along an edge, where it meets no side.
    """
    others = outward[:, None]
    if (surface.dimensions_at(feet) < surface.dim).all():
        others = np.stack([outward, unit_normals(surface, feet, 0.5 * spacing)], axis=1)
    basis = np.linalg.svd(others)[2][:, others.shape[1] :]
    angles = np.arange(3) * 2 * np.pi / 3
    turns = np.eye(1) if basis.shape[1] == 1 else np.stack([np.cos(angles), np.sin(angles)], axis=1)
    directions = np.einsum("sk,nkd->nsd", turns, basis)
    return np.asarray(np.concatenate([directions, -directions], axis=1))
