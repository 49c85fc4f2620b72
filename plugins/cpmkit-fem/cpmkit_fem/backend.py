"""The forms ``fem`` and ``fem-pinned``: a scene discretised on a triangulation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from cpmkit.plugin import (
    Backend,
    ClosestPointSource,
    CutMesh,
    Floats,
    InputError,
    Progress,
    ResolutionError,
    Scene,
    SceneError,
    cut_along_boundaries,
    needed_spacing,
    no_progress,
)
from cpmkit_fem.assembly import stiffness_and_mass
from cpmkit_fem.cell_mesh import CellMesh
from cpmkit_fem.filling import fills_own_mesh, is_solid, solid_mesh
from cpmkit_fem.flips import flip_thin_triangles
from cpmkit_fem.form import FiniteElements
from cpmkit_fem.on_nodes import conditions_of
from cpmkit_fem.pins import pins_of
from cpmkit_fem.quadratic import add_midpoints, fit_curved_cells
from cpmkit_fem.ties import ties_of
from cpmkit_fem.triangulation import own_mesh, triangulation


def fem() -> Backend:
    """Return the form ``solve(scene, spacing, backend="fem")``, whose one option is the ``degree``.

    A surface that is itself a mesh is solved on its own triangles and needs no spacing; any other that
    can be drawn is triangulated with edges of about the spacing. A solid is filled with tetrahedra by TetGen, with
    edges of about the spacing. Triangles are cut along the boundaries, and
    segments of a curve at boundary points.
    """
    return Elements()


def fem_pinned() -> Backend:
    """Return the form ``solve(scene, spacing, backend="fem-pinned")``: linear elements on uncut triangles of a surface.

    The vertices nearest to a boundary get its value, a common method on meshes with which King et al. (2024), section
    6.4, compare. Boundaries have Dirichlet conditions, the same on both sides.
    """
    return PinnedElements()


#: Distance of nodes from the surface or boundary, as a share of an edge, above which a warning is given.
OFF_EDGE_SHARE = 2e-3


@dataclass(frozen=True)
class Elements:
    """Finite elements on cells that boundaries cut."""

    def discretize(
        self, scene: Scene, spacing: float | None = None, *, degree: int = 1, progress: Progress = no_progress
    ) -> FiniteElements:
        """Return a scene discretised on triangles or segments that its boundaries cut.

        Raise InputError if the surface has no triangles or segments, one of the triangles has no area, curves meet
        without a common vertex, the spacing is absent for a source that is no mesh, or not above zero, or the degree is
        neither 1 nor 2. Raise SceneError if a boundary lies off the cells or on another with a different condition, a
        point of a surface has another condition than a value, a condition that couples two sides has one or three, or
        the edge has a place without condition, the boundary of a solid is not closed, or boundaries lie inside a solid.
        Raise ResolutionError if all vertices are pinned, or the boundary of a solid is too curved for the spacing;
        MissingDependencyError for a solid in space without TetGen.

        Parameters
        ----------
        scene : Scene
            A solid, surface or curve; its boundaries and its edge have any conditions, a point of a surface a value.
        spacing : float, optional
            About the length of an edge, in the scene's unit; a source that is a mesh ignores it.
        degree : int
            Degree of the polynomials on each cell: 1, or 2. Of degree 2 cells are curved, of a mesh they stay flat.
        progress : callable, optional
            ``progress(stage, fraction)``, with the stage "build" and a fraction from 0 to 1.
        """
        if degree not in (1, 2):
            raise InputError(f"backend='fem' has elements of degree 1 and 2, got degree={degree!r}; use degree=2.")
        progress("build", 0.0)
        mesh, cut = _scene_mesh(scene, spacing, cuts=True), None
        curves_cells = degree == 2 and not _is_own_mesh(scene.surface)
        if scene.boundaries:
            cut = cut_along_boundaries(scene, mesh.nodes, mesh.cells, mesh.mean_edge)
            mesh = CellMesh(cut.vertices, cut.faces, mesh.manifold_dim)
            if curves_cells and mesh.manifold_dim == 2:
                mesh = flip_thin_triangles(mesh, cut.edges)
        mesh = add_midpoints(mesh) if degree == 2 else mesh
        if curves_cells:
            mesh, off = fit_curved_cells(scene, mesh, cut)
            cut = cut and replace(cut, warnings=(*cut.warnings, *_flat_cell_warnings(mesh, off)))
        return _discretize(scene, mesh, cut, progress)


@dataclass(frozen=True)
class PinnedElements:
    """Linear finite elements on triangles of which boundaries pin the nearest vertices and cut nothing."""

    def discretize(
        self, scene: Scene, spacing: float | None = None, *, progress: Progress = no_progress
    ) -> FiniteElements:
        """Return a scene discretised on its uncut triangles, with pinned vertices in place of boundaries.

        ``spacing`` and ``progress`` are those of :meth:`Elements.discretize`, and so are the exceptions about the mesh,
        the edge and pinned vertices. Raise InputError also for a curve, SceneError if a boundary lies off the mesh or
        has another condition than one Dirichlet condition for both sides.
        """
        if scene.surface.manifold_dim == 1:
            raise InputError("backend='fem-pinned' pins vertices of surfaces, got a curve; use backend='fem'.")
        progress("build", 0.0)
        return _discretize(scene, _scene_mesh(scene, spacing, cuts=False), None, progress)


def _scene_mesh(scene: Scene, spacing: float | None, cuts: bool) -> CellMesh:
    """Return the mesh of the scene's manifold, with edges of about ``spacing``; boundaries are not used.

    Raise InputError as the functions that make it, or if a cell has no area or volume, SceneError for boundaries inside
    a solid: in space, and in the plane if they shall be ``cuts``.
    """
    surface = scene.surface
    if scene.boundaries and is_solid(surface) and surface.dim >= (2 if cuts else 3):
        raise SceneError("finite elements take no boundaries inside a solid; leave `backend` out.")
    if is_solid(surface) and surface.dim > 1:
        mesh = solid_mesh(surface, needed_spacing(surface, spacing))
    else:
        mesh = triangulation(surface, spacing)
    mesh.check_cells()
    return mesh


def _is_own_mesh(surface: ClosestPointSource) -> bool:
    """Return whether the surface, or the boundary of a solid, is itself a mesh."""
    return fills_own_mesh(surface) if is_solid(surface) else own_mesh(surface) is not None


def _flat_cell_warnings(mesh: CellMesh, off: Floats) -> Iterator[str]:
    """Yield a warning if ``off`` (n,), the nodes' distances from their wanted places, exceeds a share of an edge."""
    if off.max() > OFF_EDGE_SHARE * mesh.mean_edge:
        flat = int((off > OFF_EDGE_SHARE * mesh.mean_edge)[mesh.cells].any(axis=1).sum())
        yield (
            f"{flat} of {len(mesh.cells)} cells, beside boundaries, are too thin to be curved, and up to "
            f"{off.max():.2g} off the surface or the boundary: the answer is of second order there; another "
            "spacing may avoid them."
        )


def _discretize(scene: Scene, mesh: CellMesh, cut: CutMesh | None, progress: Progress) -> FiniteElements:
    """Return the form on ``mesh``, that of ``cut`` unless None; raise ResolutionError if all nodes are pinned."""
    parts, ties = conditions_of(scene, mesh, cut), ties_of(scene, mesh, cut)
    pins = pins_of(parts, ties, scene.channels)
    if len(pins.vertices) == len(mesh.nodes):
        raise ResolutionError(
            f"All {len(mesh.nodes)} vertices of the mesh are pinned by Dirichlet data; use a finer mesh."
        )
    laplacian, mass = stiffness_and_mass(mesh.nodes, mesh.cells, degree=mesh.degree)
    progress("build", 1.0)
    return FiniteElements(scene, mesh, cut, parts, ties, pins, laplacian, mass)
