"""The form ``fem``: from a scene to its vertices, on a triangulation."""

from __future__ import annotations

from dataclasses import dataclass

from cpmkit.plugin import Backend, Progress, ResolutionError, Scene, no_progress
from cpmkit_fem.assembly import stiffness_and_mass
from cpmkit_fem.form import FiniteElements
from cpmkit_fem.pins import pin
from cpmkit_fem.rim import rim_of
from cpmkit_fem.triangulation import triangulate


def fem() -> Backend:
    """Return the form ``solve(scene, spacing, backend="fem")``, which has no options of its own.

    A surface that is itself a mesh is solved on its own triangles and needs no spacing; any other that
    can be drawn is triangulated with edges of about the spacing.
    """
    return LinearElements()


@dataclass(frozen=True)
class LinearElements:
    """Linear finite elements."""

    def discretize(
        self, scene: Scene, spacing: float | None = None, *, progress: Progress = no_progress
    ) -> FiniteElements:
        """Triangulate a scene.

        Parameters
        ----------
        scene : Scene
            A surface with Dirichlet data, the same on both sides, at its boundaries, and any data on its edge.
        spacing : float, optional
            About the length of an edge, in the scene's unit; a mesh needs none and keeps its own.
        progress : callable, optional
            ``progress(stage, fraction)``.

        Raises
        ------
        InputError, SceneError
            If there are no triangles, or a condition is not one that vertices can hold.
        ResolutionError
            If all vertices are pinned.
        """
        progress("build", 0.0)
        mesh = triangulate(scene, spacing)
        rim = rim_of(scene, mesh)
        pins = pin(scene, mesh, rim)
        if len(pins.vertices) == len(mesh.vertices):
            raise ResolutionError(
                f"All {len(mesh.vertices)} vertices of the mesh are pinned by Dirichlet data; use a finer mesh."
            )
        laplacian, mass = stiffness_and_mass(mesh.vertices, mesh.faces)
        progress("build", 1.0)
        return FiniteElements(scene, mesh, rim, pins, laplacian, mass)
