"""Where a curve leaves the surface over its rim: only what lies on the surface is inserted."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cpmkit.manifold.vectors import dots, norms
from cpmkit.meshing.insertion.feet import Feet, Triangles
from cpmkit.meshing.insertion.triangulation import Triangulation
from cpmkit.protocols import Bools, Floats, Ints

#: A point is off the rim if its offset along the surface is above this share of L.
OFF_RIM_SHARE = 0.02
#: Between two places on the rim a curve runs along it as long as it is no farther off than this share of L.
ALONG_RIM_SHARE = 0.15
#: The place where a curve leaves is found by so many halvings.
HALVINGS = 10


class Run(NamedTuple):
    """Feet on roots that a curve passes one after the other; a closed run goes on from the last to the first.

    ``points`` are the numbers of the curve's points, -1 where it passes the rim.
    """

    points: Ints
    cells: Ints
    places: Floats
    closed: bool


def offsets(net: Triangulation, points: Floats, feet: Feet) -> Floats:
    """Return how far (n,) in L each point lies past a rim, along the surface; 0 where it does not."""
    corners = net.vertices[net.cells[feet.cell]]
    off = points - np.einsum("nk,nkd->nd", feet.shares, corners)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = across / norms(across)[:, None]
    height = dots(off, normal)
    tangential = norms(off - height[:, None] * normal)
    past = np.where(tangential >= np.abs(height), tangential / net.sizes[feet.cell], 0.0)
    for row in np.flatnonzero((past > 0) & (feet.shares <= 0).any(axis=1)):
        cell, shares = feet.cell[row], feet.shares[row]
        on = net.cells[cell][shares > 0]
        past[row] *= net.on_rim(int(on[0])) if len(on) == 1 else net.rims[cell, shares.argmin()]
    past[(feet.shares > 0).all(axis=1)] = 0.0
    return past


def runs(net: Triangulation, triangles: Triangles, points: Floats, feet: Feet, closed: bool) -> list[Run]:
    """Return the parts of a curve that lie on the surface, cut off where they pass its rim."""
    off = _off_runs(offsets(net, points, feet), closed)
    if not off.any():
        return [_run(net, feet, closed)]
    if closed:
        order = (np.arange(len(points) + 1) + int(off.argmax())) % len(points)
        points, feet, off = points[order], feet.take(order), off[order]
    found = []
    for first, last in _stretches(~off):
        piece = [feet.take(np.arange(first, last))]
        if first > 0:
            piece.insert(0, _leaving(net, triangles, points[first], points[first - 1]))
        if last < len(off):
            piece.append(_leaving(net, triangles, points[last - 1], points[last]))
        found.append(_run(net, _joined(piece), False))
    return found


def _off_runs(past: Floats, closed: bool) -> Bools:
    """Return which points are off the rim; what runs along it between two places on it, or as a whole, is not."""
    off = past > OFF_RIM_SHARE
    start = int((~off).argmax()) if closed else 0
    off, past = np.roll(off, -start), np.roll(past, -start)
    for first, last in _stretches(off):
        ends = (first == 0) + (last == len(off))
        if past[first:last].max() < ALONG_RIM_SHARE and (closed or ends != 1):
            off[first:last] = False
    return np.roll(off, start)


def _stretches(mask: Bools) -> list[tuple[int, int]]:
    """Return where each stretch of True starts and ends."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in change.reshape(-1, 2)]


def _leaving(net: Triangulation, triangles: Triangles, on: Floats, off: Floats) -> Feet:
    """Return the foot of the place between a point on the surface and one past its rim where the way leaves it."""
    for _ in range(HALVINGS):
        middle = 0.5 * (on + off)
        past = offsets(net, middle[None], triangles.nearest(middle[None]))[0] > OFF_RIM_SHARE
        on, off = (on, middle) if past else (middle, off)
    return replace(triangles.nearest(off[None]), point=np.array([-1]))


def _joined(parts: list[Feet]) -> Feet:
    return Feet(*(np.concatenate([getattr(part, name) for part in parts]) for name in Feet.__dataclass_fields__))


def _run(net: Triangulation, feet: Feet, closed: bool) -> Run:
    corners = net.vertices[net.cells[feet.cell]]
    return Run(feet.point, feet.cell, np.einsum("nk,nkd->nd", feet.shares, corners), closed)
