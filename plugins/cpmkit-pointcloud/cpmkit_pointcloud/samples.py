"""Operations on samples: a k-d tree, nearest samples, and thinning for pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import Floats, Ints, positive, thread_count

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


def build_kd_tree(points: Floats) -> cKDTree:
    """Return a k-d tree of ``points``."""
    from scipy.spatial import cKDTree

    return cKDTree(points)


def thin_out(points: Floats, spacing: float) -> Floats:
    """Return (k, d) of each cube of side ``spacing`` / 2 the one of ``points`` (n, d) nearest to its centre.

    Their order stays. Drawn as discs, they overlap. Raise InputError if ``spacing`` is not a number above zero.
    """
    place = (points - points.min(axis=0)) / (0.5 * positive(spacing, "spacing"))
    cube = np.floor(place)
    order = np.argsort(np.sum((place - cube - 0.5) ** 2, axis=1), kind="stable")
    first = np.unique(cube[order], axis=0, return_index=True)[1]
    return points[np.sort(order[first])]


def as_cells(points: Floats) -> tuple[Floats, Ints]:
    """Return ``points`` (v, d) and a cell (v, 1) for each."""
    return points, np.arange(len(points))[:, None]


def query_nearest_samples(tree: cKDTree, x: Floats) -> tuple[Floats, Ints]:
    """Return (n,) the distance of each of ``x`` (n, d) to the nearest sample in ``tree``, and (n,) its row."""
    distance, nearest = tree.query(x, workers=thread_count())
    return distance, nearest.astype(np.int64)
