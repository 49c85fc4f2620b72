"""From the layout of a scene to the tables of the closest point method: E, the difference table, the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.boundary.crossing import View, visible_ghosts
from cpmkit.boundary.edge import Reading
from cpmkit.boundary.frame import Frame, stack
from cpmkit.boundary.ghosts import Ghosts
from cpmkit.grid.band import Band
from cpmkit.grid.extension import Unknowns, extend
from cpmkit.grid.stencils import cross_offsets
from cpmkit.layout import Layout, lay_out
from cpmkit.protocols import Floats, Ints, Progress, nothing
from cpmkit.scene import Scene

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
        E: one row an outer node, then one a ghost.
    datum : (rows, channels) float64
        What the boundary data add to E u.
    neighbours : csr_array (unknowns, rows)
        N: ones at the difference neighbours of each unknown, so that L = (N - 2 d I) / spacing^2.
    """

    layout: Layout
    unknowns: Unknowns
    extension: csr_array
    datum: Floats
    neighbours: csr_array

    @property
    def unknown_rows(self) -> Ints:
        """(unknowns,) the row of E that belongs to each unknown."""
        return _unknown_rows(self.layout.band, self.layout.ghosts)


def discretize(scene: Scene, spacing: float, *, progress: Progress = nothing, **options: Any) -> Discretization:
    """Build the tables for ``scene`` at ``spacing``.

    Parameters
    ----------
    scene : Scene
        Surface, boundaries, edge, problem.
    spacing : float
        Of the lattice, in the scene's unit.
    progress : callable, optional
        Told the stage and the share of it that is done.
    **options
        ``degree``, ``order`` and ``origin``, as for :func:`cpmkit.solve`.

    Raises
    ------
    InputError, SceneError, ResolutionError
        If an argument, a boundary or the spacing does not fit.
    """
    return tabulate(lay_out(scene, spacing, progress=progress, **options), progress)


def tabulate(layout: Layout, progress: Progress = nothing) -> Discretization:
    """Build E and N for a layout; no closest point is asked for."""
    ghosts = layout.ghosts
    unknowns = Unknowns(layout.band, ghosts)
    rows = _all_readings(layout.reading, ghosts)
    view = _all_views(layout.sight.frames, ghosts, len(layout.band.nodes))
    extension = extend(unknowns, rows.points, view, rows.coefficient, lambda stage, share: progress(stage, 0.8 * share))
    neighbours = _neighbours(unknowns, view)
    progress("tables", 1.0)
    return Discretization(layout, unknowns, extension, rows.datum, neighbours)


def _all_readings(nodes: Reading, ghosts: Sequence[Ghosts]) -> Reading:
    """Return what all rows of E read: the band's nodes, then each boundary's ghosts."""
    parts = [nodes, *(one.reading for one in ghosts)]
    return Reading(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.coefficient for part in parts]),
        np.concatenate([part.datum for part in parts]),
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


def _neighbours(unknowns: Unknowns, view: View) -> csr_array:
    """Return N: which rows of E the difference stencil of each unknown reads.

    A neighbour across a boundary is read through its ghost. A ghost's neighbour on the ghost's own side is
    that neighbour's ghost; one on the side that it carries, or past an open end, is the node itself.
    """
    from scipy.sparse import csr_array

    band, ghosts = unknowns.band, unknowns.ghosts
    first = _first_rows(len(band.nodes), ghosts)
    centres = np.concatenate([np.arange(band.inner), *(one.nodes[: one.unknowns] for one in ghosts)])
    rows = _unknown_rows(band, ghosts)
    nodes = band.find(band.nodes[centres][:, None] + cross_offsets(band.dim))
    label, number = visible_ghosts(
        view.select(rows), nodes, [one.numbers for one in ghosts], [one.director for one in ghosts]
    )
    columns = np.where(label >= 0, first[label] + number, nodes)
    starts = np.arange(len(rows) + 1) * columns.shape[1]
    return csr_array((np.ones(columns.size), columns.ravel(), starts), shape=(len(rows), int(first[-1])))
