"""Points at which a curve crosses the planes between the cells of a lattice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.grid.lattice import Codes
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import norms, unit
from cpmkit.meshing.contouring.contour_edges import connected_groups
from cpmkit.types import Floats, Ints

#: Number of halvings of a cell's face around the curve: strands farther apart than the parts are found separately.
HALVINGS = 5
#: A curve that meets a plane at a sine below this grazes it: such crossings are dropped.
GRAZING_SINE = 0.03
#: Crossings nearer to each other than this share of the spacing are merged.
SAME_SHARE = 1e-6
#: The same in units of the noise of closest points.
SAME_NOISES = 10.0
#: Points are moved along the curve at least so many times the noise: the direction is then known to 1/40.
STEP_NOISES = 30.0


@dataclass(frozen=True, eq=False)
class PlaneCrossings:
    """Points at which a curve crosses the faces of cells.

    Attributes
    ----------
    points, tangents : (c, d) float64
        The crossings, and the unit tangents there, of either orientation.
    member : (k,) int64
        The crossing of each entry. An entry is a pair of a cell and a crossing on one of its faces; entries are sorted
        by cells.
    cells : (k, d) int64
        The cell of each entry.
    start : (cells + 1,) int64
        The first entry of each cell, and the number of entries.
    """

    points: Floats
    tangents: Floats
    member: Ints
    cells: Ints
    start: Ints


def plane_crossings(source: LocalSource, cells: Ints, spacing: float) -> PlaneCrossings:
    """Return the points where the curve crosses the faces of ``cells`` (c, d), whose centres are lattice nodes."""
    from scipy.spatial import KDTree

    codes = Codes.around(cells, 2)
    cell, axis = _faces(cells, codes)
    starts, owner = _start_points(source, cell, axis, spacing)
    plane = np.asarray((cell[np.arange(len(cell)), axis] - 0.5) * spacing)
    points, rows = _step_to_planes(source, starts, axis[owner], plane[owner], spacing)
    owner = owner[rows]
    inside = np.abs(points / spacing - cell[owner]) <= 0.5 + same_share(source, spacing)
    inside[np.arange(len(owner)), axis[owner]] = True
    points, owner = points[inside.all(axis=1)], owner[inside.all(axis=1)]
    tangents = _tangents(source, points, axis[owner], spacing)
    steep = np.abs(tangents[np.arange(len(owner)), axis[owner]]) > GRAZING_SINE
    points, tangents, owner = points[steep], tangents[steep], owner[steep]
    reach = same_share(source, spacing) * spacing
    sine = np.abs(tangents[np.arange(len(owner)), axis[owner]])
    plane_of = np.stack([axis[owner], cell[owner, axis[owner]]], axis=1)
    i, j = KDTree(points).query_pairs(reach / sine.min(initial=1.0), output_type="ndarray").T
    distance, in_one_plane = norms(points[i] - points[j]), (plane_of[i] == plane_of[j]).all(axis=1)
    # Where the curve nearly lies in the plane, noise moves a crossing far along it.
    same = distance <= np.where(in_one_plane, reach / np.minimum(sine[i], sine[j]), reach)
    number, first = number_groups(i[same], j[same], len(points))
    sides = np.concatenate([cell[owner], cell[owner] - np.eye(cells.shape[1], dtype=np.int64)[axis[owner]]])
    entries = np.unique(np.stack([codes.encode(sides), np.tile(number, 2)], axis=1), axis=0)
    start = np.append(np.flatnonzero(np.diff(entries[:, 0], prepend=-1)), len(entries))
    member = np.ascontiguousarray(entries[:, 1])
    return PlaneCrossings(points[first], tangents[first], member, codes.decode(entries[:, 0]), start.astype(np.int64))


def same_share(source: LocalSource, spacing: float) -> float:
    """Return the distance, as a share of the spacing, below which crossings are merged."""
    return max(SAME_SHARE, SAME_NOISES * source.noise / spacing)


def _faces(cells: Ints, codes: Codes) -> tuple[Ints, Ints]:
    """Return the faces of ``cells`` (c, d), each once: the cell (f, d) above the face, and its normal axis (f,)."""
    dim = cells.shape[1]
    faces = []
    for axis in range(dim):
        step = np.eye(dim, dtype=np.int64)[axis]
        faces.append(np.unique(codes.encode(np.concatenate([cells, cells + step]))))
    return codes.decode(np.concatenate(faces)), np.repeat(np.arange(dim), [len(part) for part in faces])


def _start_points(source: LocalSource, cell: Ints, axis: Ints, spacing: float) -> tuple[Floats, Ints]:
    """Return closest points (k, d) of the smallest parts of faces that the curve may cross, and the face (k,) of each.

    A face is given by the ``cell`` (f, d) above it and its normal ``axis`` (f,); faces are halved repeatedly.
    """
    dim = cell.shape[1]
    owner, side = np.arange(len(cell)), spacing
    centre: Floats = np.asarray(cell * spacing, dtype=np.float64)
    centre[owner, axis] -= 0.5 * spacing
    signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    for halving in range(HALVINGS + 1):
        answer = source.closest_point(centre)
        is_close = answer.distance <= 0.5 * side * np.sqrt(dim - 1) * (1 + SAME_SHARE) + SAME_NOISES * source.noise
        centre, owner = centre[is_close], owner[is_close]
        if halving == HALVINGS:
            break
        side *= 0.5
        shift = signs[:, None] * 0.5 * side  # along the face's own axis the two halves are the same
        shift = np.where(np.arange(dim) == axis[owner][:, None], 0.0, shift)
        is_part = signs[:, axis[owner]] > 0
        centre = (centre + shift)[is_part]
        owner = np.broadcast_to(owner, is_part.shape)[is_part]
    return answer.points[is_close], owner


def _step_to_planes(
    source: LocalSource, starts: Floats, axis: Ints, plane: Floats, spacing: float
) -> tuple[Floats, Ints]:
    """Return the points (c, d) at which secant steps along the curve reach planes, and the start (c,) of each.

    Starts from which the iteration does not converge have no point.

    Parameters
    ----------
    source : LocalSource
    starts : (k, d) float64
        Points of the curve.
    axis, plane : (k,)
        The axis normal to the plane to be reached, and the coordinate of the plane.
    spacing : float
    """
    rows, tolerance = np.arange(len(starts)), max(1e-10 * spacing, 3.0 * source.noise)
    shortest = max(0.02 * spacing, STEP_NOISES * source.noise)  # a first step; longer ones may reach other strands
    before, ahead = starts, plane - starts[rows, axis]
    probe = np.where(np.abs(ahead) < shortest, np.copysign(shortest, ahead), ahead)
    pushed = starts.copy()
    pushed[rows, axis] += probe
    now = source.closest_point(pushed).points
    arrived = np.abs(ahead) <= tolerance
    points, of_start = [starts[arrived]], [np.flatnonzero(arrived)]
    go = (norms(now - before) > GRAZING_SINE**2 * np.abs(probe)) & ~arrived
    rows, now, before = rows[go], now[go], before[go]
    for _ in range(14):  # a limit; what has not converged by then grazes the plane
        each = np.arange(len(rows))
        step = now - before
        with np.errstate(all="ignore"):
            step = step * ((plane[rows] - now[each, axis[rows]]) / step[each, axis[rows]])[:, None]
        length = norms(step)
        usable = np.isfinite(length) & (norms(now - starts[rows]) < 2 * spacing)
        rows, before, now, step, length = rows[usable], before[usable], now[usable], step[usable], length[usable]
        if not len(rows):
            break
        step *= np.minimum(1.0, 0.5 * spacing / np.maximum(length, 1e-300))[:, None]
        new = source.closest_point(now + step).points
        # The secant through a point too near to be told from noise would have any direction: the older one serves.
        resolved = norms(new - now) > STEP_NOISES * source.noise
        before, now = np.where(resolved[:, None], now, before), new
        arrived = np.abs(now[np.arange(len(rows)), axis[rows]] - plane[rows]) <= tolerance
        points.append(now[arrived])
        of_start.append(rows[arrived])
        rows, now, before = rows[~arrived], now[~arrived], before[~arrived]
    return np.concatenate(points), np.concatenate(of_start)


def _tangents(source: LocalSource, points: Floats, axis: Ints, spacing: float) -> Floats:
    """Return unit tangents (n, d) at ``points`` (n, d) of the curve, by differences of closest points.

    Points are moved along ``axis`` (n,), the normal of the plane that they lie in. Where closest points are noisy and
    the axis leads across the curve, that direction is inaccurate: points are moved along it once more.
    """
    step, ways = max(1e-3 * spacing, STEP_NOISES * source.noise), np.eye(points.shape[1])[axis]
    for _ in range(2 if source.noise else 1):
        ahead, back = (source.closest_point(points + sign * step * ways).points for sign in (1.0, -1.0))
        ways = unit(ahead - back)
    return ways


def merge_near(points: Floats, reach: float) -> tuple[Ints, Ints]:
    """Return a group number (n,) for each of ``points`` (n, d), and the first point (g,) of each group.

    Points nearer to each other than ``reach`` are in one group.
    """
    from scipy.spatial import KDTree

    if not len(points):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    pairs = KDTree(points).query_pairs(reach, output_type="ndarray")
    return number_groups(pairs[:, 0], pairs[:, 1], len(points))


def number_groups(i: Ints, j: Ints, count: int) -> tuple[Ints, Ints]:
    """Return the number (count,) of the connected group of each item, and the first item (g,) of each group.

    Items ``i`` (k,) are connected with items ``j`` (k,).
    """
    _, label = connected_groups(i, j, count)
    _, first, number = np.unique(label, return_index=True, return_inverse=True)
    return number.astype(np.int64), first.astype(np.int64)
