"""What a triangulation of a surface must keep, and how much of that is broken."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.meshing.contouring.contour_edges import areas_of_pieces, border_of, edges_of
from cpmkit.meshing.contouring.coverage import CreaseFeet, uncovered
from cpmkit.meshing.contouring.leaves import crowded_edges
from cpmkit.meshing.contouring.nodes import Nodes
from cpmkit.meshing.contouring.rim_test import RimTest
from cpmkit.meshing.contouring.rims import rim_edges
from cpmkit.protocols import Bools, Floats, Ints

#: An area that differs from the sum over nodes by more than this share is a fault.
AREA_SHARE = 0.15
#: Pieces with less area than so many squares of the form's spacing are taken for faults where another lattice has none.
SMALL_AREA = 2.0
#: What faults weigh, a fold at a rim or an uncovered foot one: open edges, edges of four and small pieces; a piece too
#: many, a wrong area.
EDGE_WEIGHT, PIECE_WEIGHT = 4, 40


@dataclass(frozen=True, eq=False)
class MeshDefects:
    """Places at which laws of a triangulation are broken.

    Attributes
    ----------
    cracks, nonmanifold_edges, branch_ends, folds : (k, 3) float64
        Middles of open edges off rims and of edges of four or more that are no crossing; ends of branch lines that
        lie neither at another branch line nor at the border; centres of triangles that fold over beside a rim.
    uncovered : (k, 3) float64
        Points of creases, rims and close sheets with no triangle within .3 spacings of the lattice.
    component_change : int
        How many pieces were gained or lost by moving vertices onto rims.
    small_components : int
        Pieces with an area below two squares of the form's spacing.
    area_error : float
        By how much the area exceeds the sum over nodes, as a share.
    """

    cracks: Floats
    nonmanifold_edges: Floats
    branch_ends: Floats
    folds: Floats
    uncovered: Floats
    component_change: int
    small_components: int
    area_error: float

    @property
    def wrong_area(self) -> bool:
        """Whether the area is not what the nodes say."""
        return abs(self.area_error) > AREA_SHARE

    @property
    def severity(self) -> int:
        """How much is broken: zero where all laws hold."""
        places = len(self.cracks) + len(self.nonmanifold_edges) + len(self.branch_ends) + self.small_components
        return (
            len(self.folds)
            + len(self.uncovered)
            + EDGE_WEIGHT * places
            + PIECE_WEIGHT * (abs(self.component_change) + self.wrong_area)
        )


def faults_of(
    rims: RimTest,
    nodes: Nodes,
    vertices: Floats,
    cells: Ints,
    on_rim: Bools,
    folds: Floats,
    pieces_before: int,
    spacing: float,
) -> MeshDefects:
    """Return where the triangulation breaks a law; ``spacing`` is the form's."""
    edges = edges_of(cells)
    border = border_of(vertices, cells, edges)
    off = np.setdiff1d(np.arange(len(border.edge)), rim_edges(border, on_rim))
    off = off[~rims.of_border(vertices, border.take(off))]
    crowded = crowded_edges(rims.source, vertices, cells, edges)
    degree = np.bincount(edges.ends[edges.count > 2].ravel(), minlength=len(vertices))
    single = (edges.count > 2) & (degree[edges.ends] == 1).all(axis=1)
    degree[edges.ends[edges.count == 1]] = 0  # at the border
    degree[edges.ends[single]] = 1  # but a line of one edge is none
    areas = areas_of_pieces(vertices, cells)
    return MeshDefects(
        border.middles[off],
        vertices[edges.ends[crowded]].mean(axis=1),
        vertices[degree == 1],
        folds,
        uncovered(CreaseFeet.of(nodes).points, vertices, cells, nodes.spacing),
        len(areas) - pieces_before,
        int((areas < SMALL_AREA * spacing**2).sum()),
        float(areas.sum() / area_by_nodes(nodes) - 1),
    )


def area_by_nodes(nodes: Nodes) -> float:
    """Return the area by the coarea formula: a raised cosine of the distance, summed over the nodes.

    Its width is the spacing, within which all nodes are known; feet on rims are left out (Kublik, Tsai 2016).
    """
    s = nodes.spacing
    near = nodes.distance[(nodes.distance < s) & ~nodes.rim]
    return float((1 + np.cos(np.pi * near / s)).sum() * 0.5 * s**2)
