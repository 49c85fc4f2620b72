"""Cubics as points along them, so close that chords leave the curve by a hundred-thousandth of its size."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats

#: How far chords may leave the curve, as a share of the size of its box, and how many there may be of a cubic.
TOLERANCE_SHARE, MOST_CHORDS = 1e-5, 2000


def flattened(cubics: Floats) -> Floats:
    """Return points (n, 2) along cubics (k, 4, 2) that follow each other, their ends among them.

    A cubic cut into n equal parts of its parameter leaves the chords by at most 6/8 of its largest second difference of
    control points over n^2.
    """
    tolerance = TOLERANCE_SHARE * float(np.ptp(cubics.reshape(-1, 2), axis=0).max())
    bend = np.linalg.norm(np.diff(cubics, n=2, axis=1), axis=2).max(axis=1)
    counts = np.clip(np.ceil(np.sqrt(0.75 * bend / tolerance)), 1, MOST_CHORDS).astype(int)
    parts = [_at(cubic, np.arange(count) / count) for cubic, count in zip(cubics, counts, strict=True)]
    return np.concatenate([*parts, cubics[-1:, 3]])


def _at(cubic: Floats, t: Floats) -> Floats:
    s = 1 - t
    return np.stack([s**3, 3 * s**2 * t, 3 * s * t**2, t**3], axis=1) @ cubic
