"""Nodes and weights of interpolation stencils, and the neighbours of the cross-shaped Laplacian."""

from __future__ import annotations

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.types import Floats, Ints


def check_degree(degree: int, label: str = "degree") -> int:
    """Return ``degree``, of the interpolation, if it is an integer from 2 to 5; ``label`` names it in the message.

    Raises InputError if it is not. Degree 1 does not converge: its error stays of order one at every spacing.
    """
    if isinstance(degree, bool) or not isinstance(degree, (int, np.integer)) or not 2 <= degree <= 5:
        reason = (
            " (degree 1 does not converge: the second differences of its error do not vanish)" if degree == 1 else ""
        )
        raise InputError(f"{label} must be one of 2, 3, 4, 5, got {shown(degree)}{reason}; 3 is the default.")
    return int(degree)


def base_offset(degree: int) -> float:
    """Return the shift, in cells, to be added to coordinates in cells before ``floor`` gives the cell of the stencil.

    A stencil of odd degree is centred on a cell between nodes, a stencil of even degree on the nearest node.
    """
    return 0.0 if degree % 2 else 0.5


def stencil_range(degree: int) -> range:
    """Return the offsets of a stencil's nodes from its cell along one axis."""
    first = -((degree - 1) // 2) if degree % 2 else -(degree // 2)
    return range(first, first + degree + 1)


def stencil_cells(points: Floats, spacing: float, degree: int) -> tuple[Ints, Floats]:
    """Return the stencil's cell (n, d) of each point (n, d), and the fractions (n, d) in [0, 1) of its position there.

    Points are relative to the lattice's origin; a fraction is the distance from the cell's lower side, in cells.
    """
    coordinates = points / spacing + base_offset(degree)
    cells = np.floor(coordinates)
    return cells.astype(np.int64), coordinates - cells


def lagrange_weights(fractions: Floats, degree: int) -> Floats:
    """Return the weights (n, d, degree + 1) of one-dimensional Lagrange interpolation along each axis, nodes ascending.

    The first barycentric form (Berrut and Trefethen 2004, eq. 3.1), ``l(t) lambda_k / (t - t_k)``, with the product
    ``l(t) / (t - t_k)`` written out, so that a point on a node is no special case. ``fractions`` (n, d) are those of
    :func:`stencil_cells`.
    """
    nodes = np.array(stencil_range(degree), dtype=np.float64) + base_offset(degree)
    differences = fractions[..., None] - nodes
    weights = np.empty_like(differences)
    for k in range(degree + 1):
        others = [j for j in range(degree + 1) if j != k]
        weights[..., k] = np.prod(differences[..., others], axis=-1) / np.prod(nodes[k] - nodes[others])
    return weights


def tensor_weights(fractions: Floats, degree: int, along: int | None = None) -> Floats:
    """Return the weights (n, (degree + 1)^d) of tensor-product interpolation at ``fractions`` (n, d).

    The last axis varies fastest; fractions are those of :func:`stencil_cells`. With an axis ``along``, return the
    derivatives of the weights with respect to the fractions along it: per cell, not per unit of length.
    """
    # King et al. (2024), eq. 1: the weights of the closest point extension.
    lines = lagrange_weights(fractions, degree)
    if along is not None:
        lines[:, along] = _lagrange_slopes(fractions[:, along], degree)
    weights = lines[:, 0]
    for axis in range(1, lines.shape[1]):
        weights = (weights[:, :, None] * lines[:, axis, None, :]).reshape(len(weights), -1)
    return weights


def _lagrange_slopes(fractions: Floats, degree: int) -> Floats:
    """Return the derivatives (n, degree + 1) of Lagrange weights along one axis with respect to ``fractions`` (n,)."""
    nodes = np.array(stencil_range(degree), dtype=np.float64) + base_offset(degree)
    differences = fractions[:, None] - nodes
    slopes = np.zeros_like(differences)
    for k in range(degree + 1):
        others = [j for j in range(degree + 1) if j != k]
        for omitted in others:
            slopes[:, k] += np.prod(differences[:, [j for j in others if j != omitted]], axis=-1)
        slopes[:, k] /= np.prod(nodes[k] - nodes[others])
    return slopes


def tensor_offsets(degree: int, dim: int) -> Ints:
    """Return the offsets ((degree + 1)^d, d) of a stencil's nodes from its cell, last axis fastest."""
    lines = np.array(stencil_range(degree), dtype=np.int64)
    return np.stack(np.meshgrid(*[lines] * dim, indexing="ij"), axis=-1).reshape(-1, dim)


def cross_offsets(dim: int) -> Ints:
    """Return the offsets (2 d, d) of the neighbours in the cross-shaped Laplacian, positive before negative directions.

    In ``spacing^2`` times the Laplacian they have the weight 1, and the node itself -2 d: King et al. (2024), eq. 2.
    """
    unit = np.eye(dim, dtype=np.int64)
    return np.concatenate([unit, -unit])


def reading_radius(dim: int, degree: int) -> float:
    """Return the radius, in spacings, of a ball that contains the stencil of its centre: ``sqrt(d) (p + 1) / 2``."""
    # King et al. (2024), eq. 4 with q = 0.
    return float(np.sqrt(dim) * (degree + 1) / 2)
