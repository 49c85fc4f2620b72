"""The surface gradient of a solution.

On the manifold it is the gradient of what extends the solution constantly along normals (Ruuth and Merriman 2008,
principle 1), here of the interpolant of the band's values; what discretisation leaves of a normal part is projected
away. Beside a Dirichlet condition the ghosts continue the solution by a straight line, which bends the interpolant
there: see :mod:`cpmkit.forms.collocation.reading.one_sided`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.collocation.boundary.side_view import SideView
from cpmkit.forms.collocation.reading import one_sided
from cpmkit.forms.collocation.selection import Centres, Unknowns
from cpmkit.grid.stencils import stencil_cells, stencil_nodes, tensor_slopes
from cpmkit.linear.operators import matrix_of_rows
from cpmkit.manifold.tangent_space import project_tangent
from cpmkit.protocols import ClosestPoints, Floats, Ints, Side

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from cpmkit.forms.collocation.reading.points import Reader

#: Points at which the gradient is read at a time: their weights are small beside the tables.
GRADIENT_CHUNK_POINTS = 8192


def surface_gradient(reader: Reader, values: Floats, local: Floats, wanted: Mapping[int, Side]) -> Floats:
    """Return the gradient (n, channels, d) at the points of the manifold nearest to ``local`` (n, d).

    Parameters
    ----------
    reader : Reader
        Of the tables.
    values : (unknowns, channels) float64
        What is read.
    local : (n, d) float64
        Relative to the lattice's origin.
    wanted : mapping
        The side from which points on a boundary are read, by the boundary's number.
    """
    gradient = np.empty((len(local), values.shape[1], local.shape[1]))
    for start in range(0, len(local), GRADIENT_CHUNK_POINTS):
        part = slice(start, start + GRADIENT_CHUNK_POINTS)
        feet = reader.checked_closest_points(local[part])
        side_views = reader.side_views(feet.points, wanted)
        gradient[part] = _tangential(reader, values, feet, side_views)
        # Beside a bend it is continued from farther inside.
        bends = one_sided.find_bends(reader, feet, side_views)
        inside = one_sided.samples_inside(reader, feet, side_views, bends, wanted)
        if len(inside.rows):
            read = _tangential(reader, values, inside.feet, reader.side_views(inside.feet.points, wanted))
            read = read.reshape(*inside.weights.shape, *read.shape[1:])
            continued = np.einsum("ks,kscd->kcd", inside.weights, read)
            gradient[part][inside.rows] = _projected(reader, feet.take(inside.rows), continued)
    return gradient


def _tangential(reader: Reader, values: Floats, feet: ClosestPoints, side_views: Sequence[SideView]) -> Floats:
    """Return the gradient (n, channels, d) of the interpolant at ``feet``, projected on the tangent space."""
    columns, slopes = _slopes(reader.tables.unknowns, feet, side_views)
    return _projected(reader, feet, np.asarray(np.einsum("nds,nsc->ncd", slopes, values[columns], optimize=True)))


def _slopes(unknowns: Unknowns, feet: ClosestPoints, side_views: Sequence[SideView]) -> tuple[Ints, Floats]:
    """Return the unknowns (n, s) that the interpolant reads at feet, and their weights (n, d, s) in its gradient."""
    cells, fractions = stencil_cells(feet.points, unknowns.band.spacing, unknowns.band.degree)
    columns = unknowns.select(Centres.of_points(feet, side_views), stencil_nodes(unknowns.band, cells))
    return columns, tensor_slopes(fractions, unknowns.band.degree) / unknowns.band.spacing


def interpolant_gradient_rows(
    reader: Reader, feet: ClosestPoints, side_views: Sequence[SideView]
) -> tuple[csr_array, ...]:
    """Return the d matrices (n, unknowns) of the interpolant's gradient at ``feet``, on the tangent space."""
    unknowns = reader.tables.unknowns
    columns, slopes = _slopes(unknowns, feet, side_views)
    weights = _projected(reader, feet, np.moveaxis(slopes, 1, 2))
    return tuple(matrix_of_rows(weights[..., axis], columns, unknowns.count) for axis in range(weights.shape[-1]))


def _projected(reader: Reader, feet: ClosestPoints, vectors: Floats) -> Floats:
    n, channels, dim = vectors.shape
    each: Ints = np.repeat(np.arange(n), channels)
    tangential = project_tangent(
        reader.tables.layout.surface, feet.take(each), vectors.reshape(-1, dim), 0.5 * reader.spacing
    )
    return tangential.reshape(n, channels, dim)
