"""The matrix that interpolates the unknowns of a band at points of the manifold, each read from its own side.

The closest point extension E and the evaluation of a solution are this matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cpmkit.forms.collocation.band_layout import Layout
from cpmkit.forms.collocation.row_formula import BoundaryData, RowFormula
from cpmkit.forms.collocation.selection import Centres, Unknowns
from cpmkit.forms.collocation.side_view import SideView
from cpmkit.grid.band import stencil_nodes
from cpmkit.grid.stencils import stencil_cells, tensor_weights
from cpmkit.linear.operators import matrix_of_rows, scatter_matrix
from cpmkit.manifold.source import ClosestPoints
from cpmkit.types import Floats, Progress, SparseMatrix, no_progress

#: Number of rows that are built at a time, so that their memory is small compared with the matrix.
EXTENSION_CHUNK_ROWS = 16384


def extension_matrix(
    unknowns: Unknowns,
    points: Floats,
    centres: Centres,
    coefficient: Floats | None = None,
    progress: Progress = no_progress,
) -> SparseMatrix:
    """Return the matrix (n, unknowns) that interpolates the unknowns at ``points`` of the manifold.

    ``unknowns``: unknowns of the band that is interpolated in.
    ``points`` (n, d): points of the manifold, relative to the lattice's origin.
    ``centres``: the side of each boundary, and the sheet, that each point is on.
    ``coefficient`` (n,): factor of each row, by default 1.
    ``progress``: called with the stage "tables" and the share of it that is done.

    Raises ResolutionError if a stencil leaves the band, which happens only if the source breaks its contract.
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


def extend_rows(
    layout: Layout, progress: Progress = no_progress
) -> tuple[SparseMatrix, Sequence[BoundaryData], Centres]:
    """Return E (rows, unknowns), the boundary data added to E u, and the stencils' centres, of all rows of a layout.

    ``progress`` is called with the stage "tables" and the share of it that is done.
    """
    formula = _formula_of_rows(layout)
    centres = row_centres(layout, formula)
    extension = extension_matrix(layout.unknowns, formula.points, centres, formula.coefficient, progress)
    for term in formula.terms:
        at_term = Centres(term.side_views, np.full(len(term.points), term.owner), term.feet)
        added = extension_matrix(layout.unknowns, term.points, at_term, term.coefficient)
        extension = extension + scatter_matrix(term.rows, extension.shape[0]) @ added
    if formula.terms:
        extension.eliminate_zeros()
    return extension.tocsr(), formula.data, centres


def _formula_of_rows(layout: Layout) -> RowFormula:
    """Return the formulas of all rows of E: of the band's nodes, then of each boundary's ghosts."""
    parts, unknowns = [layout.formula, *(group.formula for group in layout.ghosts)], layout.unknowns
    numbers = np.split(np.arange(unknowns.rows), unknowns.first_rows[:-1])
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
    """Return the centres of the stencils of all rows of E, with the side of each boundary on which each lies.

    If the band has sheets and the rows' ``formula`` is given, they include the feet and normals that choose the sheet.
    """
    band, first = layout.band, layout.unknowns.first_rows
    owner = np.repeat(np.arange(-1, len(layout.ghosts)), np.diff(first, prepend=0))
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
