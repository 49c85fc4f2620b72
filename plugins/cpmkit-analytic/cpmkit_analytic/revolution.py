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
    upper = np.arange(len(radius) if closed else len(radius) - 1)
    return vertices, _strip_triangles(starts, counts, upper, (upper + 1) % len(radius))


def _strip_triangles(starts: Ints, counts: Ints, upper: Ints, lower: Ints) -> Ints:
    """Return the triangles between rings ``upper`` (s,) and ``lower`` (s,), strip by strip, one on each edge.

    Walk both rings at once; each steps when the other has passed the middle of its edge, edges of the upper one first.
    In integers both always agree about who steps first.
    """
    rings = np.stack([starts[upper], starts[lower], counts[upper], counts[lower]])
    strip, i = _edges(counts[upper])
    a, b, n, m = rings[:, strip]
    passed = -((n - (2 * i + 1) * m) // (2 * n)) % m  # of the lower ring's middles, those before this edge's
    on_upper = np.stack([a + i, b + passed, a + (i + 1) % n], axis=1)
    other, j = _edges(counts[lower])
    a, b, n, m = rings[:, other]
    passed = (((2 * j + 1) * n - m) // (2 * m) + 1) % n
    on_lower = np.stack([b + j, b + (j + 1) % m, a + passed], axis=1)
    order = np.argsort(np.concatenate([strip, other]), kind="stable")
    return np.asarray(np.concatenate([on_upper, on_lower])[order], dtype=np.int64)


def _edges(counts: Ints) -> tuple[Ints, Ints]:
    """Return the strip (k,) and the number (k,) of each edge of rings with so many vertices; a pole has none."""
    edges = np.where(counts > 1, counts, 0)
    strip = np.repeat(np.arange(len(edges)), edges)
    return strip, np.arange(len(strip)) - (np.cumsum(edges) - edges)[strip]
