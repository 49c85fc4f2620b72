"""How noisy a source's closest points are, measured by a few queries."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.protocols import Floats

#: Lines along which it is measured: five queries each.
LINES = 25
#: A noise below this share of the spacing is rounding.
LEAST_NOISE = 1e-10


def with_noise(source: LocalSource, spacing: float) -> LocalSource:
    """Return the source with its ``noise`` measured within half a ``spacing`` of the manifold.

    All points of the line from a foot to its query have this foot, so that feet along it are one point where they are
    exact, and lie on a smooth curve where their error varies smoothly. Noise is what third differences along such lines
    leave, as the root of the median of their squares.
    """
    rng = np.random.default_rng(0)
    low, high = source.bounds
    around = source.closest_point(rng.uniform(low, high, (LINES, source.dim))).points
    queries = around + rng.uniform(-0.5, 0.5, around.shape) * spacing
    feet = source.closest_point(queries).points

    def along(share: float) -> Floats:
        return source.closest_point(feet + share * (queries - feet)).points

    third = feet - 3 * along(0.75) + 3 * along(0.5) - along(0.25)
    variances = (third * third).mean(axis=1) / 20.0  # of 1 + 9 + 9 + 1 independent errors
    noise = float(np.sqrt(np.median(variances)))
    return replace(source, noise=noise if noise > LEAST_NOISE * spacing else 0.0)
