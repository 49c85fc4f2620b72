"""Where a band's nodes are doubled: clusters of twins, by the boxes that hold them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.forms.collocation.layout import Layout
from cpmkit.protocols import Floats, Ints

#: Twins belong together if they lie in neighbouring cells of a grid of so many spacings, about a stencil's width.
CLUSTER_CELL_SPACINGS = 4


@dataclass(frozen=True)
class TwinCluster:
    """Twins that lie together.

    Attributes
    ----------
    twins : int
        How many unknowns.
    lower, upper : tuple of float
        Corners of the box that holds their nodes, in the scene's coordinates.
    """

    twins: int
    lower: tuple[float, ...]
    upper: tuple[float, ...]

    def __str__(self) -> str:
        lower, upper = (", ".join(f"{x:.3g}" for x in corner) for corner in (self.lower, self.upper))
        return f"{self.twins:,} in ({lower}) to ({upper})"


def find_twin_clusters(layout: Layout) -> tuple[TwinCluster, ...]:
    """Return clusters of the twins that are unknowns, the largest first; none where no sheets share the band."""
    band = layout.band
    if band.first_twin == band.inner:
        return ()
    nodes = band.nodes[band.first_twin : band.inner]
    piece = _pieces(nodes // CLUSTER_CELL_SPACINGS)
    clusters = []
    for number in np.argsort(-np.bincount(piece), kind="stable"):
        members = nodes[piece == number]
        lower, upper = layout.lattice.to_scene(np.stack([members.min(axis=0), members.max(axis=0)]) * band.spacing)
        clusters.append(TwinCluster(len(members), tuple(lower.tolist()), tuple(upper.tolist())))
    return tuple(clusters)


def twin_feet(layout: Layout) -> Floats:
    """Return the feet (k, d) of the twins that are unknowns, in the scene's coordinates."""
    band = layout.band
    return layout.lattice.to_scene(band.feet.points[band.first_twin : band.inner])


def _pieces(cells: Ints) -> Ints:
    """Return for each of ``cells`` (n, d) the number of the connected piece that it belongs to; corners connect."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    used, member = np.unique(cells, axis=0, return_inverse=True)
    first, second = cKDTree(used).query_pairs(1.5, p=np.inf, output_type="ndarray").T
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(len(used), len(used)))
    return np.asarray(connected_components(graph, directed=False)[1][member.ravel()], dtype=np.int64)
