"""Singular functions at tips, the ends of boundaries: powers of the distance times a wave of the angle.

    psi = (1 - r^2 / R^2)^3 r^|k| sin(k t + p),   R the radius of the disc around the tip.

With zero flux on both sides k = 1/2 and p = 0, with values on both k = 1/2 and p = pi/2; with a value on one side alone
|k| = 1/4 and 3/4, and psi vanishes on that side. These are the leading terms of u at a tip whose gradient is not
bounded.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.errors import place
from cpmkit.forms.galerkin.conditions.boundary_samples import BoundarySamples
from cpmkit.forms.galerkin.conditions.imposed_conditions import ImposedCondition, conditions_with_law
from cpmkit.forms.galerkin.enrichment.tip_discs import TipDisc, TipDiscFinder
from cpmkit.forms.galerkin.solution_warnings import ends_inside
from cpmkit.grid.lattice import Lattice
from cpmkit.mesh.mesh import Mesh
from cpmkit.scene.laws import Interface, Value
from cpmkit.types import Floats, Ints

#: Frequency k and phase p of the functions of a tip, by whether a value is given on the left and on the right.
WAVES: dict[tuple[bool, bool], tuple[tuple[float, float], ...]] = {
    (False, False): ((0.5, 0.0),),
    (True, True): ((0.5, 0.5 * np.pi),),
    (True, False): ((-0.25, 0.25 * np.pi), (-0.75, 0.75 * np.pi)),
    (False, True): ((0.25, 0.25 * np.pi), (0.75, 0.75 * np.pi)),
}
#: Nearer to a tip than this share of its disc's radius the gradient at that distance is used.
LEAST_DISTANCE_SHARE = 1e-9
#: A disc with a radius of fewer spacings contains too few splines to distinguish its function from them.
LEAST_RADIUS_SPACINGS = 1.0
#: Kinds of condition on a side at a tip: the flux is given, the value is given, or u and its flux are continuous.
FLUX, VALUE, THROUGH = range(3)


@dataclass(frozen=True, eq=False)
class SingularFunction:
    """A singular function psi of a tip.

    Attributes
    ----------
    disc : TipDisc
        The support of psi.
    frequency, phase : float
        The frequency k and the phase p.
    """

    disc: TipDisc
    frequency: float
    phase: float

    def values(self, points: Floats, cells: Ints) -> tuple[Ints, Floats]:
        """Return the numbers (k,) of the ``points`` (q, d) inside the disc, and the values (k,) of psi there.

        The points lie in the mesh ``cells`` (q,).
        """
        rows, r, t = self._polar(points, cells)
        bump = (1 - (r / self.disc.radius) ** 2) ** 3
        return rows, bump * r ** abs(self.frequency) * np.sin(self.frequency * t + self.phase)

    def slopes(self, points: Floats, cells: Ints) -> tuple[Ints, Floats]:
        """Return the numbers (k,) of the ``points`` (q, d) inside the disc, and the gradients (k, d) of psi there.

        The gradients are those of psi as a function that is constant along normals.
        """
        disc, power = self.disc, abs(self.frequency)
        rows, r, t = self._polar(points, cells)
        r = np.maximum(r, LEAST_DISTANCE_SHARE * disc.radius)
        rest, angle = 1 - (r / disc.radius) ** 2, self.frequency * t + self.phase
        along = (power * rest - 6 * (r / disc.radius) ** 2) * rest**2 * r ** (power - 1) * np.sin(angle)
        around = rest**3 * r ** (power - 1) * self.frequency * np.cos(angle)
        by_x = along * np.cos(t) - around * np.sin(t)
        by_y = along * np.sin(t) + around * np.cos(t)
        x = disc.plane(points[rows])[0]
        by_x = by_x - disc.geometry * x * by_y
        return rows, by_x[:, None] * disc.heading + by_y[:, None] * disc.leftward

    def _polar(self, points: Floats, cells: Ints) -> tuple[Ints, Floats, Floats]:
        """Return the numbers (k,) of the ``points`` (q, d) inside the disc, and their coordinates r and t (k,)."""
        inside, sides = self.disc.side_of(cells)
        rows = np.flatnonzero(inside)
        r, t = self.disc.polar(points[rows], sides[rows])
        near = r < self.disc.radius
        return rows[near], r[near], t[near]


def tip_functions(disc: TipDisc, has_value: tuple[bool, bool]) -> Sequence[SingularFunction]:
    """Return the singular functions of a tip; ``has_value``: whether u is given on the left, and on the right."""
    return [SingularFunction(disc, frequency, phase) for frequency, phase in WAVES[has_value]]


def singular_functions(
    mesh: Mesh, boundary: BoundarySamples, conditions: Sequence[ImposedCondition], lattice: Lattice
) -> tuple[tuple[SingularFunction, ...], tuple[str, ...]]:
    """Return the singular functions of all tips of a cut mesh, and a warning if no disc fits around some of them."""
    finder, kinds = TipDiscFinder(mesh, lattice.spacing), _kinds(boundary, conditions)
    functions: list[SingularFunction] = []
    narrow = []
    for number, tip in _tips(mesh):
        disc = finder.around(tip, number)
        if disc.radius < LEAST_RADIUS_SPACINGS * lattice.spacing:
            narrow.append(disc)
            continue
        left, right = (_kind_on(side, disc, number, boundary, kinds) for side in (1, -1))
        if THROUGH not in (left, right):
            functions += tip_functions(disc, (left == VALUE, right == VALUE))
    return tuple(functions), tuple(_narrow_disc_warnings(narrow, lattice))


def _tips(mesh: Mesh) -> Iterator[tuple[int, int]]:
    """Yield each end of a boundary inside the surface: the number of the boundary, and the vertex."""
    for number in np.unique(mesh.owner).tolist():
        for tip in ends_inside(mesh, number).tolist():
            yield number, tip


def _kinds(boundary: BoundarySamples, conditions: Sequence[ImposedCondition]) -> Ints:
    """Return the kind of condition (b,) at each boundary sample: FLUX, VALUE or THROUGH."""
    kinds = np.full(len(boundary), FLUX)
    for _, condition in conditions_with_law(conditions, Value):
        kinds[condition.all_rows] = VALUE
    for law, condition in conditions_with_law(conditions, Interface):
        if law.resistance == 0:
            kinds[condition.all_rows] = THROUGH
    return kinds


def _kind_on(side: int, disc: TipDisc, number: int, boundary: BoundarySamples, kinds: Ints) -> int:
    """Return the kind of condition (FLUX, VALUE or THROUGH) that is most frequent on a boundary's side in a disc."""
    inside, sides = disc.side_of(boundary.cell)
    rows = np.flatnonzero(inside & (sides == side) & (boundary.owner == number) & ~boundary.beyond_tip)
    return int(np.bincount(kinds[rows], minlength=1).argmax())


def _narrow_disc_warnings(narrow: Sequence[TipDisc], lattice: Lattice) -> Iterator[str]:
    """Yield a warning if there are tips whose discs are too small for a singular function."""
    if narrow:
        disc, count = narrow[0], len(narrow)
        where = place(lattice.to_scene(disc.origin[None])[0])
        yield (
            f"{count} end{'s' * (count > 1)} of boundaries, near {where}{' and elsewhere' * (count > 1)}, have no "
            f"singular unknown: within {disc.radius:.2g} of it, less than a spacing, {lattice.spacing:.2g}, the "
            "boundary bends, the surface turns, or another boundary or the rim is met; take a smaller spacing."
        )
