"""Where an interpolation stencil lies, its weights, and the neighbours of the cross Laplacian."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.errors import InputError, ResolutionError, shown
from cpmkit.protocols import Floats, Ints

if TYPE_CHECKING:
    from cpmkit.grid.band import Band

DEGREES = (2, 3, 4, 5)


def check_degree(degree: int, what: str = "degree") -> int:
    """Return ``degree`` if interpolation of that degree is offered.

    Raises
    ------
    InputError
        If it is not 2 to 5. Degree 1 does not converge: its error stays of order one at every spacing.
    """
    if not isinstance(degree, (int, np.integer)) or degree not in DEGREES or isinstance(degree, bool):
        reason = (
            " (degree 1 does not converge: the second differences of its error do not vanish)" if degree == 1 else ""
        )
        raise InputError(f"{what} must be one of 2, 3, 4, 5, got {shown(degree)}{reason}; 3 is the default.")
    return int(degree)


def base_offset(degree: int) -> float:
    """Return the shift in cells that makes ``floor`` pick the stencil's cell.

    An odd degree is centred on a cell between nodes, an even one on the nearest node; taking the
    floor for an even degree too would let its stencil leave the band.
    """
    return 0.0 if degree % 2 else 0.5


def stencil_range(degree: int) -> range:
    """Return the offsets of a stencil's nodes from its cell along one axis."""
    first = -((degree - 1) // 2) if degree % 2 else -(degree // 2)
    return range(first, first + degree + 1)


def stencil_cells(points: Floats, spacing: float, degree: int) -> tuple[Ints, Floats]:
    """Return the cells (n, d) of points relative to the origin, and the fractions (n, d) in [0, 1) inside them."""
    coordinates = points / spacing + base_offset(degree)
    cells = np.floor(coordinates)
    return cells.astype(np.int64), coordinates - cells


def lagrange_weights(fractions: Floats, degree: int) -> Floats:
    """Return the weights (n, d, degree + 1) of one-dimensional Lagrange interpolation along each axis.

    The first barycentric form (Berrut and Trefethen 2004, eq. 3.1), ``l(t) lambda_k / (t - t_k)``, with
    ``l(t) / (t - t_k)`` multiplied out, so that a point on a node needs no case of its own.
    """
    nodes = np.array(stencil_range(degree), dtype=np.float64) + base_offset(degree)
    differences = fractions[..., None] - nodes
    weights = np.empty_like(differences)
    for k in range(degree + 1):
        others = [j for j in range(degree + 1) if j != k]
        weights[..., k] = np.prod(differences[..., others], axis=-1) / np.prod(nodes[k] - nodes[others])
    return weights


def tensor_weights(fractions: Floats, degree: int) -> Floats:
    """Return the weights (n, (degree + 1)^d) of tensor-product interpolation, last axis fastest."""
    # King et al. (2024), eq. 1: the weights of the closest point extension.
    lines = lagrange_weights(fractions, degree)
    weights = lines[:, 0]
    for axis in range(1, lines.shape[1]):
        weights = (weights[:, :, None] * lines[:, axis, None, :]).reshape(len(weights), -1)
    return weights


def lagrange_slopes(fractions: Floats, degree: int) -> Floats:
    """Return the derivatives (n, d, degree + 1) of :func:`lagrange_weights` by the fractions, per cell."""
    nodes = np.array(stencil_range(degree), dtype=np.float64) + base_offset(degree)
    differences = fractions[..., None] - nodes
    slopes = np.zeros_like(differences)
    for k in range(degree + 1):
        others = [j for j in range(degree + 1) if j != k]
        for left_out in others:
            slopes[..., k] += np.prod(differences[..., [j for j in others if j != left_out]], axis=-1)
        slopes[..., k] /= np.prod(nodes[k] - nodes[others])
    return slopes


def tensor_slopes(fractions: Floats, degree: int) -> Floats:
    """Return the derivatives (n, d, (degree + 1)^d) of :func:`tensor_weights` along each axis, per cell."""
    lines, slopes = lagrange_weights(fractions, degree), lagrange_slopes(fractions, degree)
    dim = lines.shape[1]
    derivatives = np.empty((len(lines), dim, (degree + 1) ** dim))
    for axis in range(dim):
        factors = [slopes[:, k] if k == axis else lines[:, k] for k in range(dim)]
        product = factors[0]
        for factor in factors[1:]:
            product = (product[:, :, None] * factor[:, None, :]).reshape(len(product), product.shape[1] * (degree + 1))
        derivatives[:, axis] = product
    return derivatives


def tensor_offsets(degree: int, dim: int) -> Ints:
    """Return the offsets ((degree + 1)^d, d) of a stencil's nodes from its cell, last axis fastest."""
    lines = np.array(stencil_range(degree), dtype=np.int64)
    return np.stack(np.meshgrid(*[lines] * dim, indexing="ij"), axis=-1).reshape(-1, dim)


def cross_offsets(dim: int) -> Ints:
    """Return the offsets (2 d, d) of the difference neighbours, all positive before negative.

    They have the weight 1 in ``spacing^2`` Lap, and the node itself -2 d: King et al. (2024), eq. 2.
    """
    unit = np.eye(dim, dtype=np.int64)
    return np.concatenate([unit, -unit])


def reading_radius(dim: int, degree: int) -> float:
    """Return the distance, in spacings, within which a stencil reads nodes: ``sqrt(d) (p + 1) / 2``."""
    # King et al. (2024), eq. 4 with q = 0.
    return float(np.sqrt(dim) * (degree + 1) / 2)


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
