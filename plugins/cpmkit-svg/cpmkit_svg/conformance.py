"""Curves of path data on which ``cpmkit.testing`` checks the laws."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import Floats
from cpmkit_svg.path import path

if TYPE_CHECKING:
    from cpmkit.plugin import ConformanceCase

PATHS = {
    "open, of lines": ("M 0 0 L 1 0 v 1 l -0.5 0.5", [[0, 0], [1, 0], [1, 1], [0.5, 1.5]]),
    "closed, of lines": ("M 0 0 H 2 V 1 Z", [[0, 0], [2, 0], [2, 1], [0, 0]]),
    "open, of curves": ("M 0 0 C 0 1 1 1 1 0 S 2 -1 2 0 q 0.5 1 1 0 T 4 0 A 1 0.5 30 0 1 5 1", None),
    "closed, of arcs": ("M 1 0 A 1 1 0 0 1 -1 0 A 1 1 0 0 1 1 0 Z", None),
}


def cases() -> list[ConformanceCase]:
    """Return a case for each of :data:`PATHS`; those of lines alone have samples on the curve."""
    from cpmkit.plugin import ConformanceCase

    return [
        ConformanceCase(
            "svg.path", name, lambda d=d: path(d=d), None if corners is None else _polyline_sampler(np.array(corners))
        )
        for name, (d, corners) in PATHS.items()
    ]


def _polyline_sampler(corners: Floats) -> Callable[[np.random.Generator, int], Floats]:
    """Return a function of a generator and n that draws points (n, 2) of the polyline with ``corners`` (k, 2)."""

    def samples(rng: np.random.Generator, n: int) -> Floats:
        at, t = rng.integers(0, len(corners) - 1, n), rng.uniform(size=(n, 1))
        return (1.0 - t) * corners[at] + t * corners[at + 1]

    return samples
