"""Separation of sheets of the manifold that lie close together, however small the gap between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.mesh.mesh import Mesh
from cpmkit.runtime.compilation import compiled
from cpmkit.runtime.index_sets import find_root, unite
from cpmkit.types import Floats, Ints, SparseMatrix

#: Two vertices are the same if they are nearer than this share of the mesh's size.
SAME_SIZE_SHARE = 1e-12
#: Paths are followed up to this multiple of the distance of the farthest corner plus a spacing.
PATH_FACTOR = 2.0
#: A sheet counts as farther if its path is longer by this, in spacings: near the end of a slit paths hardly differ.
LONGER_SPACINGS = 0.25


@dataclass(frozen=True, eq=False)
class SheetSeparation:
    """The mesh of the manifold, by which points are assigned to one of several sheets that lie close together.

    The source names its own triangle or segment that contains a point. The sheet of the point is the one from which
    paths along edges of the mesh to the corners of that triangle are shortest.
    """

    mesh: Mesh  #: The mesh of the manifold.
    #: given_vertices, given_cells (v, d) float64, (c, k) int64: the source's own mesh, relative to the origin.
    given_vertices: Floats
    given_cells: Ints
    spacing: float  #: Spacing h of the lattice.

    def total_path_lengths(self, points: Floats, element: Ints, cells: Ints, group: Ints) -> tuple[Floats, float]:
        """Return path lengths (k, q), smallest on a point's own sheet, and the smallest significant difference of two.

        ``cells`` (k, q) are mesh cells near each of the ``points`` (k, d), and ``group`` (k, q) numbers the sheets to
        which they belong; -1 excludes a cell. A length is the sum of the lengths of paths along edges of the mesh from
        the point, in a cell of the group, to the corners of ``element`` (k,), the source's own triangle or segment that
        contains the point. Lengths are infinite for excluded cells, and where a path is longer than the search.
        """
        size = float(np.ptp(self.mesh.vertices, axis=0).max())
        bound = max(SAME_SIZE_SHARE * size, np.finfo(float).tiny)
        corners = self.given_vertices[self.given_cells[element]]
        distance, at = self._tree.query(corners, distance_upper_bound=bound)
        ends = np.where(np.isfinite(distance), at, -1)  # -1 at corners where the mesh has no vertex
        offsets = self.mesh.vertices[ends] - points[:, None]
        farthest = np.where(ends >= 0, np.sqrt((offsets**2).sum(axis=2)), 0.0).max(axis=1)
        reach = PATH_FACTOR * (farthest + self.spacing)
        order = np.argsort(ends, axis=None, kind="stable")
        order = order[np.count_nonzero(ends < 0) :]  # -1 comes first
        lengths = np.where(group < 0, np.inf, 0.0)
        graph, arguments = self._vertex_graph, (points, self.mesh.cells[cells], group, ends, order, reach)
        add_path_lengths(*arguments, self.mesh.vertices, graph.indptr, graph.indices, graph.data, lengths)
        return lengths, LONGER_SPACINGS * self.spacing

    @cached_property
    def _tree(self) -> Any:
        """The k-d tree of the vertices of the mesh."""
        from scipy.spatial import cKDTree

        return cKDTree(self.mesh.vertices)

    @cached_property
    def _vertex_graph(self) -> SparseMatrix:
        """(v, v) adjacency matrix of the vertices, with the length of the edge for each two that share one."""
        from scipy.sparse import coo_array

        ends, count = self.mesh.edges.ends, len(self.mesh.vertices)
        length = np.sqrt(((self.mesh.vertices[ends[:, 0]] - self.mesh.vertices[ends[:, 1]]) ** 2).sum(axis=1))
        pairs = np.concatenate([ends, ends[:, ::-1]]).T
        return coo_array((np.tile(length, 2), tuple(pairs)), shape=(count, count)).tocsr()


@compiled
def group_touching_patches(patches: Ints, pairs: Ints, count: int) -> Ints:
    """Return the component (k, q) of each of the ``patches`` (k, q), connected within rows if patches touch.

    A component is numbered by its first column. ``pairs`` (t,) are the ascending codes ``first * count + second`` of
    patches that touch, first < second; ``count`` is the number of patches.
    """
    rows, width = patches.shape
    group, parent = np.empty((rows, width), dtype=np.int64), np.empty(width, dtype=np.int64)
    for row in range(rows):
        for j in range(width):
            parent[j] = j
        for j in range(width):
            for i in range(j):
                first, second = min(patches[row, i], patches[row, j]), max(patches[row, i], patches[row, j])
                if find_root(parent, i) != find_root(parent, j):
                    code, low, high = first * count + second, 0, len(pairs)
                    while low < high:
                        middle = (low + high) // 2
                        if pairs[middle] < code:
                            low = middle + 1
                        else:
                            high = middle
                    if first == second or (low < len(pairs) and pairs[low] == code):
                        unite(parent, i, j)
        for j in range(width):
            group[row, j] = find_root(parent, j)
    return group


@compiled
def add_path_lengths(
    points: Floats,
    cells: Ints,
    group: Ints,
    ends: Ints,
    order: Ints,
    reach: Floats,
    vertices: Floats,
    starts: Ints,
    others: Ints,
    steps: Floats,
    lengths: Floats,
) -> None:
    """Add to ``lengths`` (k, q) those of the shortest paths from ``points`` (k, d) over cells of a group to its ends.

    ``cells`` (k, q, c) are the corners, among ``vertices`` (n, d), of the q cells near each point, and ``group`` (k, q)
    their groups. All cells of a group have the same length; cells of group -1 are left out. ``ends`` (k, c) are the
    vertices at which the paths of each point end, -1 for none, and ``order`` (m,) the places in ``ends.ravel()`` of
    those that are not, by ascending vertex. Paths longer than ``reach`` (k,) count as infinite. The neighbours of each
    vertex are in compressed rows, ``starts`` (n + 1,) and ``others`` (2 e,), with the lengths ``steps`` (2 e,) of the
    edges. Paths are followed from each end, once for all points.
    """
    width, corners, per_row = cells.shape[1], cells.shape[2], ends.shape[1]
    least, distance, waiting = np.empty(width), np.empty(len(vertices)), np.empty(len(vertices), dtype=np.bool_)
    distance[:], waiting[:] = np.inf, False
    after = 0
    while after < len(order):
        first, end = after, ends[order[after] // per_row, order[after] % per_row]
        farthest = 0.0
        while after < len(order) and ends[order[after] // per_row, order[after] % per_row] == end:
            farthest = max(farthest, reach[order[after] // per_row])
            after += 1
        queue = [end]
        distance[end] = 0.0
        done = 0
        while done < len(queue):
            at = queue[done]
            done += 1
            waiting[at] = False
            for place in range(starts[at], starts[at + 1]):
                to = np.int64(others[place])
                candidate = distance[at] + steps[place]
                if candidate < distance[to] and candidate <= farthest:
                    distance[to] = candidate
                    if not waiting[to]:
                        waiting[to] = True
                        queue.append(to)
        for place in range(first, after):
            row = order[place] // per_row
            for j in range(width):
                least[j] = np.inf
                for i in range(corners):
                    at, square = cells[row, j, i], 0.0
                    for axis in range(points.shape[1]):
                        square += (vertices[at, axis] - points[row, axis]) ** 2
                    least[j] = min(least[j], distance[at] + np.sqrt(square))
            for j in range(width):
                length = np.inf
                for other in range(width):
                    if group[row, other] == group[row, j]:
                        length = min(length, least[other])
                lengths[row, j] += length if length <= reach[row] else np.inf
        for at in queue:
            distance[at] = np.inf
