"""What holds unknowns whose splines the manifold only grazes, so that no boundary term outweighs their energy.

Their differences along the axes are held, inside the heaviest patch that reads them: polynomials of a degree below the
splines' feel nothing of it, where pulling coefficients to zero would leave an error that grows with refinement and
contrast. Of splines of degree 1 that would be the slope: there it is the second differences of the runs they are in,
and only beside boundaries, for elsewhere it would cost iterations and is of no use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.galerkin.space.energy import (
    Strength,
    add_differences,
    add_ghosts,
    conductivity,
    energy_data,
)
from cpmkit.forms.galerkin.space.space import Space, lines_through
from cpmkit.protocols import Bools, Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Diagonals over coefficients that are below this share of their median are floored.
LIGHT_SHARE = 1e-4
#: The floor, as a share of that median.
FLOOR_SHARE = 1e-3
#: The same of splines of degree 1: with half of it a circle in a knot plane is still definite, with a tenth it is not.
LINEAR_FLOOR_SHARE = 0.2


def floored_stiffness(
    space: Space,
    a: Floats | float,
    strength: Strength,
    c: Floats | float | None = None,
    holding: Floats | None = None,
) -> csr_array:
    """Return the stiffness of ``a`` plus the mass of ``c``, with the floor under the unknowns that are light.

    Parameters
    ----------
    space, a, strength
        As of `stiffness`.
    c : float or (q,) float64, optional
        The coefficient of u v at the samples; None for none.
    holding : (q,) float64, optional
        What holds u off the manifold is in units of it; of ``a`` itself unless given.
    """
    data = energy_data(space, a, c, strength, holding)
    diagonal = space.matrix(data).diagonal()
    held: Floats | float = a if holding is None else holding
    add_ghosts(space, held, strength, data)
    add_floor(space, held, diagonal, data)
    return space.matrix(data)


def add_floor(space: Space, a: Floats | float, diagonal: Floats, data: Floats) -> None:
    """Add the floor to the entries ``data``; ``diagonal`` (n,) is that of the energy, before ghosts and conditions."""
    means = space.means(conductivity(space, a))
    ratio = diagonal / means
    median = float(np.median(ratio))
    light = ratio < LIGHT_SHARE * median
    if space.dof_map.degree == 1:
        runs = space.runs[(light & _beside_boundaries(space))[space.runs].any(axis=1)]
        factors = LINEAR_FLOOR_SHARE * median * means[runs].mean(axis=1)
        add_differences(space, runs, factors, data)
        return
    lines = lines_through(space.dof_map, space.heaviest[light])
    factors = np.tile(FLOOR_SHARE * median * means[light], space.dof_map.dim)
    add_differences(space, lines, factors, data)


def _beside_boundaries(space: Space) -> Bools:
    """Return (n,) which unknowns patches read that hold samples of boundaries, those without weight."""
    found = np.zeros(space.dof_map.size, dtype=bool)
    found[space.dof_map.unknowns[space.dof_map.patch[space.samples.weights == 0]]] = True
    return found
