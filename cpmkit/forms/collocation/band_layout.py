"""The layout of a scene (unknowns at band nodes and ghosts, formulas of their rows), and the matrix of these rows.

The layout is made before the matrices, with nearly all closest point queries of a discretization. The matrix
interpolates the unknowns at points of the manifold, each point from its own side. The closest point extension E is such
a matrix, and so is the matrix that evaluates a solution.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cpmkit.forms.collocation.ghosts.ghost_geometry import SIDE_READING_SPACINGS, node_sources
from cpmkit.forms.collocation.ghosts.ghosts import Ghosts, build_ghosts
from cpmkit.forms.collocation.ghosts.nodes_past_edge import node_formulas, nodes_behind_boundaries
from cpmkit.forms.collocation.options import CollocationOptions
from cpmkit.forms.collocation.row_formula import BoundaryData, RowFormula
from cpmkit.forms.collocation.selection import Centres, Unknowns
from cpmkit.forms.collocation.side_view import (
    BoundariesOnBand,
    ParallelPair,
    SideView,
    find_parallel_pairs,
    put_on_lattice,
)
from cpmkit.forms.collocation.twins import add_twins
from cpmkit.forms.options import Options
from cpmkit.grid.band import Band, build_band, reading_radius, stencil_cells, stencil_nodes, tensor_weights
from cpmkit.grid.lattice import COARSEST_BAND_SHARE, Lattice, lattice_of
from cpmkit.linear.operators import matrix_of_rows, scatter_matrix
from cpmkit.manifold.local_source import LocalSource, localize
from cpmkit.manifold.source import ClosestPoints
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Progress, SparseMatrix, no_progress

#: Number of rows that are built at a time, so that their memory is small compared with the matrix.
EXTENSION_CHUNK_ROWS = 16384


@dataclass(frozen=True, eq=False)
class Layout:
    """The unknowns of a scene on a lattice, and the formulas of the rows of the extension matrix E; no matrix yet."""

    #: Options: options that lay out the same scene in the same way; their origin is that of the lattice.
    options: Options[CollocationOptions]
    lattice: Lattice  #: Origin and spacing.
    surface: LocalSource  #: The manifold, relative to the lattice's origin.
    band: Band  #: The nodes near the manifold and their closest points.
    formula: RowFormula  #: The formula of each node of the band, the edge's conditions included.
    sources: RowFormula  #: The points at which each node reads right-hand sides.
    boundaries: BoundariesOnBand  #: The boundaries, and the distances and sides of the band's nodes from each.
    ghosts: Sequence[Ghosts]  #: The ghosts of each boundary.
    channels: int  #: Number of right-hand sides that are solved together.

    @cached_property
    def unknowns(self) -> Unknowns:
        """The unknowns: the band's inner nodes, then the ghosts of each boundary."""
        return Unknowns(self.band, self.ghosts)

    @cached_property
    def parallel_pairs(self) -> list[ParallelPair]:
        """The pairs of boundaries that run side by side, less than a spacing apart, or lie at the same place."""
        return find_parallel_pairs(self.boundaries, self.lattice.spacing)

    @property
    def queries(self) -> Counter[str]:
        """The number of closest point queries so far, of the surface and of each boundary by name."""
        counts = Counter({"surface": self.surface.queries["points"]})
        for boundary, on_lattice in zip(self.boundaries.definitions, self.boundaries.on_lattice, strict=True):
            counts[boundary.name] = on_lattice.source.queries["points"]
        return counts


def build_layout(scene: Scene, options: Options[CollocationOptions], progress: Progress = no_progress) -> Layout:
    """Return the layout of a scene: its unknowns on a lattice, and the formulas of the rows of the matrix E.

    ``progress`` is called with stages and the shares done. Raises InputError, SceneError or ResolutionError if the
    lattice's origin, a boundary, a condition or the spacing does not fit.
    """
    lattice = lattice_of(scene.surface, options.spacing, options.origin, COARSEST_BAND_SHARE)
    options = replace(options, origin=lattice.origin)
    surface = localize(scene.surface, lattice.origin)
    band = build_band(surface, lattice.spacing, options.own.degree, progress)
    if options.own.sheets:
        band = add_twins(surface, band)
    boundaries, formula = _boundaries_and_node_formulas(scene, surface, band, lattice, options.own.order)
    ghosts: list[Ghosts] = []
    for index in range(len(scene.boundaries)):
        ghosts.append(build_ghosts(index, boundaries, band, lattice, formula, options.own.order))
        progress("boundaries", (index + 1) / len(scene.boundaries))
    sources = _sources_of_nodes(boundaries, band)
    return Layout(options, lattice, surface, band, formula, sources, boundaries, ghosts, scene.channels)


def _boundaries_and_node_formulas(
    scene: Scene, surface: LocalSource, band: Band, lattice: Lattice, order: int
) -> tuple[BoundariesOnBand, RowFormula]:
    """Return the boundaries with the nodes' distances and sides, and the formulas by which the band's nodes read u.

    A node past an edge reads its closest point, not its mirror point, if a boundary with uncoupled sides is between.
    """
    # King et al. (2024), section 4.6: boundaries within twice the reach of a stencil are found.
    formula, reach = node_formulas(surface, band, lattice, scene.edge, order), reading_radius(band.dim, band.degree)
    reach *= band.spacing
    on_lattice = [
        put_on_lattice(boundary, surface, lattice, reach, scene.oriented, band.sheets) for boundary in scene.boundaries
    ]
    uncoupled = [boundary for boundary in on_lattice if not boundary.oriented.boundary.condition("left").couples]
    behind = nodes_behind_boundaries(uncoupled, band, formula, 2 * reach)
    if len(behind):
        formula = node_formulas(surface, band, lattice, scene.edge, order, behind)
    side_views = [boundary.side_view(formula.points, 2 * reach, band.spacing) for boundary in on_lattice]
    diffusivity = scene.problem.terms().diffusivity
    return BoundariesOnBand(scene.boundaries, on_lattice, side_views, behind, diffusivity), formula


def _sources_of_nodes(boundaries: BoundariesOnBand, band: Band) -> RowFormula:
    """Return the formula by which the band's nodes read right-hand sides: at their closest points, on their own side.

    A node whose closest point is almost on a boundary (not at an open end or past an edge) extrapolates from points on
    its side that are farther from the boundary.
    """
    points, coefficient, terms = band.feet.points.copy(), np.ones(len(band.nodes)), []
    for number, view in enumerate(boundaries.side_views):
        doubtful = (np.abs(view.signed) < SIDE_READING_SPACINGS * band.spacing) & ~view.end
        doubtful &= band.feet.edge[view.rows] < 0
        if doubtful.any():
            chosen = view.take(doubtful)
            others = [other for index, other in enumerate(boundaries.on_lattice) if index != number]
            formula = node_sources(points[chosen.rows], boundaries.on_lattice[number], others, chosen)
            points[chosen.rows], coefficient[chosen.rows] = formula.points, formula.coefficient
            terms += [replace(term, rows=chosen.rows[term.rows]) for term in formula.terms]
    return RowFormula(points, coefficient, (), terms)


def extension_matrix(
    unknowns: Unknowns,
    points: Floats,
    centres: Centres,
    coefficient: Floats | None = None,
    progress: Progress = no_progress,
) -> SparseMatrix:
    """Return the matrix (n, unknowns) that interpolates the unknowns at ``points`` of the manifold.

    ``unknowns``: unknowns of the band, whose order is that of the columns.
    ``points`` (n, d): points of the manifold, relative to the lattice's origin.
    ``centres``: the side of each boundary on which each point is, and its sheet.
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


def build_extension(
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
    """Return the formulas of all rows of E: of the band's nodes, then of the ghosts of each boundary in turn."""
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
    """Return the centres of the stencils of all rows of E, with the side of each near boundary on which each lies.

    If the band has sheets and the rows' ``formula`` is given, the centres include the feet by which the sheet is
    chosen, and the normals known so far.
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
