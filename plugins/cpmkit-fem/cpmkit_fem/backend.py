"""The form ``fem``: from a scene to its vertices, on a triangulation."""

from __future__ import annotations

from dataclasses import dataclass

from cpmkit.plugin import Backend, InputError, Progress, ResolutionError, Scene, cut_along_boundaries, no_progress
from cpmkit_fem.assembly import stiffness_and_mass
from cpmkit_fem.cell_mesh import CellMesh
from cpmkit_fem.equations import conditions_of
from cpmkit_fem.form import FiniteElements
from cpmkit_fem.pins import pins_of
from cpmkit_fem.ties import ties_of
from cpmkit_fem.triangulation import triangulate


def fem() -> Backend:
    """Return the form ``solve(scene, spacing, backend="fem")``, which has no options of its own.

    A surface that is itself a mesh is solved on its own triangles and needs no spacing; any other that
    can be drawn is triangulated with edges of about the spacing. The triangles are cut along the boundaries.
    """
    return LinearElements()


def fem_pinned() -> Backend:
    """Return the form ``solve(scene, spacing, backend="fem-pinned")``: as ``fem``, on triangles that nothing cuts.

    The vertices nearest to a boundary get its value, as mesh methods commonly do, and as King et al. (2024), section
    6.4, compare with. Boundaries hold Dirichlet conditions, the same on both sides.
    """
    return LinearElements(pinned=True)


@dataclass(frozen=True)
class LinearElements:
    """Linear finite elements; ``pinned`` says whether boundaries pin the nearest vertices and cut nothing."""

    pinned: bool = False

    def discretize(
        self, scene: Scene, spacing: float | None = None, *, progress: Progress = no_progress
    ) -> FiniteElements:
        """Triangulate a scene.

        Parameters
        ----------
        scene : Scene
            A surface; its boundaries and its edge hold any conditions; a point of a surface holds a value.
        spacing : float, optional
            About the length of an edge, in the scene's unit; a mesh needs none and keeps its own.
        progress : callable, optional
            ``progress(stage, fraction)``.

        Raises
        ------
        InputError, SceneError
            If there are no triangles, a boundary lies off them, or what couples two sides has one alone.
        ResolutionError
            If all vertices are pinned.
        """
        if self.pinned and scene.surface.manifold_dim == 1:
            raise InputError("backend='fem-pinned' pins vertices of surfaces, got a curve; use backend='fem'.")
        progress("build", 0.0)
        mesh = triangulate(scene, spacing)
        cut = None
        if scene.boundaries and not self.pinned:
            cut = cut_along_boundaries(scene, mesh.nodes, mesh.cells, mesh.mean_edge)
        mesh = mesh if cut is None else CellMesh(cut.vertices, cut.faces, mesh.manifold_dim)
        parts = conditions_of(scene, mesh, cut)
        ties = ties_of(scene, mesh, cut)
        pins = pins_of(parts, ties, scene.channels)
        if len(pins.vertices) == len(mesh.nodes):
            raise ResolutionError(
                f"All {len(mesh.nodes)} vertices of the mesh are pinned by Dirichlet data; use a finer mesh."
            )
        laplacian, mass = stiffness_and_mass(mesh.nodes, mesh.cells)
        progress("build", 1.0)
        return FiniteElements(scene, mesh, cut, parts, ties, pins, laplacian, mass)
