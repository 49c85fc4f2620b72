"""Reading a band at surface points, seen from their sides: the one operator behind E and evaluation.

The closest point extension E, the evaluation of a solution and the transfers between bands all are
*interpolate in this band at these surface points, and in each node of a stencil take the unknown that
is on the point's own side of every boundary*.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.collocation.selection import Centres, Unknowns
from cpmkit.grid.stencils import stencil_cells, stencil_nodes, tensor_weights
from cpmkit.protocols import Floats, Progress, nothing

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Rows that are built at a time: what they need meanwhile is small beside the tables.
CHUNK = 16384


def extend(
    unknowns: Unknowns,
    points: Floats,
    centres: Centres,
    coefficient: Floats | None = None,
    progress: Progress = nothing,
) -> csr_array:
    """Return the matrix that reads the unknowns at surface ``points``.

    Parameters
    ----------
    unknowns : Unknowns
        Of the band that is read.
    points : (n, d) float64
        Points of the manifold, relative to the lattice's origin.
    centres : Centres
        How each point sees the boundaries, and on which sheet it is.
    coefficient : (n,) float64, optional
        Multiplies each row.
    progress : callable, optional
        Told the share of the stage "tables" that is done.

    Returns
    -------
    csr_array (n, unknowns)

    Raises
    ------
    ResolutionError
        If a stencil leaves the band, which the laws of a closest point source exclude.
    """
    from scipy.sparse import csr_array

    band, n = unknowns.band, len(points)
    width = (band.degree + 1) ** band.dim
    weights = np.empty((n, width))
    columns = np.empty((n, width), dtype=np.int32)
    for start in range(0, n, CHUNK):
        rows = np.arange(start, min(start + CHUNK, n))
        cells, fractions = stencil_cells(points[rows], band.spacing, band.degree)
        columns[rows] = unknowns.select(centres.take(rows), stencil_nodes(band, cells))
        weights[rows] = tensor_weights(fractions, band.degree)
        progress("tables", (rows[-1] + 1) / n)
    if coefficient is not None:
        weights *= coefficient[:, None]
    starts = np.arange(n + 1, dtype=np.int32 if columns.size < 2**31 else np.int64) * width
    return csr_array((weights.ravel(), columns.ravel(), starts), shape=(n, unknowns.count))
