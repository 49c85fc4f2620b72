"""A mesh whose triangles are as small as the lattice cells that they lie in, and its samples."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.quadrature.cell_quadrature import quadrature, triangles_to_clip
from cpmkit.forms.galerkin.quadrature.samples import Samples
from cpmkit.forms.galerkin.refinement.regions import Regions, codes_of_cells, is_among
from cpmkit.forms.galerkin.solution_warnings import ends_inside
from cpmkit.mesh.mesh import CellGeometry, Edges, Mesh
from cpmkit.mesh.subdivision import halve_edges
from cpmkit.types import Bools, Floats, Ints

#: Edges are looked at from these places between their ends.
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)


def grade_mesh(mesh: Mesh, regions: Regions, spacings: float) -> Mesh:
    """Return flat triangles with their edges halved that are longer than ``spacings`` times the spacing around them.

    With them the longest edge of each triangle is halved, and so on from triangle to triangle: needles end so.
    """
    near = regions.codes_near()
    while True:
        edges = mesh.edges
        lengths = mesh.edge_lengths
        long = _with_longest(_is_long(mesh.vertices, edges.ends, lengths, regions, near, spacings), edges, lengths)
        if not long.any():
            return mesh
        middle = np.full(len(edges.ends), -1)
        middle[long] = len(mesh.vertices) + np.arange(long.sum())
        mesh = halve_edges(mesh, middle, mesh.vertices[edges.ends[long]].mean(axis=1))


def _is_long(vertices: Floats, ends: Ints, lengths: Floats, regions: Regions, near: Ints, spacings: float) -> Bools:
    """Return which edges (e,) are long; ``near`` are the codes of the cells of level 0 where any may be."""
    longest = spacings * regions.spacing
    long = lengths > longest * 0.5**regions.finest
    middles = vertices[ends[long]].mean(axis=1)
    rows = np.flatnonzero(long)[is_among(codes_of_cells(regions.cells(middles, 0)), near)]
    first, second = vertices[np.sort(ends[rows], axis=1)].transpose(1, 0, 2)
    level = np.zeros(len(rows), dtype=np.int64)
    for share in SHARES:
        level = np.maximum(level, regions.levels_around((1 - share) * first + share * second))
    long[:] = False
    long[rows] = lengths[rows] > longest * 0.5**level
    return long


def _with_longest(long: Bools, edges: Edges, lengths: Floats) -> Bools:
    """Return the ``long`` edges (e,) with the longest of each triangle that has one of those returned."""
    longest = edges.of_cells[np.arange(len(edges.of_cells)), lengths[edges.of_cells].argmax(axis=1)]
    rows = np.flatnonzero(~long[longest])
    while True:
        rows = rows[~long[longest[rows]]]
        new = longest[rows[long[edges.of_cells[rows]].any(axis=1)]]
        if not len(new):
            return long
        long[new] = True


def graded_samples(mesh: Mesh, regions: Regions, sampling: str, bend: CellGeometry, further: Samples | None) -> Samples:
    """Return the samples of triangles, those of one after those of another, and ``further`` ones behind them.

    Triangles that are clipped are so at the knot planes of the finest level that their corners or middle lie in.
    """
    middle = mesh.vertices[mesh.cells].mean(axis=1)
    corners = [mesh.vertices[one] for one in mesh.cells.T]
    level = np.max([regions.levels(one) for one in (middle, *corners)], axis=0)
    parts = [
        _of_level(mesh, np.flatnonzero(level == one), regions, one, sampling, bend) for one in range(regions.finest + 1)
    ]
    whole = [np.concatenate([getattr(one, name) for one in parts]) for name in ("points", "weights", "normals", "cell")]
    order = np.argsort(whole[3], kind="stable")
    behind = [] if further is None else [further.points, further.weights, further.normals, further.cell]
    own = [one[order] for one in whole]
    return Samples(*(own if not behind else [np.concatenate(pair) for pair in zip(own, behind, strict=True)]))


def _of_level(mesh: Mesh, chosen: Ints, regions: Regions, level: int, sampling: str, bend: CellGeometry) -> Samples:
    shift = shift_of(regions.spacing, level)
    midpoints = None if mesh.midpoints is None else mesh.midpoints[chosen] + shift
    moved = replace(mesh, vertices=mesh.vertices + shift, cells=mesh.cells[chosen], midpoints=midpoints)
    spacing = regions.spacing / 2**level
    found = quadrature(moved, spacing, clipped=triangles_to_clip(moved, sampling, bend, spacing))
    return Samples(found.points - shift, found.weights, found.normals, chosen[found.cell])


def shift_of(spacing: float, level: Any) -> Any:
    """Return how far before that of level 0 the lattice of a level has its node (0, ..., 0), along every axis."""
    return 0.5 * spacing * (1 - 0.5**level)


#: Edges are no longer than this share of their distance from a tip,
LONGEST_EDGE_SHARE = 0.5
#: but may be as long as this many spacings: what lies in one such edge is 1/1000 of the energy within a spacing.
LEAST_EDGE_SPACINGS = 1e-3


def grade_towards_tips(mesh: Mesh, spacing: float) -> Mesh:
    """Return flat triangles with their edges halved that are longer than half their distance from a boundary's end.

    Parameters
    ----------
    mesh : Mesh
        Of flat triangles.
    spacing : float
        h of the lattice.
    """
    tips = np.concatenate([np.zeros(0, dtype=np.int64), *(ends_inside(mesh, k) for k in np.unique(mesh.owner))])
    if not len(tips):
        return mesh
    centres, done = mesh.vertices[tips], []
    while True:
        edges = mesh.edges
        long = _is_long_near_tips(mesh.vertices, edges.ends, mesh.edge_lengths, centres, spacing)
        open_cells = long[edges.of_cells].any(axis=1)
        done.append(mesh.cells[~open_cells])
        if not open_cells.any():
            return replace(mesh, cells=np.concatenate(done))
        mesh = replace(mesh, cells=mesh.cells[open_cells])
        edges = mesh.edges
        long = _is_long_near_tips(mesh.vertices, edges.ends, mesh.edge_lengths, centres, spacing)
        middle = np.full(len(edges.ends), -1)
        middle[long] = len(mesh.vertices) + np.arange(long.sum())
        mesh = halve_edges(mesh, middle, mesh.vertices[edges.ends[long]].mean(axis=1))


def _is_long_near_tips(vertices: Floats, ends: Ints, lengths: Floats, centres: Floats, spacing: float) -> Bools:
    from scipy.spatial import cKDTree

    distance = cKDTree(centres).query(vertices[ends.ravel()])[0].reshape(-1, 2).min(axis=1)
    return np.asarray(lengths > np.maximum(LONGEST_EDGE_SHARE * distance, LEAST_EDGE_SPACINGS * spacing))
