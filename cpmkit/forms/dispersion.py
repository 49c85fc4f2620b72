"""How well a form carries waves: up to which wavelength, and by how much eigenvalues are off."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Dispersion:
    """How far an eigenvalue lambda = k^2 of -Lap is off.

    By about ``lambda (waves (k h)^power + bends (h / radius)^bend_power)``.

    Attributes
    ----------
    resolved, coarsest : float
        k h, radians of a wave over a spacing: up to the first eigenvalues are off by 1 percent, up to the second by 2,
        and beyond the first few of them none is told from the next.
    power : int
        The order of eigenvalues.
    waves, bends : float
        Measured on the circle and the sphere.
    bend_power : int
        The order at which samples follow what bends.
    """

    resolved: float
    coarsest: float
    power: int
    waves: float
    bends: float
    bend_power: int = 2

    def error(self, eigenvalue: float, spacing: float, radius: float) -> float:
        """Return by how much an eigenvalue is off on a manifold of this radius."""
        waves = self.waves * (eigenvalue * spacing**2) ** (self.power / 2)
        return float(eigenvalue * (waves + self.bends * (spacing / radius) ** self.bend_power))


#: Of formulas of second order on nodes: ten nodes a wavelength, and six.
SECOND_ORDER = Dispersion(resolved=0.6, coarsest=1.0, power=2, waves=0.03, bends=0.2)
#: Of quadratic splines, 3.5 nodes a wavelength and 2.9: the first 144 eigenvalues of a sphere at h = .2 and .25 have
#: errors of .0007 to .0018 (k h)^4.
QUADRATIC_SPLINES = Dispersion(resolved=1.8, coarsest=2.2, power=4, waves=0.002, bends=0.02)
#: Of all degrees. Of linear splines errors are .031 to .041 (k h)^2; of cubic ones .0005 to .001 (k h)^4 beyond the
#: first few: at spacings as coarse as these they feel how the sphere bends.
SPLINES = {
    1: Dispersion(resolved=0.55, coarsest=0.75, power=2, waves=0.035, bends=0.02),
    2: QUADRATIC_SPLINES,
    3: Dispersion(resolved=1.9, coarsest=2.2, power=4, waves=0.001, bends=0.02),
}


def on_curved_cells(splines: Dispersion) -> Dispersion:
    """Return how well splines carry waves where their cells follow a smooth source.

    The first eigenvalues of the circle at h = .05 and of the sphere at .2 have .5 to 1.5 times these errors; with the
    square of h / radius a hundred times as much had been told.
    """
    return replace(splines, bend_power=splines.power)
