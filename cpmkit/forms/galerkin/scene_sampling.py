"""From a scene to samples: a mesh of the manifold, its boundaries inserted, split, curved, cut and sampled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.conditions.boundary_samples import BoundarySamples, boundary_samples
from cpmkit.forms.galerkin.conditions.boundary_sides import left_of_boundaries
from cpmkit.forms.galerkin.conditions.imposed_conditions import (
    ImposedCondition,
    impose_conditions,
    point_warnings,
    reads_rims,
)
from cpmkit.forms.galerkin.enrichment.singular_functions import SingularFunction, singular_functions
from cpmkit.forms.galerkin.galerkin_cost import check_samples_fit
from cpmkit.forms.galerkin.mesh_warnings import (
    check_insertion,
    contouring_warnings,
    insertion_warnings,
    noise_warnings,
    repair_warnings,
    seam_warnings,
    tracing_warnings,
    with_noise_advice,
)
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.galerkin.quadrature.cell_quadrature import (
    PLAIN_EDGE_SPACINGS,
    longest_edge,
    needs_degree_four,
    quadrature,
    triangles_to_clip,
)
from cpmkit.forms.galerkin.quadrature.samples import QuantisedSamples, Samples
from cpmkit.forms.galerkin.refinement.graded_mesh import grade_mesh, grade_towards_tips, graded_samples
from cpmkit.forms.galerkin.refinement.regions import Regions
from cpmkit.forms.options import Options
from cpmkit.grid.lattice import Lattice, lattice_of
from cpmkit.manifold.local_source import LocalSource, localize, with_noise
from cpmkit.mesh.adjacency import HalfFacets, cut_corners, half_facets, has_cut_corners, seam_midpoints
from cpmkit.mesh.mesh import CellGeometry, Mesh
from cpmkit.mesh.subdivision import subdivide
from cpmkit.meshing.contouring.contoured_curves import contour_curve
from cpmkit.meshing.contouring.contoured_surfaces import contour_surface
from cpmkit.meshing.curved_from_normals import curve_cells
from cpmkit.meshing.insertion.boundary_insertion import insert_boundaries
from cpmkit.meshing.mesh_cache import repair_source_mesh
from cpmkit.meshing.source_cells import source_cells
from cpmkit.scene.oriented import OrientedBoundary
from cpmkit.scene.scene import Scene
from cpmkit.types import Bools, Ints, Progress


@dataclass(frozen=True, eq=False)
class SampledScene:
    """A scene's manifold as samples, and its boundaries as facets of the cells between them.

    Attributes
    ----------
    lattice : Lattice
        That all coordinates are relative to.
    surface : LocalSource
        The manifold.
    sources : sequence of LocalSource
        Where the boundaries lie.
    oriented : sequence of OrientedBoundary
        The boundaries with what tells their left.
    mesh : Mesh
        Split, curved, cut; its cells in 32 bits.
    corners : (m, k) int32
        The vertices of its cells after cutting.
    half : HalfFacets
        Its facets on boundaries and rims.
    samples : Samples or FixedSamples
        Those of the manifold, those on boundaries after them; the latter once they are parted.
    boundary : BoundarySamples
        The latter.
    left : (b,) bool
        Which of these are on the left of their boundary.
    held : sequence of Held
        Which law holds at which of these.
    told : tuple of str
        What a reader of a solution should know of the way here.
    winding : (m,) int8
        Which way its cells are wound, see :attr:`cpmkit.mesh.mesh.Connectivity.winding`.
    bend : "flat", "closest_point" or "normals"
        How the cells follow the manifold between their vertices.
    singular : tuple of SingularFunction
        What u behaves like at the ends of boundaries, where that is asked for.
    """

    lattice: Lattice
    surface: LocalSource
    sources: Sequence[LocalSource]
    oriented: Sequence[OrientedBoundary]
    mesh: Mesh
    corners: Any
    half: HalfFacets
    samples: Samples | QuantisedSamples
    boundary: BoundarySamples
    left: Bools
    held: tuple[ImposedCondition, ...]
    told: tuple[str, ...]
    winding: Any = None
    geometry: CellGeometry = "flat"
    singular: tuple[SingularFunction, ...] = ()

    @property
    def interior(self) -> int:
        """Number of samples that lie on no boundary: the first ones."""
        return len(self.samples) - len(self.boundary)

    @property
    def queries(self) -> int:
        """Closest points that were asked for, of the manifold and its boundaries."""
        counted = {id(one.queries): one.queries["points"] for one in (self.surface, *self.sources)}
        return sum(counted.values())


@dataclass(frozen=True, eq=False)
class InsertedScene:
    """A scene's manifold as a mesh with the boundaries in it, from which samples of any fineness are taken.

    Attributes
    ----------
    lattice, surface, sources, oriented
        As of :class:`SampledScene`.
    mesh : Mesh
        Of flat cells, not yet split.
    points : mapping
        The vertices that are points of a surface with a condition, by the number of the boundary.
    bend, told
        As of :class:`SampledScene`.
    """

    lattice: Lattice
    surface: LocalSource
    sources: Sequence[LocalSource]
    oriented: Sequence[OrientedBoundary]
    mesh: Mesh
    points: Mapping[int, Ints]
    geometry: CellGeometry
    told: tuple[str, ...]


def sample_scene(scene: Scene, options: Options[GalerkinOptions], progress: Progress) -> SampledScene:
    """Sample a scene at the spacing of the options; ``progress`` is told the stage and the share that is done.

    Raises
    ------
    InputError, SceneError, ResolutionError
        If the lattice's origin, a boundary or the spacing does not fit.
    """
    progress("samples", 0.0)
    found = insert(scene, options)
    progress("samples", 0.5)
    sampled = sample_inserted(scene, options, found)
    progress("samples", 1.0)
    return sampled


def insert(scene: Scene, options: Options[GalerkinOptions]) -> InsertedScene:
    """Return a mesh of a scene's manifold with its boundaries inserted.

    Raises
    ------
    InputError, SceneError, ResolutionError
        As :func:`sample_scene` does.
    """
    spacing = options.spacing
    lattice = lattice_of(scene.surface, spacing, options.origin)
    surface = localize(scene.surface, lattice.origin)
    oriented = [scene.oriented(boundary) for boundary in scene.boundaries]
    sources = [localize(boundary.source, lattice.origin) for boundary in scene.boundaries]
    check_samples_fit(surface, spacing, options.own.degree)
    surface, mesh, bend, told = _repaired_cells(surface, spacing, options.own.sampling)
    points: Mapping[int, Ints] = {}
    if sources:
        insertion = insert_boundaries(mesh, sources, spacing, movable=bend == "closest_point")
        mesh, points = insertion.mesh, insertion.point_vertices
        check_insertion(insertion, scene.boundaries, spacing)
        told += tuple(insertion_warnings(insertion, scene.boundaries, spacing))
    return InsertedScene(lattice, surface, sources, oriented, mesh, points, bend, told)


def sample_inserted(
    scene: Scene, options: Options[GalerkinOptions], found: InsertedScene, regions: Regions | None = None
) -> SampledScene:
    """Sample a scene whose boundaries are inserted, finer in ``regions``.

    Raises
    ------
    InputError, SceneError, ResolutionError
        As :func:`sample_scene` does.
    """
    spacing, sampling, bend = options.spacing, options.own.sampling, found.geometry
    lattice, surface, sources, oriented = found.lattice, found.surface, found.sources, found.oriented
    told = found.told
    longest = longest_edge(sampling, bend, found.mesh.manifold_dim)
    mesh = subdivide(found.mesh, longest * spacing)
    mesh = mesh if regions is None else grade_mesh(mesh, regions, longest)
    with_tips = options.own.tips == "singular" and mesh.manifold_dim == 2
    mesh = grade_towards_tips(mesh, spacing) if with_tips else mesh
    mesh = curve_cells(mesh, bend, surface, sources, spacing)
    is_whole = bend != "closest_point" and not len(mesh.cut)  # repaired cells: each vertex has one fan of cells
    corners = mesh.cells if is_whole else cut_corners(mesh)
    half, winding = half_facets(mesh), mesh.winding
    told += tuple(seam_warnings(seam_midpoints(mesh, half), surface, bend))
    boundary = boundary_samples(mesh, half, corners, reads_rims(scene), found.points)
    left = left_of_boundaries(mesh, half, corners, boundary, oriented, lattice)
    laws = impose_conditions(scene, boundary, left, surface, lattice)
    singular, of_ends = singular_functions(mesh, boundary, laws, lattice) if with_tips else ((), ())
    told += of_ends
    further, fine = boundary.as_samples if len(boundary) else None, needs_degree_four(options.own.degree, bend)
    if regions is None:
        samples = quadrature(mesh, spacing, further, triangles_to_clip(mesh, sampling, bend, spacing), fine)
    else:
        samples = graded_samples(mesh, regions, sampling, bend, further)
    if len(boundary):
        some = samples.weights > 0
        told += point_warnings(
            scene, boundary, spacing, (lattice.to_scene(samples.points[some]), samples.weights[some])
        )
    # what is held on: cells in 32 bits, and no midpoints, which samples were taken from alone
    cells: Any = mesh.cells.astype(np.int32)
    held_corners: Any = corners.astype(np.int32) if has_cut_corners(mesh, corners) else cells
    mesh = replace(mesh, cells=cells, midpoints=None)
    parts = (
        lattice,
        surface,
        sources,
        oriented,
        mesh,
        held_corners,
        half,
        samples,
        boundary,
        left,
        laws,
        told,
        winding,
        bend,
        singular,
    )
    return SampledScene(*parts)


def _repaired_cells(
    surface: LocalSource, spacing: float, sampling: str
) -> tuple[LocalSource, Mesh, CellGeometry, tuple[str, ...]]:
    """Return the manifold, a sound mesh of it, how its cells are to be bent, and what is to be told of it.

    The noise of what has closest points alone is known then.
    """
    lengths = longest_edge(sampling, "closest_point", surface.manifold_dim or 0), PLAIN_EDGE_SPACINGS
    own = source_cells(surface, *(spacing * length for length in lengths))
    if own is not None:
        mesh, mended = repair_source_mesh(surface, own.mesh, own.split)
        return surface, mesh, own.geometry, tuple(repair_warnings(mended, own.geometry))
    surface = with_noise(surface, spacing)
    noisy = tuple(noise_warnings(surface, spacing))
    if surface.manifold_dim == 1:
        traces, of_curve = contour_curve(surface, spacing, curved=False)
        return (
            surface,
            traces,
            "closest_point",
            noisy + with_noise_advice(tracing_warnings(of_curve, surface), surface, spacing),
        )
    triangles, of_surface = contour_surface(surface, spacing, curved=False)
    return (
        surface,
        triangles,
        "closest_point",
        noisy + with_noise_advice(contouring_warnings(of_surface, surface), surface, spacing),
    )
