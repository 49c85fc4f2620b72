"""One triangulation for every surface of revolution: rings around the axis, stitched to each other.

A ring has as many vertices as its own length asks for, so triangles keep their shape towards a
pole; neighbouring rings share their vertices, so the mesh is watertight wherever the surface is.
"""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats, Ints


def intervals(length: float, spacing: float, least: int = 1) -> int:
    """Return into how many parts of at most ``spacing`` a length is cut, never fewer than ``least``."""
    return max(least, int(np.ceil(length / spacing * (1 - 1e-12))))


def revolve(radius: Floats, height: Floats, spacing: float, closed: bool = False) -> tuple[Floats, Ints]:
    """Return the triangulated surface that a profile sweeps around the z axis.

    Parameters
    ----------
    radius, height : (k,) float64
        The profile, walked with the outside at the left hand seen from +y with x to the right: a
        sphere from its north to its south pole. A radius of zero is a pole.
    spacing : float
        Length of the edges along the rings.
    closed : bool
        Stitch the last ring to the first.

    Returns
    -------
    vertices : (v, 3) float64
    triangles : (m, 3) int64
        Counterclockwise seen from outside.
    """
    counts = np.array([1 if r == 0 else intervals(2 * np.pi * r, spacing, least=3) for r in radius])
    starts = np.cumsum(counts) - counts
    ring = np.repeat(np.arange(len(radius)), counts)
    angle = 2 * np.pi * (np.arange(len(ring)) - starts[ring]) / counts[ring]
    vertices = np.stack([radius[ring] * np.cos(angle), radius[ring] * np.sin(angle), height[ring]], axis=1)
    upper = range(len(radius) if closed else len(radius) - 1)
    strips = [_strip(starts, counts, a, (a + 1) % len(radius)) for a in upper]
    return vertices, np.concatenate(strips)


def _strip(starts: Ints, counts: Ints, a: int, b: int) -> Ints:
    """Return the triangles between rings ``a`` and ``b``: one on each edge of either.

    Walk both rings at once; each steps when the other has passed the middle of its edge. In
    integers the two searches below always agree about who steps first.
    """
    n, m = int(counts[a]), int(counts[b])
    step_a, step_b = (2 * np.arange(n) + 1) * m, (2 * np.arange(m) + 1) * n
    opposite_in_b = np.searchsorted(step_b, step_a, side="left") % m
    opposite_in_a = np.searchsorted(step_a, step_b, side="right") % n
    i, j = np.arange(n if n > 1 else 0), np.arange(m if m > 1 else 0)
    on_a = np.stack([starts[a] + i, starts[b] + opposite_in_b[i], starts[a] + (i + 1) % n], axis=1)
    on_b = np.stack([starts[b] + j, starts[b] + (j + 1) % m, starts[a] + opposite_in_a[j]], axis=1)
    return np.concatenate([on_a, on_b]).astype(np.int64)
