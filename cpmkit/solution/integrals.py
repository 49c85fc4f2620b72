"""Integrals over the manifold and over its boundaries, of a solution and of its conormal derivative.

Integrals over the manifold use the form's own quadrature, or one on the cells of a mesh cut along the boundaries.
"""

from __future__ import annotations

from collections.abc import Callable
from math import gamma, pi
from typing import Any

import numpy as np

from cpmkit.errors import InputError, place, shown
from cpmkit.formulas.expressions import Expression
from cpmkit.grid.band import surface_cells
from cpmkit.grid.lattice import Codes
from cpmkit.manifold.abilities import HasMesh
from cpmkit.manifold.local_source import localize
from cpmkit.manifold.source import ClosestPoints, ClosestPointSource
from cpmkit.manifold.vector_algebra import unit
from cpmkit.mesh.adjacency import rim_of_edges, rim_of_vertices
from cpmkit.mesh.cell_quadrature import OUTWARD_EDGE_SHARE, limit_midpoint_shift, project_edge_midpoints, quadratic_rule
from cpmkit.mesh.mesh import Mesh
from cpmkit.mesh.mixed_cells import (
    cells_of_dimension,
    cells_with_corners,
    member_dimensions,
    mesh_method,
    refine_mixed_cells,
)
from cpmkit.runtime.messages import warn_each
from cpmkit.scene.boundary import boundary_number
from cpmkit.scene.data import evaluate_data, read_formula
from cpmkit.scene.laws import Spectral, Value
from cpmkit.solution.display_mesh import LONGEST_EDGE_SPACINGS, evaluate_on_sides, project_onto_boundaries
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import SIDES, Bools, Floats, Ints, Side

#: An integrand: a number, or a function of points (n, d) and the solution there, (n,) or (n, channels).
Integrand = float | Callable[[Floats, Floats], Any]


def integrate(solution: SolutionRecord, function: Integrand | None, dim: int | None) -> float | Floats:
    """Return the integral of a solution, or of ``function`` of it; arguments are as for `SolutionRecord.integrate`.

    The quadrature is that of the form; for a form without quadrature weights that of the display mesh, curved.
    """
    dimension, form = _integrated_dimension(solution.scene.surface, dim), solution.discretized
    if form.point_weights is not None:  # u is one-sided at points on boundaries
        parts = form.traits.parts
        if parts:  # of several dimensions
            return integrate(solution.of_dimension(dimension), function, dimension)
        read = form.at_points(solution.values)
        if function is not None:
            read = _evaluate_integrand(function, form.points.copy(), read)
        return _float_if_single(form.point_weights @ read)
    curved, values = _cells_to_integrate(solution, dimension)
    points, _, weights, shares = quadratic_rule(curved)
    read = np.einsum("qk,mkc->mqc", shares, values).reshape(-1, values.shape[2])
    if function is not None:
        on_surface = solution.scene.surface.closest_point(points.reshape(-1, points.shape[2])).points
        read = _evaluate_integrand(function, on_surface, read)
    return _float_if_single(weights.ravel() @ read)


def _float_if_single(total: Floats) -> float | Floats:
    """Return an integral (channels,) as a float if it has one channel, else unchanged."""
    return float(total[0]) if len(total) == 1 else total


def _evaluate_integrand(function: Integrand, points: Floats, values: Floats) -> Floats:
    """Return ``function`` (n, k) at ``points`` (n, d), ``values`` (n, channels); raises as :func:`evaluate_data`."""
    if not callable(function):
        return evaluate_data(function, points, None, "the integrand")
    columns = values[:, 0] if values.shape[1] == 1 else values
    return evaluate_data(lambda at: function(at, columns), points, None, "the integrand")


def _integrated_dimension(surface: ClosestPointSource, dim: int | None) -> int:
    """Return ``dim``, or for None the manifold's only dimension; InputError if it has several, or not ``dim``."""
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


def _cells_to_integrate(solution: SolutionRecord, dim: int) -> tuple[Mesh, Floats]:
    """Return m curved cells of dimension ``dim`` to integrate over, and the solution (m, k, channels) at their k nodes.

    The nodes of a cell are its corners, then the midpoints of its edges. On boundaries the solution is that of the
    cell's side.
    """
    mesh, scene = solution.display_mesh(), solution.scene
    corners = cells_of_dimension(mesh.cells, scene.surface, dim)
    sides = mesh.sides if mesh.sides is not None else np.zeros((len(mesh.points), 0), dtype=np.int64)
    points = project_onto_boundaries(scene, mesh.points, sides)
    points = scene.surface.closest_point(points).points
    flat = Mesh.of(points, corners)
    a, b = flat.edges.ends.T
    shared = np.where(sides[a] == sides[b], sides[a], 0)
    midpoints = project_edge_midpoints(scene.surface, flat)
    on_boundary = np.flatnonzero(shared.any(axis=1))
    straight = 0.5 * (points[a] + points[b])[on_boundary]
    moved = scene.surface.closest_point(project_onto_boundaries(scene, straight, shared[on_boundary])).points
    midpoints[on_boundary] = limit_midpoint_shift(straight, moved, flat.edge_lengths[on_boundary])
    off = (np.linalg.norm(moved - midpoints[on_boundary], axis=1) > 0)[:, None]
    shared[on_boundary] = np.where(off, 0, shared[on_boundary])
    of_cells, at_midpoints = flat.edges.of_cells, evaluate_on_sides(solution, midpoints, shared)
    values = np.concatenate([mesh.values[corners], at_midpoints[of_cells]], axis=1)
    return Mesh.of(points, corners, midpoints[of_cells]), values


#: Width, in spacings, of the bump function around a boundary without a mesh.
BUMP_WIDTH_SPACINGS = 3.0
BUMP_POWER = 4  #: The bump is (1 - r^2)^POWER, r in widths.
#: Points of a rim are the closest points of points this share of a spacing beyond the mesh.
BEYOND_RIM_SPACINGS = 0.25
#: Values on the two sides of a boundary are different if they differ by this share of the largest of them.
DIFFERENT_SHARE = 0.01


def boundary_rule(source: ClosestPointSource, surface: ClosestPointSource, spacing: float) -> tuple[Floats, Floats]:
    """Return quadrature points (n, d) on ``surface`` along the boundary ``source``, and weights (n,).

    Weights are lengths or areas; those of a point sum up to 1. If ``source`` has a mesh, for ``spacing``, the rule is
    that of its curved cells; else the points are closest points of lattice nodes around the boundary.
    """
    dim = source.manifold_dim or 0
    if not isinstance(source, HasMesh):
        return _bump_rule(source, surface, spacing, dim)
    points, cells = source.mesh(spacing)
    points, cells = refine_mixed_cells(points, cells, points.shape[1], LONGEST_EDGE_SPACINGS * spacing)
    cells = cells_with_corners(cells, dim + 1)
    flat = Mesh.of(points, cells)
    nodes = surface.closest_point(source.closest_point(points).points).points
    midpoints = surface.closest_point(project_edge_midpoints(source, flat)).points
    rule_points, _, weights, _ = quadratic_rule(Mesh.of(nodes, cells, midpoints[flat.edges.of_cells]))
    on_source = source.closest_point(rule_points.reshape(-1, rule_points.shape[2])).points
    return surface.closest_point(on_source).points, weights.ravel()


def _bump_rule(
    source: ClosestPointSource, surface: ClosestPointSource, spacing: float, dim: int
) -> tuple[Floats, Floats]:
    """Return quadrature points (n, d) and weights (n,) on a boundary C of dimension ``dim`` that has no mesh.

    The points are closest points of the nodes of a lattice around C: ``int_C f ds = int f(cp_C(x)) bump(|x - cp_C(x)|)
    dx``. The bump has integral 1 over the normal space. It is even, so that curvature changes the measure to second
    order in the width at most. Nodes beyond the ends of an open curve are left out.
    """
    local = localize(source, np.zeros(source.dim))
    cells = surface_cells(local, spacing, 3)
    reach = int(np.ceil(BUMP_WIDTH_SPACINGS)) + 1
    codes = Codes.from_points(cells, reach)
    nodes = np.unique(codes.encode(cells))
    for axis in range(source.dim):
        nodes = codes.dilate(nodes, axis, range(-reach, reach + 1))
    feet = source.closest_point(np.asarray(codes.decode(nodes) * spacing, dtype=np.float64))
    feet = feet.take((feet.distance < BUMP_WIDTH_SPACINGS * spacing) & (feet.edge < 0))
    normal, width = source.dim - dim, BUMP_WIDTH_SPACINGS * spacing
    volume = pi ** (normal / 2) * gamma(BUMP_POWER + 1) / gamma(BUMP_POWER + 1 + normal / 2) * width**normal
    weights = (1 - (feet.distance / width) ** 2) ** BUMP_POWER * spacing**source.dim / volume
    return surface.closest_point(feet.points).points, weights


def rim_rule(surface: ClosestPointSource, spacing: float, loop: int | None) -> tuple[ClosestPoints, Floats]:
    """Return quadrature points on the manifold's edge, or on one ``loop`` of it, as closest points, and weights (n,).

    The rule is that of the mesh for ``spacing``; ``loop`` None is the whole edge. An end of a curve has weight 1.
    Raises InputError if the surface has no mesh or no such edge.
    """
    points, cells = mesh_method(surface)(spacing)
    points, cells = refine_mixed_cells(points, cells, points.shape[1], LONGEST_EDGE_SPACINGS * spacing)
    parts = [_rim_of_triangles(surface, points, cells_with_corners(cells, 3), spacing)]
    rim = rim_of_vertices(Mesh.of(points, cells_with_corners(cells, 2)))  # the ends of segments, each with weight 1
    beyond = points[rim.rows] + BEYOND_RIM_SPACINGS * spacing * unit(rim.outward)
    parts.append((surface.closest_point(beyond), np.ones(len(beyond))))
    feet = ClosestPoints.join([part for part, _ in parts])
    weights = np.concatenate([weight for _, weight in parts])
    on_loop = feet.edge >= 0 if loop is None else feet.edge == loop
    if not on_loop.any():
        loops = np.unique(feet.edge[feet.edge >= 0]).tolist()
        raise InputError(
            f"The manifold has no edge{'' if loop is None else f' {loop}'} with a flux; "
            + (f"its edges are {', '.join(map(str, loops))}." if loops else "it is closed.")
        )
    return feet.take(on_loop), weights[on_loop]


def _rim_of_triangles(
    surface: ClosestPointSource, points: Floats, cells: Ints, spacing: float
) -> tuple[ClosestPoints, Floats]:
    """Return quadrature points on edges that belong to one triangle only, as closest points, and weights (n,).

    The closest points are those of points slightly beyond the mesh, so that they lie on the rim and have its loop
    number.
    """
    flat = Mesh.of(points, cells)
    rim, midpoints = rim_of_edges(flat), project_edge_midpoints(surface, flat)
    at, _, weights, _ = quadratic_rule(Mesh.of(points, flat.edges.ends[rim.rows], midpoints[rim.rows][:, None]))
    outward = np.repeat(unit(rim.outward), at.shape[1], axis=0)
    beyond = at.reshape(-1, points.shape[1]) + min(BEYOND_RIM_SPACINGS, OUTWARD_EDGE_SHARE) * spacing * outward
    return surface.closest_point(beyond), weights.ravel()


def flux_density(solution: SolutionRecord, boundary: str, side: Side | None, points: Any) -> Floats:
    """Return du/db (n,) or (n, channels) at points (n, d); as :meth:`SolutionRecord.flux_density`, with its errors."""
    boundaries = solution.scene.boundaries
    if boundary == "edge" and boundary not in [each.name for each in boundaries]:
        raise InputError(
            "flux_density is that of a boundary with two sides, got 'edge'; solution.flux('edge') is the flux through "
            "the edge, and solution.gradient(points) the gradient there."
        )
    number = boundary_number(boundaries, boundary)  # a wrong name is refused before a missing side
    density = solution.discretized.conormal_derivative(solution.values, points, boundary, _check_side(boundary, side))
    _warn_of_infinite_flux(solution, number)
    return density[:, 0] if solution.channels == 1 else density


#: Why a form computes no flux through the edge of a solid in space.
_NO_FLUX = {
    "collocation": "the form 'collocation' computes no flux through the edge of a solid in space; use form='galerkin'.",
    "galerkin": "the flux through an edge of a solid in space with ck.Steklov() is not computed: it is the eigenvalue "
    "times the integral of u over the edge.",
}


def flux(solution: SolutionRecord, boundary: str | int, side: Side | None, where: Any = None) -> float | Floats:
    """Return the flux through a side of a boundary, the integral of du/db, as :meth:`SolutionRecord.flux` does."""
    scene, form = solution.scene, solution.discretized
    names = [boundary.name for boundary in scene.boundaries]
    matches: list[bool] = []
    chosen = None if where is None else _part_of(where, matches)
    if boundary not in names and (boundary == "edge" or isinstance(boundary, int)):
        if side is not None:
            raise InputError(f"the edge has one side only; leave side out, got {shown(side)}.")
        loop = None if boundary == "edge" else int(boundary)
        total = form.flux(solution.values, boundary, None, solution.data_time, chosen)
        if total is None:
            if scene.surface.dim == 3 and 3 in member_dimensions(scene.surface):
                is_eigenvalue = any(isinstance(each.law, Spectral) for each in scene.edge_conditions)
                if form.form == "galerkin" and not is_eigenvalue:
                    raise InputError(f"The manifold has no edge{'' if loop is None else f' {loop}'} with a flux.")
                raise InputError(_NO_FLUX.get(form.form, _NO_FLUX["collocation"]))
            feet, weights = rim_rule(scene.surface, solution.spacing, loop)
            density = form.conormal_derivative(solution.values, feet.points)
            total = (weights if chosen is None else weights * chosen(feet.points)) @ density
    else:
        name = str(boundary)
        number, checked = boundary_number(scene.boundaries, name), _check_side(name, side)
        total = form.flux(solution.values, name, checked, solution.data_time, chosen)
        if total is None:
            source = scene.boundaries[number].source
            points, weights = boundary_rule(source, scene.surface, solution.spacing)
            density = form.conormal_derivative(solution.values, points, name, checked)
            total = (weights if chosen is None else weights * chosen(points)) @ density
        _warn_of_infinite_flux(solution, number)
    if matches and not any(matches):
        raise InputError(f"`where` holds at no point of {shown(boundary)}, got {shown(where)}.")
    return float(total[0]) if solution.channels == 1 else np.asarray(total)


def _part_of(where: Any, matches: list[bool]) -> Callable[[Floats], Bools]:
    """Return whether ``where``, a formula or a function, holds at points (n, d).

    Each call appends to ``matches`` whether it holds at any of them. Raises InputError if ``where`` is neither.
    """
    holds = read_formula(Expression, where, "`where`") if isinstance(where, str) else where
    if not callable(holds):
        raise InputError(f"`where` must be a formula such as 'x < 0', or a function of points, got {shown(where)}.")

    def chosen(points: Floats) -> Bools:
        found = np.asarray(evaluate_data(holds, points, 1, "`where`")[:, 0] != 0)
        matches.append(bool(found.any()))
        return found

    return chosen


def _warn_of_infinite_flux(solution: SolutionRecord, number: int) -> None:
    """Warn if boundary ``number`` ends inside the surface with different values on its sides.

    du/db then behaves like one over the distance from the end, with opposite signs on the two sides. The warning is
    attributed to the caller of the solution's method.
    """
    scene, spacing = solution.scene, solution.spacing
    boundary = scene.boundaries[number]
    source = boundary.source
    laws = [law for side in SIDES if isinstance(law := boundary.condition(side).law, Value)]
    is_curve = scene.surface.manifold_dim == 2 and source.manifold_dim == 1
    if len(laws) < len(SIDES) or not is_curve or not isinstance(source, HasMesh):
        return
    points, cells = source.mesh(spacing)
    rim = rim_of_vertices(Mesh.of(points, cells_with_corners(cells, 2)))
    if not len(rim.rows):
        return
    on_rim = scene.surface.closest_point(points[rim.rows] + BEYOND_RIM_SPACINGS * spacing * unit(rim.outward)).edge >= 0
    others = [other.source for other in scene.boundaries if other is not boundary]
    apart = [other.closest_point(points[rim.rows]).distance > BEYOND_RIM_SPACINGS * spacing for other in others]
    at = scene.surface.closest_point(points).points
    values = [evaluate_data(law.datum, at, scene.channels, "a value", solution.data_time) for law in laws]
    jump = np.abs(values[0] - values[1]).max(axis=1)[rim.rows]
    infinite = np.logical_and.reduce([~on_rim, *apart, jump > DIFFERENT_SHARE * np.abs(values).max()])
    if infinite.any():
        warn_each(
            [
                f"The flux of each side of boundary {boundary.name!r} is infinite, since the sides have different "
                f"values at its end near {place(at[rim.rows][infinite][0])}, and its number depends on the spacing; "
                "only the sum of both sides is finite."
            ],
            stacklevel=4,
        )


def _check_side(boundary: str, side: Side | None) -> Side:
    """Return the side of a boundary at which a flux is requested; raise InputError if it is None."""
    if side is None:
        raise InputError(f"side of {boundary!r} must be 'left' or 'right': a flux leaves one side, got None.")
    return side
