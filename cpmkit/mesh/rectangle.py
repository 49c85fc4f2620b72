"""A rectangle of the plane as a regular triangulation."""

from __future__ import annotations

import numpy as np

from cpmkit.types import Floats, Ints


def rectangle(lower: Floats, upper: Floats, spacing: float) -> tuple[Floats, Ints]:
    """Return vertices (v, 2) of a regular triangulation between opposite corners, and its triangles (m, 3).

    Triangles are counterclockwise; the legs are at most ``spacing`` long.
    """
    counts = np.maximum(np.ceil((upper - lower) / spacing).astype(np.int64), 1) + 1
    axes = [np.linspace(low, high, count) for low, high, count in zip(lower, upper, counts, strict=True)]
    vertices = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    number = np.arange(len(vertices)).reshape(counts)
    a, b, c, d = number[:-1, :-1].ravel(), number[1:, :-1].ravel(), number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    return vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
