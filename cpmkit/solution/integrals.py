"""Integrals over the manifold, by a form's own quadrature or over the cells of a mesh cut along the boundaries."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.mesh.cell_quadrature import edge_midpoints_on, limit_midpoint_shift, quadratic_rule
from cpmkit.mesh.mesh import Mesh
from cpmkit.mesh.mixed_cells import cells_of_dimension, member_dimensions
from cpmkit.scene.data import evaluate_data
from cpmkit.solution.display_mesh import evaluate_on_sides, moved_onto_boundaries
from cpmkit.types import Floats

if TYPE_CHECKING:
    from cpmkit.solution.record import SolutionRecord

#: An integrand: a number, or a function of points (n, d) and the solution there, (n,) or (n, channels).
Integrand = float | Callable[[Floats, Floats], Any]


def integrate(solution: SolutionRecord, function: Integrand | None, dim: int | None) -> float | Floats:
    """Return the integral of the solution, or of a function of it; see :meth:`SolutionRecord.integrate`."""
    dimension, form = _dimension(solution.scene.surface, dim), solution.discretized
    if form.point_weights is not None:  # the form's own quadrature, each point on its side
        read = form.at_points(solution.values)
        if function is not None:
            read = _integrand(function, form.points.copy(), read)
        return _one_or_each(form.point_weights @ read)
    curved, values = _curved_cells(solution, dimension)
    points, _, weights, shares = quadratic_rule(curved)
    read = np.einsum("qk,mkc->mqc", shares, values).reshape(-1, values.shape[2])
    if function is not None:
        on_surface = solution.scene.surface.closest_point(points.reshape(-1, points.shape[2])).points
        read = _integrand(function, on_surface, read)
    return _one_or_each(weights.ravel() @ read)


def _one_or_each(total: Floats) -> float | Floats:
    """Return a total (channels,) as a float if it has one channel, else as it is."""
    return float(total[0]) if len(total) == 1 else total


def mean(solution: SolutionRecord, function: Integrand | None, dim: int | None) -> float | Floats:
    """Return the integral divided by the length, area or volume; see :meth:`SolutionRecord.mean`."""
    return integrate(solution, function, dim) / float(integrate(solution, 1.0, dim))


def _integrand(function: Integrand, points: Floats, values: Floats) -> Floats:
    """Return the integrand (n,) or (n, k) at ``points`` (n, d), where the solution is ``values`` (n, channels)."""
    if not callable(function):
        return evaluate_data(function, points, None, "the integrand")
    columns = values[:, 0] if values.shape[1] == 1 else values
    return evaluate_data(lambda at: function(at, columns), points, None, "the integrand")


def _dimension(surface: ClosestPointSource, dim: int | None) -> int:
    """Return the dimension of the parts to integrate over; raise InputError if ``dim`` is needed or not among them."""
    dimensions = member_dimensions(surface)
    if dim is None and len(dimensions) > 1:
        raise InputError(
            f"The manifold has parts of the dimensions {' and '.join(map(str, dimensions))}, whose sizes do not add "
            f"up; integrate over one of them, such as dim={dimensions[-1]}."
        )
    if dim is not None and dim not in dimensions:
        raise InputError(
            f"dim must be {' or '.join(map(str, dimensions))}, the dimensions of the manifold, got {shown(dim)}."
        )
    return dimensions[0] if dim is None else dim


def _curved_cells(solution: SolutionRecord, dim: int) -> tuple[Mesh, Floats]:
    """Return a mesh of m curved cells on the manifold, and the solution (m, k, channels) at their k nodes.

    The nodes of a cell are its corners, then the midpoints of its edges. On boundaries the solution is that of the
    cell's side.
    """
    mesh, scene = solution.display_mesh(), solution.scene
    corners = cells_of_dimension(mesh.cells, scene.surface, dim)
    sides = mesh.sides if mesh.sides is not None else np.zeros((len(mesh.points), 0), dtype=np.int64)
    points = moved_onto_boundaries(scene, mesh.points, sides)
    points = scene.surface.closest_point(points).points
    flat = Mesh.of(points, corners)
    a, b = flat.edges.ends.T
    shared = np.where(sides[a] == sides[b], sides[a], 0)
    middles = edge_midpoints_on(scene.surface, flat)
    on_boundary = np.flatnonzero(shared.any(axis=1))
    straight = 0.5 * (points[a] + points[b])[on_boundary]
    moved = scene.surface.closest_point(moved_onto_boundaries(scene, straight, shared[on_boundary])).points
    middles[on_boundary] = limit_midpoint_shift(straight, moved, flat.edge_lengths[on_boundary])
    off = (np.linalg.norm(moved - middles[on_boundary], axis=1) > 0)[:, None]
    shared[on_boundary] = np.where(off, 0, shared[on_boundary])
    of_cells, at_middles = flat.edges.of_cells, evaluate_on_sides(solution, middles, shared)
    values = np.concatenate([mesh.values[corners], at_middles[of_cells]], axis=1)
    return Mesh.of(points, corners, middles[of_cells]), values
