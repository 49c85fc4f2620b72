"""All levels of a parting, down to a few hundred unknowns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.forms.galerkin.dof_map import DofMap
from cpmkit.forms.galerkin.hierarchy.coarser import coarser
from cpmkit.linear.multigrid.cycle import Level
from cpmkit.protocols import Ints

#: No coarser level is made of fewer unknowns: they are solved for exactly.
COARSEST_UNKNOWNS = 400
#: Nor of a level that has more than this share of the finer one's unknowns: all that is left are specks.
LEAST_GAIN = 0.9


def levels_of(dof_map: DofMap, beside: Ints) -> list[Level]:
    """Return the steps to coarser levels, from the finest on.

    Parameters
    ----------
    dof_map : Parting
        The finest.
    beside : (k,) int64
        The patches that boundary samples lie in: on each level the unknowns that these read, or that the coarser
        patches that hold these read, are the strip.
    """
    level = replace(dof_map, patch=np.unique(beside))
    levels: list[Level] = []
    while level.size > COARSEST_UNKNOWNS:
        strip = np.unique(level.unknowns[level.patch])
        level, prolongation = coarser(level)
        if level.size > LEAST_GAIN * prolongation.shape[0]:
            break
        levels.append(Level(prolongation, strip, lines=_lines(level) if level.degree > 2 else None))
    return levels


def _lines(dof_map: DofMap) -> Ints:
    """Return (r, degree + 1) the unknowns on the lines along the axes inside all patches, each line once."""
    width, dim = dof_map.width, dof_map.dim
    blocks = dof_map.unknowns.reshape(-1, *(width,) * dim)
    lines = np.unique(
        np.concatenate([np.moveaxis(blocks, 1 + axis, -1).reshape(-1, width) for axis in range(dim)]), axis=0
    )
    return np.asarray(lines[lines[:, 0] != lines[:, -1]])  # specks have one unknown all along
