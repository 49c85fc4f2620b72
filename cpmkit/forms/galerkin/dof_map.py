"""The dof map: the patch of each sample, and the unknowns that each patch reads.

Two samples touch if their mesh cells share a vertex of the mesh that was cut along the boundaries. A patch is a
connected component of the samples in one lattice cell. An unknown is a lattice node together with a connected component
of the patches that read the node, where two patches are connected if some of their samples touch. Thus each side of a
boundary, each sheet of a thin part and each end of a slit gets unknowns of its own, without normals, orientation or
distances.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cpmkit.linear.constant_functions import RowGroups
from cpmkit.manifold.vector_algebra import norms
from cpmkit.runtime.compilation import compiled
from cpmkit.runtime.index_sets import connected_components, find_root, unite
from cpmkit.types import Bools, Floats, Ints

#: A piece of the manifold whose bounding box is shorter than this along every axis, in spacings, has one unknown: on so
#: small a piece splines cannot be distinguished.
ISOLATED_SPACINGS = 2.0
#: No pairs of patches.
NO_PAIRS = np.zeros((0, 2), dtype=np.int32)


@dataclass(frozen=True, eq=False)
class DofMap:
    """Patches of the manifold, and the unknowns that each reads.

    A patch is a connected part of the manifold in one lattice cell; it reads the unknowns whose splines are not zero in
    the cell. Lattice cells are bounded by knot planes: cell r has the points whose nearest lattice point is r. Splines
    of even degree are centred at lattice points, those of odd degree half a spacing below along every axis. A cell
    reads the degree + 1 nodes from r - degree // 2 on along every axis.
    """

    spacing: float  #: Spacing h of the lattice, in the unit of the scene.
    cells: Ints  #: (p, d): the lattice cell of each patch.
    #: (p, (degree + 1)^d) int32: the unknowns at the nodes that a patch reads, the last axis running fastest.
    unknowns: Any
    nodes: Ints  #: (n, d): the node of each unknown.
    touching: Any  #: (t, 2) int32: pairs of patches with samples that touch, each pair once.
    patch: Any  #: (q,) int32: the patch of each sample.
    degree: int = 2  #: Degree of the splines: 1, 2 or 3.
    #: (t, 2) int32: pairs of patches at the lips of a tie, where u is continuous.
    tied: Any = field(default_factory=lambda: NO_PAIRS)

    @property
    def size(self) -> int:
        """Number of unknowns, n."""
        return len(self.nodes)

    @property
    def dim(self) -> int:
        """Dimension d of the space."""
        return int(self.nodes.shape[1])

    @property
    def width(self) -> int:
        """Number of splines per axis that are not zero in a cell: the degree plus one."""
        return self.degree + 1

    @property
    def strides(self) -> tuple[int, ...]:
        """For each axis, how far apart neighbouring nodes along the axis are in a row of :attr:`unknowns`."""
        return tuple(self.width**axis for axis in reversed(range(self.dim)))

    @property
    def places(self) -> Floats:
        """(n, d) centres of the splines, relative to the origin of the lattice."""
        return np.asarray(self.spacing * (self.nodes - 0.5 * (self.degree % 2)))

    def magnify(self, _patch: Ints, points: Floats) -> Floats:
        """Return ``points`` (..., d) in patches (...), mapped so that lattice cells of any level have side `spacing`.

        Splines of one level leave points unchanged. Shapes broadcast.
        """
        return points

    def magnification(self, _patch: Ints) -> Floats:
        """Return the factor by which :meth:`magnify` enlarges lengths: 1 as (1,), (k,) in dof maps of levels."""
        return np.ones(1)


def build_dof_map(
    points: Floats, contacts: Any, spacing: float, cell: Any = None, degree: int = 2, tied: Any = NO_PAIRS
) -> DofMap:
    """Return the dof map of splines of a ``degree``: the patches of samples ``points`` (q, d), and their unknowns.

    ``contacts`` (m, k) are the vertices of the cells of the mesh that was cut along the boundaries, ``cell`` (q,) is
    the mesh cell of each sample, by default cell i of sample i, ``tied`` (t, 2) are pairs of samples at the lips of
    ties. Points are relative to the origin of the lattice. A piece of the manifold, connected also across ties, that is
    smaller than `ISOLATED_SPACINGS` has one unknown, which all of its patches read, or one for each part between ties.
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    cell = np.arange(len(points)) if cell is None else cell
    patch, roots, touching = build_patches(cell_codes(points, spacing), contacts, cell)
    cells = np.floor(points[roots] / spacing + 0.5).astype(np.int64)
    pairs = distinct_pairs(patch[tied], len(roots))
    joined, is_curve = np.concatenate([touching, pairs]), np.shape(contacts)[1] == 2
    isolated = isolated_patches(points, patch, joined, len(roots), spacing, is_curve)
    return dof_map_from_patches(spacing, cells, touching, patch, isolated, degree, pairs)


def isolated_patches(
    points: Floats, patch: Any, joined: Any, patches: int, spacing: float, by_diagonal: bool = False
) -> Bools:
    """Return whether (p,) each of ``patches`` patches is on a piece of the manifold so small that it has one unknown.

    ``points`` (q, d) lie in the patches ``patch`` (q,), and include the extreme points of each piece; ``joined`` (t, 2)
    are pairs of patches on one piece. The size is the largest extent along an axis, or if ``by_diagonal`` the diagonal.
    """
    count, piece = connected_components(patches, joined)
    groups = RowGroups.from_numbers(count, piece[patch])
    extent = groups.reduce_groups(np.maximum, points) - groups.reduce_groups(np.minimum, points)
    size = norms(extent) if by_diagonal else extent.max(axis=1)
    return np.asarray((size < ISOLATED_SPACINGS * spacing)[piece])


def distinct_pairs(pairs: Any, count: int) -> Any:
    """Return the distinct pairs of unequal numbers in ``pairs`` (t, 2), sorted, smaller first; all below ``count``."""
    low, high = np.sort(pairs, axis=1).astype(np.int64).T
    codes = np.unique(low[low < high] * count + high[low < high])
    return np.stack([codes // count, codes % count], axis=1).astype(np.int32)


def build_patches(code: Ints, corners: Any, cell: Any) -> tuple[Any, Ints, Any]:
    """Return each sample's patch (s,), the number (p,) of one sample of each patch, and pairs (t, 2) of touching ones.

    ``code`` (s,) is the code of the lattice cell, ``cell`` (s,) the mesh cell of each sample; ``corners`` (m, k) are
    the vertices of the mesh cells after cutting.
    """
    cell = np.ascontiguousarray(cell, dtype=np.int32)
    contacts = np.ascontiguousarray(corners, dtype=np.int32)
    root, vertex, holder = join_samples(code, contacts, cell, int(corners.max()) + 1)
    roots = np.flatnonzero(root == np.arange(len(root)))
    roots = roots[np.argsort(code[roots], kind="stable")]
    numbers = np.empty(len(root), dtype=np.int32)
    numbers[roots] = np.arange(len(roots))
    patch = numbers[root]
    del code, numbers, root  # at a million unknowns each of these arrays has a hundred megabytes: released early
    return patch, roots, touching_patches(patch, len(roots), vertex, holder)


def dof_map_from_patches(
    spacing: float, cells: Ints, touching: Any, patch: Any, isolated: Bools, degree: int = 2, tied: Any = NO_PAIRS
) -> DofMap:
    """Return the dof map of given patches, with the attributes of :class:`DofMap`, and the unknowns numbered.

    ``isolated`` (p,) is whether each patch is on a piece of the manifold that has a single unknown.
    """
    touching = np.ascontiguousarray(touching, dtype=np.int32)
    unknowns, nodes = number_unknowns(np.ascontiguousarray(cells), touching, isolated, degree + 1)
    return DofMap(spacing, cells, unknowns, nodes, touching, patch, degree, tied)


def connected_pieces(dof_map: DofMap, across_ties: bool = True) -> tuple[int, Ints]:
    """Return the number of connected pieces of the manifold, and the piece (n,) that each unknown belongs to.

    Ties connect pieces, unless ``across_ties`` is False.
    """
    pairs = np.concatenate([dof_map.touching, dof_map.tied]) if across_ties else dof_map.touching
    count, piece = connected_components(len(dof_map.cells), pairs)
    piece_of_unknown = np.empty(dof_map.size, dtype=np.int64)
    piece_of_unknown[dof_map.unknowns] = piece[:, None]
    return count, piece_of_unknown


def lines_through(dof_map: DofMap, entries: Ints) -> Ints:
    """Return lines (d k, degree + 1) of unknowns through k given unknowns, within their patches, along each of d axes.

    ``entries`` (k,) are places in ``dof_map.unknowns.ravel()``, each an unknown in a patch. Lines along the first axis
    come first.
    """
    flat, width = dof_map.unknowns.ravel(), dof_map.width
    lines = [(entries - entries // s % width * s)[:, None] + s * np.arange(width) for s in dof_map.strides]
    return np.asarray(flat[np.concatenate(lines)])


@compiled
def with_double_room(values: Any) -> Any:
    """Return ``values`` (k,) copied into an array (2 k,) whose second half is not set, for kernels that append."""
    more = np.empty(2 * len(values), dtype=values.dtype)
    for i in range(len(values)):
        more[i] = values[i]
    return more


def cell_codes(points: Floats, spacing: float) -> Ints:
    """Return an integer (q,) for each of the ``points`` (q, d), equal for points in the same lattice cell only.

    Cells are centred at multiples of the ``spacing``. Codes of different calls are not comparable.
    """
    code = np.zeros(len(points), dtype=np.int64)
    for axis in range(points.shape[1]):
        cell = np.floor(points[:, axis] / spacing + 0.5).astype(np.int64)
        low, high = cell.min(), cell.max()
        code = code * (high - low + 1) + cell - low
    return code


@compiled
def join_samples(code: Ints, contacts: Any, cell: Any, vertices: int) -> tuple[Any, Any, Any]:
    """Join the samples of a lattice cell whose mesh cells share a vertex: they form a patch.

    The arguments are the ``code`` (q,) of the lattice cell and the mesh ``cell`` (q,) of each sample, and the vertices
    ``contacts`` (m, k) of mesh cells, numbered below ``vertices``. The first result is the root (q,) of each sample,
    equal for samples of one patch. The others are the vertex (s,) and one sample (s,) of each pair (slot) of a vertex
    and a lattice cell with samples whose mesh cells have that vertex.
    """
    q, k = len(code), contacts.shape[1]
    parent, first = np.empty(q, dtype=np.int32), np.empty(vertices, dtype=np.int32)
    for i in range(q):
        parent[i] = i
    first[:] = -1
    after, holder = np.empty(vertices + 1, dtype=np.int32), np.empty(vertices + 1, dtype=np.int32)
    vertex = np.empty(vertices + 1, dtype=np.int32)
    used = 0  # slots; the next slot of the same vertex is ``after``, or -1
    for i in range(q):
        if i > 0 and code[i] == code[i - 1] and cell[i] == cell[i - 1]:
            parent[i] = parent[i - 1]
            continue
        for c in range(k):
            v = contacts[cell[i], c]
            slot = first[v]
            while slot >= 0 and code[holder[slot]] != code[i]:
                slot = after[slot]
            if slot >= 0:
                unite(parent, np.int64(holder[slot]), i)
                continue
            if used == len(after):
                after, holder, vertex = with_double_room(after), with_double_room(holder), with_double_room(vertex)
            after[used], holder[used], vertex[used] = first[v], i, v
            first[v] = used
            used += 1
    for i in range(q):
        parent[i] = find_root(parent, i)
    return parent, vertex[:used], holder[:used]


def touching_patches(patch: Any, patches: int, vertex: Any, holder: Any) -> Any:
    """Return the pairs (t, 2) of patches that have mesh cells with a common vertex: ascending, smaller number first.

    A patch is a connected set of samples in a lattice cell. ``vertex`` and ``holder`` (s,) are those of
    :func:`join_samples`, ``patch`` (q,) is each sample's patch, ``patches`` their number.
    """
    from scipy.sparse import csr_array, triu

    places = vertex, patch[holder]
    at_vertices = csr_array((np.ones(len(vertex), dtype=bool), places), shape=(int(vertex.max()) + 1, patches))
    pairs = triu(at_vertices.T @ at_vertices, 1, format="csr")
    pairs.sort_indices()
    return np.stack(pairs.nonzero(), axis=1).astype(np.int32)


@compiled
def number_unknowns(cells: Ints, touching: Any, single: Bools, along: int) -> tuple[Any, Ints]:
    """Return the unknowns (p, along^d) at the nodes that each patch reads, and the node (n, d) of each unknown.

    A node has an unknown for each connected component of the patches that read the node; ``touching`` (t, 2) are the
    connected pairs. ``cells`` (p, d) are the lattice cells of the patches, which read ``along`` nodes per axis. A patch
    that is ``single`` (p,) has the same unknown at all nodes, shared with the patches that it touches. Unknowns are
    numbered in the order in which patches first read them.
    """
    p, d = cells.shape
    width = along**d
    parent = np.empty(p * width, dtype=np.int64)
    for place in range(p * width):
        parent[place] = place
    depth = along if d == 3 else 1
    for t in range(len(touching)):
        a, b = touching[t, 0], touching[t, 1]
        if single[a]:
            unite(parent, a * width, b * width)
            continue
        di, dj = cells[b, 0] - cells[a, 0], cells[b, 1] - cells[a, 1]
        dk = cells[b, 2] - cells[a, 2] if d == 3 else 0
        shift = (di * along + dj) * depth + dk
        for i in range(max(0, di), min(along, along + di)):
            for j in range(max(0, dj), min(along, along + dj)):
                for k in range(max(0, dk), min(depth, depth + dk)):
                    place = (i * along + j) * depth + k
                    unite(parent, a * width + place, b * width + place - shift)
    unknowns = np.empty((p, width), dtype=np.int32)
    nodes = np.empty((p * width, d), dtype=np.int64)
    numbers = np.empty(p * width, dtype=np.int64)
    n = 0
    for a in range(p):
        for place in range(width):
            at = a * width + place
            root = find_root(parent, a * width) if single[a] else find_root(parent, at)
            if root == at:
                numbers[at] = n
                rest = width // 2 if single[a] else place
                for axis in range(d - 1, -1, -1):
                    nodes[n, axis] = cells[a, axis] + rest % along - (along - 1) // 2
                    rest //= along
                n += 1
            unknowns[a, place] = numbers[root]
    return unknowns, nodes[:n].copy()
