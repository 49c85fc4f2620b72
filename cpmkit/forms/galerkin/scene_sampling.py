"""Sampling of a scene: the manifold as a mesh with boundaries inserted, subdivided, curved, cut and sampled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.forms.galerkin.charts import chart_facets
from cpmkit.forms.galerkin.conditions.boundary_samples import BoundarySamples, boundary_samples
from cpmkit.forms.galerkin.conditions.boundary_sides import left_of_boundaries
from cpmkit.forms.galerkin.conditions.imposed_conditions import (
    ImposedCondition,
    Tie,
    conditions_with_law,
    imposed_conditions,
    needs_rims,
    part_function,
    point_warnings,
)
from cpmkit.forms.galerkin.enrichment.singular_functions import SingularFunction, singular_functions
from cpmkit.forms.galerkin.mesh_of_manifold import mesh_of_manifold
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.galerkin.refinement.regions import Regions, grade_mesh, grade_towards_tips, graded_samples
from cpmkit.forms.galerkin.rim_corners import neck_warnings
from cpmkit.forms.galerkin.space.quantised_samples import QuantisedSamples
from cpmkit.forms.options import Options
from cpmkit.grid.lattice import Lattice, lattice_of
from cpmkit.manifold.local_source import LocalSource, localize
from cpmkit.manifold.vector_algebra import dots
from cpmkit.mesh.adjacency import HalfFacets, cut_corners, half_facets, has_cut_corners, rim_of_edges, seam_midpoints
from cpmkit.mesh.cell_quadrature import Samples, longest_edge, needs_degree_four, quadrature, triangles_to_clip
from cpmkit.mesh.mesh import CellGeometry, Mesh
from cpmkit.mesh.part_borders import split_at_parts
from cpmkit.mesh.subdivision import subdivide
from cpmkit.meshing.creases import CREASE_OWNER, FOLD_OWNER, SLIVER_SPACINGS, VOID_OWNER, crease_facets, with_ties
from cpmkit.meshing.curved_from_normals import curve_cells
from cpmkit.meshing.insertion.boundary_insertion import Insertion, insert_boundaries
from cpmkit.meshing.mesh_warnings import insertion_warnings, seam_warnings
from cpmkit.meshing.sharp_creases import creased_edges
from cpmkit.scene.boundary import Boundary
from cpmkit.scene.conditions import same_condition
from cpmkit.scene.laws import Value
from cpmkit.scene.oriented import OrientedBoundary
from cpmkit.scene.scene import Scene
from cpmkit.types import SIDES, Bools, Floats, Ints

#: A boundary farther from the manifold than so many spacings is refused.
AWAY_SPACINGS = 3.0
#: Parts of an edge whose conormals have a larger cosine, below 60 degrees, are taken for one smooth part.
MIXED_COSINE = 0.5


@dataclass(frozen=True, eq=False)
class InsertedScene:
    """The manifold of a scene as a mesh with the boundaries inserted, which can be sampled at any fineness."""

    lattice: Lattice  #: The lattice; all coordinates are relative to its origin.
    surface: LocalSource  #: The manifold.
    sources: Sequence[LocalSource]  #: The boundaries.
    oriented: Sequence[OrientedBoundary]  #: The boundaries with the rule that names their left.
    mesh: Mesh  #: A mesh of flat cells, not yet subdivided.
    #: mapping of int to (k,) int64: the vertices at boundaries that are points, by boundary number.
    points: Mapping[int, Ints]
    #: "flat", "closest_point" or "normals": how the cells follow the manifold between their vertices.
    geometry: CellGeometry
    warnings: tuple[str, ...]  #: Warnings of the mesh and of the insertion of boundaries.


@dataclass(frozen=True, eq=False)
class SampledScene(InsertedScene):
    """A scene with samples; its mesh is subdivided, curved and cut. Cells are stored in 32 bits, without midpoints."""

    corners: Any  #: (m, k) int32: the vertices of the cells after cutting.
    half: HalfFacets  #: The pairs of a cell and a facet of it on a boundary or rim, two for a facet of two cells.
    #: Samples or QuantisedSamples: samples on the manifold, then on boundaries; quantised once there is a dof map.
    samples: Samples | QuantisedSamples
    boundary: BoundarySamples  #: The samples on boundaries.
    left: Bools  #: (b,): whether each sample on a boundary is on its left.
    conditions: tuple[ImposedCondition, ...]  #: The conditions of the scene, with the samples at which each is imposed.
    winding: Any  #: (m,) int8: the orientation of the cells, see :attr:`cpmkit.mesh.mesh.Connectivity.winding`.
    #: The singular functions at the ends of boundaries, if the options ask for them.
    singular: tuple[SingularFunction, ...]

    @property
    def interior(self) -> int:
        """Number of samples on the manifold and on no boundary, which come first."""
        return len(self.samples) - len(self.boundary)

    @property
    def tied(self) -> Ints:
        """(t, 2) the numbers of two samples at one point of a tie (see :class:`Tie`), on its first and another side."""
        lips = [condition.sides for condition in conditions_with_law(self.conditions, Tie)]
        pairs = [np.stack([first, other], axis=1) for first, *others in lips for other in others]
        return self.interior + np.concatenate([np.zeros((0, 2), dtype=np.int64), *pairs])

    @property
    def ties(self) -> Floats:
        """(t, k - 1, d): the corners of the facets of ties, each facet once."""
        half = self.boundary.half[self.boundary.on_tie & (self.boundary.place == 0)]
        half = half[np.unique(self.half.cut[half], return_index=True)[1]]
        k = self.mesh.cells.shape[1]
        places = (self.half.facet[half, None] + np.arange(1, k)) % k
        return np.asarray(self.mesh.vertices[self.mesh.cells[self.half.cell[half, None], places]])

    @property
    def slow_part_of_solid(self) -> str:
        """In words, the part of a solid at which errors fall slowly; empty without one, and for other manifolds."""
        return ""

    @cached_property
    def mixed_edge(self) -> Floats:
        """(k, d): samples with Dirichlet conditions within a spacing of a Neumann or Robin condition on a smooth edge.

        There u behaves like the root of the distance. Where the two parts of the edge meet at a right angle, u need not
        be singular.
        """
        from scipy.spatial import cKDTree

        kinds = np.ones(len(self.boundary), dtype=np.int64)
        for condition in self.conditions:
            kinds[condition.all_rows] = 2 if condition.law.couples else 0 if isinstance(condition.law, Value) else 1
        values, others = (np.flatnonzero(kinds == kind) for kind in range(2))
        if self.surface.largest_dim == 1 or not (len(values) and len(others)):
            return np.zeros((0, self.mesh.dim))
        points, conormals = self.boundary.points, self.boundary.conormals
        tree, reach = cKDTree(points[others]), self.lattice.spacing
        distance, nearest = tree.query(points[values], distance_upper_bound=reach)
        values, others = values[distance < reach], others[nearest[distance < reach]]
        return np.asarray(points[values[dots(conormals[values], conormals[others]) > MIXED_COSINE]])

    @property
    def has_tips(self) -> bool:
        """Whether a boundary ends inside the manifold."""
        return bool(self.boundary.beyond_tip.any())

    @property
    def has_charts(self) -> bool:
        """Whether the mesh is cut between charts."""
        return bool((self.boundary.owner <= FOLD_OWNER).any())

    @property
    def has_voids(self) -> bool:
        """Whether the mesh is cut between charts at slots, necks or holes, at whose corners u is singular."""
        return bool((self.boundary.owner == VOID_OWNER).any())

    @property
    def queries(self) -> int:
        """Number of closest points computed, of the manifold and its boundaries."""
        sources = {id(source.queries): source.queries["points"] for source in (self.surface, *self.sources)}
        return sum(sources.values())


def insert_scene(scene: Scene, options: Options[GalerkinOptions]) -> InsertedScene:
    """Return a mesh of a scene's manifold with the boundaries inserted, not yet subdivided.

    Raises InputError, SceneError or ResolutionError if the lattice's origin, a boundary or the spacing does not fit.
    """
    spacing = options.spacing
    lattice = lattice_of(scene.surface, spacing, options.origin)
    surface = localize(scene.surface, lattice.origin)
    oriented = [scene.oriented(boundary) for boundary in scene.boundaries]
    sources = [localize(boundary.source, lattice.origin) for boundary in scene.boundaries]
    longest = longest_edge(options.own.sampling, "closest_point", surface.manifold_dim or 0)
    surface, mesh, geometry, warnings = mesh_of_manifold(surface, spacing, longest)
    points: Mapping[int, Ints] = {}
    if sources:
        insertion = insert_boundaries(mesh, sources, spacing, movable=geometry == "closest_point")
        mesh, points = insertion.mesh, insertion.point_vertices
        check_insertion(insertion, scene.boundaries, spacing)
        warnings += tuple(insertion_warnings(insertion, [boundary.name for boundary in scene.boundaries], spacing))
    return InsertedScene(lattice, surface, sources, oriented, mesh, points, geometry, warnings)


def sample_scene(
    scene: Scene, options: Options[GalerkinOptions], inserted: InsertedScene, regions: Regions | None = None
) -> SampledScene:
    """Return the scene with its final mesh, the quadrature samples, and the conditions imposed at samples.

    ``inserted`` is the scene's coarse mesh. Cells in ``regions``, if given, are smaller; the quadrature is then that of
    :func:`graded_samples`. Raises InputError or SceneError as :func:`imposed_conditions` does.
    """
    spacing, sampling, geometry = options.spacing, options.own.sampling, inserted.geometry
    lattice, surface, oriented, warnings = inserted.lattice, inserted.surface, inserted.oriented, inserted.warnings
    has_singular_functions = options.own.tips == "singular" and inserted.mesh.manifold_dim == 2
    mesh = _fine_mesh(scene, options, inserted, regions, has_singular_functions)
    is_uncut = geometry != "closest_point" and not len(mesh.cut)  # repaired cells have distinct vertices
    corners_at_boundaries = mesh.cells if is_uncut else cut_corners(mesh)
    creased = creased_edges(mesh, surface, SLIVER_SPACINGS * spacing) if surface.slight_creases else None
    cut, corners = _with_ties(mesh, corners_at_boundaries, spacing, options.own.degree, creased)
    half, winding = half_facets(cut), mesh.winding
    warnings += tuple(neck_warnings(mesh, lattice, regions))
    warnings += tuple(seam_warnings(seam_midpoints(mesh, half), surface, geometry))
    terms = scene.problem.terms()
    flows_out = terms.conservative and terms.velocity is not None  # the flow through rims is integrated over samples
    boundary = boundary_samples(cut, half, corners, needs_rims(scene) or flows_out, inserted.points)
    left = left_of_boundaries(cut, half, corners_at_boundaries, boundary, oriented, lattice)
    conditions = imposed_conditions(scene, boundary, left, surface, lattice)
    singular: tuple[SingularFunction, ...] = ()
    if has_singular_functions:
        singular, tip_warnings = singular_functions(mesh, boundary, conditions, lattice)
        warnings += tip_warnings
    further = boundary.as_samples if len(boundary) else None
    if regions is None:
        clipped = triangles_to_clip(mesh, sampling, geometry, spacing)
        samples = quadrature(mesh, spacing, further, clipped, needs_degree_four(options.own.degree, geometry))
    else:
        samples = graded_samples(mesh, regions, sampling, geometry, further)
    if len(boundary):
        on_manifold = samples.weights > 0
        interior = lattice.to_scene(samples.points[on_manifold]), samples.weights[on_manifold]
        warnings += point_warnings(scene, boundary, spacing, interior)
    cells: Any = mesh.cells.astype(np.int32)
    stored = replace(inserted, mesh=replace(mesh, cells=cells, midpoints=None), warnings=warnings)
    return SampledScene(
        **vars(stored),
        corners=corners.astype(np.int32) if has_cut_corners(mesh, corners) else cells,
        half=half,
        samples=samples,
        boundary=boundary,
        left=left,
        conditions=conditions,
        winding=winding,
        singular=singular,
    )


def _fine_mesh(
    scene: Scene, options: Options[GalerkinOptions], inserted: InsertedScene, regions: Regions | None, at_tips: bool
) -> Mesh:
    """Return the mesh of ``inserted`` subdivided, split where conditions on the edge change, and with curved cells.

    Cells are smaller in ``regions``, if given, and if ``at_tips`` also at the tips of boundaries.
    """
    spacing, geometry = options.spacing, inserted.geometry
    longest = longest_edge(options.own.sampling, geometry, inserted.mesh.manifold_dim)
    mesh = subdivide(inserted.mesh, longest * spacing)
    mesh = mesh if regions is None else grade_mesh(mesh, regions, longest)
    mesh = grade_towards_tips(mesh, spacing) if at_tips else mesh
    if (part_at := part_function(scene, inserted.lattice)) is not None:
        mesh = split_at_parts(mesh, rim_of_edges(mesh).rows, part_at, geometry, inserted.surface)
    return curve_cells(mesh, geometry, inserted.surface, inserted.sources, spacing)


def _with_ties(mesh: Mesh, corners: Ints, spacing: float, degree: int, creased: Bools | None) -> tuple[Mesh, Ints]:
    """Return the mesh cut also at creases, at junctions and between charts, and the corners (m, k) of its cells.

    A corner is the number of a vertex after cutting; ``corners`` (m, k) are those of the mesh cut along boundaries
    alone. For ``creased`` (f,) see :func:`crease_facets`.
    """
    creases = crease_facets(mesh, spacing, creased)
    if len(creases):
        mesh = with_ties(mesh, creases, CREASE_OWNER)
        corners = cut_corners(mesh)
    charts, has_voids = chart_facets(mesh, corners, spacing, degree)
    if len(charts):
        mesh = with_ties(mesh, charts, VOID_OWNER if has_voids else FOLD_OWNER)
        corners = cut_corners(mesh)
    return mesh, corners


def check_insertion(insertion: Insertion, boundaries: Sequence[Boundary], spacing: float) -> None:
    """Raise SceneError if a boundary is missing in the mesh, far off it, or on a boundary with other conditions."""
    for number, gap in insertion.max_distances.items():
        if gap > AWAY_SPACINGS * spacing:
            raise SceneError(
                f"boundary {boundaries[number].name!r} is up to {gap:.3g} away from the surface, more than "
                f"{AWAY_SPACINGS:g} spacings, {AWAY_SPACINGS * spacing:.3g}; move it onto the surface, or check its "
                "unit of length."
            )
    for number, other in sorted(insertion.coincident):
        first, second = boundaries[other], boundaries[number]
        conditions = [boundary.condition(side) for boundary in (first, second) for side in SIDES]
        if not all(same_condition(conditions[0], condition) for condition in conditions):
            raise SceneError(
                f"boundaries {first.name!r} and {second.name!r} lie at the same place, and their conditions or sides "
                "differ; keep one of them there, with `left` and `right` where its sides differ."
            )
    for number in sorted({*insertion.empty} - {number for number, _ in insertion.coincident}):
        raise SceneError(
            f"boundary {boundaries[number].name!r} left no trace in the mesh of the manifold and would act on nothing; "
            "look where it lies."
        )
