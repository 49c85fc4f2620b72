"""Edges of a cloud: samples with all neighbours on one side."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import Floats, Ints
from cpmkit_pointcloud.blend import Blend, find_feet

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

#: Samples at which an end of the surface is looked for.
RIM_CANDIDATES = 10_000
#: So many of them at a time: their neighbours' directions take more memory than a coarse solve.
PARCEL_CANDIDATES = 2_000
#: Neighbours whose directions are compared, on curves and on surfaces.
DIRECTION_NEIGHBOURS = {2: 3, 3: 16}
#: Radians without a neighbour in the tangent plane at a sample on the rim. Among samples inside, 7 in 10,000 have them.
OPEN_ANGLE_RADIANS = 2.6
#: How far beyond such a sample the surface is looked for, in radii of its patch.
OUT_RADII = 2.0
#: An open cloud has at least so many samples on its rim, and this share of all.
LEAST_RIM_SAMPLES, LEAST_RIM_SHARE = {2: 1, 3: 4}, 3e-4


def rim_samples(surface: Blend, tree: cKDTree, rows: Ints) -> tuple[Ints, Floats]:
    """Return the samples (m,) of ``rows`` with all neighbours on one side, and unit vectors (m, d) to the other side.

    ``tree`` is that of the samples. One side: of directions from the sample in the tangent plane, an angle of
    :data:`OPEN_ANGLE_RADIANS` holds no neighbour; of a curve, the nearest three neighbours lie in one direction.
    """
    points, dim = surface.points, surface.points.shape[1]
    count = min(DIRECTION_NEIGHBOURS[dim] + 1, len(points))
    index = tree.query(points[rows], k=count)[1].reshape(len(rows), count)[:, 1:]
    frames = surface.patches.frames[rows]
    flat = np.einsum("mtd,mkd->mkt", frames[:, :-1], points[index] - points[rows, None])
    if dim == 2:
        side = np.sign(flat[:, :, 0]).sum(axis=1)
        found = np.abs(side) == count - 1
        return rows[found], -np.sign(side[found])[:, None] * frames[found, 0]
    angle = np.sort(np.arctan2(flat[:, :, 1], flat[:, :, 0]), axis=1)
    gaps = np.diff(angle, axis=1, append=angle[:, :1] + 2 * np.pi)
    widest = gaps.argmax(axis=1)
    gap = np.take_along_axis(gaps, widest[:, None], 1)[:, 0]
    middle = np.take_along_axis(angle, widest[:, None], 1)[:, 0] + 0.5 * gap
    outward = np.cos(middle)[:, None] * frames[:, 0] + np.sin(middle)[:, None] * frames[:, 1]
    return rows[gap > OPEN_ANGLE_RADIANS], outward[gap > OPEN_ANGLE_RADIANS]


def count_open_samples(surface: Blend, tree: cKDTree, tiny: float) -> tuple[int, int]:
    """Return the number of samples at an edge of the surface, 0 if these may be chance, and that of samples examined.

    ``tree`` is that of the samples, of which :data:`RIM_CANDIDATES` at most, of a fixed seed, are examined; ``tiny`` is
    the length of a last step of the searches.
    """
    n, dim = surface.points.shape
    rows = np.sort(np.random.default_rng(0).choice(n, min(RIM_CANDIDATES, n), replace=False))
    parcels = np.array_split(rows, -(-len(rows) // PARCEL_CANDIDATES))
    found = [rim_samples(surface, tree, some) for some in parcels]
    rim, outward = (np.concatenate(parts) for parts in zip(*found, strict=True))
    beyond = np.ascontiguousarray(surface.points[rim] + OUT_RADII * surface.patches.radii[rim, None] * outward)
    lost = find_feet(surface, beyond, rim, tiny, True)[3]
    ends = int(lost.sum())
    return (ends if ends >= max(LEAST_RIM_SAMPLES[dim], LEAST_RIM_SHARE * len(rows)) else 0), len(rows)
