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
from cpmkit.manifold.tangent_space import outward_conormals, unit_normals
from cpmkit.manifold.vectors import norms
from cpmkit.protocols import Bools, ClosestPoints, Floats, Ints

#: Sides of a corner are looked for so many spacings beside it, on either side.
BESIDE_SPACINGS = 0.6
#: And so much of that past the rim: feet of points on it may count as inside.
OUTWARD_SHARE = 0.1
#: Fluxes are read nearer to the corner by this factor, where they are those of its sides and hardly others than there.
READ_SHARE = 0.05
#: A node that lies less far beyond a side, in spacings, is not beyond it.
LEAST_BEYOND_SPACINGS = 1e-9
#: Turns of the ways beside a foot on a solid.
THIRDS = np.array([0.0, 2.0, 4.0]) * np.pi / 3
#: Points of a rim on both sides of one that are farther apart than this share of the most have no corner between them.
STRAIGHT_SHARE = 0.97
#: Their conormals are taken from closest points so many spacings around them: a corner nearer than that bends them.
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
        How far the node lies beyond each: the sum of these times the conormals there is its way from the corner.
    """

    rows: Ints
    points: Floats
    loops: Ints
    beyond: Floats

    def take(self, kept: Bools) -> RimCorners:
        """Return those that are ``kept`` (k,)."""
        return RimCorners(self.rows[kept], self.points[kept], self.loops[kept], self.beyond[kept])


def rim_corners(
    surface: LocalSource, feet: ClosestPoints, beyond: Floats, outward: Floats, spacing: float
) -> list[RimCorners]:
    """Return the corners among ``feet`` on a rim, of surfaces and of solids, where a curve has none.

    Parameters
    ----------
    surface : LocalSource
        The manifold.
    feet : ClosestPoints
        Of n nodes.
    beyond, outward : (n, d) float64
        The ways from the feet to the nodes, and the conormals at the feet.
    spacing : float
        Of the lattice.
    """
    dimension = surface.dimensions_at(feet)
    found = []
    for m in range(2, surface.dim + 1):
        rows = np.flatnonzero(dimension == m)
        if len(rows):
            found.append(_corners(surface, feet.take(rows), beyond[rows], outward[rows], spacing, rows))
    return [one for one in found if len(one.rows)]


def _corners(
    surface: LocalSource, feet: ClosestPoints, beyond: Floats, outward: Floats, spacing: float, rows: Ints
) -> RimCorners:
    """Return the same of feet on parts of one dimension, which are numbered by ``rows``."""
    reach = BESIDE_SPACINGS * spacing
    ways = _across(surface, feet, outward, spacing)
    places = feet.points[:, None] + reach * (ways + OUTWARD_SHARE * outward[:, None])
    sides = surface.closest_point(places.reshape(-1, surface.dim))
    points = sides.points.reshape(places.shape)
    half = places.shape[1] // 2
    bent = norms(points[:, :half] - points[:, half:]) < 2 * STRAIGHT_SHARE * reach
    kept = np.flatnonzero(bent.any(axis=1) & (sides.edge.reshape(len(rows), -1) >= 0).all(axis=1))
    there = (kept[:, None] * places.shape[1] + np.arange(places.shape[1])).ravel()
    conormals = outward_conormals(surface, sides.take(there), CONORMAL_SPACINGS * spacing)
    conormals = conormals.reshape(len(kept), *places.shape[1:]) * np.tile(bent[kept], (1, 2))[:, :, None]
    inverse = np.linalg.pinv(conormals.transpose(0, 2, 1), rcond=LEAST_SINGULAR_SHARE)
    shares = np.einsum("nsd,nd->ns", inverse, beyond[kept])
    shares = np.where(shares > LEAST_BEYOND_SPACINGS * spacing, shares, 0.0)
    ways = points[kept] - feet.points[kept, None] + OUTWARD_SHARE * reach * conormals
    beside = surface.closest_point((feet.points[kept, None] + READ_SHARE * ways).reshape(-1, surface.dim))
    loops = sides.edge.reshape(len(rows), -1)[kept]
    return RimCorners(rows[kept], beside.points.reshape(ways.shape), loops, shares)


def _across(surface: LocalSource, feet: ClosestPoints, outward: Floats, spacing: float) -> Floats:
    """Return unit ways (n, s, d) in the tangent space at right angles to ``outward``, then their opposites.

    On a solid there are three: one may run along an edge, where it meets no side.
    """
    others = outward[:, None]
    if (surface.dimensions_at(feet) < surface.dim).all():
        others = np.stack([outward, unit_normals(surface, feet, 0.5 * spacing)], axis=1)
    basis = np.linalg.svd(others)[2][:, others.shape[1] :]
    turns = np.eye(1) if basis.shape[1] == 1 else np.stack([np.cos(THIRDS), np.sin(THIRDS)], axis=1)
    ways = np.einsum("sk,nkd->nsd", turns, basis)
    return np.asarray(np.concatenate([ways, -ways], axis=1))
