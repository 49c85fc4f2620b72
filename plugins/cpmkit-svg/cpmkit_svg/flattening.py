"""Flattening of cubics: points whose chords deviate from the curve by a hundred-thousandth of its size."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats

#: Largest deviation of chords from the curve, over the size of its box, and largest number of chords of a cubic.
TOLERANCE_SHARE, MOST_CHORDS = 1e-5, 2000


def flatten_cubics(cubics: Floats) -> Floats:
    """Return points (p, 2) along a chain of ``cubics`` (k, 4, 2), from its start to its end, all cubics' ends included.

    The chords deviate from the curve by at most :data:`TOLERANCE_SHARE` of the longest side of the control points' box,
    unless a cubic needs more than :data:`MOST_CHORDS`. For c chords at equal steps of its parameter the deviation is at
    most 6/8 of the largest second difference of its control points, over c^2.
    """
    tolerance = TOLERANCE_SHARE * float(np.ptp(cubics.reshape(-1, 2), axis=0).max())
    bend = np.linalg.norm(np.diff(cubics, n=2, axis=1), axis=2).max(axis=1)
    counts = np.clip(np.ceil(np.sqrt(0.75 * bend / tolerance)), 1, MOST_CHORDS).astype(int)
    parts = [_cubic_points(cubic, np.arange(count) / count) for cubic, count in zip(cubics, counts, strict=True)]
    return np.concatenate([*parts, cubics[-1:, 3]])


def _cubic_points(cubic: Floats, t: Floats) -> Floats:
    """Return points (c, 2) of the Bezier curve of the control points ``cubic`` (4, 2) at ``t`` (c,) in [0, 1]."""
    s = 1 - t
    return np.stack([s**3, 3 * s**2 * t, 3 * s * t**2, t**3], axis=1) @ cubic
