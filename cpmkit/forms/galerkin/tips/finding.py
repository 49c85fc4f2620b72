"""The singular functions of a scene: one disc a tip, and by the conditions beside it what u is like there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from cpmkit.errors import place
from cpmkit.forms.galerkin.conditions.boundary_samples import BoundarySamples
from cpmkit.forms.galerkin.conditions.crossings import ends_inside
from cpmkit.forms.galerkin.conditions.held import ImposedCondition
from cpmkit.forms.galerkin.tips.functions import SingularFunction, functions_of
from cpmkit.forms.galerkin.tips.surroundings import Surroundings, TipFinder
from cpmkit.grid.lattice import Lattice
from cpmkit.mesh.mesh import SampleMesh
from cpmkit.protocols import Ints
from cpmkit.scene.laws import Interface, Value

#: A disc of fewer spacings holds too few splines to tell its function from them.
LEAST_RADIUS_SPACINGS = 1.0
#: What a side has at a tip: its flux is given or follows from u, u is held, or u and its flux go on across.
FLUX, VALUE, THROUGH = range(3)


def singular_functions(
    mesh: SampleMesh, boundary: BoundarySamples, laws: Sequence[ImposedCondition], lattice: Lattice
) -> tuple[tuple[SingularFunction, ...], tuple[str, ...]]:
    """Return the functions of all tips of a cut mesh, and a sentence on those around which no disc fits."""
    finder, kinds = TipFinder(mesh, lattice.spacing), _kinds(boundary, laws)
    found: list[SingularFunction] = []
    narrow = []
    for number, tip in _tips(mesh):
        disc = finder.around(tip, number)
        if disc.radius < LEAST_RADIUS_SPACINGS * lattice.spacing:
            narrow.append(disc)
            continue
        left, right = (_kind_on(side, disc, number, boundary, kinds) for side in (1, -1))
        if THROUGH not in (left, right):
            found += functions_of(disc, (left == VALUE, right == VALUE))
    return tuple(found), tuple(_of_narrow(narrow, lattice))


def _tips(mesh: SampleMesh) -> Iterator[tuple[int, int]]:
    for number in np.unique(mesh.owner).tolist():
        for tip in ends_inside(mesh, number).tolist():
            yield number, tip


def _kinds(boundary: BoundarySamples, laws: Sequence[ImposedCondition]) -> Ints:
    """Return what stands at each boundary sample (b,), zero flux where nothing is held."""
    kinds = np.full(len(boundary), FLUX)
    for one in laws:
        if isinstance(one.law, Value):
            kinds[one.all_rows] = VALUE
        elif isinstance(one.law, Interface) and one.law.resistance == 0:
            kinds[one.all_rows] = THROUGH
    return kinds


def _kind_on(side: int, disc: Surroundings, number: int, boundary: BoundarySamples, kinds: Ints) -> int:
    """Return what stands on a side of a boundary inside a disc."""
    inside, sides = disc.side_of(boundary.cell)
    rows = np.flatnonzero(inside & (sides == side) & (boundary.owner == number) & ~boundary.extends)
    return int(np.bincount(kinds[rows], minlength=1).argmax())


def _of_narrow(narrow: Sequence[Surroundings], lattice: Lattice) -> Iterator[str]:
    if narrow:
        disc, count = narrow[0], len(narrow)
        where = place(lattice.to_scene(disc.origin[None])[0])
        yield (
            f"{count} end{'s' * (count > 1)} of boundaries, near {where}{' and elsewhere' * (count > 1)}, have no "
            f"singular unknown: within {disc.radius:.2g} of it, less than a spacing, {lattice.spacing:.2g}, the "
            "boundary bends, the surface turns, or another boundary or the rim is met; take a smaller spacing."
        )
