"""Directions of many vectors, safe from overflow, underflow and zero."""

from __future__ import annotations

from functools import reduce

import numpy as np

from cpmkit.plugin import Floats, norms


def normalize_or_default(vectors: Floats, default: tuple[float, ...]) -> Floats:
    """Return vectors (n, d) scaled to length one; in place of a zero vector, ``default`` (d,) scaled alike.

    Each is divided by its largest component first: the square of 1e-170 would vanish, and a query that near to a centre
    would leave the sphere.
    """
    largest = reduce(np.maximum, np.abs(vectors).T)[:, None]
    scaled = np.where(largest > 0, vectors, default) / np.where(largest > 0, largest, 1.0)
    return scaled / norms(scaled)[:, None]
