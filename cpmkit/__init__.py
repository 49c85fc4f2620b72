"""The closest point method with interior boundary conditions.

A surface, curve or solid is known only by its closest points; a PDE on it is solved on a thin band of a
Cartesian grid; conditions hold on points and curves inside it.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from cpmkit.runtime.deprecation import lazy_names, names_by_use

#: The public names, imported on first use.
if TYPE_CHECKING:
    from cpmkit.accuracy.solve_to_target import estimate_error_by as estimate_error_by
    from cpmkit.accuracy.solve_to_target import solve_by as solve_by
    from cpmkit.errors import ConvergenceError as ConvergenceError
    from cpmkit.errors import CpmkitError as CpmkitError
    from cpmkit.errors import CpmkitWarning as CpmkitWarning
    from cpmkit.errors import InputError as InputError
    from cpmkit.errors import PluginError as PluginError
    from cpmkit.errors import ResolutionError as ResolutionError
    from cpmkit.errors import SceneError as SceneError
    from cpmkit.facade import EigenSolution as EigenSolution
    from cpmkit.facade import Solution as Solution
    from cpmkit.facade import pick_line as pick_line
    from cpmkit.families.steady import assemble as assemble
    from cpmkit.forms.field import Field as Field
    from cpmkit.grid.band import build_band as build_band
    from cpmkit.loading import load as load
    from cpmkit.manifold.source import ClosestPoints as ClosestPoints
    from cpmkit.manifold.source import ClosestPointSource as ClosestPointSource
    from cpmkit.plugins import read_mesh as read_mesh
    from cpmkit.plugins import read_texture_coordinates as read_texture_coordinates
    from cpmkit.plugins import source as source
    from cpmkit.preparing import prepare as prepare
    from cpmkit.scene.boundary import Boundary as Boundary
    from cpmkit.scene.compound_equations import Biharmonic as Biharmonic
    from cpmkit.scene.compound_equations import Coupled as Coupled
    from cpmkit.scene.compound_equations import Eigen as Eigen
    from cpmkit.scene.compound_equations import ReactionDiffusion as ReactionDiffusion
    from cpmkit.scene.conditions import Dirichlet as Dirichlet
    from cpmkit.scene.conditions import Neumann as Neumann
    from cpmkit.scene.conditions import Robin as Robin
    from cpmkit.scene.equations import Elliptic as Elliptic
    from cpmkit.scene.equations import Equation as Equation
    from cpmkit.scene.equations import Helmholtz as Helmholtz
    from cpmkit.scene.equations import Laplace as Laplace
    from cpmkit.scene.equations import Poisson as Poisson
    from cpmkit.scene.equations import ScreenedPoisson as ScreenedPoisson
    from cpmkit.scene.equations_in_time import Heat as Heat
    from cpmkit.scene.equations_in_time import Wave as Wave
    from cpmkit.scene.junction import Junction as Junction
    from cpmkit.scene.member_data import MemberData as MemberData
    from cpmkit.scene.nonlinear_equations import NonlinearDiffusion as NonlinearDiffusion
    from cpmkit.scene.nonlinear_equations import PLaplacian as PLaplacian
    from cpmkit.scene.nonlinear_equations import TotalVariation as TotalVariation
    from cpmkit.scene.scene import Scene as Scene
    from cpmkit.scene.special_conditions import NonlinearFlux as NonlinearFlux
    from cpmkit.scene.special_conditions import SimplySupported as SimplySupported
    from cpmkit.scene.special_conditions import Steklov as Steklov
    from cpmkit.scene.special_conditions import Transmission as Transmission
    from cpmkit.scene.special_data import Divergence as Divergence
    from cpmkit.scene.special_data import PointSource as PointSource
    from cpmkit.scene.special_data import VertexData as VertexData
    from cpmkit.scenefile.kinds import kinds as kinds
    from cpmkit.scenefile.scene_files import load_scene as load_scene
    from cpmkit.solution.boundary_points import boundary_points as boundary_points
    from cpmkit.solution.boundary_points import directions_along as directions_along
    from cpmkit.solution.boundary_points import normals_at as normals_at
    from cpmkit.solving import discretize as discretize
    from cpmkit.solving import estimate_error as estimate_error
    from cpmkit.solving import explain as explain
    from cpmkit.solving import solve as solve

__version__ = "0.1.0"

#: Messages of long computations are not shown unless the caller configures Python's logging.
logging.getLogger("cpmkit").addHandler(logging.NullHandler())

if not TYPE_CHECKING:  # else every name, even a misspelt one, would exist for a type checker
    _USES = names_by_use(__name__)
    __getattr__, __dir__ = lazy_names(__name__, {**_USES, "the module itself": {"plugin": "cpmkit.plugin"}})
    __all__ = sorted(name for names in _USES.values() for name in names)
