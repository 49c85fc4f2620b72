"""Cells of mixed dimension in one array (triangles, segments and points; shorter rows end in -1), and polylines."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from cpmkit.errors import InputError
from cpmkit.manifold.abilities import HasMesh, members_of
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.mesh.mesh import Connectivity
from cpmkit.types import Floats, Ints


def with_corners(cells: Ints, corners: int) -> Ints:
    """Return those rows of ``cells`` (m, k) that have this number of ``corners``, (n, corners), without padding.

    Examples
    --------
    >>> import numpy as np
    >>> cells = np.array([[0, 1, 2], [3, 4, -1], [5, -1, -1]])
    >>> with_corners(cells, 2).tolist(), with_corners(cells, 3).tolist()
    ([[3, 4]], [[0, 1, 2]])
    """
    if corners > cells.shape[1]:
        return np.zeros((0, corners), dtype=np.int64)
    return cells[(cells >= 0).sum(axis=1) == corners, :corners]


def stack_cells(parts: Iterable[Ints]) -> Ints:
    """Return cells with different numbers of corners as one array (m, k), shorter rows padded with -1."""
    non_empty = [part for part in parts if len(part)]
    width = max((part.shape[1] for part in non_empty), default=1)
    rows = [np.pad(part, ((0, 0), (0, width - part.shape[1])), constant_values=-1) for part in non_empty]
    return np.concatenate(rows) if rows else np.zeros((0, width), dtype=np.int64)


def renumber_cells(cells: Ints, number: Ints) -> Ints:
    """Return ``cells`` (m, k) with ``number[v]`` in place of each vertex v; padding stays -1."""
    return np.where(cells >= 0, number[cells], -1)


def number_edges(cells: Ints, count: int) -> tuple[Ints, Ints]:
    """Return the edges (e, 2) of triangles or segments among ``count`` vertices, and the edges (m, c) of each cell.

    Edge k of a cell joins its corners k and k + 1; a segment has one edge, a point none.
    """
    edges = Connectivity(cells, count).edges
    return edges.ends, np.roll(edges.of_cells, 1, axis=1)


def rotate_triangles(cells: Ints, of_edges: Ints, first: Ints) -> tuple[Ints, Ints]:
    """Return the corners and ``of_edges``, both (3, m), of triangles rotated so that corner ``first`` (m,) leads."""
    order = (first[:, None] + np.arange(3)) % 3
    return np.take_along_axis(cells, order, 1).T, np.take_along_axis(of_edges, order, 1).T


def mesh_of(surface: ClosestPointSource) -> Callable[[float], tuple[Floats, Ints]]:
    """Return the bound method of ``surface`` that takes a spacing and returns vertices and cells.

    Raises
    ------
    InputError
        If the surface has no such method.
    """
    if isinstance(surface, HasMesh):
        return surface.mesh
    raise InputError(
        f"The surface {type(surface).__name__} has no method mesh(spacing), so it can be neither drawn nor saved as a "
        "mesh; give it one, or ask for 'solution.npz' and 'summary.json' alone."
    )


def member_dimensions(surface: ClosestPointSource) -> list[int]:
    """Return the different dimensions of a surface's members, ascending; a solid has the dimension of the space."""
    members = members_of(surface)
    return sorted({member.dim if member.manifold_dim is None else member.manifold_dim for member in members})


def cells_of_dimension(cells: Ints, surface: ClosestPointSource, dim: int) -> Ints:
    """Return those of a surface's mesh ``cells`` that have dimension ``dim``, (m, dim + 1).

    Raises
    ------
    InputError
        If the mesh has cells of a dimension that no member has, such as a solid's boundary, or none of this dimension.
    """
    dimensions = {corners - 1 for corners in (1, 2, 3) if len(with_corners(cells, corners))}
    if dim not in dimensions or not dimensions <= {member.manifold_dim for member in members_of(surface)}:
        names = " and ".join({0: "points", 1: "segments", 2: "triangles"}[shown] for shown in sorted(dimensions))
        raise InputError(
            f"The mesh of {type(surface).__name__} has {names} "
            f"where a manifold of dimension {dim} is integrated over; curves, surfaces and areas of the plane with a "
            "mesh that fills them are accepted."
        )
    return with_corners(cells, dim + 1)


def refine_mixed_cells(attributes: Floats, cells: Ints, dim: int, longest: float) -> tuple[Floats, Ints]:
    """Return the mesh with edges halved until none is longer than ``longest``.

    Parameters
    ----------
    attributes : (v, w) float64
        The first ``dim`` columns are positions; the middle of an edge has the mean of all columns.
    cells : (m, k) int64
        Triangles, segments and points; shorter rows end in -1.
    dim : int
        2 or 3.
    longest : float
        Longest edge, in the unit of the positions.

    Returns
    -------
    attributes, cells
        The given vertices come first; neighbours share the middles of their edges.
    """
    from cpmkit.mesh.subdivision_kernels import split_triangles

    parts = []
    for corners in (3, 2):
        part = with_corners(cells, corners)
        while True:
            edges = Connectivity(part, len(attributes)).edges
            long = edges.lengths(attributes[:, :dim]) > longest
            if not long.any():
                break
            middle = np.where(long, len(attributes) + np.cumsum(long) - 1, -1)
            attributes = np.concatenate([attributes, attributes[edges.ends[long]].mean(axis=1)])
            if corners == 3:
                points = np.ascontiguousarray(attributes[:, :dim])
                part = split_triangles(np.ascontiguousarray(part), edges.of_cells, middle, points)
            else:
                (a, b), p = part[long].T, middle[long]
                part = np.concatenate([part[~long], np.stack([a, p], axis=1), np.stack([p, b], axis=1)])
        parts.append(part)
    return attributes, stack_cells([*parts, with_corners(cells, 1)])


class Polyline(NamedTuple):
    """Points (n, d) in the direction of travel; a closed polyline continues from the last point to the first."""

    points: Floats
    closed: bool


def chain_segments(vertices: Floats, segments: Ints) -> list[Polyline]:
    """Return the polylines formed by directed segments (m, 2) between vertices (v, d).

    A polyline passes through vertices at which exactly one segment ends and one starts, and ends at all others.
    """
    starts, ends = segments.T
    count = int(segments.max(initial=-1)) + 1
    is_passed = (np.bincount(starts, minlength=count) == 1) & (np.bincount(ends, minlength=count) == 1)
    following = np.full(count, -1)
    following[starts] = ends
    polylines, seen = [], np.zeros(count, dtype=bool)
    for chain in ([start, end] for start, end in segments.tolist() if not is_passed[start]):
        while is_passed[chain[-1]]:
            seen[chain[-1]] = True
            chain.append(int(following[chain[-1]]))
        closed = chain[0] == chain[-1]
        polylines.append(Polyline(vertices[chain[:-1] if closed else chain], closed))
    for first in np.flatnonzero(is_passed).tolist():
        if not seen[first]:
            chain = [first]
            while not seen[chain[-1]]:
                seen[chain[-1]] = True
                chain.append(int(following[chain[-1]]))
            polylines.append(Polyline(vertices[chain[:-1]], True))
    return polylines
