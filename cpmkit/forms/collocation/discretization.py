"""From the layout of a scene to the tables of the closest point method: E, the difference table, the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.forms.collocation.boundary.row_formula import BoundaryData, ExtraPoint, RowFormula, sum_of_data
from cpmkit.forms.collocation.diagnosis.refusals import check_effect, check_layout
from cpmkit.forms.collocation.extension import extend, extend_rows, row_centres
from cpmkit.forms.collocation.ghosts.edge import EDGE_CONDITION as EDGE
from cpmkit.forms.collocation.layout import Layout, lay_out, with_data_of
from cpmkit.forms.collocation.numbering import Numbering
from cpmkit.forms.collocation.options import CollocationOptions
from cpmkit.forms.collocation.selection import Centres, Unknowns
from cpmkit.forms.options import Options
from cpmkit.grid.stencils import cross_offsets
from cpmkit.linear.operators import matrix_of_rows, scatter_matrix
from cpmkit.protocols import SIDES, Floats, Ints, Progress, no_progress
from cpmkit.scene.conditions import same_condition
from cpmkit.scene.data import Data, evaluate_data
from cpmkit.scene.laws import Interface, Law
from cpmkit.scene.scene import Scene

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class Discretization:
    """The tables of one band, without an equation.

    Attributes
    ----------
    layout : Layout
        Lattice, band, boundaries and ghosts.
    extension : csr_array (rows, unknowns)
        E: one row an outer node, then one a ghost. Its arrays are read-only: every operator shares them.
    data : sequence of BoundaryData
        What the boundary data add to E u.
    neighbours : (unknowns, k) int, read-only
        Rows of E that the difference stencil of each unknown reads, in the order of
        :func:`cpmkit.grid.stencils.cross_offsets`.
    """

    layout: Layout
    extension: csr_array
    data: Sequence[BoundaryData]
    neighbours: Ints

    @cached_property
    def differences(self) -> csr_array:
        """N (unknowns, rows): ones, so that L = (N - 2 d I) / spacing^2. Read-only."""
        return self.weighted_differences(np.ones(self.neighbours.size))

    def weighted_differences(self, weights: Floats) -> csr_array:
        """Return the matrix (unknowns, rows) with ``weights`` (unknowns, k) at the difference neighbours, read-only."""
        return read_only(matrix_of_rows(weights, self.neighbours, self.extension.shape[0]))

    @property
    def unknowns(self) -> Unknowns:
        """What stencils read: the band's inner nodes, and the ghosts of each boundary."""
        return self.layout.unknowns

    @property
    def numbering(self) -> Numbering:
        """The numbers of rows of E and of unknowns."""
        return self.layout.numbering

    def datum(self, time: float | None = None) -> Floats:
        """Return what the boundary data add to E u at ``time``, (rows, channels)."""
        return sum_of_data(self.data, self.extension.shape[0], self.layout.channels, time)

    @cached_property
    def sources(self) -> RowFormula:
        """Where the unknowns read right-hand sides and initial data: nodes at their feet, ghosts on their side."""
        readings = [self.layout.sources, *(ghosts.sources for ghosts in self.layout.ghosts)]
        numbers = np.split(self.numbering.unknown_of_row, self.numbering.first_rows[:-1])
        kept = self.numbering.unknown_of_row >= 0
        return RowFormula(
            np.concatenate([one.points for one in readings])[kept],
            np.concatenate([one.coefficient for one in readings])[kept],
            (),
            [_renumbered(term, number) for one, number in zip(readings, numbers, strict=True) for term in one.terms],
        )

    def read_sources(self, data: Data, what: str, time: float | None = None) -> Floats:
        """Return ``data`` at the unknowns, (unknowns, channels), each read on the side that it carries."""
        sources, lattice, channels = self.sources, self.layout.lattice, self.layout.channels
        values = evaluate_data(data, lattice.to_scene(sources.points), channels, what, time)
        if not sources.terms:
            return values
        values = sources.coefficient[:, None] * values
        for term in sources.terms:
            read = evaluate_data(data, lattice.to_scene(term.points), channels, what, time)
            np.add.at(values, term.rows, term.coefficient[:, None] * read)
        return values

    def read_at_rows(self, data: Any, what: str, channels: int | None = 1) -> Floats:
        """Return a coefficient (rows, channels) of the equation at all rows of E, ghosts on the side they carry."""
        lattice, readings = self.layout.lattice, [self.layout.sources, *(one.sources for one in self.layout.ghosts)]
        return np.concatenate([evaluate_data(data, lattice.to_scene(one.points), channels, what) for one in readings])

    def read_in_place_of(self, law: type[Law]) -> csr_array:
        """Return the matrix (rows, unknowns) that reads u where E u + data has the data of a ``law``, factors alike."""
        from scipy.sparse import csr_array, diags_array

        read = csr_array(self.extension.shape)
        for datum in self.data:
            if isinstance(datum.law, law):
                factor = np.zeros(read.shape[0])
                factor[datum.rows] = datum.factor
                read = read + diags_array(factor) @ self.read_at_datum(datum)
        return csr_array(read)

    def read_at_datum(self, datum: BoundaryData) -> csr_array:
        """Return the matrix (rows, unknowns) that reads u at a datum's points, in its rows, from their sides."""
        order = np.argsort(datum.rows)
        rows, points = datum.rows[order], self.layout.lattice.to_local(datum.points[order])
        centres = row_centres(self.layout).take(rows)
        if self.layout.band.sheets is not None:
            centres = replace(centres, feet=self.layout.surface.closest_point(points), normals=None)
        read: csr_array = (scatter_matrix(rows, self.numbering.rows) @ extend(self.unknowns, points, centres)).tocsr()
        return read


def build_tables(
    scene: Scene, options: Options[CollocationOptions], progress: Progress = no_progress
) -> Discretization:
    """Build the tables for a scene; ``progress`` is told the stage and the share of it that is done.

    Raises
    ------
    InputError, SceneError, ResolutionError
        If the lattice's origin, a boundary or the spacing does not fit.
    """
    layout = lay_out(scene, options, progress)
    check_layout(layout, scene)
    tables = tabulate(layout, progress)
    check_effect(layout, tables.extension, tables.neighbours)
    return tables


def tabulate(layout: Layout, progress: Progress = no_progress) -> Discretization:
    """Build E and N for a layout; no closest point is asked for."""
    extension, data, centres = extend_rows(layout, lambda stage, share: progress(stage, 0.8 * share))
    neighbours = _neighbours(layout.unknowns, centres)
    neighbours.flags.writeable = False
    progress("tables", 1.0)
    return Discretization(layout, read_only(extension), data, neighbours)


def read_only(matrix: csr_array) -> csr_array:
    """Return ``matrix`` with arrays that nothing can write to.

    SciPy sorts the indices of an operand in place where it needs them sorted (``abs`` does): what shares the arrays, or
    knows the order of a row, is then wrong without a word.
    """
    for part in (matrix.data, matrix.indices, matrix.indptr):
        part.flags.writeable = False
    return matrix


def _renumbered(term: ExtraPoint, rows: Ints) -> ExtraPoint:
    """Return a term with row k of its batch called ``rows[k]``; -1 leaves it out. Its side views go."""
    kept = term.take(rows[term.rows] >= 0)
    return replace(kept, rows=rows[kept.rows])


def _neighbours(unknowns: Unknowns, centres: Centres) -> Ints:
    """Return which rows of E (unknowns, k) the difference stencil of each unknown reads.

    A neighbour across a boundary is read through its ghost. A ghost's neighbour on the ghost's own side is
    that neighbour's ghost; one on the side that it carries, or past an open end, is the node itself.
    """
    band, numbering = unknowns.band, unknowns.numbering
    nodes = np.concatenate([np.arange(band.inner), *(one.nodes[: one.unknowns] for one in unknowns.ghosts)])
    beside = band.find(band.nodes[nodes][:, None] + cross_offsets(band.dim))
    own = Centres.of_nodes(band, nodes)
    centre_view = centres.take(numbering.row_of_unknown)
    columns = unknowns.select_rows(replace(own, side_views=centre_view.side_views, own=centre_view.own), beside)
    return columns.astype(np.int32 if numbering.rows <= np.iinfo(np.int32).max else np.int64)


def restated(tables: Discretization, old: Scene, new: Scene) -> Discretization:
    """Return the tables of the scene ``old`` with the data of ``new``, which differs in its equation and data alone.

    Raises
    ------
    SceneError
        If the tables hold what would change: the equation's diffusivity on both sides of a boundary that couples them,
        a wall, whose flux of zero has no rows, or one condition where there would be several.
    """
    laws = list(zip(_laws(old), _laws(new), strict=True))
    coupled = [law for (_, law), _ in laws if isinstance(law, Interface) and None in (law.left, law.right)]
    if coupled and old.problem.terms().diffusivity != new.problem.terms().diffusivity:
        raise SceneError(
            "the tables hold the diffusivity of the equation that they were made for, on both sides of a transmission; "
            "give Transmission its left and right, or use cpmkit.solve."
        )
    held, known = {_owner(datum) for datum in tables.data}, dict[tuple[int, str], Law]()
    for (what, before), (_, after) in laws:
        if not same_condition(known.setdefault((id(before), what), after), after):
            raise SceneError(
                f"{what} is one object for several loops or sides in the tables, and takes no different data; make "
                "a condition of each before ck.prepare, or use cpmkit.solve."
            )
        if (id(before), what) not in held and not same_condition(before, after):
            raise SceneError(
                f"{what} has no data in the tables, a flux of zero has none, and takes no others; use cpmkit.solve."
            )
    layout = with_data_of(tables.layout, new)
    check_layout(layout, new)
    laws_of_data = [known[_owner(datum)] for datum in tables.data]
    data = [
        replace(datum, law=law, data=getattr(law, _part(datum)))
        for datum, law in zip(tables.data, laws_of_data, strict=True)
    ]
    return replace(tables, layout=layout, data=data)


def _laws(scene: Scene) -> list[tuple[str, Law]]:
    """Return the laws of a scene, each with what it is of, as :class:`BoundaryData` tells it."""
    edge = [(EDGE, one.law) for one in scene.edge_conditions]
    sides = [
        (f"boundary {boundary.name!r}", boundary.condition(side).law) for boundary in scene.boundaries for side in SIDES
    ]
    return sides + edge


def _part(datum: BoundaryData) -> str:
    """Return which datum of its law it is: the jump or the flux of an interface, else the one there is."""
    return next((name for name in ("jump", "flux") if datum.what.startswith(f"the {name} of ")), "datum")


def _owner(datum: BoundaryData) -> tuple[int, str]:
    """Return the law that a datum is of, and what that is of."""
    return id(datum.law), datum.what.removeprefix(f"the {_part(datum)} of ")
