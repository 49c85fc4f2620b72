"""About how large errors are, told by one solution alone: from how much the third derivative's size leaves unresolved.

Splines of degree 2 follow a function but for a share of h^3 times its third derivatives, and so much do third
differences of their coefficients tell. It foretells spacings, and agrees with an estimate or not; it is none.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.galerkin.parting import Parting
from cpmkit.protocols import Floats

if TYPE_CHECKING:
    from cpmkit.forms.galerkin.form import Galerkin

#: Root mean squares of third differences over those of errors, and the largest over the largest: where cells follow the
#: source (measured on 22 problems at 250 to 3,000 unknowns: 60 to 240, and 50 to 300), where they are flat (95 to 110,
#: and 80 to 150), where they are bent by normals or the source turns or bends under splines (8 to 40, and 12 to 70;
#: where it bends alone up to 240), and where boundaries end (22 to 36, and 25 to 50).
SMOOTH, FLAT, ROUGH, ENDING = (110.0, 130.0), (100.0, 110.0), (22.0, 27.0), (30.0, 32.0)
#: Sources bend under splines that count where they do so on more than this share of their area.
BENT_AREA = 0.02


def expected_error(form: Galerkin, u: Floats) -> tuple[Floats, Floats] | None:
    """Return about the root mean square and the largest of the error of u (unknowns, channels), each (channels,).

    In the unit of u; most are within a factor of two. None where splines have another degree than 2, for which nothing
    was measured, or where no two patches stand beside each other.
    """
    if form.options.own.degree != 2:
        return None
    found = highest_differences(form.space.parting, u)
    if not len(found):
        return None
    rms, largest = _ratios(form)
    return np.sqrt(np.mean(found**2, axis=0)) / rms, np.abs(found).max(axis=0) / largest


def highest_differences(parting: Parting, u: Floats) -> Floats:
    """Return (k, channels) differences of coefficients along the axes, of one order more than the degree.

    Of each pair of patches side by side that share unknowns, along the axis that they stand beside each other.
    """
    first, second = parting.touching.T
    step = parting.cells[second] - parting.cells[first]
    blocks = parting.unknowns.reshape(-1, *[parting.width] * parting.dim)
    found = []
    for axis in range(parting.dim):
        beside = np.flatnonzero((np.abs(step).sum(axis=1) == 1) & (step[:, axis] != 0))
        forward = step[beside, axis] > 0
        low, high = np.where(forward, first[beside], second[beside]), np.where(forward, second[beside], first[beside])
        one, other = (np.moveaxis(blocks[some], 1 + axis, -1).reshape(-1, parting.width) for some in (low, high))
        joined = (one[:, 1:] == other[:, :-1]).all(axis=1)
        lines = np.concatenate([one, other[:, -1:]], axis=1)[joined]
        found.append(np.diff(u[lines], n=parting.width, axis=1)[:, 0])
    return np.concatenate(found)


def _ratios(form: Galerkin) -> tuple[float, float]:
    bend = form.sampled.bend
    if bend == "normals" or (bend == "feet" and form.turned.bent > BENT_AREA):
        return ROUGH
    if form.sampled.mesh.extends.any():
        return ENDING
    return FLAT if form.sampled.bend == "flat" else SMOOTH
