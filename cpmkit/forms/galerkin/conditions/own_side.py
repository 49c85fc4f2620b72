"""Samples beside a boundary that lie on its other side: where data, which may jump there, are read for them.

Cells follow a boundary along quadratic edges, and on a mesh along the surface that it samples: they come as near to it
as that. A sample past it by a thousandth of a spacing would be given the other material, and where that is a thousand
times stiffer the form would no longer be positive.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.forms.galerkin.conditions.sides import DIFFERENCE_SPACINGS
from cpmkit.forms.galerkin.sides_of_cells import SidesOfCells
from cpmkit.manifold.vectors import dots, norms
from cpmkit.protocols import Bools, Floats, Ints

if TYPE_CHECKING:
    from cpmkit.forms.galerkin.sampling import SampledScene

#: Samples nearer than so many spacings to the chord of an edge on a boundary are looked at: edges bend by less.
NEAR_CHORD_SPACINGS = 0.05
#: So many times as far as a boundary is off the manifold data are surely those of one side.
GAPS = 2.0


def astray(one: SampledScene, sides: SidesOfCells) -> tuple[Ints, Floats]:
    """Return the samples (k,) that are past the boundary beside their cell, and places (k, d) on the cell's side.

    Their mirror images, in the scene's coordinates. Where a boundary lies off the manifold, data may change anywhere
    between it and its feet there: samples as near as that are past it, too. Boundaries that have no left, and those of
    curves, have none.
    """
    rows, places = [np.zeros(0, dtype=np.int64)], [np.zeros((0, one.lattice.dim))]
    for number, oriented in enumerate(one.oriented):
        if one.mesh.manifold_dim == 1 or not oriented.has_left:
            continue
        near, side = _beside(one, np.flatnonzero(sides.owner == number), sides.left)
        if not len(near):
            continue
        origin = oriented.left.origin
        x = one.lattice.to_scene(one.samples.points_at(near)) - origin
        feet, on = oriented.feet(x)
        leftward = oriented.axis_and_left(feet, on, DIFFERENCE_SPACINGS * one.lattice.spacing)[1]
        inside, doubt = side * dots(x - on.points, leftward), GAPS * norms(on.points - feet.points)
        past = (inside < doubt) & (feet.edge < 0)
        step = side * np.maximum(doubt, -inside)
        rows.append(near[past])
        places.append((on.points + step[:, None] * leftward)[past] + origin)
    found, first = np.unique(np.concatenate(rows), return_index=True)
    return found, np.concatenate(places)[first]


def _beside(one: SampledScene, on: Ints, left: Bools) -> tuple[Ints, Ints]:
    """Return the samples (k,) of cells with one of the half facets ``on`` that lie near its chord, and their side.

    Which is 1 where the half facet is on the ``left`` (n,), and -1 elsewhere.
    """
    half, mesh = one.half, one.mesh
    samples: Any = one.samples  # fixed to their lattice by now
    cells, facet = half.cell[on], half.facet[on]
    starts = samples.cell_starts[cells].astype(np.int64)
    count = samples.cell_starts[cells + 1] - starts
    rows = np.arange(count.sum()) + np.repeat(starts - np.cumsum(count) + count, count)
    start, end = (mesh.vertices[mesh.cells[cells, (facet + k) % 3]] for k in (1, 2))
    along = np.repeat((end - start) / norms(end - start)[:, None], count, axis=0)
    way = samples.points_at(rows) - np.repeat(start, count, axis=0)
    near = norms(way - dots(way, along)[:, None] * along) < NEAR_CHORD_SPACINGS * one.lattice.spacing
    found, first = np.unique(rows[near], return_index=True)
    return found, np.repeat(np.where(left[on], 1, -1), count)[near][first]
