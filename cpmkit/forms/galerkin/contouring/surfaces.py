"""A surface that is known by its closest points alone, as triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.forms.galerkin.contouring.crossings import crossings
from cpmkit.forms.galerkin.contouring.dual_vertices import DualVertices, dual_vertices
from cpmkit.forms.galerkin.contouring.edges import border_of, edges_of, split_fans
from cpmkit.forms.galerkin.contouring.midpoints import midpoints
from cpmkit.forms.galerkin.contouring.nodes import Nodes, surrounding_nodes
from cpmkit.forms.galerkin.contouring.quads import triangles
from cpmkit.forms.galerkin.contouring.rims import onto_rims, rim_edges, without_holes
from cpmkit.forms.galerkin.contouring.specks import without_specks
from cpmkit.forms.galerkin.sample_mesh import SampleMesh
from cpmkit.grid.lattice import find
from cpmkit.manifold.local_source import LocalSource
from cpmkit.protocols import Floats, Ints

#: Contouring's lattice has half the spacing, or a quarter where more than this share of edges is nonmanifold.
SIDES, MOST_NONMANIFOLD = (0.5, 0.25), 0.02


@dataclass(frozen=True)
class SurfaceReport:
    """What a reader should know of a triangulation.

    Attributes
    ----------
    side : float
        Spacing of contouring's lattice, in spacings of the form's.
    nonmanifold_share : float
        The share of edges with three triangles or more: junctions, and parts thinner than 1.6 sides.
    holes_filled : int
        Small holes that were closed.
    open_edges : int
        Border edges that lie on no rim: cracks that were not closed.
    unmet : (k, 3) float64
        Points of the surface with no triangle near by: pieces too small for the lattice.
    specks : int
        Pieces of hardly any area that were left out.
    """

    side: float
    nonmanifold_share: float
    holes_filled: int
    open_edges: int
    unmet: Floats
    specks: int = 0


def triangulated(source: LocalSource, spacing: float, curved: bool = True) -> tuple[SampleMesh, SurfaceReport]:
    """Return triangles on a surface in space, with vertices on it and those of its rims on the rims.

    Parameters
    ----------
    source : LocalSource
        A surface (m = 2) in space. No normals and no sense of its sides are asked of it.
    spacing : float
        h, of the form's lattice.
    curved : bool
        Whether midpoints of edges are given too, on the surface.

    Raises
    ------
    ResolutionError
        If closest points make no surface.
    """
    for side in SIDES:
        nodes, found, cells = _contoured(source, side * spacing)
        share = edges_of(cells).nonmanifold_share
        if share <= MOST_NONMANIFOLD:
            break
    if not len(cells):
        raise ResolutionError(
            f"Closest points make no surface at the spacing {spacing:g}: they lie apart, or hang together nowhere. "
            "Give the surface by a mesh, by points with a fitted surface or by a formula, or use form='collocation'."
        )
    cells, copied = split_fans(cells, edges_of(cells))
    vertices, cells, filled = without_holes(source, found.points[copied], cells)
    cells, specks = without_specks(vertices, cells, spacing)
    vertices, on_rim = onto_rims(source, vertices, cells, side * spacing)
    middles = midpoints(source, vertices, cells, on_rim) if curved else None
    border = border_of(vertices, cells, edges_of(cells))
    cracks = len(border.edge) - len(rim_edges(border, on_rim))
    report = SurfaceReport(side, share, filled, cracks, _unmet(nodes, found.cell), specks)
    return SampleMesh.of(vertices, cells, middles), report


def _contoured(source: LocalSource, side: float) -> tuple[Nodes, DualVertices, Ints]:
    nodes = surrounding_nodes(source, side)
    found = dual_vertices(source, nodes, crossings(source, nodes))
    return nodes, found, triangles(source, found)


def _unmet(nodes: Nodes, cells: Ints) -> Floats:
    """Return the feet in cells with no vertex in any of the 27 cells round them."""
    met = np.unique(cells)
    for axis in range(3):
        met = nodes.codes.dilate(met, axis, range(-1, 2))
    near = nodes.feet[nodes.distance <= nodes.spacing]
    low = nodes.place(nodes.codes.lower)
    inside = np.floor((near - low) / nodes.spacing).astype(np.int64) + nodes.codes.lower
    return np.asarray(near[find(met, nodes.codes.encode(inside)) < 0])
