"""Curves made of arcs between nodes: exact closest points, length, ends, components, loops, and finite elements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve
from scipy.spatial import KDTree

from cpmkit import ClosestPoints

#: Samples of a smooth arc, from which Newton's steps to the foot start, and how many of these are made.
ARC_SAMPLES, NEWTON_STEPS = 2000, 4
#: Elements of the reference, on each arc.
ELEMENTS = 400


@dataclass(frozen=True)
class Arc:
    """A smooth piece of a curve, ``at(t, k)`` its k-th derivative (n, d) at t (n,) in [start, stop]; None: straight."""

    ends: tuple[int, int]
    at: Callable | None = None
    start: float = 0.0
    stop: float = 1.0


class ArcCurve:
    """The source: nodes (n, d) and the arcs between them, turned and moved; it answers closest points and no more."""

    manifold_dim = 1
    exact = True

    def __init__(self, nodes, arcs, turn=None, move=0.0):
        self.nodes = np.asarray(nodes, dtype=float)
        self.arcs = arcs
        self.dim = self.nodes.shape[1]
        self.turn = np.eye(self.dim) if turn is None else turn
        self.move = np.broadcast_to(np.asarray(move, dtype=float), (self.dim,))

    @cached_property
    def degree(self):
        """(n,) how many arcs meet at each node."""
        return np.bincount(np.array([arc.ends for arc in self.arcs]).ravel(), minlength=len(self.nodes))

    @cached_property
    def lines(self):
        """(k, 2) the ends of straight arcs."""
        return np.array([arc.ends for arc in self.arcs if arc.at is None], dtype=int).reshape(-1, 2)

    @cached_property
    def bends(self):
        """The other arcs, each with a tree of its samples and their parameters."""
        found = []
        for arc in self.arcs:
            if arc.at is not None:
                t = np.linspace(arc.start, arc.stop, ARC_SAMPLES)
                found.append((arc, KDTree(arc.at(t, 0)), t))
        return found

    @cached_property
    def bounds(self):
        """(2, d) of the turned curve."""
        points = np.concatenate([self._points(arc, 200) for arc in self.arcs]) @ self.turn.T + self.move
        return np.stack([points.min(axis=0), points.max(axis=0)])

    @property
    def size(self):
        """The largest side of the box of the curve before it was turned."""
        return float(np.ptp(np.concatenate([self._points(arc, 200) for arc in self.arcs]), axis=0).max())

    def _points(self, arc, count):
        share = np.linspace(0.0, 1.0, count + 1)
        if arc.at is None:
            a, b = self.nodes[list(arc.ends)]
            return a + share[:, None] * (b - a)
        return arc.at(arc.start + share * (arc.stop - arc.start), 0)

    def closest_point(self, x):
        """Return the nearest of the feet on all arcs."""
        x = (np.asarray(x, dtype=float) - self.move) @ self.turn
        best, feet, edge = np.full(len(x), np.inf), x.copy(), np.full(len(x), -1)
        if len(self.lines):
            a, b = self.nodes[self.lines[:, 0]], self.nodes[self.lines[:, 1]]
            along = b - a
            off = x[:, None] - a
            t = np.clip((off * along).sum(axis=-1) / (along * along).sum(axis=-1), 0.0, 1.0)
            points = np.where((t == 1.0)[..., None], b, a + t[..., None] * along)
            distance = np.linalg.norm(x[:, None] - points, axis=-1)
            row, near = np.arange(len(x)), distance.argmin(axis=1)
            best, feet, t = distance[row, near], points[row, near], t[row, near]
            node = np.where(t == 0.0, self.lines[near, 0], np.where(t == 1.0, self.lines[near, 1], -1))
            edge = np.where((node >= 0) & (self.degree[node] == 1), node, -1)
        for arc, tree, samples in self.bends:
            t = samples[tree.query(x)[1]]
            step = samples[1] - samples[0]
            low, high = np.maximum(t - step, arc.start), np.minimum(t + step, arc.stop)
            for _ in range(NEWTON_STEPS):
                off, slope = arc.at(t, 0) - x, arc.at(t, 1)
                first = (off * slope).sum(axis=1)
                second = (slope * slope).sum(axis=1) + (off * arc.at(t, 2)).sum(axis=1)
                t = np.clip(t - first / np.where(second > 0, second, (slope * slope).sum(axis=1)), low, high)
            points = arc.at(t, 0)
            distance = np.linalg.norm(x - points, axis=1)
            nearer = distance < best
            best, feet = np.where(nearer, distance, best), np.where(nearer[:, None], points, feet)
            node = np.where(t == arc.start, arc.ends[0], np.where(t == arc.stop, arc.ends[1], -1))
            edge = np.where(nearer, np.where((node >= 0) & (self.degree[node] == 1), node, -1), edge)
        return ClosestPoints(feet @ self.turn.T + self.move, best, edge.astype(np.int64))

    @cached_property
    def truth(self):
        """Ends, components and loops of the curve."""
        return graph_counts(np.array([arc.ends for arc in self.arcs]))

    @cached_property
    def elements(self):
        """Vertices (v, d) and linear elements (e, 2) of a fine mesh of the curve."""
        points, cells = [self.nodes], []
        count = len(self.nodes)
        for arc in self.arcs:
            inner = self._points(arc, ELEMENTS)[1:-1]
            chain = np.concatenate([[arc.ends[0]], count + np.arange(len(inner)), [arc.ends[1]]])
            cells.append(np.stack([chain[:-1], chain[1:]], axis=1))
            points.append(inner)
            count += len(inner)
        return np.concatenate(points) @ self.turn.T + self.move, np.concatenate(cells)

    @cached_property
    def length(self):
        """The length: chords, with the error of their squares taken out (Richardson)."""
        total = 0.0
        for arc in self.arcs:
            fine, coarse = (np.linalg.norm(np.diff(self._points(arc, n), axis=0), axis=1).sum() for n in (8000, 4000))
            total += fine + (fine - coarse) / 3
        return float(total)

    def screened(self, load):
        """Return the fine mesh's vertices, the solution of -u'' + u = f there, and the share of the length of each."""
        points, cells = self.elements
        length = np.linalg.norm(points[cells[:, 1]] - points[cells[:, 0]], axis=1)
        rows, columns = cells[:, [0, 0, 1, 1]].ravel(), cells[:, [0, 1, 0, 1]].ravel()
        mass = (length[:, None] * np.array([2, 1, 1, 2]) / 6).ravel()
        stiffness = (np.array([1, -1, -1, 1]) / length[:, None]).ravel()
        shape = (len(points),) * 2
        m = coo_array((mass, (rows, columns)), shape=shape).tocsc()
        k = coo_array((stiffness, (rows, columns)), shape=shape).tocsc()
        return points, spsolve(k + m, m @ load(points)), np.asarray(m.sum(axis=0)).ravel()


def graph_counts(pairs):
    """Return how many ends, components and loops a graph of edges ``pairs`` (k, 2) has."""
    names, pairs = np.unique(pairs, return_inverse=True)
    pairs = pairs.reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(len(names), len(names)))
    components = connected_components(graph, directed=False)[0]
    ends = int((np.bincount(pairs.ravel(), minlength=len(names)) == 1).sum())
    return ends, components, len(pairs) - len(names) + components
