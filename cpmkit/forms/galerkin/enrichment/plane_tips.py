"""Ends of curves in a plane solid: discs for singular functions, and the quadrature of products with these.

The samples of a solid are Gauss points of lattice cells. Near a tip the products are not smooth enough for them. There
a cell is the signed sum of fans from the tip to the edges of the cell: a point of the fan of an edge point y is the tip
plus s^4 (y - tip), in coordinates in which the curve is straight, with Gauss points in s and along the edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cpmkit.forms.galerkin.conditions.boundary_samples import BoundarySamples
from cpmkit.forms.galerkin.enrichment.singular_functions import (
    AT_TIP_SPACINGS,
    PARABOLA_SHARE,
    RADIUS_SHARE,
    TipDisc,
    axes_at_tip,
)
from cpmkit.manifold.vector_algebra import norms
from cpmkit.mesh.cell_quadrature import Samples
from cpmkit.mesh.solid_moments import FULL_POINTS, MOMENTS, gauss_points
from cpmkit.mesh.solid_pieces import SolidPatches
from cpmkit.types import Floats, Ints, SparseMatrix

#: Cells at most so many cells from that of a tip, along each axis, are divided into fans.
NEAR_CELLS = 2
#: Numbers of Gauss points of a fan: from the tip outwards, and along each part of an edge.
OUTWARD_POINTS, EDGE_POINTS = 14, 5
#: An edge is divided at its point nearest to the tip, and at twice, four times ... the distance of that point; the
#: distance counts as at least this share of the spacing.
LEAST_DISTANCE_SHARE, DOUBLINGS = 1e-3, 12


@dataclass(frozen=True, eq=False)
class TipSamples:
    """Quadrature points near tips, in place of the samples of some patches."""

    points: Floats  #: (k, 2), relative to the lattice's origin.
    patch: Ints  #: (k,): the patch whose functions are integrated.
    weights: Floats  #: (k,), of either sign.
    from_samples: SparseMatrix  #: (k, p): a linear fit to the values at the p samples inside, patch by patch.
    replaced: Ints  #: (n,): the patches whose samples they replace, ascending.


def plane_tip_disc(
    tip: Floats, number: int, others: Floats, boundary: BoundarySamples, samples: Samples, cells: Ints, spacing: float
) -> TipDisc:
    """Return the disc around ``tip`` (2,), an end of the boundary with this ``number``; its radius may be very small.

    ``others`` (k, 2) are the other tips, ``samples`` those inside the solid, ``cells`` (p, 2) the lattice cells of the
    patches.
    """
    own = (boundary.owner == number) & ~boundary.beyond_tip
    disc = axes_at_tip(tip, boundary.points[own] - tip, spacing, lambda v: np.array([-v[1], v[0]]))
    x, y = disc.coordinates(boundary.points[own])
    distance = np.hypot(x, y)
    off = ((x > 0) | (np.abs(y) > PARABOLA_SHARE * distance)) & (distance > AT_TIP_SPACINGS * spacing)
    ends = [distance[off], *(disc.distance(each) for each in (boundary.points[boundary.owner != number], others))]
    disc = replace(disc, radius=RADIUS_SHARE * float(np.concatenate(ends).min(initial=np.inf)))
    near = np.flatnonzero(norms(spacing * cells - tip) < 1.5 * disc.radius + spacing)
    return replace(disc, cells=near, sides=_sides_of_patches(disc, samples, len(cells))[near])


def gathered_at_tips(boundary: BoundarySamples, tips: Sequence[Floats], length: float) -> BoundarySamples:
    """Return the samples with those at a distance r below ``length`` from one of the ``tips`` (2,) moved towards it.

    They move to ``length (r / length)^4``, and weights with them: slopes like r^(-1/2) and r^(-3/4) are then integrated
    exactly there.
    """
    points, weights = boundary.points.copy(), boundary.weights.copy()
    for tip in tips:
        distance = norms(boundary.points - tip)
        rows = np.flatnonzero((distance < length) & (boundary.owner >= 0))
        share = (distance[rows] / length) ** 3
        points[rows] = tip + share[:, None] * (points[rows] - tip)
        weights[rows] *= 4 * share
    return replace(boundary, points=points, weights=weights)


def _sides_of_patches(disc: TipDisc, samples: Samples, count: int) -> Ints:
    """Return (count,) the side of the curve, continued, on which the centre of each patch lies: 1 left, -1 right."""
    moments = [
        np.bincount(samples.cell, samples.weights * x, count) for x in (np.ones(len(samples)), *samples.points.T)
    ]
    centres = np.stack(moments[1:], axis=1) / moments[0][:, None]
    return np.where(_straightened(disc, centres)[1] < 0, -1, 1)


def _straightened(disc: TipDisc, points: Floats) -> tuple[Floats, Floats]:
    """Return coordinates of ``points`` (..., 2) in which the curve is straight, with its straight continuation."""
    apart = points - disc.origin
    x = apart @ disc.heading
    return x, apart @ disc.leftward - 0.5 * disc.curvature * np.minimum(x, 0.0) ** 2


def tip_samples(discs: Sequence[TipDisc], patches: SolidPatches, samples: Samples, spacing: float) -> TipSamples:
    """Return the quadrature points near the tips of ``discs``; ``samples`` are those inside the solid."""
    centres = spacing * patches.cells
    distance = np.array([norms(centres - disc.origin) for disc in discs])
    found, replaced = [], []
    for disc, own in zip(discs, distance, strict=True):
        tip_cell = np.floor(disc.origin / spacing + 0.5).astype(np.int64)
        near = (np.abs(patches.cells[disc.cells] - tip_cell) <= NEAR_CELLS).all(axis=1)
        near &= own[disc.cells] == distance[:, disc.cells].min(axis=0)  # a cell belongs to the nearest tip
        rows = disc.cells[near]
        replaced.append(rows)
        found.append(_fans(disc, rows, patches.cells[rows], spacing))
    points, weights, patch = (np.concatenate(each) for each in zip(*found, strict=True))
    take = _linear_fit(points / spacing, patch, patches, len(samples))
    return TipSamples(points, patch, weights, take, np.unique(np.concatenate(replaced)))


def _fans(disc: TipDisc, patches: Ints, cells: Ints, spacing: float) -> tuple[Floats, Floats, Ints]:
    """Return points (k, 2), weights (k,) and patches (k,) of the fans to the edges of ``cells`` (n, 2).

    ``patches`` (n,) lie in the cells. Where a cell has two, each point belongs to that on its side of the curve.
    """
    corners = spacing * (cells[:, None] + np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]))
    start, along = corners.reshape(-1, 2), (np.roll(corners, -1, axis=1) - corners).reshape(-1, 2)
    cuts = _cuts_of_edges(disc, start, along, spacing)
    x, w = np.polynomial.legendre.leggauss(EDGE_POINTS)
    length = np.diff(cuts, axis=1)[..., None]
    at = cuts[:, :-1, None] + 0.5 * length * (x + 1)  # (edges, parts, points): share of the edge
    on_edge = start[:, None, None] + at[..., None] * along[:, None, None]
    u, v = _straightened(disc, on_edge)
    du = (along @ disc.heading)[:, None, None]
    dv = (along @ disc.leftward)[:, None, None] - disc.curvature * np.minimum(u, 0.0) * du
    weight = 0.5 * length * w * (u * dv - v * du)
    is_left = np.broadcast_to(v.mean(axis=2, keepdims=True) >= 0, v.shape)
    row = np.broadcast_to(np.repeat(np.arange(len(cells)), 4)[:, None, None], v.shape)
    sides = disc.side_of(patches)[1]
    several = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    is_shared = (several[2][several[1].ravel()] > 1)[row]
    kept = (weight != 0) & (~is_shared | (np.where(is_left, 1, -1) == sides[row]))
    s, ws = np.polynomial.legendre.leggauss(OUTWARD_POINTS)
    s = 0.5 * (s + 1)
    share, ws = s**4, 0.5 * ws * 4 * s**7  # of the distance, and its square's derivative
    u, v, weight = (np.outer(each[kept], factor).ravel() for each, factor in ((u, share), (v, share), (weight, ws)))
    v = v + 0.5 * disc.curvature * np.minimum(u, 0.0) ** 2
    apart = u[:, None] * disc.heading + v[:, None] * disc.leftward
    return disc.origin + apart, weight, np.repeat(patches[row[kept]], len(s))


def _cuts_of_edges(disc: TipDisc, start: Floats, along: Floats, spacing: float) -> Floats:
    """Return shares (e, k) of the edges from ``start`` (e, 2) along ``along`` (e, 2) where they are divided, ascending.

    Edges are divided where they cross the curve or its continuation, and ever more finely towards the point nearest to
    the tip.
    """
    size = norms(along)
    foot = np.einsum("ed,ed->e", disc.origin - start, along) / size**2
    gap = np.maximum(norms(start + foot[:, None] * along - disc.origin), LEAST_DISTANCE_SHARE * spacing) / size
    steps = gap[:, None] * 2.0 ** np.arange(DOUBLINGS)
    # on the curve Y = c0 + c1 s + c2 s^2 vanishes at share s, on the continuation y, and X where the two meet
    (x, c0), dx, dy = disc.coordinates(start), along @ disc.heading, along @ disc.leftward
    c1, c2 = dy - disc.curvature * x * dx, -0.5 * disc.curvature * dx**2
    root = np.sqrt(np.maximum(c1**2 - 4 * c2 * c0, 0.0))
    q = -0.5 * (c1 + np.where(c1 < 0, -root, root))
    quotients = (c0, q), (q, c2), (-(start - disc.origin) @ disc.leftward, dy), (-x, dx)
    crossings = [np.divide(a, b, out=np.zeros_like(a), where=b != 0) for a, b in quotients]
    near = foot[:, None]
    parts = [np.zeros((len(size), 1)), np.ones((len(size), 1)), near, near - steps, near + steps]
    return np.sort(np.clip(np.concatenate([*parts, np.stack(crossings, axis=1)], axis=1), 0, 1), axis=1)


def _linear_fit(points: Floats, patch: Ints, patches: SolidPatches, count: int) -> SparseMatrix:
    """Return the matrix (k, count) that fits linear functions to samples of each patch, and evaluates them.

    ``points`` (k, 2), in spacings, lie in or near the patches ``patch`` (k,). Samples are Gauss points, by patch.
    """
    from scipy.sparse import csr_array

    is_cut = patch < patches.cut
    numbers = np.where(is_cut, MOMENTS**2, FULL_POINTS**2)
    first = np.where(is_cut, patch * MOMENTS**2, patches.cut * MOMENTS**2 + (patch - patches.cut) * FULL_POINTS**2)
    starts = np.concatenate([[0], np.cumsum(numbers)])
    entries, offset = np.empty(starts[-1]), points - patches.cells[patch]
    for side, cut in ((MOMENTS, True), (FULL_POINTS, False)):
        nodes, rows = gauss_points(side, 2)[0] - 0.5, np.flatnonzero(is_cut == cut)
        fit = 1 / len(nodes) + offset[rows] @ (nodes / (nodes**2).sum(axis=0)).T
        entries[starts[rows][:, None] + np.arange(side**2)] = fit
    columns = np.repeat(first - starts[:-1], numbers) + np.arange(starts[-1])
    return csr_array((entries, columns, starts), shape=(len(points), count))
