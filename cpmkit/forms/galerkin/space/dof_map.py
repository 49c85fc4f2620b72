"""Samples parted into patches, and nodes into unknowns: one rule for sheets, sides, rims and tips.

Samples touch if their cells share a vertex of the mesh that was cut along the boundaries. A patch is a component of the
samples of one lattice cell; an unknown is a node together with a component of the patches that read it, two patches
being joined there if samples of theirs touch. No normal is asked, no orientation, no distance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.manifold.vector_algebra import norms
from cpmkit.types import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class DofMap:
    """The space of splines: a patch is what of the manifold hangs together inside one lattice cell.

    Lattice cells are bounded by knot planes: cell r holds the points that r is the nearest lattice point of. Splines of
    even degree p are centred at lattice points, of odd degree half a spacing below them along every axis: in any case a
    cell reads the p + 1 nodes an axis from r - p // 2 on.

    Attributes
    ----------
    spacing : float
        h, of the lattice, in the scene's unit.
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
        Of the splines: 1, 2 or 3.
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
        """Number of splines along an axis that a cell reads: one more than the degree."""
        return self.degree + 1

    @property
    def strides(self) -> tuple[int, ...]:
        """How far apart neighbours along each axis stand among the unknowns of a patch."""
        return tuple(self.width**axis for axis in reversed(range(self.dim)))

    @property
    def places(self) -> Floats:
        """(n, d) where the spline of each unknown is centred, relative to the lattice's origin."""
        return np.asarray(self.spacing * (self.nodes - 0.5 * (self.degree % 2)))


#: A piece of a surface whose bounds have no longer side than this, in spacings, has one unknown, and a shorter curve.
ISOLATED_SPACINGS = 2.0


def build_dof_map(points: Floats, contacts: Any, spacing: float, cell: Any = None, degree: int = 2) -> DofMap:
    """Return the parting of samples at ``points`` (q, d), relative to the lattice's origin.

    Parameters
    ----------
    points : (q, d) float64
        The samples, in the unit of ``spacing``.
    contacts : (m, k) int32 or int64
        The vertices of cells of the mesh that was cut along the boundaries, numbered from 0.
    spacing : float
        h, of the lattice.
    cell : (q,) int32, optional
        The cell of each sample; unless given, there is one for each, in their order.
    degree : int
        Of the splines: 1, 2 or 3.

    Notes
    -----
    A piece of a surface shorter than `SPECK_SPACINGS` along every axis carries constants alone: all that its patches
    read is one unknown. So does a piece of a curve that is no longer than this, however it is turned.
    """
    from cpmkit.forms.galerkin.space.dof_map_kernels import bounds, codes_of, join_samples, touching_pairs

    contacts = np.ascontiguousarray(contacts)
    points = np.ascontiguousarray(points, dtype=np.float64)
    cell = np.ascontiguousarray(np.arange(len(points)) if cell is None else cell, dtype=np.int32)
    code = codes_of(points, spacing)
    root, first, after, holder = join_samples(code, contacts, cell, int(contacts.max()) + 1)
    roots = np.flatnonzero(root == np.arange(len(root)))
    roots = roots[np.argsort(code[roots], kind="stable")]
    cells = np.floor(points[roots] / spacing + 0.5).astype(np.int64)
    del code  # what is needed no more: at a million unknowns each such array has a hundred megabytes
    numbers = np.empty(len(points), dtype=np.int32)
    numbers[roots] = np.arange(len(roots))
    patch = numbers[root]
    del numbers, root
    touching = touching_pairs(patch, len(roots), first, after, holder)
    pieces, label = components(len(roots), touching)
    del first, after, holder
    extent = bounds(points, patch, label, pieces)
    size = norms(extent) if contacts.shape[1] == 2 else extent.max(axis=1)
    specks = size < ISOLATED_SPACINGS * spacing
    return dof_map_from_patches(spacing, cells, touching, patch, specks[label], degree)


def dof_map_from_patches(
    spacing: float, cells: Ints, touching: Any, patch: Any, single: Bools, degree: int = 2
) -> DofMap:
    """Return the parting into these patches: ``cells`` (p, d), pairs ``touching`` (t, 2), ``patch`` (q,) of samples.

    ``single`` (p,): patches of pieces that have one unknown each.
    """
    from cpmkit.forms.galerkin.space.dof_map_kernels import number

    touching = np.ascontiguousarray(touching, dtype=np.int32)
    unknowns, nodes = number(np.ascontiguousarray(cells), touching, single, degree + 1)
    return DofMap(spacing, cells, unknowns, nodes, touching, patch, degree)


def components(patches: int, touching: Any) -> tuple[int, Ints]:
    """Return how many pieces the patches make that touch, and the piece of each patch."""
    from cpmkit.runtime.disjoint_sets import label_sets, unite_pairs

    parent = np.arange(patches)
    unite_pairs(parent, np.ascontiguousarray(touching, dtype=np.int32))
    return label_sets(parent)


def connected_pieces(dof_map: DofMap) -> tuple[int, Ints]:
    """Return how many pieces of the manifold share no unknown, and the piece of each unknown (n,)."""
    count, label = components(len(dof_map.cells), dof_map.touching)
    of_unknown = np.empty(dof_map.size, dtype=np.int64)
    of_unknown[dof_map.unknowns] = label[:, None]
    return count, of_unknown
