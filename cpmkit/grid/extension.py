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

from cpmkit.boundary.crossing import View, visible_ghosts
from cpmkit.errors import ResolutionError
from cpmkit.grid.band import Band
from cpmkit.grid.stencils import stencil_cells, tensor_offsets, tensor_weights
from cpmkit.protocols import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from cpmkit.boundary.ghosts import Ghosts

#: Rows whose stencils are searched for crossings at a time.
CHUNK = 65536


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


def extend(unknowns: Unknowns, points: Floats, view: View, coefficient: Floats | None = None) -> csr_array:
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

    Returns
    -------
    csr_array (n, unknowns)

    Raises
    ------
    ResolutionError
        If a stencil leaves the band, which the laws of a closest point source exclude.
    """
    from scipy.sparse import csr_array

    band = unknowns.band
    cells, fractions = stencil_cells(points, band.spacing, band.degree)
    columns = stencil_nodes(band, cells)
    weights = tensor_weights(fractions, band.degree)
    if coefficient is not None:
        weights *= coefficient[:, None]
    see_ghosts(unknowns, view, columns)
    width = columns.shape[1]
    starts = np.arange(len(points) + 1, dtype=np.int32 if columns.size < 2**31 else np.int64) * width
    return csr_array((weights.ravel(), columns.ravel(), starts), shape=(len(points), unknowns.count))


def stencil_nodes(band: Band, cells: Ints) -> Ints:
    """Return the inner nodes (n, (p + 1)^d), int32, of the stencils of ``cells`` (n, d); each cell is looked up once."""
    codes = band.codes.encode(cells)
    _, first, member = np.unique(codes, return_index=True, return_inverse=True)
    nodes = band.find_inner(cells[first][:, None] + tensor_offsets(band.degree, band.dim))
    if np.any(nodes < 0):
        lost = int(np.count_nonzero((nodes < 0).any(axis=1)[member]))
        raise ResolutionError(
            f"{lost} interpolation stencils leave the band: the source's distances or bounds contradict its closest "
            "points; run `cpmkit.testing.run_laws` on it."
        )
    return np.asarray(nodes.astype(np.int32)[member.ravel()])


def see_ghosts(unknowns: Unknowns, view: View, columns: Ints) -> None:
    """Replace, in the stencils ``columns`` (n, s), the nodes that lie across a boundary by their ghosts."""
    if not view.frames:
        return
    band = unknowns.band
    numbers = [np.where(ghosts.numbers < ghosts.unknowns, ghosts.numbers, -1) for ghosts in unknowns.ghosts]
    directors = [ghosts.director for ghosts in unknowns.ghosts]
    touched = np.unique(np.concatenate([frame.rows for frame in view.frames]))
    for start in range(0, len(touched), CHUNK):
        rows = touched[start : start + CHUNK]
        stencils = columns[rows]
        label, number = visible_ghosts(view.select(rows), stencils, numbers, directors)
        columns[rows] = np.where(label >= 0, unknowns.first[label] + number, stencils)
    assert columns.max(initial=0) < max(unknowns.count, band.inner)
