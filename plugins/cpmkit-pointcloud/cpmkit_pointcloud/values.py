"""Data given a sample, read between the samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import Floats, Ints

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

#: Samples around a foot that its value is read from, by the dimension of the space.
VALUE_SAMPLES = {2: 5, 3: 12}
#: Directions in which the samples spread less than this, relative to the widest, carry no slope.
LEAST_SPREAD_SHARE = 1e-9


def interpolation_weights(feet: Floats, points: Floats, tree: cKDTree, tangents: Floats) -> tuple[Ints, Floats]:
    """Return the samples (n, k) around ``feet`` (n, d) and the weights (n, k) by which their data are summed.

    ``tree`` is that of the samples ``points`` (m, d). The weights are those of a linear function of the coordinates
    along the unit ``tangents`` (n, d - 1, d), fitted to the samples around, nearer ones counting more: they add up to
    1, and such functions are read as they are, if the samples spread in each of these directions.
    """
    n, dim = feet.shape
    count = min(VALUE_SAMPLES[dim], len(points))
    index = tree.query(feet, k=count)[1].reshape(n, count)
    offsets = points[index] - feet[:, None]
    square = np.einsum("nkd,nkd->nk", offsets, offsets)
    farthest = np.maximum(square.max(axis=1, keepdims=True), np.finfo(float).tiny)
    weights = np.exp(-3.0 * square / farthest)
    flat = np.einsum("nkd,ntd->nkt", offsets, tangents) / np.sqrt(farthest)[:, :, None]
    design = np.concatenate([np.ones((n, count, 1)), flat], axis=2)
    weighted = design * weights[:, :, None]
    inverse = np.linalg.pinv(np.swapaxes(design, 1, 2) @ weighted, rcond=LEAST_SPREAD_SHARE, hermitian=True)
    return index, np.einsum("nt,nkt->nk", inverse[:, 0], weighted)
