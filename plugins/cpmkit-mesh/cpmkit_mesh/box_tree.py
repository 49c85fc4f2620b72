"""A bounding box tree over triangles or segments in space, and searches for the nearest of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cpmkit.plugin import Bools, Floats, Ints, run_parcels

#: Boxes of a translated tree are widened by so many roundings of the largest coordinate.
ROUNDINGS = 8
#: Twice the area over the square of the longest edge, below which a triangle counts as a sliver.
SLIVER_SHARE = 1e-2


@dataclass(frozen=True, eq=False)
class BoxTree:
    """A binary tree of boxes around primitives. A slot is the position of a primitive in the order of the leaves.

    Attributes
    ----------
    boxes : (nodes, 6) float64
        The lowest and the highest corner of each node's box.
    nodes : (nodes, 2) uint64
        Of an inner node 0 and its first child, the second follows it; of a leaf the number of its slots and the first.
    order : (m,) int64
        The primitive in each slot.
    frames : (m, 3, 3) float64
        By slot, the first corner and the edges from it to the other two, which are equal for a segment.
    shape : (m,) uint8
        By slot, the formula of the distance: that of a triangle, a sliver or a segment.
    """

    boxes: Floats
    nodes: NDArray[np.uint64]
    order: Ints
    frames: Floats
    shape: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Nearest:
    """The nearest points of n queries on the primitives of a tree.

    Attributes
    ----------
    slot : (n,) int64
        The slot in the tree of the primitive on which each lies.
    local : (n, 2) float64
        v, w of the point p + v a + w b of the primitive with first corner p and edges a, b from it; w = 0 on a segment.
    point : (n, 3) float64
        The nearest points.
    distance : (n,) float64
        Their distances from the queries.
    """

    slot: Ints
    local: Floats
    point: Floats
    distance: Floats

    @classmethod
    def empty(cls, n: int, slot: Ints | None = None) -> Nearest:
        """Return a record of ``n`` points with uninitialised arrays for kernels to fill; a ``slot`` (n,) is kept."""
        slot = np.empty(n, dtype=np.int64) if slot is None else slot
        return cls(slot, np.empty((n, 2)), np.empty((n, 3)), np.empty(n))

    def take(self, index: Ints | Bools) -> Nearest:
        """Return the rows at ``index``, row numbers or a mask (n,)."""
        return Nearest(self.slot[index], self.local[index], self.point[index], self.distance[index])


def build_tree(corners: Floats) -> BoxTree:
    """Return the bounding box tree over m > 0 triangles with ``corners`` (m, 3, 3); in a segment the last two agree."""
    from cpmkit_mesh import box_tree_kernels, query_kernels

    boxes, nodes, order = box_tree_kernels.build_boxes(corners.min(axis=1), corners.max(axis=1))
    frames = as_frames(corners[order])
    first, second = frames[:, 1], frames[:, 2]
    edges = np.stack([first, second, second - first], axis=1)
    longest = np.einsum("mik,mik->mi", edges, edges).max(axis=1)
    thin = np.linalg.norm(np.cross(first, second), axis=1) < SLIVER_SHARE * longest
    shape = np.where(thin, query_kernels.SLIVER_KIND, query_kernels.TRIANGLE_KIND)
    shape[(first == second).all(axis=1)] = query_kernels.SEGMENT_KIND
    return BoxTree(boxes, nodes, order, frames, shape.astype(np.uint8))


def translate_tree(tree: BoxTree, corners: Floats) -> BoxTree:
    """Return the tree of the same primitives, translated by one vector to ``corners`` (m, 3, 3).

    The primitives are in the order in which the tree was built from them. Boxes are translated too, and widened by
    rounding. That takes a twentieth of the time of :func:`build_tree`.
    """
    frames = as_frames(corners[tree.order])
    offset = np.tile(frames[0, 0] - tree.frames[0, 0], 2)
    rounding = ROUNDINGS * np.finfo(float).eps * (np.abs(tree.boxes).max() + np.abs(offset).max())
    return replace(tree, boxes=tree.boxes + offset + np.repeat([-rounding, rounding], 3), frames=frames)


def as_frames(at_corners: Floats) -> Floats:
    """Return (m, 3, 3) values at corner 0 of ``at_corners`` (m, 3, 3), and the differences of the others from it."""
    frames = at_corners - at_corners[:, :1]
    frames[:, 0] = at_corners[:, 0]
    return frames


def find_nearest(tree: BoxTree, x: Floats) -> Nearest:
    """Return the nearest point of the primitives of ``tree`` to each of ``x`` (n, 3)."""
    from cpmkit_mesh import query_kernels

    points = Nearest.empty(len(x))
    answer = (points.slot, points.local, points.point, points.distance)
    arrays = (tree.boxes, tree.nodes, tree.frames, tree.shape, *answer)
    run_parcels(lambda start, stop: query_kernels.fill_nearest(x, start, stop, *arrays), len(x))
    return points


def project_onto_primitives(tree: BoxTree, x: Floats, slot: Ints) -> Nearest:
    """Return the point nearest to each of ``x`` (n, 3) on the primitive of ``tree`` in its ``slot`` (n,)."""
    from cpmkit_mesh import query_kernels

    points = Nearest.empty(len(x), slot)
    arrays = (tree.frames, tree.shape, points.slot, points.local, points.point, points.distance)
    run_parcels(lambda start, stop: query_kernels.fill_projections(x, start, stop, *arrays), len(x))
    return points
