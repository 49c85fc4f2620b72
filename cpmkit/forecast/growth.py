"""How a number grows as the spacing shrinks, and a cost with it: ``a / h^m + b / h^(m - 1)`` through two counts.

The first term is the manifold's, of dimension m; the second that of edges, boundary curves and curvature.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Growth:
    """``a / h^m + b / h^(m - 1)``."""

    a: float
    b: float
    m: int

    def at(self, spacing: float) -> float:
        """Return the number at a spacing."""
        return self.a / spacing**self.m + self.b / spacing ** (self.m - 1)

    def spacing_with(self, number: float) -> float:
        """Return the largest spacing at which there are so many; both terms must be of a growing number."""
        if self.m == 1:
            return self.a / max(number - self.b, 1e-9 * number)
        roots = np.roots([number, *[0] * (self.m - 2), -self.b, -self.a])
        return float(np.min([root.real for root in roots if root.real > 0]))


def growth_through(fine: tuple[float, float], coarse: tuple[float, float], m: int) -> Growth:
    """Return the growth through two pairs of a spacing and the number there."""
    (h, n), (wide, few) = fine, coarse
    b = (few * wide**m - n * h**m) / (wide - h)
    return Growth(n * h**m - b * h, b, m)


def rising_growth(fine: tuple[float, float], coarse: tuple[float, float], m: int) -> Growth:
    """Return the same, or ``a / h^m`` through the finer pair where a term is below zero.

    A coarse lattice then does not see the manifold well enough.
    """
    found = growth_through(fine, coarse, m)
    return found if found.a > 0 and found.b >= 0 else Growth(fine[1] * fine[0] ** m, 0.0, m)


def line_through(coarse: tuple[float, float], fine: tuple[float, float]) -> tuple[float, float]:
    """Return what a solve costs to begin with and for each unknown, through two pairs of unknowns and a cost.

    Each unknown costs at least half of what those of the finer one did: what began slowly was not yet in a cache.
    """
    (few, less), (many, more) = coarse, fine
    each = max((more - less) / (many - few), 0.5 * more / many)
    return max(more - each * many, 0.0), each
