"""The closest point method with interior boundary conditions.

A surface, curve or solid is known only by its closest points; a PDE on it is solved on a thin band of a
Cartesian grid; conditions hold on points and curves inside it.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

#: Public names and the modules that hold them, imported on first use.
_PUBLIC = {
    "Biharmonic": "scene.compound_equations",
    "Boundary": "scene.boundary",
    "ClosestPoints": "protocols",
    "ClosestPointSource": "protocols",
    "ConvergenceError": "errors",
    "Coupled": "scene.compound_equations",
    "CpmkitError": "errors",
    "CpmkitWarning": "errors",
    "Dirichlet": "scene.conditions",
    "Eigen": "scene.compound_equations",
    "Divergence": "scene.functionals",
    "EigenSolution": "solution.modes",
    "Elliptic": "scene.equations",
    "Equation": "scene.equations",
    "Field": "forms.field",
    "Heat": "scene.equations_in_time",
    "Helmholtz": "scene.equations",
    "InputError": "errors",
    "Laplace": "scene.equations",
    "Neumann": "scene.conditions",
    "NonlinearDiffusion": "scene.nonlinear_equations",
    "NonlinearFlux": "scene.special_conditions",
    "PLaplacian": "scene.nonlinear_equations",
    "PluginError": "errors",
    "PointSource": "scene.functionals",
    "Poisson": "scene.equations",
    "ReactionDiffusion": "scene.reaction_diffusion",
    "ResolutionError": "errors",
    "Robin": "scene.conditions",
    "Scene": "scene.scene",
    "SceneError": "errors",
    "ScreenedPoisson": "scene.equations",
    "SimplySupported": "scene.special_conditions",
    "Solution": "solution.solution",
    "Steklov": "scene.special_conditions",
    "TotalVariation": "scene.nonlinear_equations",
    "Transmission": "scene.special_conditions",
    "Wave": "scene.equations_in_time",
    "VertexData": "scene.vertex_data",
    "assemble": "families.steady",
    "boundary_points": "solution.boundary_points",
    "build_band": "grid.band",
    "directions_along": "solution.boundary_points",
    "discretize": "solving",
    "estimate_error": "accuracy.estimate",
    "estimate_error_by": "accuracy.by_spacing",
    "explain": "explaining",
    "load": "saving.loading",
    "load_scene": "scenefile.reading",
    "normals_at": "solution.boundary_points",
    "prepare": "preparing",
    "read_mesh": "plugins",
    "solve": "solving",
    "solve_by": "accuracy.by_spacing",
    "source": "plugins",
}

__all__ = sorted(_PUBLIC)


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'cpmkit' has no attribute {name!r}")
    value = getattr(import_module(f"cpmkit.{_PUBLIC[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_PUBLIC])
