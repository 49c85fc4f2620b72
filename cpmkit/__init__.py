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
    "Biharmonic": "compound_problems",
    "Boundary": "scene",
    "ClosestPoints": "protocols",
    "ClosestPointSource": "protocols",
    "ConvergenceError": "errors",
    "CpmkitError": "errors",
    "CpmkitWarning": "errors",
    "Dirichlet": "conditions",
    "Eigen": "compound_problems",
    "EigenSolution": "eigen.solution",
    "Elliptic": "problems",
    "Equation": "problems",
    "Heat": "evolution.equations",
    "Helmholtz": "problems",
    "InputError": "errors",
    "Laplace": "problems",
    "Neumann": "conditions",
    "NonlinearFlux": "special_conditions",
    "PluginError": "errors",
    "Poisson": "problems",
    "ResolutionError": "errors",
    "Robin": "conditions",
    "Scene": "scene",
    "SceneError": "errors",
    "ScreenedPoisson": "problems",
    "SimplySupported": "special_conditions",
    "Solution": "solution",
    "Steklov": "special_conditions",
    "Transmission": "special_conditions",
    "Wave": "evolution.equations",
    "VertexData": "vertex_data",
    "assemble": "assembly",
    "build_band": "grid.band",
    "discretize": "discretization",
    "estimate_error": "estimate",
    "explain": "explanation",
    "load": "loading",
    "load_scene": "scenefile",
    "read_mesh": "data",
    "solve": "solving",
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
