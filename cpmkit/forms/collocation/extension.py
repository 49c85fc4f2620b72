"""Reading a band at surface points, seen from their sides: the one operator behind E and evaluation.

The closest point extension E, the evaluation of a solution and the transfers between bands all are
*interpolate in this band at these surface points, and in each node of a stencil take the unknown that
is on the point's own side of every boundary*.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.forms.collocation.boundary.crossing import View, visible_ghosts
from cpmkit.grid.band import Band
from cpmkit.grid.stencils import stencil_cells, tensor_offsets, tensor_weights
from cpmkit.manifold.tangent_space import normals
from cpmkit.protocols import Bools, Floats, Ints, Progress, nothing

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from cpmkit.forms.collocation.ghosts.nodes import Ghosts

#: Rows that are built at a time: what they need meanwhile is small beside the tables.
CHUNK = 16384


@dataclass(frozen=True, eq=False)
class Unknowns:
    """What can be read: the inner nodes of a band, and after them the ghosts of each boundary.

    Attributes
    ----------
    band : Band
        The nodes.
    ghosts : sequence of Ghosts
        One a boundary.
    """

    band: Band
    ghosts: Sequence[Ghosts]

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return self.band.inner + sum(ghosts.unknowns for ghosts in self.ghosts)

    @property
    def first(self) -> Ints:
        """First unknown of each boundary's ghosts."""
        counts = [self.band.inner] + [ghosts.unknowns for ghosts in self.ghosts]
        return np.cumsum(counts)[:-1].astype(np.int64)

    @property
    def ghost_nodes(self) -> Ints:
        """(g, 2) the number of its boundary, and of its node in the band, of each ghost that is an unknown."""
        parts = [
            np.stack([np.full(ghosts.unknowns, index), ghosts.nodes[: ghosts.unknowns]], axis=1)
            for index, ghosts in enumerate(self.ghosts)
        ]
        return np.concatenate([np.zeros((0, 2), dtype=np.int64), *parts])

    @property
    def ghost_sides(self) -> Bools:
        """(g,) whether each ghost that is an unknown carries the left of its boundary."""
        return np.concatenate([np.zeros(0, bool), *(one.carries_left[: one.unknowns] for one in self.ghosts)])


def extend(
    unknowns: Unknowns,
    points: Floats,
    view: View,
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
    view : View
        How each point sees the boundaries.
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
        columns[rows] = stencil_nodes(band, cells)
        weights[rows] = tensor_weights(fractions, band.degree)
        part = columns[rows[0] : rows[-1] + 1]
        see(unknowns, points[rows], view.select(rows), part)
        progress("tables", (rows[-1] + 1) / n)
    if coefficient is not None:
        weights *= coefficient[:, None]
    starts = np.arange(n + 1, dtype=np.int32 if columns.size < 2**31 else np.int64) * width
    return csr_array((weights.ravel(), columns.ravel(), starts), shape=(n, unknowns.count))


def stencil_nodes(band: Band, cells: Ints) -> Ints:
    """Return the inner nodes (n, (p + 1)^d), int32, of the stencils of ``cells`` (n, d).

    Each cell is looked up once, however many of the points lie in it.
    """
    codes = band.codes.encode(cells)
    _, first, member = np.unique(codes, return_index=True, return_inverse=True)
    nodes = band.find_inner(cells[first][:, None] + tensor_offsets(band.degree, band.dim))
    incomplete = np.asarray((nodes < 0).any(axis=1))
    if incomplete.any():
        lost = int(np.count_nonzero(incomplete[member.ravel()]))
        raise ResolutionError(
            f"{lost} interpolation stencils leave the band: the source's distances or bounds contradict its closest "
            "points; run `cpmkit.testing.run_laws` on it."
        )
    return np.asarray(nodes.astype(np.int32)[member.ravel()])


def see(unknowns: Unknowns, points: Floats, view: View, columns: Ints) -> None:
    """Choose, in the stencils ``columns`` (n, s) of surface ``points`` (n, d), the unknown that each sees in each node.

    First that of its own sheet, then, where a boundary runs between, the ghost that continues its own side.
    """
    _see_sheets(unknowns.band, points, columns)
    _see_ghosts(unknowns, view, columns)


def _see_sheets(band: Band, points: Floats, columns: Ints) -> None:
    """Replace, in the stencils ``columns`` (n, s) of ``points`` (n, d), nodes of other sheets by their twins."""
    if band.sheets is None:
        return
    touched = np.flatnonzero(band.sheets.counts(columns).any(axis=1))
    if not len(touched):
        return
    feet = band.sheets.source.closest_point(points[touched])
    own = columns[touched]
    n = normals(band.sheets.source, feet, 0.5 * band.spacing)
    band.sheets.choose(feet, n, own, np.arange(len(band.nodes)) < band.inner)
    columns[touched] = own


def _see_ghosts(unknowns: Unknowns, view: View, columns: Ints) -> None:
    """Replace, in the stencils ``columns`` (n, s), the nodes that lie across a boundary by their ghosts."""
    if not any(len(frame.rows) for frame in view.frames):
        return
    numbers = [ghosts.unknown_numbers for ghosts in unknowns.ghosts]
    directors = [ghosts.director for ghosts in unknowns.ghosts]
    touched = np.unique(np.concatenate([frame.rows for frame in view.frames]))
    label, number = visible_ghosts(view.select(touched), columns[touched], numbers, directors)
    columns[touched] = np.where(label >= 0, unknowns.first[label] + number, columns[touched])
