"""A triangulation of a surface that is known by closest points alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.grid.lattice import find_codes
from cpmkit.manifold.local_source import LocalSource
from cpmkit.mesh.mesh import Mesh
from cpmkit.meshing.contour_edges import components_with_areas, edge_table, remove_small_components
from cpmkit.meshing.contouring.contour_checks import COMPONENT_WEIGHT, MeshDefects, find_defects, restore_creases
from cpmkit.meshing.contouring.contour_nodes import LatticeNodes, lattice_nodes
from cpmkit.meshing.contouring.contour_repair import collapse_short_edges, fill_holes, remove_flaps, separate_sheets
from cpmkit.meshing.contouring.contour_rims import RimTest, move_to_rims, remove_bridges, remove_folds, weld_rim_corners
from cpmkit.meshing.contouring.dual_vertices import dual_triangles, dual_vertices
from cpmkit.meshing.contouring.edge_crossings import edge_crossings
from cpmkit.types import Floats, Ints

#: The lattices of contouring: spacings, in those of the form, and shifts, in their own spacings. They are tried in turn
#: until no defect is left. The shifts avoid planes of symmetry and of boxes.
LATTICES = (
    (0.5, (0.3717, 0.4203, 0.4411)),
    (0.5, (0.1513, 0.2719, 0.0637)),
    (0.5, (0.0811, 0.1733, 0.2891)),
    (0.4, (0.2873, 0.1181, 0.3301)),
    (0.25, (0.3717, 0.4203, 0.4411)),
)
#: The share of edges with three triangles or more above which the finest lattice is tried at once: the surface is thin.
MAX_NONMANIFOLD_SHARE = 0.02


@dataclass(frozen=True)
class SurfaceReport:
    """Properties of a triangulation that may cause warnings."""

    lattice_spacing: float  #: Spacing of the lattice of contouring, in spacings of the form's lattice.
    #: The share of edges with three triangles or more before repair: junctions, and parts thinner than 1.6 spacings of
    #: contouring's lattice.
    nonmanifold_share: float
    defects: MeshDefects  #: Defects that are left after repair.
    missed: Floats  #: (k, 3): points of the surface far from all triangles: components too small for the lattice.
    isolated_components: int = 0  #: Components of hardly any area that were left out.
    slight_creases: bool = False  #: Whether creases turn by less than ``creases.CREASE_DEGREES``.

    @property
    def severity(self) -> int:
        """A weighted count of the defects: zero if there is none and no part of the surface is missed."""
        return self.defects.severity + (COMPONENT_WEIGHT if len(self.missed) else 0)


def contour_surface(source: LocalSource, spacing: float) -> tuple[Mesh, SurfaceReport]:
    """Return a triangulation of a surface in space, with vertices on the surface and its rims, and a report.

    Dual contouring of unsigned distances: edges of a lattice are intersected with the surface, the crossings of each
    cell are grouped by whether they are connected on the surface in the cell, and each group becomes a vertex.
    Triangles have no common orientation. Raises ResolutionError if no triangle results.

    ``source``: a surface (m = 2) in space. Neither its normals nor its orientation are used.
    ``spacing``: spacing h of the form's lattice.
    """
    best = _contour_from_lattice(source, spacing, *LATTICES[0])
    others = list(LATTICES[1:])
    if best[1].nonmanifold_share > MAX_NONMANIFOLD_SHARE:
        finest = _contour_from_lattice(source, spacing, *others.pop())
        best = finest if finest[1].severity <= best[1].severity else best
    for lattice in others:
        if not best[1].severity:
            break
        attempt = _contour_from_lattice(source, spacing, *lattice)
        best = attempt if attempt[1].severity < best[1].severity else best
    return best


def _contour_from_lattice(
    source: LocalSource, spacing: float, relative_spacing: float, offsets: tuple[float, ...]
) -> tuple[Mesh, SurfaceReport]:
    """Return the repaired triangulation from one lattice, and its report.

    The lattice has ``relative_spacing`` times the form's ``spacing``, and is shifted by ``offsets`` (3,) spacings of
    its own.
    Raises ResolutionError if no triangle results.
    """
    fine = relative_spacing * spacing
    nodes = lattice_nodes(source, fine, np.array(offsets))
    vertices, normals, quads, slight_creases = dual_vertices(source, nodes, edge_crossings(source, nodes))
    cells = dual_triangles(source, vertices, normals, quads)
    if not len(cells):
        raise ResolutionError(
            f"Closest points make no surface at the spacing {spacing:g}: they lie apart, or are connected nowhere. "
            "Give the surface by a mesh, by points with a fitted surface or by a formula, or use form='collocation'."
        )
    edges = edge_table(cells)
    nonmanifold_share = float((edges.count > 2).mean()) if len(edges.count) else 0.0
    rims = RimTest(source, fine, bool(nodes.on_rim.any()))
    vertices, cells = collapse_short_edges(source, vertices, cells, fine)
    cells = remove_flaps(rims, vertices, cells)
    vertices, cells = separate_sheets(source, vertices, cells)
    cells, open_components = remove_small_components(vertices, cells, cells, spacing)
    cells = fill_holes(rims, vertices, cells)
    cells, closed_components = remove_small_components(vertices, cells, cells, spacing)
    components_before = len(components_with_areas(vertices, cells, cells)[1])
    vertices, on_rim = move_to_rims(rims, vertices, cells)
    cells = remove_bridges(rims, vertices, cells, on_rim)
    cells, folds = remove_folds(vertices, cells, on_rim, fine)
    cells = remove_small_components(vertices, cells, edge_table(cells).of_cells, spacing)[0]
    cells = weld_rim_corners(vertices, cells, fine)
    vertices, cells, on_rim = restore_creases(nodes, vertices, cells, on_rim)
    defects = find_defects(rims, nodes, vertices, cells, on_rim, folds, components_before, spacing)
    missed = _missed_points(nodes, vertices[np.unique(cells)])
    removed = open_components + closed_components
    report = SurfaceReport(relative_spacing, nonmanifold_share, defects, missed, removed, slight_creases)
    return Mesh.of(vertices, cells), report


def _missed_points(nodes: LatticeNodes, vertices: Floats) -> Floats:
    """Return the closest points (k, 3) of nodes without one of ``vertices`` (v, 3) in the 27 cells around them."""
    low = nodes.position_of(nodes.codes.lower)

    def cells_of(points: Floats) -> Ints:
        """Return the codes (n,) of the cells that contain ``points`` (n, 3)."""
        return nodes.codes.encode(np.floor((points - low) / nodes.spacing).astype(np.int64) + nodes.codes.lower)

    met = np.unique(cells_of(vertices))
    for axis in range(3):
        met = nodes.codes.dilate(met, axis, range(-1, 2))
    closest_points = nodes.closest[nodes.distance <= nodes.spacing]
    return np.asarray(closest_points[find_codes(met, cells_of(closest_points)) < 0])
