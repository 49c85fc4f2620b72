"""One triangulation for every surface of revolution: rings around the axis, stitched to each other.

A ring has as many vertices as its own length asks for, so triangles keep their shape towards a
pole; neighbouring rings share their vertices, so the mesh is watertight wherever the surface is.
"""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats, Ints


def count_intervals(length: float, spacing: float, least: int = 1) -> int:
    """Return the number, at least ``least``, of parts of a length that are at most ``spacing`` to rounding."""
    return max(least, int(np.ceil(length / spacing * (1 - 1e-12))))


def revolve_profile(radius: Floats, height: Floats, spacing: float, closed: bool = False) -> tuple[Floats, Ints]:
    """Return the triangulated surface that a profile sweeps around the z axis.

    Parameters
    ----------
    radius, height : (k,) float64
        Distance from the axis and z of the profile's points, in the order that goes down where the outside is away from
        the axis: a sphere from its north to its south pole. A radius of exactly zero is a pole.
    spacing : float
        Greatest length of the edges along the rings.
    closed : bool
        Connect the last ring to the first.

    Returns
    -------
    vertices : (v, 3) float64
        Ring by ring, in each by growing angle from the x axis.
    triangles : (m, 3) int64
        Counterclockwise seen from outside.
    """
    counts = np.array([1 if r == 0 else count_intervals(2 * np.pi * r, spacing, least=3) for r in radius])
    starts = np.cumsum(counts) - counts
    ring = np.repeat(np.arange(len(radius)), counts)
    angle = 2 * np.pi * (np.arange(len(ring)) - starts[ring]) / counts[ring]
    vertices = np.stack([radius[ring] * np.cos(angle), radius[ring] * np.sin(angle), height[ring]], axis=1)
    upper = np.arange(len(radius) if closed else len(radius) - 1)
    return vertices, _strip_triangles(starts, counts, upper, (upper + 1) % len(radius))


def _strip_triangles(starts: Ints, counts: Ints, upper: Ints, lower: Ints) -> Ints:
    """Return the triangles (m, 3) between rings ``upper`` (s,) and ``lower`` (s,), strip by strip, one on each edge.

    Ring r has ``counts[r]`` vertices from the number ``starts[r]`` on, by growing angle; a pole has one and no edge.
    The third corner is the vertex of the other ring nearest to the edge's middle by angle; integers decide ties alike
    for both rings. Triangles are counterclockwise seen from outside with the upper ring on top.
    """
    rings = np.stack([starts[upper], starts[lower], counts[upper], counts[lower]])
    strip, i = _ring_edges(counts[upper])
    a, b, n, m = rings[:, strip]
    passed = -((n - (2 * i + 1) * m) // (2 * n)) % m  # of the lower ring's middles, those before this edge's
    on_upper = np.stack([a + i, b + passed, a + (i + 1) % n], axis=1)
    other, j = _ring_edges(counts[lower])
    a, b, n, m = rings[:, other]
    passed = (((2 * j + 1) * n - m) // (2 * m) + 1) % n
    on_lower = np.stack([b + j, b + (j + 1) % m, a + passed], axis=1)
    order = np.argsort(np.concatenate([strip, other]), kind="stable")
    return np.asarray(np.concatenate([on_upper, on_lower])[order], dtype=np.int64)


def _ring_edges(counts: Ints) -> tuple[Ints, Ints]:
    """Return the ring and the number in it (k,) of each edge of rings with ``counts`` vertices; poles have none."""
    edges = np.where(counts > 1, counts, 0)
    strip = np.repeat(np.arange(len(edges)), edges)
    return strip, np.arange(len(strip)) - (np.cumsum(edges) - edges)[strip]
