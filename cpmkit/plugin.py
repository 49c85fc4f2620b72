"""The names that a plugin may import from cpmkit; it imports no other module of cpmkit.

The names are listed by their use, which a comment states, and imported on first use: a plugin that reads no file loads
no reader. Everything else in cpmkit may change without notice. import-linter checks this rule for the plugins of the
repository.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cpmkit.runtime.deprecation import deprecated_names, lazy_names, names_by_use

if TYPE_CHECKING:  # Types
    from cpmkit.manifold.source import ClosestPoints as ClosestPoints
    from cpmkit.manifold.source import ClosestPointSource as ClosestPointSource
    from cpmkit.types import Bools as Bools
    from cpmkit.types import Floats as Floats
    from cpmkit.types import Ints as Ints
    from cpmkit.types import Progress as Progress
    from cpmkit.types import Side as Side
if TYPE_CHECKING:  # Abilities of sources
    from cpmkit.manifold.abilities import MOST_EDGES as MOST_EDGES
    from cpmkit.manifold.abilities import Advice as Advice
    from cpmkit.manifold.abilities import HasAdvice as HasAdvice
    from cpmkit.manifold.abilities import HasCreases as HasCreases
    from cpmkit.manifold.abilities import HasFacets as HasFacets
    from cpmkit.manifold.abilities import HasGivenMesh as HasGivenMesh
    from cpmkit.manifold.abilities import HasInside as HasInside
    from cpmkit.manifold.abilities import HasLeft as HasLeft
    from cpmkit.manifold.abilities import HasLocalMinima as HasLocalMinima
    from cpmkit.manifold.abilities import HasMembers as HasMembers
    from cpmkit.manifold.abilities import HasMesh as HasMesh
    from cpmkit.manifold.abilities import HasNormals as HasNormals
    from cpmkit.manifold.abilities import HasSkin as HasSkin
    from cpmkit.manifold.abilities import HasSmoothSurface as HasSmoothSurface
    from cpmkit.manifold.abilities import HasTangents as HasTangents
    from cpmkit.manifold.abilities import HasTranslation as HasTranslation
    from cpmkit.manifold.abilities import HasValues as HasValues
    from cpmkit.manifold.abilities import advice_of as advice_of
    from cpmkit.manifold.abilities import edge_limit_of as edge_limit_of
    from cpmkit.manifold.abilities import local_minima_of as local_minima_of
    from cpmkit.manifold.abilities import members_of as members_of
if TYPE_CHECKING:  # Errors
    from cpmkit.errors import ConvergenceError as ConvergenceError
    from cpmkit.errors import CpmkitError as CpmkitError
    from cpmkit.errors import CpmkitWarning as CpmkitWarning
    from cpmkit.errors import InputError as InputError
    from cpmkit.errors import MissingDependencyError as MissingDependencyError
    from cpmkit.errors import ResolutionError as ResolutionError
    from cpmkit.errors import SceneError as SceneError
    from cpmkit.errors import place as place
    from cpmkit.errors import shown as shown
if TYPE_CHECKING:  # Checking input
    from cpmkit.manifold.source import check_source as check_source
    from cpmkit.manifold.vector_algebra import as_rotation as as_rotation
    from cpmkit.runtime.arrays import as_colour as as_colour
    from cpmkit.runtime.arrays import as_points as as_points
    from cpmkit.runtime.arrays import as_positions as as_positions
    from cpmkit.runtime.arrays import as_vector as as_vector
    from cpmkit.runtime.arrays import check_size as check_size
    from cpmkit.runtime.arrays import length as length
    from cpmkit.runtime.arrays import one_row_each as one_row_each
    from cpmkit.runtime.arrays import positive as positive
    from cpmkit.runtime.arrays import whole as whole
if TYPE_CHECKING:  # Reading and writing files
    from cpmkit.files.array_files import read_array as read_array
    from cpmkit.files.array_files import read_bytes as read_bytes
    from cpmkit.files.whole_files import existing_file as existing_file
    from cpmkit.files.whole_files import write_png as write_png
    from cpmkit.files.whole_files import written_whole as written_whole
    from cpmkit.plugins import read_ply_points as read_ply_points
if TYPE_CHECKING:  # Formulas
    from cpmkit.formulas.expressions import Expression as Expression
    from cpmkit.formulas.expressions import FormulaJets as FormulaJets
    from cpmkit.formulas.expressions import formula_jets as formula_jets
    from cpmkit.formulas.steps import COORDINATES as COORDINATES
    from cpmkit.formulas.steps import FUNCTIONS as FUNCTIONS
    from cpmkit.formulas.steps import formula_tree as formula_tree
if TYPE_CHECKING:  # Compiled kernels and threads
    from cpmkit.runtime.compilation import compiled as compiled
    from cpmkit.runtime.compilation import inlined as inlined
    from cpmkit.runtime.compilation import run_parcels as run_parcels
    from cpmkit.runtime.compilation import thread_count as thread_count
if TYPE_CHECKING:  # Vectors and meshes
    from cpmkit.manifold.orientation import Chain as Chain
    from cpmkit.manifold.orientation import link_chains as link_chains
    from cpmkit.manifold.source import source_repr as source_repr
    from cpmkit.manifold.vector_algebra import dots as dots
    from cpmkit.manifold.vector_algebra import in_three_dimensions as in_three_dimensions
    from cpmkit.manifold.vector_algebra import norms as norms
    from cpmkit.manifold.vector_algebra import rotate as rotate
    from cpmkit.manifold.vector_algebra import unit as unit
    from cpmkit.mesh.mesh import Mesh as Mesh
    from cpmkit.mesh.mesh import rectangle as rectangle
    from cpmkit.mesh.mixed_cells import Polyline as Polyline
    from cpmkit.mesh.mixed_cells import chain_segments as chain_segments
    from cpmkit.mesh.mixed_cells import number_edges as number_edges
    from cpmkit.mesh.mixed_cells import rotate_triangles as rotate_triangles
if TYPE_CHECKING:  # Closest points seen from a place
    from cpmkit.grid.lattice import cell_levels as cell_levels
    from cpmkit.manifold.local_source import LocalSource as LocalSource
    from cpmkit.manifold.local_source import localize as localize
    from cpmkit.manifold.tangent_space import outward_conormals as outward_conormals
    from cpmkit.manifold.tangent_space import unit_normals as unit_normals
    from cpmkit.manifold.tangent_space import unit_tangents as unit_tangents
if TYPE_CHECKING:  # Making and solving scenes
    from cpmkit.facade import Solution as Solution
    from cpmkit.plugins import source as source
    from cpmkit.scene.boundary import Boundary as Boundary
    from cpmkit.scene.conditions import Dirichlet as Dirichlet
    from cpmkit.scene.conditions import Neumann as Neumann
    from cpmkit.scene.equations import Laplace as Laplace
    from cpmkit.scene.special_data import VertexData as VertexData
    from cpmkit.scene.surface_input import Surface as Surface
    from cpmkit.scene.surface_input import as_source as as_source
    from cpmkit.solving import solve as solve
if TYPE_CHECKING:  # Scenes, and the laws of their conditions
    from cpmkit.scene.conditions import Condition as Condition
    from cpmkit.scene.data import Data as Data
    from cpmkit.scene.data import evaluate_data as evaluate_data
    from cpmkit.scene.data import takes_time as takes_time
    from cpmkit.scene.edge_conditions import conditions_along as conditions_along
    from cpmkit.scene.equations import Equation as Equation
    from cpmkit.scene.equations import Terms as Terms
    from cpmkit.scene.laws import Flux as Flux
    from cpmkit.scene.laws import Interface as Interface
    from cpmkit.scene.laws import Law as Law
    from cpmkit.scene.laws import Mixed as Mixed
    from cpmkit.scene.laws import Nonlinear as Nonlinear
    from cpmkit.scene.laws import OneSided as OneSided
    from cpmkit.scene.laws import Spectral as Spectral
    from cpmkit.scene.laws import Support as Support
    from cpmkit.scene.laws import Value as Value
    from cpmkit.scene.point_values import small_boundary_warnings as small_boundary_warnings
    from cpmkit.scene.scene import Scene as Scene
    from cpmkit.types import SIDES as SIDES
if TYPE_CHECKING:  # Linear solvers
    from cpmkit.linear.operators import LinearSolver as LinearSolver
    from cpmkit.linear.operators import Operator as Operator
    from cpmkit.linear.operators import PreparedSolver as PreparedSolver
    from cpmkit.linear.residuals import SolveReport as SolveReport
    from cpmkit.linear.residuals import judge as judge
if TYPE_CHECKING:  # Forms and back ends
    from cpmkit.forms.choice import Backend as Backend
    from cpmkit.forms.contract import Discretized as Discretized
    from cpmkit.forms.form_records import FormTraits as FormTraits
    from cpmkit.forms.form_records import StateFlux as StateFlux
    from cpmkit.forms.galerkin.cut_mesh import CutMesh as CutMesh
    from cpmkit.forms.galerkin.cut_mesh import cut_along_boundaries as cut_along_boundaries
    from cpmkit.grid.lattice import needed_spacing as needed_spacing
    from cpmkit.linear.operators import Border as Border
    from cpmkit.linear.operators import CsrOperator as CsrOperator
    from cpmkit.linear.operators import Stiffness as Stiffness
    from cpmkit.manifold.abilities import warnings_of as warnings_of
    from cpmkit.mesh.mesh import CurvatureSupport as CurvatureSupport
    from cpmkit.mesh.mesh import curvature_support as curvature_support
    from cpmkit.mesh.mesh import vertex_normals as vertex_normals
    from cpmkit.scene.boundary import BoundarySet as BoundarySet
    from cpmkit.scene.boundary import named_sides as named_sides
    from cpmkit.scene.scene import conditions_depend_on_time as conditions_depend_on_time
    from cpmkit.solution.display_mesh import DisplayMesh as DisplayMesh
    from cpmkit.types import no_progress as no_progress
if TYPE_CHECKING:  # Hooks
    from cpmkit.hookspecs import hookimpl as hookimpl
if TYPE_CHECKING:  # Testing
    from cpmkit.testing import ConformanceCase as ConformanceCase
    from cpmkit.testing import parametrize_with_laws as parametrize_with_laws
    from cpmkit.testing import run_laws as run_laws

if not TYPE_CHECKING:  # else every name, even a misspelt one, would exist for a type checker
    #: The names and the modules that define them, by their use.
    USES = names_by_use(__name__)
    _lazy, __dir__ = lazy_names(__name__, USES, "; docs/reference/plugin-api.md has what it offers")
    _NEW_NAMES = dict.fromkeys(("support_of", "edge_support"), "cpmkit.plugin.curvature_support")
    _NEW_NAMES["NamesLeft"] = "cpmkit.plugin.HasLeft"
    __getattr__ = deprecated_names(__name__, _NEW_NAMES, _lazy)
