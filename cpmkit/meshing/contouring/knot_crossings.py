"""Where a curve crosses the knot planes of the form's lattice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.grid.lattice import Codes
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import norms, unit
from cpmkit.protocols import Floats, Ints

#: Faces of cells are halved so many times round the curve: strands that are farther apart are found one by one.
HALVINGS = 5
#: Secant steps along the curve, at most, and the distance from the plane, in spacings, at which they end.
MOST_STEPS, ON_PLANE = 14, 1e-10
#: The first step, and the one that tells the direction at a crossing, in spacings: other strands may be near.
PROBE, TANGENT_STEP = 0.02, 1e-3
#: A curve that meets a plane at a sine below this grazes it: such crossings are dropped.
GRAZING = 0.03
#: Crossings nearer than this share of the spacing are one.
SAME = 1e-6
#: Where feet are noisy, in units of the noise: how far from the plane steps end, how near crossings are one, and how
#: far points are moved along the curve to tell its direction to 1/40.
ON_PLANE_NOISES, SAME_NOISES, STEP_NOISES = 3.0, 10.0, 30.0


@dataclass(frozen=True, eq=False)
class KnotCrossings:
    """Points at which a curve crosses knot planes.

    Attributes
    ----------
    points, tangents : (c, d) float64
        The crossings, and the unit tangents there, of either sense.
    member : (k,) int64
        The crossing of each entry, sorted by cells; one that lies on a cell's edge has several.
    cells : (k, d) int64
        The cell of each entry.
    start : (cells + 1,) int64
        Where each cell's entries begin.
    """

    points: Floats
    tangents: Floats
    member: Ints
    cells: Ints
    start: Ints


def knot_crossings(source: LocalSource, cells: Ints, spacing: float) -> KnotCrossings:
    """Return where the curve crosses the faces of ``cells`` (c, d), whose centres are at lattice nodes."""
    from scipy.spatial import KDTree

    codes = Codes.around(cells, 2)
    cell, axis = _faces(cells, codes)
    starts, owner = _starts(source, cell, axis, spacing)
    plane = np.asarray((cell[np.arange(len(cell)), axis] - 0.5) * spacing)
    points, rows = _landed(source, starts, axis[owner], plane[owner], spacing)
    owner = owner[rows]
    inside = np.abs(points / spacing - cell[owner]) <= 0.5 + same_share(source, spacing)
    inside[np.arange(len(owner)), axis[owner]] = True
    points, owner = points[inside.all(axis=1)], owner[inside.all(axis=1)]
    tangents = _tangents(source, points, axis[owner], spacing)
    steep = np.abs(tangents[np.arange(len(owner)), axis[owner]]) > GRAZING
    points, tangents, owner = points[steep], tangents[steep], owner[steep]
    reach = same_share(source, spacing) * spacing
    sine = np.abs(tangents[np.arange(len(owner)), axis[owner]])
    at = np.stack([axis[owner], cell[owner, axis[owner]]], axis=1)
    i, j = KDTree(points).query_pairs(reach / sine.min(initial=1.0), output_type="ndarray").T
    away, one_plane = norms(points[i] - points[j]), (at[i] == at[j]).all(axis=1)
    near = away <= np.where(one_plane, reach / np.minimum(sine[i], sine[j]), reach)  # along a plane noise goes far
    same, first = grouped(i[near], j[near], len(points))
    sides = np.concatenate([cell[owner], cell[owner] - np.eye(cells.shape[1], dtype=np.int64)[axis[owner]]])
    entries = np.unique(np.stack([codes.encode(sides), np.tile(same, 2)], axis=1), axis=0)
    start = np.append(np.flatnonzero(np.diff(entries[:, 0], prepend=-1)), len(entries))
    member = np.ascontiguousarray(entries[:, 1])
    return KnotCrossings(points[first], tangents[first], member, codes.decode(entries[:, 0]), start.astype(np.int64))


def same_share(source: LocalSource, spacing: float) -> float:
    """Return how near crossings are one, as a share of the spacing."""
    return max(SAME, SAME_NOISES * source.noise / spacing)


def _faces(cells: Ints, codes: Codes) -> tuple[Ints, Ints]:
    """Return each face of the cells once, as the cell that it is the lower face of along an axis."""
    dim = cells.shape[1]
    found = []
    for axis in range(dim):
        step = np.eye(dim, dtype=np.int64)[axis]
        found.append(np.unique(codes.encode(np.concatenate([cells, cells + step]))))
    return codes.decode(np.concatenate(found)), np.repeat(np.arange(dim), [len(part) for part in found])


def _starts(source: LocalSource, cell: Ints, axis: Ints, spacing: float) -> tuple[Floats, Ints]:
    """Return the feet of the smallest parts of the faces that the curve may cross, and the faces of those."""
    dim = cell.shape[1]
    owner, side = np.arange(len(cell)), spacing
    centre: Floats = np.asarray(cell * spacing, dtype=np.float64)
    centre[owner, axis] -= 0.5 * spacing
    signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    for halving in range(HALVINGS + 1):
        answer = source.closest_point(centre)
        near = answer.distance <= 0.5 * side * np.sqrt(dim - 1) * (1 + SAME) + SAME_NOISES * source.noise
        centre, owner = centre[near], owner[near]
        if halving == HALVINGS:
            break
        side *= 0.5
        within = signs[:, None] * 0.5 * side  # along the face's own axis the two halves are one
        within = np.where(np.arange(dim) == axis[owner][:, None], 0.0, within)
        kept = signs[:, axis[owner]] > 0
        centre = (centre + within)[kept]
        owner = np.broadcast_to(owner, kept.shape)[kept]
    return answer.points[near], owner


def _landed(source: LocalSource, feet: Floats, axis: Ints, plane: Floats, spacing: float) -> tuple[Floats, Ints]:
    """Return points of the curve on the planes, by secant steps from ``feet``, and of which start each is."""
    rows, near = np.arange(len(feet)), max(ON_PLANE * spacing, ON_PLANE_NOISES * source.noise)
    shortest = max(PROBE * spacing, STEP_NOISES * source.noise)
    before, ahead = feet, plane - feet[rows, axis]
    probe = np.where(np.abs(ahead) < shortest, np.copysign(shortest, ahead), ahead)
    pushed = feet.copy()
    pushed[rows, axis] += probe
    now = source.closest_point(pushed).points
    landed, of = [feet[np.abs(ahead) <= near]], [np.flatnonzero(np.abs(ahead) <= near)]
    go = (norms(now - before) > GRAZING**2 * np.abs(probe)) & (np.abs(ahead) > near)
    rows, now, before = rows[go], now[go], before[go]
    for _ in range(MOST_STEPS):
        each = np.arange(len(rows))
        step = now - before
        with np.errstate(all="ignore"):
            step = step * ((plane[rows] - now[each, axis[rows]]) / step[each, axis[rows]])[:, None]
        length = norms(step)
        fine = np.isfinite(length) & (norms(now - feet[rows]) < 2 * spacing)
        rows, before, now, step, length = rows[fine], before[fine], now[fine], step[fine], length[fine]
        if not len(rows):
            break
        step *= np.minimum(1.0, 0.5 * spacing / np.maximum(length, 1e-300))[:, None]
        following = source.closest_point(now + step).points
        known = norms(following - now) > STEP_NOISES * source.noise  # else the older point tells the direction better
        before, now = np.where(known[:, None], now, before), following
        done = np.abs(now[np.arange(len(rows)), axis[rows]] - plane[rows]) <= near
        landed.append(now[done])
        of.append(rows[done])
        rows, now, before = rows[~done], now[~done], before[~done]
    return np.concatenate(landed), np.concatenate(of)


def _tangents(source: LocalSource, points: Floats, axis: Ints, spacing: float) -> Floats:
    """Return unit tangents at points of the curve, from the feet of points moved along ``axis``.

    Where feet are noisy and the axis leads across the curve these say little, and points are moved along what they say.
    """
    step, ways = max(TANGENT_STEP * spacing, STEP_NOISES * source.noise), np.eye(points.shape[1])[axis]
    for _ in range(2 if source.noise else 1):
        ahead, back = (source.closest_point(points + sign * step * ways).points for sign in (1.0, -1.0))
        ways = unit(ahead - back)
    return ways


def merged(points: Floats, reach: float) -> tuple[Ints, Ints]:
    """Return a number for each point that those nearer than ``reach`` share, and the first point of each number."""
    from scipy.spatial import KDTree

    if not len(points):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    pairs = KDTree(points).query_pairs(reach, output_type="ndarray")
    return grouped(pairs[:, 0], pairs[:, 1], len(points))


def grouped(i: Ints, j: Ints, count: int) -> tuple[Ints, Ints]:
    """Return a number for each of ``count`` that linked ones share, by pairs (k,), (k,), and the first of each."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(i), dtype=np.int8), (i, j)), shape=(count, count))
    _, number = connected_components(graph, directed=False)
    _, first, number = np.unique(number, return_index=True, return_inverse=True)
    return number.astype(np.int64), first.astype(np.int64)
