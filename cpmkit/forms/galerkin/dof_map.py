"""The dof map: the patch of each sample, and the unknowns that each patch reads.

Two samples touch if their mesh cells share a vertex of the mesh that was cut along the boundaries. A patch is a
connected component of the samples in one lattice cell. An unknown is a lattice node together with a connected component
of the patches that read the node, where two patches are connected if some of their samples touch. So each side of a
boundary, each sheet of a thin part and each end of a slit gets unknowns of its own, without normals, orientation or
distances.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.manifold.vector_algebra import norms
from cpmkit.types import Bools, Floats, Ints

#: A piece of a surface whose bounding box is shorter than this along every axis, in spacings, has one unknown; so has a
#: curve that is shorter. Splines cannot be distinguished on it.
ISOLATED_SPACINGS = 2.0


@dataclass(frozen=True, eq=False)
class DofMap:
    """Patches of the manifold, and the unknowns that each reads.

    Lattice cells are bounded by knot planes: cell r holds the points whose nearest lattice point is r. Splines of even
    degree p are centred at lattice points, those of odd degree half a spacing below along every axis. A cell reads the
    p + 1 nodes from r - p // 2 on along every axis.

    Attributes
    ----------
    spacing : float
        Spacing h of the lattice, in the unit of the scene.
    cells : (p, d) int64
        The lattice cell of each patch.
    unknowns : (p, (degree + 1)^d) int32
        The unknowns at the nodes that a patch reads, the last axis running fastest.
    nodes : (n, d) int64
        The node of each unknown.
    touching : (t, 2) int32
        Pairs of patches with samples that touch, each pair once.
    patch : (q,) int32
        The patch of each sample.
    degree : int
        Degree of the splines: 1, 2 or 3.
    """

    spacing: float
    cells: Ints
    unknowns: Any
    nodes: Ints
    touching: Any
    patch: Any
    degree: int = 2

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
        """For each axis, the distance of neighbouring nodes along it in a row of :attr:`unknowns`."""
        return tuple(self.width**axis for axis in reversed(range(self.dim)))

    @property
    def places(self) -> Floats:
        """(n, d) centres of the splines, relative to the origin of the lattice."""
        return np.asarray(self.spacing * (self.nodes - 0.5 * (self.degree % 2)))

    def magnify(self, _patch: Ints, points: Floats) -> Floats:
        """Return ``points`` (k, d), each in the patch ``patch`` (k,), on the lattice that the cells belong to.

        These are the points themselves, except for dof maps of several levels.
        """
        return points

    def magnification(self, _patch: Ints) -> Floats:
        """Return the factor (k,) or (1,) by which :meth:`magnify` enlarges lengths in each patch."""
        return np.ones(1)


def build_dof_map(points: Floats, contacts: Any, spacing: float, cell: Any = None, degree: int = 2) -> DofMap:
    """Return the patches and unknowns of splines over given samples.

    Parameters
    ----------
    points : (q, d) float64
        The samples, relative to the origin of the lattice, in the unit of ``spacing``.
    contacts : (m, k) int32 or int64
        The vertices of the cells of the mesh that was cut along the boundaries.
    spacing : float
        Spacing h of the lattice.
    cell : (q,) int32, optional
        The mesh cell of each sample; by default sample i lies in cell i.
    degree : int
        Degree of the splines: 1, 2 or 3.

    Notes
    -----
    A connected piece of the manifold smaller than `ISOLATED_SPACINGS` has one unknown, which all of its patches read.
    """
    from cpmkit.forms.galerkin.dof_map_kernels import cell_codes, join_samples, piece_extents, touching_patches

    contacts = np.ascontiguousarray(contacts)
    points = np.ascontiguousarray(points, dtype=np.float64)
    cell = np.ascontiguousarray(np.arange(len(points)) if cell is None else cell, dtype=np.int32)
    code = cell_codes(points, spacing)
    root, first, after, holder = join_samples(code, contacts, cell, int(contacts.max()) + 1)
    roots = np.flatnonzero(root == np.arange(len(root)))
    roots = roots[np.argsort(code[roots], kind="stable")]
    cells = np.floor(points[roots] / spacing + 0.5).astype(np.int64)
    del (
        code
    )  # at a million unknowns each of these arrays has a hundred megabytes: they are released as early as possible
    numbers = np.empty(len(points), dtype=np.int32)
    numbers[roots] = np.arange(len(roots))
    patch = numbers[root]
    del numbers, root
    touching = touching_patches(patch, len(roots), first, after, holder)
    count, piece = components(len(roots), touching)
    del first, after, holder
    extent = piece_extents(points, patch, piece, count)
    size = norms(extent) if contacts.shape[1] == 2 else extent.max(axis=1)
    isolated = size < ISOLATED_SPACINGS * spacing
    return dof_map_from_patches(spacing, cells, touching, patch, isolated[piece], degree)


def dof_map_from_patches(
    spacing: float, cells: Ints, touching: Any, patch: Any, isolated: Bools, degree: int = 2
) -> DofMap:
    """Return the dof map of given patches.

    Parameters
    ----------
    spacing, cells, touching, patch, degree
        The attributes of :class:`DofMap`.
    isolated : (p,) bool
        Whether each patch is on a piece of the manifold that has one unknown.
    """
    from cpmkit.forms.galerkin.dof_map_kernels import number_unknowns

    touching = np.ascontiguousarray(touching, dtype=np.int32)
    unknowns, nodes = number_unknowns(np.ascontiguousarray(cells), touching, isolated, degree + 1)
    return DofMap(spacing, cells, unknowns, nodes, touching, patch, degree)


def components(count: int, pairs: Any) -> tuple[int, Ints]:
    """Return the number of connected components of a graph, and the component (count,) of each node.

    ``pairs`` (t, 2) are the edges between the nodes 0 to ``count`` - 1.
    """
    from cpmkit.runtime.disjoint_sets import label_sets, unite_pairs

    parent = np.arange(count)
    unite_pairs(parent, np.ascontiguousarray(pairs, dtype=np.int32))
    return label_sets(parent)


def connected_pieces(dof_map: DofMap) -> tuple[int, Ints]:
    """Return the number of connected pieces of the manifold, and the piece (n,) that each unknown belongs to."""
    count, piece = components(len(dof_map.cells), dof_map.touching)
    piece_of_unknown = np.empty(dof_map.size, dtype=np.int64)
    piece_of_unknown[dof_map.unknowns] = piece[:, None]
    return count, piece_of_unknown


def lines_through(dof_map: DofMap, entries: Ints) -> Ints:
    """Return (d k, degree + 1) the unknowns on the lines along each axis, inside a patch, through k nodes of patches.

    ``entries`` (k,) are the indices of these nodes in ``dof_map.unknowns.ravel()``.
    """
    flat, width = dof_map.unknowns.ravel(), dof_map.width
    lines = [(entries - entries // s % width * s)[:, None] + s * np.arange(width) for s in dof_map.strides]
    return np.asarray(flat[np.concatenate(lines)])
