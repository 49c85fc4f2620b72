"""Thin triangles flipped away: a boundary that runs beside edges cuts off such, and they do not bend along with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.plugin import Bools, Floats, Ints
from cpmkit_fem.cell_mesh import CellMesh

#: Triangles with a height below this share of their longest edge are flipped, where that leaves better ones.
THIN_SHARE = 0.05
#: Rounds in which neighbours of flipped triangles are flipped.
ROUNDS = 6


def flip_thin_triangles(mesh: CellMesh, kept: Ints) -> CellMesh:
    """Return ``mesh``, of degree 1, with longest edges of thin triangles flipped, except for the edges ``kept`` (e, 2).

    An edge is flipped where both new triangles are less thin than the thinner old one, in :data:`ROUNDS` rounds at
    most. Edges of the rim, and so those on cuts, have no other diagonal.
    """
    size = len(mesh.nodes)
    kept_keys = _edge_keys(kept, size)
    for _ in range(ROUNDS):
        cells = mesh.corners
        thin = np.flatnonzero(_height_ratios(mesh.nodes, cells) < THIN_SHARE)
        turned = _start_at_longest_edge(mesh.nodes, cells)
        keys = _edge_keys(cells[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), size)
        order = np.argsort(keys, kind="stable")
        first, count = np.unique(keys[order], return_index=True, return_counts=True)[1:]
        place = np.searchsorted(keys[order][first], _edge_keys(turned[thin, :2], size))
        pair = order[first[place][:, None] + np.array([0, 1])[None, :] * (count[place] == 2)[:, None]] // 3
        other = np.where(pair[:, 0] == thin, pair[:, 1], pair[:, 0])
        free = (count[place] == 2) & ~np.isin(_edge_keys(turned[thin, :2], size), kept_keys)
        thin, other = thin[free], other[free]
        a, b, v = turned[thin].T
        w = cells[other].sum(axis=1) - a - b
        new = np.stack([np.stack([a, w, v], axis=1), np.stack([w, b, v], axis=1)])
        better = _improving_flips(mesh.nodes, new, cells[thin], cells[other]) & ~np.isin(
            _edge_keys(np.stack([v, w], 1), size), keys
        )
        chosen = np.flatnonzero(better & _independent_flips(thin, other, better, len(cells)))
        if not len(chosen):
            return mesh
        cells = cells.copy()
        cells[thin[chosen]], cells[other[chosen]] = new[0, chosen], new[1, chosen]
        mesh = replace(mesh, cells=cells)
    return mesh


def _start_at_longest_edge(nodes: Floats, cells: Ints) -> Ints:
    """Return the triangles (m, 3), in their orientation, with the longest edge from the first corner to the second."""
    sides = np.linalg.norm(nodes[np.roll(cells, -1, axis=1)] - nodes[cells], axis=2)
    turn = (np.argmax(sides, axis=1)[:, None] + np.arange(3)) % 3
    return np.take_along_axis(cells, turn, axis=1)


def _height_ratios(nodes: Floats, cells: Ints) -> Floats:
    """Return (...) the height of each triangle (..., 3) above its longest edge, divided by that edge."""
    corners = nodes[cells]
    first, second = corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=-2), axis=-1).max(axis=-1)
    dots = [np.sum(p * q, axis=-1) for p, q in ((first, first), (second, second), (first, second))]
    return np.asarray(np.sqrt(np.maximum(dots[0] * dots[1] - dots[2] ** 2, 0.0)) / longest**2)


def _improving_flips(nodes: Floats, new: Ints, thin: Ints, other: Ints) -> Bools:
    """Return (k,) where both triangles ``new`` (2, k, 3) are less thin than the thinner of two old ones (k, 3)."""
    before = np.minimum(_height_ratios(nodes, thin), _height_ratios(nodes, other))
    return np.asarray(_height_ratios(nodes, new).min(axis=0) > before)


def _independent_flips(thin: Ints, other: Ints, wanted: Bools, count: int) -> Bools:
    """Return (k,) which flips are the first, of those ``wanted`` (k,), of both triangles ``thin`` and ``other`` (k,).

    ``count`` is the number of all triangles.
    """
    number = np.arange(len(thin))
    first = np.full(count, len(thin))
    for cells in (thin, other):
        np.minimum.at(first, cells[wanted], number[wanted])
    return np.asarray((first[thin] == number) & (first[other] == number))


def _edge_keys(pairs: Ints, size: int) -> Ints:
    """Return (e,) a number for each pair of nodes ``pairs`` (e, 2), below ``size``; the same in either order."""
    low, high = np.sort(pairs, axis=1).T
    return np.asarray(low * size + high)
