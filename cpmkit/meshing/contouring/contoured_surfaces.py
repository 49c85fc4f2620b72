"""A surface that is known by its closest points alone, as triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.grid.lattice import find
from cpmkit.manifold.local_source import LocalSource
from cpmkit.mesh.mesh import SampleMesh
from cpmkit.meshing.contouring.contour_checks import PIECE_WEIGHT, MeshDefects, faults_of
from cpmkit.meshing.contouring.contour_edges import (
    areas_of_pieces,
    edges_of,
    remove_isolated_components,
    without_hanging_specks,
)
from cpmkit.meshing.contouring.coverage import CreaseFeet, pulled_out
from cpmkit.meshing.contouring.crossings import crossings
from cpmkit.meshing.contouring.dual_vertices import dual_vertices
from cpmkit.meshing.contouring.holes import without_holes
from cpmkit.meshing.contouring.joining import JoinTolerances
from cpmkit.meshing.contouring.leaves import parted_leaves
from cpmkit.meshing.contouring.midpoints import midpoints
from cpmkit.meshing.contouring.nodes import Nodes, surrounding_nodes
from cpmkit.meshing.contouring.quads import triangles
from cpmkit.meshing.contouring.repair import without_flaps, without_short_edges
from cpmkit.meshing.contouring.rim_test import RimTest
from cpmkit.meshing.contouring.rims import joined_at_corners, onto_rims, without_bridges, without_folds
from cpmkit.protocols import Bools, Floats, Ints

#: Spacings of contouring's lattices, in spacings of the form's, and where their nodes lie in the cells: one is tried
#: after another until all laws hold. Planes of symmetry and of boxes miss such places.
LATTICES = (
    (0.5, (0.3717, 0.4203, 0.4411)),
    (0.5, (0.1513, 0.2719, 0.0637)),
    (0.5, (0.0811, 0.1733, 0.2891)),
    (0.4, (0.2873, 0.1181, 0.3301)),
    (0.25, (0.3717, 0.4203, 0.4411)),
)
#: Where more than this share of edges has three triangles or more the last lattice is tried first.
MAX_NONMANIFOLD_SHARE = 0.02


@dataclass(frozen=True)
class SurfaceReport:
    """What a reader should know of a triangulation.

    Attributes
    ----------
    lattice_spacing : float
        Spacing of contouring's lattice, in spacings of the form's.
    nonmanifold_share : float
        The share of edges with three triangles or more before repair: junctions, and parts thinner than 1.6 sides.
    holes_filled : int
        Holes that were closed.
    defects : MeshDefects
        Where laws of triangulations are broken.
    missed : (k, 3) float64
        Points of the surface with no triangle near by: pieces too small for the lattice.
    isolated_components : int
        Pieces of hardly any area that were left out.
    """

    lattice_spacing: float
    nonmanifold_share: float
    holes_filled: int
    defects: MeshDefects
    missed: Floats
    isolated_components: int = 0

    @property
    def severity(self) -> int:
        """How much is broken: zero where all laws hold and all of the surface is met."""
        return self.defects.severity + (PIECE_WEIGHT if len(self.missed) else 0)

    @property
    def open_edges(self) -> int:
        """Border edges that lie on no rim: cracks that were not closed."""
        return len(self.defects.cracks)


def contour_surface(source: LocalSource, spacing: float, curved: bool = True) -> tuple[SampleMesh, SurfaceReport]:
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
    best = _attempt(source, spacing, *LATTICES[0])
    others = list(LATTICES[1:])
    if best.report.nonmanifold_share > MAX_NONMANIFOLD_SHARE:
        finest = _attempt(source, spacing, *LATTICES[-1])
        best = finest if finest.report.severity <= best.report.severity else best
        del others[-1]
    for lattice in others:
        if not best.report.severity:
            break
        attempt = _attempt(source, spacing, *lattice)
        best = attempt if attempt.report.severity < best.report.severity else best
    middles = midpoints(best.rims, best.vertices, best.cells, best.on_rim) if curved else None
    return SampleMesh.of(best.vertices, best.cells, middles), best.report


@dataclass(frozen=True, eq=False)
class _Attempt:
    """A triangulation by one lattice, and what is broken in it."""

    rims: RimTest
    vertices: Floats
    cells: Ints
    on_rim: Bools
    report: SurfaceReport


def _attempt(source: LocalSource, spacing: float, side: float, offsets: tuple[float, ...]) -> _Attempt:
    nodes = surrounding_nodes(source, side * spacing, np.array(offsets))
    tolerances = JoinTolerances.of_lattice(side * spacing, source.noise)
    found = dual_vertices(source, nodes, crossings(source, nodes), tolerances)
    cells = triangles(source, found)
    if not len(cells):
        raise ResolutionError(
            f"Closest points make no surface at the spacing {spacing:g}: they lie apart, or hang together nowhere. "
            "Give the surface by a mesh, by points with a fitted surface or by a formula, or use form='collocation'."
        )
    share = edges_of(cells).nonmanifold_share
    rims = RimTest(source, side * spacing, bool(nodes.rim.any()))
    vertices, cells = without_short_edges(source, found.points, cells, side * spacing)
    cells = without_flaps(rims, vertices, cells)
    vertices, cells = parted_leaves(source, vertices, cells)
    cells, open_specks = remove_isolated_components(vertices, cells, spacing)
    cells, filled = without_holes(rims, vertices, cells)
    cells, specks = remove_isolated_components(vertices, cells, spacing)
    pieces = len(areas_of_pieces(vertices, cells))
    vertices, on_rim = onto_rims(rims, vertices, cells)
    cells = without_bridges(rims, vertices, cells, on_rim)
    cells, folds = without_folds(vertices, cells, on_rim, side * spacing)
    cells = without_hanging_specks(vertices, cells, spacing)
    cells = joined_at_corners(vertices, cells, side * spacing)
    vertices, cells, on_rim = pulled_out(CreaseFeet.of(nodes), vertices, cells, on_rim, side * spacing)
    faults = faults_of(rims, nodes, vertices, cells, on_rim, folds, pieces, spacing)
    report = SurfaceReport(side, share, filled, faults, _unmet(nodes, vertices[np.unique(cells)]), open_specks + specks)
    return _Attempt(rims, vertices, cells, on_rim, report)


def _unmet(nodes: Nodes, vertices: Floats) -> Floats:
    """Return the feet in cells with none of the ``vertices`` of triangles in any of the 27 cells round them."""
    low = nodes.place(nodes.codes.lower)

    def cells(points: Floats) -> Ints:
        return nodes.codes.encode(np.floor((points - low) / nodes.spacing).astype(np.int64) + nodes.codes.lower)

    met = np.unique(cells(vertices))
    for axis in range(3):
        met = nodes.codes.dilate(met, axis, range(-1, 2))
    near = nodes.feet[nodes.distance <= nodes.spacing]
    return np.asarray(near[find(met, cells(near)) < 0])
