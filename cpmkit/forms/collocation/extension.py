"""Reading a band at surface points, seen from their sides: the one operator behind E and evaluation.

The closest point extension E, the evaluation of a solution and the transfers between bands all are
*interpolate in this band at these surface points, and in each node of a stencil take the unknown that
is on the point's own side of every boundary*.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.collocation.boundary.row_formula import BoundaryData, ExtraPoint, RowFormula
from cpmkit.forms.collocation.boundary.side_view import stack
from cpmkit.forms.collocation.layout import Layout
from cpmkit.forms.collocation.selection import Centres, Unknowns
from cpmkit.grid.stencils import stencil_cells, stencil_nodes, tensor_weights
from cpmkit.linear.operators import matrix_of_rows, scatter_matrix
from cpmkit.protocols import ClosestPoints, Floats, Progress, no_progress

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Rows that are built at a time: what they need meanwhile is small beside the tables.
EXTENSION_CHUNK_ROWS = 16384


def extend(
    unknowns: Unknowns,
    points: Floats,
    centres: Centres,
    coefficient: Floats | None = None,
    progress: Progress = no_progress,
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
    band, n = unknowns.band, len(points)
    width = (band.degree + 1) ** band.dim
    # King et al. (2024), eq. 1, at any points of the manifold.
    weights = np.empty((n, width))
    columns = np.empty((n, width), dtype=np.int32)
    for start in range(0, n, EXTENSION_CHUNK_ROWS):
        rows = np.arange(start, min(start + EXTENSION_CHUNK_ROWS, n))
        cells, fractions = stencil_cells(points[rows], band.spacing, band.degree)
        columns[rows] = unknowns.select(centres.take(rows), stencil_nodes(band, cells))
        weights[rows] = tensor_weights(fractions, band.degree)
        progress("tables", (rows[-1] + 1) / n)
    if coefficient is not None:
        weights *= coefficient[:, None]
    return matrix_of_rows(weights, columns, unknowns.count)


def extend_rows(layout: Layout, progress: Progress = no_progress) -> tuple[csr_array, Sequence[BoundaryData], Centres]:
    """Return E (rows, unknowns), what boundary data add to E u, and where the rows' stencils are centred."""
    rows = _all_readings(layout)
    centres = row_centres(layout, rows)
    extension = extend(layout.unknowns, rows.points, centres, rows.coefficient, progress)
    if rows.terms:
        extension = _with_terms(extension, layout.unknowns, rows.terms)
    return extension, rows.data, centres


def _with_terms(extension: csr_array, unknowns: Unknowns, terms: Sequence[ExtraPoint]) -> csr_array:
    """Return E with further points read by some rows."""
    for term in terms:
        centres = Centres(term.side_views, np.full(len(term.points), term.own), term.feet)
        read = extend(unknowns, term.points, centres, term.coefficient)
        extension = extension + scatter_matrix(term.rows, extension.shape[0]) @ read
    extension.eliminate_zeros()
    made: csr_array = extension.tocsr()
    return made


def _all_readings(layout: Layout) -> RowFormula:
    """Return what all rows of E read: the band's nodes, then each boundary's ghosts."""
    parts, numbering = [layout.formula, *(group.formula for group in layout.ghosts)], layout.numbering
    numbers = np.split(np.arange(numbering.rows), numbering.first_rows[:-1])
    numbered = list(zip(parts, numbers, strict=True))
    return RowFormula(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.coefficient for part in parts]),
        [datum.renumbered(rows) for part, rows in numbered for datum in part.data],
        [replace(term, rows=rows[term.rows]) for part, rows in numbered for term in part.terms],
        _joined([part.feet for part in parts]),
    )


def _joined(feet: Sequence[ClosestPoints | None]) -> ClosestPoints | None:
    """Return the records of all rows, None where they were not kept."""
    known = [one for one in feet if one is not None]
    return ClosestPoints.join(known) if len(known) == len(feet) else None


def row_centres(layout: Layout, rows: RowFormula | None = None) -> Centres:
    """Return how all rows of E see the boundaries, and on which sheets they read if it is asked what they do."""
    band, own, first = layout.band, layout.numbering.boundary_of_row, layout.numbering.first_rows
    side_views = [
        stack([(0, view), *((int(first[k]), one.side_views[index]) for k, one in enumerate(layout.ghosts))])
        for index, view in enumerate(layout.boundaries.side_views)
    ]
    if band.sheets is None or rows is None:
        return Centres(side_views, own)
    normals = np.full(rows.points.shape, np.nan)
    at_feet = np.flatnonzero((rows.points[: len(band.nodes)] == band.feet.points).all(axis=1))
    normals[at_feet] = band.sheets.normals[at_feet]
    return Centres(side_views, own, rows.feet, normals)
