"""The directions of vectors that flow as heat with the Laplacian of the connection for a short time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import cpmkit as ck
from cpmkit.applications.heat import ITERATED_SHARE, LONGER, check_warmed, longest_time
from cpmkit.facade import Solution
from cpmkit.plugin import unit
from cpmkit.preparing import Prepared
from cpmkit.protocols import Floats

#: Relative residual of the vectors' heat, well below the share of the largest vector at which they are noise.
HEAT_RESIDUAL = 1e-12


def directions_of_heat(
    prepared: Prepared, coupling: ck.Field, source: ck.PointSource, first: float
) -> tuple[Floats, Solution]:
    """Return the unit vectors (p, 3) that a source's become after the shortest time in which any arrive.

    Parameters
    ----------
    prepared : Prepared
        A surface.
    coupling : Field
        What keeps vectors tangential, see `tangential_coupling`.
    source : PointSource
        Vectors at points.
    first : float
        The shortest time, over the spacing's square; where nothing but noise has arrived, four times it, and so on.

    Returns
    -------
    (p, 3) float64, Solution
        The vectors at the points of ``prepared``, and on its splines.

    Raises
    ------
    SceneError
        If none arrives somewhere.
    """
    h = prepared.discretized.spacing
    heated = prepared.solved_by("jacobi", solver_tolerance=HEAT_RESIDUAL)
    found = np.zeros_like(prepared.points)
    cold, time = np.ones(len(found), dtype=bool), first * h * h
    while cold.any() and time < LONGER * longest_time(prepared):
        problem = ck.Coupled(lambda x: coupling(x).reshape(-1, 3, 3), f=source, c=1 / time, lumped=True)
        heat = heated.solve(problem=problem)
        arrived = prepared.field(heat).project().values
        size = np.linalg.norm(arrived, axis=1)
        warm = cold & (size > ITERATED_SHARE * size.max())
        found[warm] = unit(arrived[warm])
        cold, time = cold & ~warm, LONGER * time
    check_warmed(cold, prepared.scene.surface)
    return found, replace(heat, values=prepared.discretized.project(found))
