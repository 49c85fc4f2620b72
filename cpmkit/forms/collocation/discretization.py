"""The tables of the closest point method: the extension matrix E, the difference neighbours and the boundary data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.forms.collocation import band_layout
from cpmkit.forms.collocation.ghosts.nodes_past_edge import EDGE_CONDITION
from cpmkit.forms.collocation.layout_checks import check_effect, check_layout
from cpmkit.forms.collocation.options import CollocationOptions
from cpmkit.forms.collocation.row_formula import BoundaryData, RowFormula, sum_of_data
from cpmkit.forms.collocation.selection import Centres, Unknowns
from cpmkit.forms.form_records import PlainWork
from cpmkit.forms.options import Options
from cpmkit.grid.band import cross_offsets
from cpmkit.linear.operators import Operator, matrix_of_rows, scatter_matrix
from cpmkit.linear.residuals import SolveReport
from cpmkit.runtime.memory import ENTRY_BYTES
from cpmkit.scene.conditions import same_condition
from cpmkit.scene.data import Data, evaluate_data
from cpmkit.scene.laws import Law
from cpmkit.scene.scene import Scene
from cpmkit.types import SIDES, Floats, Ints, Progress, SparseMatrix, no_progress


@dataclass(frozen=True, eq=False)
class Discretization:
    """The tables of a scene on a band; they do not depend on the equation, but for transmissions."""

    layout: band_layout.Layout  #: Lattice, band, boundaries and ghosts.
    #: (rows, unknowns): E, with a row for each node of the band and then for each ghost. Its arrays are read-only, as
    #: operators share them.
    extension: SparseMatrix
    data: Sequence[BoundaryData]  #: Terms that are added to E u.
    #: (unknowns, 2 d) int, read-only: rows of E that the difference stencil of each unknown reads, in the order of
    #: :func:`cpmkit.grid.band.cross_offsets`.
    neighbours: Ints

    @cached_property
    def differences(self) -> SparseMatrix:
        """N (unknowns, rows), with ones at the difference neighbours: L = (N - 2 d I) / spacing^2; read-only."""
        return self.weighted_differences(np.ones(self.neighbours.size))

    def weighted_differences(self, weights: Floats) -> SparseMatrix:
        """Return the read-only matrix (unknowns, rows) with ``weights``, 2 d a row, at the difference neighbours."""
        return make_read_only(matrix_of_rows(weights, self.neighbours, self.extension.shape[0]))

    @property
    def unknowns(self) -> Unknowns:
        """The unknowns: the band's inner nodes, then the ghosts of each boundary."""
        return self.layout.unknowns

    def datum(self, time: float | None = None) -> Floats:
        """Return the vector (rows, channels) of the boundary data, times their factors, that is added to E u."""
        return sum_of_data(self.data, self.extension.shape[0], self.layout.channels, time)

    @cached_property
    def sources(self) -> RowFormula:
        """The formula, a row for each unknown, by which right-hand sides and initial data are read.

        Data near boundaries are extrapolated from several points; ghosts read on the side that they continue. Points
        are relative to the lattice's origin.
        """
        formulas = [self.layout.sources, *(ghosts.sources for ghosts in self.layout.ghosts)]
        numbers = np.split(self.unknowns.unknown_of_row, self.unknowns.first_rows[:-1])
        is_unknown = self.unknowns.unknown_of_row >= 0
        return RowFormula(
            np.concatenate([formula.points for formula in formulas])[is_unknown],
            np.concatenate([formula.coefficient for formula in formulas])[is_unknown],
            (),
            [term.renumber(rows) for formula, rows in zip(formulas, numbers, strict=True) for term in formula.terms],
        )

    def read_sources(self, data: Data, label: str, time: float | None = None) -> Floats:
        """Return ``data`` (unknowns, channels) read by :attr:`sources`; ``time`` None: steady; ``label`` for errors."""
        sources, lattice, channels = self.sources, self.layout.lattice, self.layout.channels
        values = evaluate_data(data, lattice.to_scene(sources.points), channels, label, time)
        if not sources.terms:
            return values
        values = sources.coefficient[:, None] * values
        for term in sources.terms:
            at_term = evaluate_data(data, lattice.to_scene(term.points), channels, label, time)
            np.add.at(values, term.rows, term.coefficient[:, None] * at_term)
        return values

    def read_at_rows(self, data: Any, label: str, channels: int | None = 1) -> Floats:
        """Return a coefficient (rows, channels), called ``label`` in errors, at all rows of E.

        Ghosts read it on the side that they continue. ``data`` are a number or function of points; ``channels`` None
        means as many as these have. Raises InputError if they are not finite numbers of this shape.
        """
        formulas = [self.layout.sources, *(ghosts.sources for ghosts in self.layout.ghosts)]
        points = [self.layout.lattice.to_scene(formula.points) for formula in formulas]
        return np.concatenate([evaluate_data(data, at, channels, label) for at in points])

    def reading_matrix_of_law(self, law: type[Law]) -> SparseMatrix:
        """Return the matrix (rows, unknowns) that reads u in rows with data of a ``law``, times the data's factors.

        Lambda times this matrix, added to E, replaces the data by lambda u. The matrix is zero if no row has such data.
        """
        from scipy.sparse import csr_array, diags_array

        matrix = csr_array(self.extension.shape)
        for datum in self.data:
            if isinstance(datum.law, law):
                factor = np.zeros(matrix.shape[0])
                factor[datum.rows] = datum.factor
                matrix = matrix + diags_array(factor) @ self.reading_matrix_of_datum(datum)
        return csr_array(matrix)

    def reading_matrix_of_datum(self, datum: BoundaryData) -> SparseMatrix:
        """Return the matrix (rows, unknowns) that, in a datum's rows, interpolates u at its points.

        Each row reads from the side that it continues; all other rows are zero.
        """
        order = np.argsort(datum.rows)
        rows, points = datum.rows[order], self.layout.lattice.to_local(datum.points[order])
        centres = band_layout.row_centres(self.layout).take(rows)
        if self.layout.band.sheets is not None:
            centres = replace(centres, feet=self.layout.surface.closest_point(points), normals=None)
        matrix: SparseMatrix = scatter_matrix(rows, self.unknowns.rows) @ band_layout.extension_matrix(
            self.unknowns, points, centres
        )
        return matrix


def build_tables(
    scene: Scene, options: Options[CollocationOptions], progress: Progress = no_progress
) -> Discretization:
    """Return the tables of a scene (E, difference neighbours, boundary data), after all checks of its layout.

    ``progress(stage, share)`` is called. Raises InputError, SceneError or ResolutionError if the lattice's origin, a
    boundary, a condition or the spacing does not fit.
    """
    layout = band_layout.build_layout(scene, options, progress)
    check_layout(layout, scene)
    tables = tables_of_layout(layout, progress)
    check_effect(layout, tables.extension, tables.neighbours)
    return tables


def tables_of_layout(layout: band_layout.Layout, progress: Progress = no_progress) -> Discretization:
    """Return the tables (E, difference neighbours, boundary data) of a layout; ``progress`` gets stage and share."""
    extension, data, centres = band_layout.build_extension(layout, lambda stage, share: progress(stage, 0.8 * share))
    neighbours = _difference_neighbours(layout.unknowns, centres)
    neighbours.flags.writeable = False
    progress("tables", 1.0)
    return Discretization(layout, make_read_only(extension), data, neighbours)


def make_read_only(matrix: SparseMatrix) -> SparseMatrix:
    """Return ``matrix``, one of the tables, after making its arrays read-only.

    SciPy sorts the indices of an operand in place if it needs them sorted (``abs`` does); that would spoil a matrix
    that shares the arrays, and code that relies on the order in a row.
    """
    for part in (matrix.data, matrix.indices, matrix.indptr):
        part.flags.writeable = False
    return matrix


def _difference_neighbours(unknowns: Unknowns, centres: Centres) -> Ints:
    """Return the rows of E (unknowns, 2 d) that difference stencils read, in the order of :func:`cross_offsets`.

    ``centres`` are those of the interpolation stencils of all rows of E. A neighbour on the other side of a boundary is
    read through its ghost. The stencil of a ghost reads the ghost of a neighbour that is on its own node's side, and
    the node itself on the side that it continues, or past an open end.
    """
    band = unknowns.band
    nodes = np.concatenate([np.arange(band.inner), *(group.nodes[: group.unknowns] for group in unknowns.ghosts)])
    neighbour = band.find(band.nodes[nodes][:, None] + cross_offsets(band.dim))
    seen = centres.take(unknowns.row_of_unknown)
    normals = None if band.sheets is None else band.sheets.normals[nodes]
    columns = unknowns.select_rows(replace(seen, feet=band.feet.take(nodes), normals=normals), neighbour)
    return columns.astype(np.int32 if unknowns.rows <= np.iinfo(np.int32).max else np.int64)


def with_new_data(tables: Discretization, old: Scene, new: Scene) -> Discretization:
    """Return the tables of the scene ``old`` with the data of ``new``, which differs only in its equation and data.

    Raises SceneError if a change affects the tables themselves: a new diffusivity that a transmission uses, new data of
    a condition without data in the tables (zero flux), or different data for loops or sides that shared one condition
    object. Raises SceneError or ResolutionError if :func:`check_layout` refuses the new data.
    """
    laws = list(zip(_labelled_laws(old), _labelled_laws(new), strict=True))
    coupled = [law for (_, law), _ in laws if law.couples and None in law.factors]
    if coupled and old.problem.terms().diffusivity != new.problem.terms().diffusivity:
        raise SceneError(
            "the tables hold the diffusivity of the equation that they were made for, on both sides of a transmission; "
            "give Transmission its left and right, or use cpmkit.solve."
        )
    in_tables, known = {(id(datum.law), datum.label) for datum in tables.data}, dict[tuple[int, str], Law]()
    for (label, before), (_, after) in laws:
        if not same_condition(known.setdefault((id(before), label), after), after):
            raise SceneError(
                f"{label} is one object for several loops or sides in the tables, and takes no different data; make "
                "a condition of each before ck.prepare, or use cpmkit.solve."
            )
        if (id(before), label) not in in_tables and not same_condition(before, after):
            raise SceneError(
                f"{label} has no data in the tables, a flux of zero has none, and takes no others; use cpmkit.solve."
            )
    boundaries = replace(tables.layout.boundaries, definitions=new.boundaries)
    layout = replace(tables.layout, boundaries=boundaries, channels=new.channels)
    check_layout(layout, new)
    laws_of_data = [known[id(datum.law), datum.label] for datum in tables.data]
    data = [
        replace(datum, law=law, data=getattr(law, datum.part))
        for datum, law in zip(tables.data, laws_of_data, strict=True)
    ]
    return replace(tables, layout=layout, data=data)


def _labelled_laws(scene: Scene) -> list[tuple[str, Law]]:
    """Return the laws of the conditions of a scene, each with its label in :class:`BoundaryData`."""
    edge = [(EDGE_CONDITION, condition.law) for condition in scene.edge_conditions]
    sides = [
        (f"boundary {boundary.name!r}", boundary.condition(side).law) for boundary in scene.boundaries for side in SIDES
    ]
    return sides + edge


@dataclass(frozen=True)
class Work(PlainWork):
    """Machine-independent cost of a solve; unknowns are inner nodes and ghosts, matrices are E and N."""

    nodes: int  #: Number of nodes of the band, outer nodes included.
    ghosts: int  #: Number of unknowns that are ghosts.
    first_order_ghosts: int  #: Number of ghosts of order 1, by request or as another boundary hides the mirror point.
    closest_point_queries: int  #: Number of closest point queries of the surface and of all boundaries.
    table_bytes: int  #: Bytes of E, N and the closest point records.
    #: The closest point queries of the surface and of each boundary, by name.
    queries: Mapping[str, int] = field(default_factory=dict)


def measure_work(tables: Discretization, operator: Operator, report: SolveReport | None) -> Work:
    """Return the sizes of the tables and of ``operator``, and the operations of a solve, 0 if ``report`` is None."""
    layout, matrix, feet = tables.layout, tables.extension, tables.layout.band.feet
    first_order = sum(np.count_nonzero(ghosts.orders[: ghosts.unknowns] == 1) for ghosts in layout.ghosts)
    stored = sum(part.nbytes for part in (matrix.data, matrix.indices, matrix.indptr))
    stored += tables.neighbours.nbytes + tables.neighbours.size * ENTRY_BYTES
    stored += layout.band.nodes.nbytes + feet.points.nbytes + feet.distance.nbytes + feet.edge.nbytes
    return Work(
        unknowns=operator.size,
        nodes=len(layout.band.nodes),
        ghosts=operator.size - layout.band.inner,
        first_order_ghosts=int(first_order),
        nonzeros=operator.nonzeros,
        operator_applications=report.operator_applications if report else 0,
        closest_point_queries=sum(layout.queries.values()),
        table_bytes=int(stored),
        queries=dict(layout.queries),
    )
