"""The functions that u behaves like at a tip: powers of the distance times a wave of the angle, cut off smoothly.

    psi = (1 - r^2 / R^2)^3 r^|k| sin(k t + p),   R the radius of the disc around the tip.

With zero flux on both sides k = 1/2 and p = 0, with values on both k = 1/2 and p = pi/2; with a value on one side alone
|k| = 1/4 and 3/4, and psi vanishes on that side: those powers below 1 of which the slope is not bounded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.forms.galerkin.tips.surroundings import Surroundings
from cpmkit.protocols import Floats, Ints

#: Frequency k and phase p of the functions of a tip, by whether a value is held on its boundary's left and right.
WAVES: dict[tuple[bool, bool], tuple[tuple[float, float], ...]] = {
    (False, False): ((0.5, 0.0),),
    (True, True): ((0.5, 0.5 * np.pi),),
    (True, False): ((-0.25, 0.25 * np.pi), (-0.75, 0.75 * np.pi)),
    (False, True): ((0.25, 0.25 * np.pi), (0.75, 0.75 * np.pi)),
}
#: Nearer to a tip than this share of its disc the slope is that at this distance.
LEAST_DISTANCE_SHARE = 1e-9


@dataclass(frozen=True, eq=False)
class SingularFunction:
    """psi of one tip.

    Attributes
    ----------
    disc : Surroundings
        Where it is not zero.
    frequency, phase : float
        k and p.
    """

    disc: Surroundings
    frequency: float
    phase: float

    def values(self, points: Floats, cells: Ints) -> tuple[Ints, Floats]:
        """Return which of the points (q, d), in these cells (q,), psi is not zero at, and its values (k,) there."""
        rows, r, t = self._polar(points, cells)
        bump = (1 - (r / self.disc.radius) ** 2) ** 3
        return rows, bump * r ** abs(self.frequency) * np.sin(self.frequency * t + self.phase)

    def slopes(self, points: Floats, cells: Ints) -> tuple[Ints, Floats]:
        """Return the same points, and the gradients (k, d) of psi, as a function that is constant along normals."""
        disc, power = self.disc, abs(self.frequency)
        rows, r, t = self._polar(points, cells)
        r = np.maximum(r, LEAST_DISTANCE_SHARE * disc.radius)
        rest, angle = 1 - (r / disc.radius) ** 2, self.frequency * t + self.phase
        along = (power * rest - 6 * (r / disc.radius) ** 2) * rest**2 * r ** (power - 1) * np.sin(angle)
        around = rest**3 * r ** (power - 1) * self.frequency * np.cos(angle)
        by_x = along * np.cos(t) - around * np.sin(t)
        by_y = along * np.sin(t) + around * np.cos(t)
        x = disc.plane(points[rows])[0]
        by_x = by_x - disc.bend * x * by_y
        return rows, by_x[:, None] * disc.heading + by_y[:, None] * disc.leftward

    def _polar(self, points: Floats, cells: Ints) -> tuple[Ints, Floats, Floats]:
        inside, sides = self.disc.side_of(cells)
        rows = np.flatnonzero(inside)
        r, t = self.disc.polar(points[rows], sides[rows])
        near = r < self.disc.radius
        return rows[near], r[near], t[near]


def functions_of(disc: Surroundings, held: tuple[bool, bool]) -> Sequence[SingularFunction]:
    """Return the functions of a tip, by whether a value is held on its boundary's left and right in the disc."""
    return [SingularFunction(disc, frequency, phase) for frequency, phase in WAVES[held]]
