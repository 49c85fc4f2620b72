"""Insertion of a curve as edges of a surface's triangles: its polyline, the parts on the surface, and edge paths."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import dots, norms
from cpmkit.mesh.mixed_cells import Polyline
from cpmkit.meshing.insertion.parallel_curves import SimplifiedCurve
from cpmkit.meshing.insertion.split_triangulation import SplitTriangulation, Vector, add_scaled, subtract
from cpmkit.meshing.insertion.surface_matching import Projections, ProjectionSearch, match_to_surface, simplify_polyline
from cpmkit.meshing.insertion.surface_paths import InsertedPoint, PathFinder, erase_short_loops
from cpmkit.types import Bools, Floats, Ints

#: A point is past a rim if its offset from the rim along the surface is above this share of L.
PAST_RIM_SHARE = 0.02


def simplify_curve(search: ProjectionSearch, line: Polyline, source: LocalSource, owner: int) -> SimplifiedCurve:
    """Return ``line``, on the curve ``source`` of boundary ``owner``, with fewer points (:func:`simplify_polyline`).

    The tolerance is .01 local edge lengths of the triangles of ``search``.
    """
    points = np.concatenate([line.points, line.points[:1]]) if line.closed else line.points
    rows = simplify_polyline(points, 0.01 * search.local_size(points))
    return SimplifiedCurve.of(points[rows[:-1] if line.closed else rows], line.closed, source, owner)


class InsertionPolyline(NamedTuple):
    """The polyline of a curve, ready for insertion."""

    points: Floats  #: (n, 3): points in the direction of the curve.
    closed: bool
    on: Ints  #: (n,): the earlier boundary on which each point lies, -1 for none.
    #: (n, 2): the number of an earlier polyline that nearly coincides, and its point there, -1 where there is none.
    partners: Ints
    number: int  #: Number of this polyline.
    rows: Ints  #: (k,): numbers of the points of the simplified curve; all other points lie between these.


def refine_curve(
    search: ProjectionSearch, curve: SimplifiedCurve, on: Ints, earlier: Sequence[InsertionPolyline]
) -> InsertionPolyline:
    """Return the polyline of a curve with points no farther apart than twice the local edge length of the triangles.

    Where the curve nearly coincides with an ``earlier`` polyline, it has a point beside each point of that polyline.
    ``on`` (n,): the earlier boundary on which each point of ``curve.loop`` lies, -1 for none. A new point lies on a
        boundary if both neighbours do.
    """
    points, original_rows = curve.loop, np.arange(len(curve.loop)) % len(curve.points)
    partners = curve.partners[original_rows]
    for row in np.flatnonzero(partners[:, 0] >= 0).tolist():
        partners[row, 1] = earlier[partners[row, 0]].rows[partners[row, 1]]
    parallel = [_parallel_points(points[k : k + 2], partners[k : k + 2], earlier) for k in range(len(points) - 1)]
    at = np.repeat(np.arange(1, len(points)), [len(places) for places, _ in parallel])
    points = np.insert(points, at, np.concatenate([places for places, _ in parallel]), axis=0)
    partners = np.insert(partners, at, np.concatenate([pairs for _, pairs in parallel]), axis=0)
    on, original_rows = (np.insert(values, at, -1) for values in (on, original_rows))
    size = search.local_size(points)
    while True:
        chord = np.linalg.norm(np.diff(points, axis=0), axis=1)
        long = np.flatnonzero(chord > 2.0 * np.minimum(size[:-1], size[1:]))
        if not len(long):
            whole = slice(len(points) - curve.closed)
            rows = np.flatnonzero(original_rows[whole] >= 0)
            return InsertionPolyline(points[whole], curve.closed, on[whole], partners[whole], len(earlier), rows)
        middle = 0.5 * (points[long] + points[long + 1])
        points = np.insert(points, long + 1, middle, axis=0)
        size = np.insert(size, long + 1, search.local_size(middle))
        both = np.where(on[long] == on[long + 1], on[long], -1)
        on, original_rows = np.insert(on, long + 1, both), np.insert(original_rows, long + 1, -1)
        partners = np.insert(partners, long + 1, -1, axis=0)


def _parallel_points(ends: Floats, partners: Ints, earlier: Sequence[InsertionPolyline]) -> tuple[Floats, Ints]:
    """Return points (k, 3) of a segment with ``ends`` (2, 3), and their partners (k, 2), points of an earlier polyline.

    If the ``partners`` (2, 2) of the two ends are consecutive points of the earlier simplified curve, each point of its
    polyline between them becomes the partner of a point of the segment at the same share of the length; else k = 0.
    """
    none = np.zeros((0, 3)), np.zeros((0, 2), dtype=np.int64)
    number = int(partners[0, 0])
    if number < 0 or partners[1, 0] != number:
        return none
    line = earlier[number]
    start, end = (int(np.searchsorted(line.rows, row)) for row in partners[:, 1])
    count = len(line.rows)
    forward = end == (start + 1) % count if line.closed else end == start + 1
    backward = start == (end + 1) % count if line.closed else start == end + 1
    if not (forward or backward) or start == end:
        return none
    low, high = (partners[:, 1] if forward else partners[::-1, 1]).tolist()
    inner = np.arange(low + 1, high if high > low else len(line.points))
    inner = inner if forward else inner[::-1]
    way = line.points[partners[:, 1]]
    share = np.linalg.norm(line.points[inner] - way[0], axis=1) / np.linalg.norm(way[1] - way[0])
    places = ends[0] + share[:, None] * (ends[1] - ends[0])
    return places, np.stack([np.full(len(inner), number), inner], axis=1)


def parts_on_surface(
    triangulation: SplitTriangulation, search: ProjectionSearch, points: Floats, matched: Projections, closed: bool
) -> list[tuple[Projections, bool]]:
    """Return the parts of a curve that lie on the surface, cut off where they pass its rim.

    With each part comes whether it is closed, so that it continues from its last point to the first. ``point`` of the
    projections, the number of the curve's point, is -1 where a part passes a rim.
    ``search``: search over the original triangles. ``matched``: one projection of each point.
    ``points`` (n, 3): points of the curve; ``closed``: whether the curve is closed.
    """
    off = _are_past_rim(_rim_offsets(triangulation, points, matched), closed)
    if not off.any():
        return [(matched, closed)]
    if closed:
        order = (np.arange(len(points) + 1) + int(off.argmax())) % len(points)
        points, matched, off = points[order], matched.take(order), off[order]
    runs = []
    for first, last in _true_ranges(~off):
        parts = [matched.take(np.arange(first, last))]
        if first > 0:
            parts.insert(0, _rim_passage(triangulation, search, points[first], points[first - 1]))
        if last < len(off):
            parts.append(_rim_passage(triangulation, search, points[last - 1], points[last]))
        runs.append((Projections.join(parts), False))
    return runs


def _rim_offsets(triangulation: SplitTriangulation, points: Floats, projections: Projections) -> Floats:
    """Return the distance (n,) of each point past a rim, along the surface, in local edge lengths.

    The distance is 0 for points before a rim, and for points whose height above the surface exceeds it.
    """
    corners = triangulation.original.vertices[triangulation.original.cells[projections.cell]]
    off = points - projections.positions(triangulation)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = across / norms(across)[:, None]
    height = dots(off, normal)
    tangential = norms(off - height[:, None] * normal)
    past = np.where(tangential >= np.abs(height), tangential / triangulation.sizes[projections.cell], 0.0)
    for row in np.flatnonzero((past > 0) & (projections.shares <= 0).any(axis=1)):
        cell, shares = projections.cell[row], projections.shares[row]
        vertices = triangulation.original.cells[cell][shares > 0]
        at_vertex = len(vertices) == 1
        past[row] *= (
            triangulation.is_on_rim(int(vertices[0])) if at_vertex else triangulation.rim_edges[cell, shares.argmin()]
        )
    past[(projections.shares > 0).all(axis=1)] = 0.0
    return past


def _are_past_rim(offsets: Floats, closed: bool) -> Bools:
    """Return which points (n,) lie past a rim, given their ``offsets`` (n,) from :func:`_rim_offsets`.

    Points within .15 local edge lengths of the rim do not count if the stretch of such points starts and ends on the
    rim, or is the whole curve.
    """
    off = offsets > PAST_RIM_SHARE
    start = int((~off).argmax()) if closed else 0
    off, offsets = np.roll(off, -start), np.roll(offsets, -start)
    for first, last in _true_ranges(off):
        ends = (first == 0) + (last == len(off))
        if offsets[first:last].max() < 0.15 and (closed or ends != 1):
            off[first:last] = False
    return np.roll(off, start)


def _true_ranges(mask: Bools) -> list[tuple[int, int]]:
    """Return the first row and the row past the last of each run of True in a ``mask`` (n,) of points."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in change.reshape(-1, 2)]


def _rim_passage(triangulation: SplitTriangulation, search: ProjectionSearch, on: Floats, off: Floats) -> Projections:
    """Return the projection of the point between ``on`` and ``off`` (3,) where a curve leaves the surface over its rim.

    ``on`` is a point on the surface, ``off`` a point past its rim. The projection's ``point`` is -1.
    """
    for _ in range(10):  # bisection, to a thousandth of the way
        middle = 0.5 * (on + off)
        past = _rim_offsets(triangulation, middle[None], search.nearest(middle[None]))[0] > PAST_RIM_SHARE
        on, off = (on, middle) if past else (middle, off)
    return replace(search.nearest(off[None]), point=np.array([-1]))


def insert_curve(finder: PathFinder, line: InsertionPolyline, counts: Counter[str]) -> float:
    """Insert a curve as edges of the triangulation, and return the largest distance of its points from the surface.

    Points past a rim do not count. ``counts["disconnected"]`` grows by the number of steps that have no path.
    """
    net, farthest = finder.triangulation, 0.0
    matched = match_to_surface(net, line.points, finder.search.candidates(line.points))
    for run, closed in parts_on_surface(net, finder.search, line.points, matched, line.closed):
        waypoints = _insert_waypoints(finder, run, closed, line)
        # vertices between which projections go back while the curve, off the surface there, continues
        known = (run.point[1:] >= 0) & (run.point[:-1] >= 0)
        ahead = dots(np.diff(line.points[run.point], axis=0), np.diff(run.positions(net), axis=0))
        backward = {waypoints[row + k].vertex for row in np.flatnonzero(known & (ahead < 0)).tolist() for k in (0, 1)}
        farthest = max(farthest, float(matched.distance[run.point[run.point >= 0]].max(initial=0.0)))
        for path in _paths_through(finder, waypoints, closed, counts):
            simple = erase_short_loops(net, net.refine_path(path), backward)
            finder.constrained.constrain_path(simple, finder.constrained.owner)
    return farthest


class Waypoint(NamedTuple):
    """A vertex that a curve passes, the earlier boundary on which it lies, and the vertex beside which it was placed.

    The last two are -1 for none.
    """

    vertex: int
    on: int
    partner: int


def _insert_waypoints(finder: PathFinder, run: Projections, closed: bool, line: InsertionPolyline) -> list[Waypoint]:
    """Insert vertices at the projections ``run`` of a part of a curve, record them in ``finder``, and return them."""
    waypoints = []
    places = run.positions(finder.triangulation).tolist()
    for k, (point, cell, (x, y, z)) in enumerate(zip(run.point, run.cell.tolist(), places, strict=True)):
        is_end = not closed and k in (0, len(places) - 1)
        if point < 0:
            waypoints.append(Waypoint(_insert_point(finder, cell, (x, y, z), -1, is_end), -1, -1))
            continue
        owner, place = int(line.on[point]), tuple(line.points[point].tolist())
        partner = finder.inserted.get(tuple(line.partners[point].tolist()))
        if partner is None:
            vertex = _insert_point(finder, cell, (x, y, z), owner, is_end)
        else:
            offset = subtract(place, partner.place)
            vertex = finder.insert_projection(add_scaled(finder.triangulation.position(partner.vertex), 1.0, offset))
        finder.inserted[line.number, int(point)] = InsertedPoint(vertex, place)
        waypoints.append(Waypoint(vertex, owner, -1 if partner is None else partner.vertex))
    return waypoints


def _insert_point(finder: PathFinder, cell: int, place: Vector, owner: int, is_end: bool) -> int:
    """Return the vertex at a point of the original triangle ``cell``, inserted if need be.

    The vertex lies on the earlier boundary ``owner`` if that is near (-1 for none); ``is_end`` marks a curve's end.
    """
    constrained = finder.constrained
    vertex = constrained.insert_on_boundary(cell, place, owner) if owner >= 0 else None
    if vertex is None:
        constrained.at_end = is_end
        vertex = constrained.insert_point(cell, place)
        constrained.at_end = False
    return vertex


def _paths_through(
    finder: PathFinder, waypoints: list[Waypoint], closed: bool, counts: Counter[str]
) -> Iterable[list[int]]:
    """Yield paths, lists of vertices, through the ``waypoints`` of a part of a curve: several where it has gaps.

    A gap is a step between waypoints that has no path; ``counts["disconnected"]`` grows by one for each.
    """
    path = [waypoints[0].vertex]
    for start, goal in pairwise(waypoints + waypoints[:1] if closed else waypoints):
        part = None
        if start.on == goal.on >= 0:
            part = finder.path_along_boundaries(start.vertex, goal.vertex, {goal.on})
        if part is None and start.partner >= 0 and goal.partner >= 0:
            part = finder.path_beside_boundary((start.vertex, start.partner), (goal.vertex, goal.partner))
        part = part or finder.path(start.vertex, goal.vertex)
        if part is None:
            counts["disconnected"] += 1
            yield path
            path = [goal.vertex]
        else:
            path += part[1:]
    yield path
