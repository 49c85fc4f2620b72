"""Meshes graded by the size of splines, or towards the tips of boundaries, and their samples."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.refinement.regions import Regions, codes_of_cells, is_among
from cpmkit.forms.galerkin.solution_warnings import ends_inside
from cpmkit.mesh.cell_quadrature import Samples, quadrature, triangles_to_clip
from cpmkit.mesh.mesh import CellGeometry, Edges, Mesh
from cpmkit.mesh.subdivision import halve_edges
from cpmkit.types import Bools, Floats, Ints

#: The level of the splines along an edge is evaluated at these shares of the edge.
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
#: Edges near a tip are no longer than this share of their distance from it, but may be as long as so many spacings: one
#: such edge holds 1/1000 of the energy within a spacing.
LONGEST_EDGE_SHARE, LEAST_EDGE_SPACINGS = 0.5, 1e-3


def grade_mesh(mesh: Mesh, regions: Regions, spacings: float) -> Mesh:
    """Return flat triangles whose edges are at most ``spacings`` times as long as the spacing of the splines there.

    Longer edges are halved, and so is the longest edge of each triangle with a halved edge, so that no needles arise.
    """
    near_codes = regions.codes_near()
    while True:
        edges = mesh.edges
        lengths = mesh.edge_lengths
        long = _with_longest(
            _is_long(mesh.vertices, edges.ends, lengths, regions, near_codes, spacings), edges, lengths
        )
        if not long.any():
            return mesh
        middle = np.full(len(edges.ends), -1)
        middle[long] = len(mesh.vertices) + np.arange(long.sum())
        mesh = halve_edges(mesh, middle, mesh.vertices[edges.ends[long]].mean(axis=1))


def _is_long(
    vertices: Floats, ends: Ints, lengths: Floats, regions: Regions, near_codes: Ints, spacings: float
) -> Bools:
    """Return (e,) whether each edge is longer than ``spacings`` times the spacing of the finest splines along it.

    ``ends`` (e, 2) are the vertices of the edges, ``lengths`` (e,) their lengths. Outside the cells of level 0 with the
    codes ``near_codes`` all splines have level 0.
    """
    longest = spacings * regions.spacing
    long = lengths > longest * 0.5**regions.finest
    middles = vertices[ends[long]].mean(axis=1)
    rows = np.flatnonzero(long)[is_among(codes_of_cells(regions.cells(middles, 0)), near_codes)]
    first, second = vertices[np.sort(ends[rows], axis=1)].transpose(1, 0, 2)
    level = np.zeros(len(rows), dtype=np.int64)
    for share in SHARES:
        level = np.maximum(level, regions.levels_around((1 - share) * first + share * second))
    long[:] = False
    long[rows] = lengths[rows] > longest * 0.5**level
    return long


def _with_longest(long: Bools, edges: Edges, lengths: Floats) -> Bools:
    """Return ``long`` (e,) in which the longest edge of each triangle with a marked edge is marked too.

    The array is changed; marking is repeated until no triangle has a marked edge but not its longest.
    """
    longest = edges.of_cells[np.arange(len(edges.of_cells)), lengths[edges.of_cells].argmax(axis=1)]
    rows = np.flatnonzero(~long[longest])
    while True:
        rows = rows[~long[longest[rows]]]
        new = longest[rows[long[edges.of_cells[rows]].any(axis=1)]]
        if not len(new):
            return long
        long[new] = True


def graded_samples(
    mesh: Mesh, regions: Regions, sampling: str, geometry: CellGeometry, further: Samples | None
) -> Samples:
    """Return the samples of triangles in the order of the triangles, followed by the samples ``further``.

    Each triangle is clipped at the knot planes of the finest level at its corners and its centroid.
    """
    middle = mesh.vertices[mesh.cells].mean(axis=1)
    corners = [mesh.vertices[vertices] for vertices in mesh.cells.T]
    levels = np.max([regions.levels(points) for points in (middle, *corners)], axis=0)
    by_level = [
        _samples_of_level(mesh, np.flatnonzero(levels == level), regions, level, sampling, geometry)
        for level in range(regions.finest + 1)
    ]
    order = np.argsort(np.concatenate([samples.cell for samples in by_level]), kind="stable")
    arrays = []
    for name in ("points", "weights", "normals", "cell"):
        array = np.concatenate([getattr(samples, name) for samples in by_level])[order]
        arrays.append(array if further is None else np.concatenate([array, getattr(further, name)]))
    return Samples(*arrays)


def _samples_of_level(
    mesh: Mesh, chosen: Ints, regions: Regions, level: int, sampling: str, geometry: CellGeometry
) -> Samples:
    """Return the samples of the triangles ``chosen`` (k,), which are clipped, if at all, at the level's knot planes."""
    shift = shift_of(regions.spacing, level)
    midpoints = None if mesh.midpoints is None else mesh.midpoints[chosen] + shift
    shifted = replace(mesh, vertices=mesh.vertices + shift, cells=mesh.cells[chosen], midpoints=midpoints)
    spacing = regions.spacing / 2**level
    samples = quadrature(shifted, spacing, clipped=triangles_to_clip(shifted, sampling, geometry, spacing))
    return Samples(samples.points - shift, samples.weights, samples.normals, chosen[samples.cell])


def shift_of(spacing: float, level: Any) -> Any:
    """Return the distance along each axis from node 0 of a level's lattice to node 0 of level 0."""
    return 0.5 * spacing * (1 - 0.5**level)


def grade_towards_tips(mesh: Mesh, spacing: float) -> Mesh:
    """Return flat triangles whose edges are at most half as long as their distance from an end of a boundary.

    Edges shorter than a thousandth of a spacing are not subdivided.

    Parameters
    ----------
    mesh : Mesh
        A mesh of flat triangles.
    spacing : float
        Spacing h of the lattice.
    """
    tips = np.concatenate([np.zeros(0, dtype=np.int64), *(ends_inside(mesh, k) for k in np.unique(mesh.owner))])
    if not len(tips):
        return mesh
    centres, finished = mesh.vertices[tips], []
    while True:
        edges = mesh.edges
        long = _is_long_near_tips(mesh.vertices, edges.ends, mesh.edge_lengths, centres, spacing)
        open_cells = long[edges.of_cells].any(axis=1)
        finished.append(mesh.cells[~open_cells])
        if not open_cells.any():
            return replace(mesh, cells=np.concatenate(finished))
        mesh = replace(mesh, cells=mesh.cells[open_cells])
        edges = mesh.edges
        long = _is_long_near_tips(mesh.vertices, edges.ends, mesh.edge_lengths, centres, spacing)
        middle = np.full(len(edges.ends), -1)
        middle[long] = len(mesh.vertices) + np.arange(long.sum())
        mesh = halve_edges(mesh, middle, mesh.vertices[edges.ends[long]].mean(axis=1))


def _is_long_near_tips(vertices: Floats, ends: Ints, lengths: Floats, centres: Floats, spacing: float) -> Bools:
    """Return (e,) whether edges are longer than half their distance from the nearest tip of ``centres`` (t, d)."""
    from scipy.spatial import cKDTree

    distance = cKDTree(centres).query(vertices[ends.ravel()])[0].reshape(-1, 2).min(axis=1)
    return np.asarray(lengths > np.maximum(LONGEST_EDGE_SHARE * distance, LEAST_EDGE_SPACINGS * spacing))
