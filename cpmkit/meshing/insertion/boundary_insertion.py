"""Insertion of boundaries as facets of a mesh: curves and points in a surface, points in a curve."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cpmkit.manifold.abilities import HasMesh
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import in_three_dimensions, nearest_shares, norms
from cpmkit.mesh.mesh import Mesh
from cpmkit.mesh.mixed_cells import Polyline
from cpmkit.meshing.insertion.constrained_triangulation import MOVABLE_SNAP_SHARE, SNAP_SHARE, ConstrainedTriangulation
from cpmkit.meshing.insertion.curve_tips import extend_tips, join_stray_tips
from cpmkit.meshing.insertion.inserted_curves import InsertionPolyline, insert_curve, refine_curve, simplify_curve
from cpmkit.meshing.insertion.parallel_curves import (
    SimplifiedCurve,
    align_close_curves,
    coincident_boundary,
    is_close_to_others,
)
from cpmkit.meshing.insertion.split_triangulation import SplitTriangulation
from cpmkit.meshing.insertion.surface_matching import ProjectionSearch, polylines_of_source, trace_polylines
from cpmkit.meshing.insertion.surface_paths import PathFinder
from cpmkit.types import Floats, Ints


@dataclass(frozen=True, eq=False)
class Insertion:
    """A mesh with boundaries among its facets, and properties of the insertion that may cause warnings."""

    mesh: Mesh  #: Flat, with ``cut``, ``owner`` and ``beyond_tip``.
    #: The vertices (k,) of each boundary that consists of points on a surface and has no facets.
    point_vertices: dict[int, Ints] = field(default_factory=dict)
    empty: tuple[int, ...] = ()  #: Numbers of boundaries without any edge or vertex in the mesh.
    #: frozenset of (int, int): a boundary and an earlier one that it lies on in places; the edges there belong to the
    #: earlier one.
    coincident: frozenset[tuple[int, int]] = frozenset()
    #: Numbers of ``disconnected`` points of curves between which there is no path, ``pruned`` tails, ``joined`` tips,
    #: and ``tips`` that are left and extended.
    counts: dict[str, int] = field(default_factory=dict)
    #: The largest distance of each boundary from the mesh, without parts past a rim.
    max_distances: dict[int, float] = field(default_factory=dict)


def insert_boundaries(
    mesh: Mesh, boundaries: Sequence[LocalSource], spacing: float, movable: bool = False
) -> Insertion:
    """Return the mesh with boundaries as facets: curves as edges of triangles, points of a curve as vertices.

    Boundaries that are points on a surface become ``point_vertices``. New vertices lie on the original flat cells.
    ``mesh``: valid, flat, not cut. Its facets may have any number of cells. ``spacing``: spacing h of the lattice.
    ``boundaries``: relative to the same origin: curves and points on a surface, points on a curve.
    ``movable``: whether vertices of curves are moved onto the curves later; then vertices of the mesh near a curve may
        become vertices of the curve.
    """
    if not boundaries:
        return Insertion(mesh)
    if mesh.manifold_dim == 1:
        return _cut_curve_at_points(mesh, boundaries)
    net = SplitTriangulation(Mesh.of(in_three_dimensions(mesh.vertices), mesh.cells), spacing)
    constrained = ConstrainedTriangulation(net, MOVABLE_SNAP_SHARE if movable else SNAP_SHARE)
    finder, counts = PathFinder(constrained, ProjectionSearch(net.original, net.sizes)), Counter[str]()
    polylines = _polylines(finder.search, boundaries, spacing)
    for number, lines in enumerate(polylines):
        others = [*boundaries[:number], *boundaries[number + 1 :]]
        if any(is_close_to_others(line.points[:, : boundaries[number].dim], others, spacing) for line in lines):
            constrained.close.add(number)
    points, farthest = dict[int, Ints](), dict.fromkeys(range(len(boundaries)), 0.0)
    for number, boundary in enumerate(boundaries):
        constrained.owner = number
        places = [point_positions(member, mesh.vertices) for member in boundary.members if member.manifold_dim == 0]
        if places:
            nearest = finder.search.nearest(in_three_dimensions(np.concatenate(places)))
            pairs = zip(nearest.cell.tolist(), nearest.positions(net).tolist(), strict=True)
            points[number] = np.array([constrained.insert_point(cell, (x, y, z)) for cell, (x, y, z) in pairs])
            farthest[number] = float(nearest.distance.max())
        for line in polylines[number]:
            farthest[number] = max(farthest[number], insert_curve(finder, line, counts))
    join_stray_tips(finder, counts)
    extend_tips(finder, 3.0 * spacing, counts)
    edges = list(constrained.edges.values())
    cut = replace(
        net.mesh(mesh.dim),
        cut=np.array([(edge.tail, edge.head) for edge in edges], dtype=np.int64).reshape(-1, 2),
        owner=np.array([edge.owner for edge in edges], dtype=np.int64),
        beyond_tip=np.array([edge.beyond_tip for edge in edges], dtype=bool),
    )
    empty = tuple(number for number in range(len(boundaries)) if number not in points and number not in cut.owner)
    return Insertion(cut, points, empty, _overlapping_boundaries(polylines), dict(counts), farthest)


def _polylines(
    search: ProjectionSearch, boundaries: Sequence[LocalSource], spacing: float
) -> list[list[InsertionPolyline]]:
    """Return for each boundary the polylines of its curves, ready for insertion."""

    def earlier_boundary(curve: SimplifiedCurve) -> Ints:
        """Return the number of the earlier boundary on which each point of a curve lies, -1 for none."""
        points = curve.loop[:, : curve.source.dim]
        return coincident_boundary(points, curve.source, boundaries[: curve.owner], spacing)

    numbers = range(len(boundaries))
    curves = [curve for number in numbers for curve in _simplified_curves(search, boundaries[number], number, spacing)]
    places = [earlier_boundary(curve) for curve in curves]
    coincident = {(k, other) for k, place in enumerate(places) for other in np.unique(place[place >= 0]).tolist()}
    polylines: list[InsertionPolyline] = []
    of_boundary: list[list[InsertionPolyline]] = [[] for _ in boundaries]
    for before, curve, place in zip(curves, align_close_curves(curves, spacing, coincident), places, strict=True):
        on = place if curve is before else earlier_boundary(curve)
        polylines.append(refine_curve(search, curve, on, polylines))
        of_boundary[curve.owner].append(polylines[-1])
    return of_boundary


def _simplified_curves(
    search: ProjectionSearch, boundary: LocalSource, number: int, spacing: float
) -> Iterator[SimplifiedCurve]:
    """Yield the curves of a boundary with this ``number`` as simplified polylines."""
    for curve in boundary.members:
        if curve.manifold_dim == 1:
            lines = polylines_of_source(curve, 0.5 * spacing)
            for line in trace_polylines(curve, search, spacing) if lines is None else lines:
                yield simplify_curve(search, Polyline(in_three_dimensions(line.points), line.closed), curve, number)


def _overlapping_boundaries(polylines: Sequence[Sequence[InsertionPolyline]]) -> frozenset[tuple[int, int]]:
    """Return pairs (later, earlier) of boundaries: two consecutive points of the later lie on the earlier boundary."""
    pairs = set()
    for number, lines in enumerate(polylines):
        for line in lines:
            stretches = line.on[1:][(line.on[1:] == line.on[:-1]) & (line.on[1:] >= 0)]
            pairs |= {(number, other) for other in stretches.tolist()}
    return frozenset(pairs)


def point_positions(source: LocalSource, vertices: Floats) -> Floats:
    """Return the points (k, d) of a source of dimension 0.

    For a source without a mesh they are the distinct closest points of about 1000 of ``vertices`` (v, d), or of all.
    """
    if isinstance(source.source, HasMesh):
        drawing, cells = source.source.mesh(1.0)
        return np.asarray(drawing, dtype=np.float64)[cells[:, 0]] - source.shift
    queries = vertices[:: max(1, len(vertices) // 1000)]
    return np.unique(source.closest_point(queries).points, axis=0)


def _cut_curve_at_points(mesh: Mesh, boundaries: Sequence[LocalSource]) -> Insertion:
    """Return the insertion of boundaries that consist of points: segments of a curve, split at their closest points."""
    members = [
        (number, member)
        for number, boundary in enumerate(boundaries)
        for member in boundary.members
        if member.manifold_dim == 0
    ]
    vertices, cells, cut, farthest = mesh.vertices, mesh.cells, dict[int, int](), dict[int, float]()
    for number, member in members:
        for point in point_positions(member, mesh.vertices):
            vertices, cells, vertex = _insert_into_segments(vertices, cells, point)
            cut.setdefault(vertex, number)
            gap = float(norms((vertices[vertex] - point)[None])[0])
            farthest[number] = max(farthest.get(number, 0.0), gap)
    owner = np.array(list(cut.values()), dtype=np.int64)
    facets = np.array(list(cut), dtype=np.int64).reshape(-1, 1)
    empty = tuple(number for number in range(len(boundaries)) if number not in owner)
    split = Mesh(vertices, cells, None, facets, owner, np.zeros(len(owner), dtype=bool))
    return Insertion(split, empty=empty, max_distances=farthest)


def _insert_into_segments(vertices: Floats, cells: Ints, point: Floats) -> tuple[Floats, Ints, int]:
    """Return the vertices and segments with a vertex at the closest point of ``point`` (d,), and the vertex's number.

    An old vertex is returned if it is within ``SNAP_SHARE`` lengths of the segment from the closest point.
    """
    start, way = vertices[cells[:, 0]], vertices[cells[:, 1]] - vertices[cells[:, 0]]
    share = nearest_shares(point - start, way)
    row = int(np.argmin(norms(start + share[:, None] * way - point)))
    t = share[row]
    if min(t, 1 - t) < SNAP_SHARE:
        return vertices, cells, int(cells[row, int(t > 0.5)])
    new, first = len(vertices), cells.copy()
    first[row, 1] = new
    second = np.array([[new, cells[row, 1]]], dtype=np.int64)
    place = start[row] + t * way[row]
    return np.concatenate([vertices, place[None]]), np.concatenate([first, second]), new
