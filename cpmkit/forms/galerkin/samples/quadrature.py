"""The samples of a mesh: points, weights and normals of its cells, flat or quadratic."""

from __future__ import annotations

import numpy as np

from cpmkit.forms.galerkin.sample_mesh import SampleMesh, Samples
from cpmkit.manifold.vectors import norms, unit
from cpmkit.protocols import Floats


def samples_of(mesh: SampleMesh) -> Samples:
    """Return three samples a cell, those of one after those of another.

    On triangles the rule of degree 2 at barycentric points (2/3, 1/6, 1/6); on segments Gauss's of degree 5. The
    weights are those of the quadratic cells: |x_1 x x_2| / 6, or the speed.
    """
    shares, slopes, weights = _segment_rule(mesh) if mesh.manifold_dim == 1 else _triangle_rule(mesh)
    cell = np.repeat(np.arange(len(mesh.cells)), len(weights))
    if mesh.manifold_dim == 1:
        along = _mixed(mesh, slopes[0])
        return Samples(_mixed(mesh, shares), np.tile(weights, len(mesh.cells)) * norms(along), _across(along), cell)
    from cpmkit.forms.galerkin.samples import quadrature_kernels

    midpoints = np.zeros((0, 3, 3)) if mesh.midpoints is None else np.ascontiguousarray(mesh.midpoints)
    arrays = (np.ascontiguousarray(mesh.vertices), np.ascontiguousarray(mesh.cells), midpoints)
    found = quadrature_kernels.triangle_samples(*arrays, shares, slopes, weights)
    return Samples(*found, cell)


def _mixed(mesh: SampleMesh, shares: Floats) -> Floats:
    """Return (m q, d) the combinations of each cell's corners and midpoints with ``shares`` (q, nodes)."""
    nodes = mesh.vertices[mesh.cells.T]
    if mesh.midpoints is not None:
        nodes = np.concatenate([nodes, mesh.midpoints.transpose(1, 0, 2)])
    mixed = shares @ nodes.reshape(len(nodes), -1)
    return np.ascontiguousarray(mixed.reshape(len(shares), -1, mesh.dim).transpose(1, 0, 2)).reshape(-1, mesh.dim)


def _triangle_rule(mesh: SampleMesh) -> tuple[Floats, Floats, Floats]:
    """Return shares (3, nodes), their slopes (2, 3, nodes) along edges from the last corner, and weights (3,).

    Midpoint j stands opposite to corner j.
    """
    bary = np.full((3, 3), 1 / 6) + 0.5 * np.eye(3)
    steps = [np.array([1.0, 0.0, -1.0]), np.array([0.0, 1.0, -1.0])]
    weights = np.full(3, 1 / 6)
    if mesh.midpoints is None:
        return bary, np.stack([np.tile(step, (3, 1)) for step in steps]), weights
    second, third = np.roll(bary, -1, axis=1), np.roll(bary, -2, axis=1)
    shares = np.hstack([bary * (2 * bary - 1), 4 * second * third])
    slopes = [
        np.hstack([(4 * bary - 1) * step, 4 * (second * np.roll(step, -2) + third * np.roll(step, -1))])
        for step in steps
    ]
    return shares, np.stack(slopes), weights


def _segment_rule(mesh: SampleMesh) -> tuple[Floats, Floats, Floats]:
    """Return shares (3, nodes), their slopes (1, 3, nodes) from start to end, and weights (3,)."""
    gauss, weights = np.polynomial.legendre.leggauss(3)
    t = 0.5 * (gauss + 1)
    if mesh.midpoints is None:
        return np.stack([1 - t, t], axis=1), np.tile([-1.0, 1.0], (1, 3, 1)), 0.5 * weights
    shares = np.stack([(1 - t) * (1 - 2 * t), t * (2 * t - 1), 4 * t * (1 - t)], axis=1)
    return shares, np.stack([4 * t - 3, 4 * t - 1, 4 - 8 * t], axis=1)[None], 0.5 * weights


def _across(along: Floats) -> Floats:
    """Return (n, d - 1, d) orthonormal vectors across ``along`` (n, d)."""
    t = unit(along)
    if t.shape[1] == 2:
        return np.stack([t[:, 1], -t[:, 0]], axis=1)[:, None]
    # Across the axis from which the direction is farthest: in the worst case by 54 degrees.
    axis = np.eye(3)[np.argmin(np.abs(t), axis=1)]
    first = unit(np.cross(t, axis))
    return np.stack([first, np.cross(t, first)], axis=1)
