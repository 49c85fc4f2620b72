"""Polylines that follow curves closely: from the mesh that a curve has of itself, or traced by closest points."""

from __future__ import annotations

import numpy as np

from cpmkit.grid.lattice import cell_levels
from cpmkit.manifold.abilities import HasMesh
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import norms
from cpmkit.mesh.mesh import Mesh
from cpmkit.mesh.mixed_cells import Polyline, chain_segments
from cpmkit.meshing.contouring.curve_graph import trace_curve
from cpmkit.meshing.insertion.surface_matching import TriangleSearch
from cpmkit.types import Floats, Ints


def in_three_dimensions(points: Floats) -> Floats:
    """Return ``points`` (n, 2 or 3) as (n, 3), with a third coordinate of zero for points of the plane."""
    return points if points.shape[1] == 3 else np.hstack([points, np.zeros((len(points), 1))])


def polylines_of_source(source: LocalSource, length: float) -> list[Polyline] | None:
    """Return polylines from the curve's own mesh at the resolution ``length``, refined; None without such a mesh."""
    if not isinstance(source.source, HasMesh):
        return None
    vertices, cells = source.source.mesh(length)
    if cells.shape[1] != 2:
        return None
    vertices = np.asarray(vertices, dtype=np.float64) - source.shift
    return [refine_polyline(source, line, length) for line in chain_segments(vertices, cells)]


def refine_polyline(source: LocalSource, line: Polyline, length: float) -> Polyline:
    """Return a polyline with chords halved at points of the curve until their middles are within .002 ``length`` of it.

    A closest point farther than .3 chords from the middle lies on another branch, and does not count.
    """
    points = np.concatenate([line.points, line.points[:1]]) if line.closed else line.points
    fresh = np.ones(len(points) - 1, dtype=bool)
    for _ in range(12):  # a limit: chords are halved so often
        rows = np.flatnonzero(fresh)
        if not len(rows):
            break
        chord = norms(points[rows + 1] - points[rows])
        middle = 0.5 * (points[rows] + points[rows + 1])
        closest = source.closest_point(middle).points
        off = norms(closest - middle)
        split = (off > 2e-3 * length) & (off < 0.3 * chord)
        points = np.insert(points, rows[split] + 1, closest[split], axis=0)
        halved = np.zeros(len(fresh), dtype=bool)
        halved[rows[split]] = True
        fresh = np.repeat(halved, np.where(halved, 2, 1))
    return Polyline(points[:-1] if line.closed else points, line.closed)


def simplify_polyline(points: Floats, tolerance: Floats) -> Ints:
    """Return the rows (k,) of ``points`` (n, d) whose polyline is within the ``tolerance`` (n,) of every point.

    Douglas and Peucker (1973).
    """
    used = np.zeros(len(points), dtype=bool)
    used[[0, -1]] = True
    waiting = [(0, len(points) - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        inner = points[first + 1 : last] - points[first]
        chord = points[last] - points[first]
        square = float(chord @ chord)
        share = np.minimum(np.maximum(inner @ chord / square, 0.0), 1.0) if square > 0 else np.zeros(len(inner))
        excess = norms(inner - share[:, None] * chord) / tolerance[first + 1 : last]
        worst = first + 1 + int(excess.argmax())
        if excess[worst - first - 1] > 1:
            used[worst] = True
            waiting += [(first, worst), (worst, last)]
    return np.flatnonzero(used)


def trace_polylines(source: LocalSource, search: TriangleSearch, spacing: float) -> list[Polyline]:
    """Return polylines on all pieces of a curve that is known by closest points alone.

    Traces start at the closest points of cells of half a spacing that the curve may meet, and continue in steps of .15
    L, where L is the local edge length of the triangles of ``search``. Polylines end at junctions.
    """
    cells = next(blocks for side, blocks in cell_levels(source, 0.5 * spacing, 0.5) if side == 1)
    seeds = source.closest_point(np.asarray(cells * (0.5 * spacing), dtype=np.float64)).points
    size = float(np.median(search.local_size(in_three_dimensions(seeds))))
    graph = trace_curve(source, seeds, 0.15 * size)
    winding = Mesh.of(graph.vertices, graph.segments).winding
    segments = np.where((winding < 0)[:, None], graph.segments[:, ::-1], graph.segments)
    lines = chain_segments(graph.vertices, segments)
    return [refine_polyline(source, _along_tangents(source, line), size) for line in lines]


def _along_tangents(source: LocalSource, line: Polyline) -> Polyline:
    """Return a polyline in the direction of the curve's tangents, where it has some."""
    middle = len(line.points) // 2
    if source.has_tangents:
        tangent = source.tangents(source.closest_point(line.points[middle : middle + 1]))[0]
        if tangent @ (line.points[middle] - line.points[middle - 1]) < 0:
            return Polyline(line.points[::-1], line.closed)
    return line
