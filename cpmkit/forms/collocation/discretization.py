"""From the layout of a scene to the tables of the closest point method: E, the difference table, the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.forms.collocation.boundary.crossing import View, visible_ghosts
from cpmkit.forms.collocation.boundary.frame import Frame, stack
from cpmkit.forms.collocation.boundary.reading import Datum, Reading, Term, sum_of_data
from cpmkit.forms.collocation.diagnosis.refusals import check_effect, check_layout
from cpmkit.forms.collocation.extension import Unknowns, extend
from cpmkit.forms.collocation.ghosts.nodes import Ghosts
from cpmkit.forms.collocation.layout import Layout, lay_out
from cpmkit.forms.collocation.options import CollocationOptions
from cpmkit.forms.options import Options
from cpmkit.grid.band import Band
from cpmkit.grid.stencils import cross_offsets, cross_weights, difference_reach
from cpmkit.protocols import Floats, Ints, Progress, nothing
from cpmkit.scene.data import Data, evaluate_data
from cpmkit.scene.laws import Law
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
    unknowns : Unknowns
        The band's inner nodes and the ghosts of each boundary.
    extension : csr_array (rows, unknowns)
        E: one row an outer node, then one a ghost. Its arrays are read-only: every operator shares them.
    data : sequence of Datum
        What the boundary data add to E u.
    neighbours : (unknowns, k) int, read-only
        Rows of E that the difference stencil of each unknown reads, in the order of
        :func:`cpmkit.grid.stencils.cross_offsets`.
    """

    layout: Layout
    unknowns: Unknowns
    extension: csr_array
    data: Sequence[Datum]
    neighbours: Ints

    @cached_property
    def differences(self) -> csr_array:
        """N (unknowns, rows): ones at second order, so that L = (N - 2 d I) / spacing^2. Read-only."""
        reach = difference_reach(self.layout.order)
        return self.weighted_differences(
            np.tile(cross_weights(self.layout.lattice.dim, reach)[0], len(self.neighbours))
        )

    def weighted_differences(self, weights: Floats) -> csr_array:
        """Return the matrix (unknowns, rows) with ``weights`` (unknowns, k) at the difference neighbours, read-only."""
        from scipy.sparse import csr_array

        count, width = self.neighbours.shape
        columns, starts = self.neighbours.ravel(), np.arange(count + 1) * width
        shape = (count, self.extension.shape[0])
        return read_only(csr_array((np.ravel(weights), columns, starts), shape=shape))

    @property
    def unknown_rows(self) -> Ints:
        """(unknowns,) the row of E that belongs to each unknown."""
        return _unknown_rows(self.layout.band, self.layout.ghosts)

    def datum(self, time: float | None = None) -> Floats:
        """Return what the boundary data add to E u at ``time``, (rows, channels)."""
        return sum_of_data(self.data, self.extension.shape[0], self.layout.channels, time)

    @cached_property
    def sources(self) -> Reading:
        """Where the unknowns read right-hand sides and initial data: nodes at their feet, ghosts on their side."""
        nodes = self.layout.sources
        inner = np.where(np.arange(len(nodes)) < self.layout.band.inner, np.arange(len(nodes)), -1)
        readings, numbers, first = [nodes], [inner], self.layout.band.inner
        for ghosts in self.layout.ghosts:
            readings.append(ghosts.sources)
            count = np.arange(len(ghosts.nodes))
            numbers.append(np.where(count < ghosts.unknowns, count + first, -1))
            first += ghosts.unknowns
        kept = [number >= 0 for number in numbers]
        return Reading(
            np.concatenate([reading.points[keep] for reading, keep in zip(readings, kept, strict=True)]),
            np.concatenate([reading.coefficient[keep] for reading, keep in zip(readings, kept, strict=True)]),
            (),
            [
                _renumbered(term, number)
                for reading, number in zip(readings, numbers, strict=True)
                for term in reading.terms
            ],
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
        lattice, parts = self.layout.lattice, []
        for sources in (self.layout.sources, *(ghosts.sources for ghosts in self.layout.ghosts)):
            parts.append(evaluate_data(data, lattice.to_scene(sources.points), channels, what))
        return np.concatenate(parts)

    def read_in_place_of(self, law: type[Law]) -> csr_array:
        """Return the matrix (rows, unknowns) that reads u where E u + data has the data of a ``law``, factors alike."""
        from scipy.sparse import csr_array, diags_array

        read = csr_array(self.extension.shape)
        for datum in self.data:
            if isinstance(datum.law, law):
                factor = np.zeros(read.shape[0])
                factor[datum.rows] = datum.factor
                read = read + diags_array(factor) @ self.read_at_datum(datum)
        made: csr_array = read.tocsr()
        return made

    def read_at_datum(self, datum: Datum) -> csr_array:
        """Return the matrix (rows, unknowns) that reads u at a datum's points, in its rows, from their sides."""
        from scipy.sparse import csr_array

        view = _all_views(self.layout.sight.frames, self.layout.ghosts, len(self.layout.band.nodes))
        order = np.argsort(datum.rows)
        rows, points = datum.rows[order], self.layout.lattice.to_local(datum.points[order])
        place = csr_array((np.ones(len(rows)), (rows, np.arange(len(rows)))), shape=(len(view.own), len(rows)))
        read: csr_array = (place @ extend(self.unknowns, points, view.select(rows))).tocsr()
        return read


def build_tables(scene: Scene, options: Options[CollocationOptions], progress: Progress = nothing) -> Discretization:
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


def tabulate(layout: Layout, progress: Progress = nothing) -> Discretization:
    """Build E and N for a layout; no closest point is asked for."""
    ghosts = layout.ghosts
    unknowns = Unknowns(layout.band, ghosts)
    rows = _all_readings(layout.reading, ghosts)
    view = _all_views(layout.sight.frames, ghosts, len(layout.band.nodes))
    extension = extend(unknowns, rows.points, view, rows.coefficient, lambda stage, share: progress(stage, 0.8 * share))
    if rows.terms:
        extension = _with_terms(extension, unknowns, rows.terms)
    neighbours = _neighbours(unknowns, view, difference_reach(layout.order))
    neighbours.flags.writeable = False
    progress("tables", 1.0)
    return Discretization(layout, unknowns, read_only(extension), rows.data, neighbours)


def read_only(matrix: csr_array) -> csr_array:
    """Return ``matrix`` with arrays that nothing can write to.

    SciPy sorts the indices of an operand in place where it needs them sorted (``abs`` does): what shares the arrays, or
    knows the order of a row, is then wrong without a word.
    """
    for part in (matrix.data, matrix.indices, matrix.indptr):
        part.flags.writeable = False
    return matrix


def _with_terms(extension: csr_array, unknowns: Unknowns, terms: Sequence[Term]) -> csr_array:
    """Return E with further points read by some rows."""
    from scipy.sparse import csr_array

    for term in terms:
        view = View(term.frames, np.full(len(term.points), term.own))
        read = extend(unknowns, term.points, view, term.coefficient)
        place = csr_array(
            (np.ones(len(term.rows)), (term.rows, np.arange(len(term.rows)))),
            shape=(extension.shape[0], len(term.rows)),
        )
        extension = extension + place @ read
    extension.eliminate_zeros()
    made: csr_array = extension.tocsr()
    return made


def _renumbered(term: Term, rows: Ints) -> Term:
    """Return a term with row k of its batch called ``rows[k]``; -1 leaves it out. Its frames go."""
    kept = rows[term.rows] >= 0
    return Term(rows[term.rows[kept]], term.points[kept], term.coefficient[kept])


def _all_readings(nodes: Reading, ghosts: Sequence[Ghosts]) -> Reading:
    """Return what all rows of E read: the band's nodes, then each boundary's ghosts."""
    parts = [nodes, *(one.reading for one in ghosts)]
    numbers = np.split(np.arange(sum(map(len, parts))), np.cumsum([len(part) for part in parts])[:-1])
    numbered = list(zip(parts, numbers, strict=True))
    return Reading(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.coefficient for part in parts]),
        [datum.renumbered(rows) for part, rows in numbered for datum in part.data],
        [replace(term, rows=rows[term.rows]) for part, rows in numbered for term in part.terms],
    )


def _first_rows(nodes: int, ghosts: Sequence[Ghosts]) -> Ints:
    """Return the first row of E of each boundary's ghosts, and the number of rows."""
    return np.cumsum([nodes] + [len(one.nodes) for one in ghosts]).astype(np.int64)


def _unknown_rows(band: Band, ghosts: Sequence[Ghosts]) -> Ints:
    """Return the row of E that belongs to each unknown: the inner nodes', then those of each boundary's ghosts."""
    first = _first_rows(len(band.nodes), ghosts)
    parts = [np.arange(band.inner), *(first[k] + np.arange(one.unknowns) for k, one in enumerate(ghosts))]
    return np.concatenate(parts)


def _all_views(frames: Sequence[Frame], ghosts: Sequence[Ghosts], nodes: int) -> View:
    """Return how all rows of E see the boundaries."""
    first = _first_rows(nodes, ghosts)
    stacked = [
        stack([(0, frame), *((int(first[k]), one.frames[index]) for k, one in enumerate(ghosts))])
        for index, frame in enumerate(frames)
    ]
    own = np.repeat(np.arange(-1, len(ghosts)), np.diff(first, prepend=0))
    return View(stacked, own)


def _neighbours(unknowns: Unknowns, view: View, reach: int) -> Ints:
    """Return which rows of E (unknowns, k) the difference stencil of each unknown reads.

    A neighbour across a boundary is read through its ghost. A ghost's neighbour on the ghost's own side is
    that neighbour's ghost; one on the side that it carries, or past an open end, is the node itself.
    """
    band, ghosts = unknowns.band, unknowns.ghosts
    first = _first_rows(len(band.nodes), ghosts)
    centres = np.concatenate([np.arange(band.inner), *(one.nodes[: one.unknowns] for one in ghosts)])
    rows = _unknown_rows(band, ghosts)
    nodes = band.find(band.nodes[centres][:, None] + cross_offsets(band.dim, reach))
    if band.sheets is not None:
        anchors, every = band.sheets.anchor[centres], np.ones(len(band.nodes), dtype=bool)
        band.sheets.choose(band.feet.take(anchors), band.sheets.normals[anchors], nodes, every)
    seen, directors = view.select(rows), [one.director for one in ghosts]
    label, number = visible_ghosts(seen, nodes, [one.numbers for one in ghosts], directors)
    columns = np.where(label >= 0, first[label] + number, nodes)
    narrow = first[-1] <= np.iinfo(np.int32).max
    return columns.astype(np.int32 if narrow else np.int64)
