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

from cpmkit.forms.collocation.band_layout import Layout
from cpmkit.forms.collocation.row_formula import BoundaryData, RowFormula
from cpmkit.forms.collocation.selection import Centres, Unknowns
from cpmkit.forms.collocation.side_view import SideView
from cpmkit.grid.band import stencil_nodes
from cpmkit.grid.stencils import stencil_cells, tensor_weights
from cpmkit.linear.operators import matrix_of_rows, scatter_matrix
from cpmkit.manifold.source import ClosestPoints
from cpmkit.types import Floats, Progress, no_progress

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Rows that are built at a time: their memory is small beside the tables.
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
        Called with the share of the stage "tables" that is done.

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
    """Return E (rows, unknowns), the boundary data added to E u, and the centres of the rows' stencils."""
    formula = _formula_of_rows(layout)
    centres = row_centres(layout, formula)
    extension = extend(layout.unknowns, formula.points, centres, formula.coefficient, progress)
    for term in formula.terms:
        at_term = Centres(term.side_views, np.full(len(term.points), term.owner), term.feet)
        added = extend(layout.unknowns, term.points, at_term, term.coefficient)
        extension = extension + scatter_matrix(term.rows, extension.shape[0]) @ added
    if formula.terms:
        extension.eliminate_zeros()
    return extension.tocsr(), formula.data, centres


def _formula_of_rows(layout: Layout) -> RowFormula:
    """Return the formulas of all rows of E: the band's nodes, then each boundary's ghosts."""
    parts, numbering = [layout.formula, *(group.formula for group in layout.ghosts)], layout.numbering
    numbers = np.split(np.arange(numbering.rows), numbering.first_rows[:-1])
    numbered = list(zip(parts, numbers, strict=True))
    feet = [part.feet for part in parts if part.feet is not None]
    return RowFormula(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.coefficient for part in parts]),
        [datum.renumber(rows) for part, rows in numbered for datum in part.data],
        [replace(term, rows=rows[term.rows]) for part, rows in numbered for term in part.terms],
        ClosestPoints.join(feet) if len(feet) == len(parts) else None,
    )


def row_centres(layout: Layout, formula: RowFormula | None = None) -> Centres:
    """Return how all rows of E see the boundaries, and on which sheets they read if their ``formula`` is given."""
    band, owner, first = layout.band, layout.numbering.boundary_of_row, layout.numbering.first_rows
    side_views = []
    for index, view in enumerate(layout.boundaries.side_views):
        of_ghosts = [group.side_views[index] for group in layout.ghosts]
        moved = [replace(view, rows=view.rows + int(first[k])) for k, view in enumerate(of_ghosts)]
        side_views.append(SideView.join([view, *moved]))
    if band.sheets is None or formula is None:
        return Centres(side_views, owner)
    normals = np.full(formula.points.shape, np.nan)
    at_feet = np.flatnonzero((formula.points[: len(band.nodes)] == band.feet.points).all(axis=1))
    normals[at_feet] = band.sheets.normals[at_feet]
    return Centres(side_views, owner, formula.feet, normals)
