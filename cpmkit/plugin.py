"""The names that a plugin may import from cpmkit; it imports no other module of cpmkit.

They are listed by their use in :data:`GROUPS`, and imported on first use: a plugin that reads no file loads no reader.
Everything else in cpmkit may change without notice. import-linter checks this rule for the plugins of the repository.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cpmkit.runtime.deprecation import deprecated_names, lazy_names

if TYPE_CHECKING:
    from cpmkit.errors import ConvergenceError as ConvergenceError
    from cpmkit.errors import CpmkitError as CpmkitError
    from cpmkit.errors import CpmkitWarning as CpmkitWarning
    from cpmkit.errors import InputError as InputError
    from cpmkit.errors import MissingDependencyError as MissingDependencyError
    from cpmkit.errors import ResolutionError as ResolutionError
    from cpmkit.errors import SceneError as SceneError
    from cpmkit.errors import place as place
    from cpmkit.errors import shown as shown
    from cpmkit.facade import Solution as Solution
    from cpmkit.files.array_files import read_array as read_array
    from cpmkit.files.array_files import read_bytes as read_bytes
    from cpmkit.files.whole_files import existing_file as existing_file
    from cpmkit.files.whole_files import write_png as write_png
    from cpmkit.files.whole_files import written_whole as written_whole
    from cpmkit.forms.choice import Backend as Backend
    from cpmkit.forms.contract import Discretized as Discretized
    from cpmkit.forms.form_records import FormTraits as FormTraits
    from cpmkit.forms.form_records import StateFlux as StateFlux
    from cpmkit.forms.galerkin.cut_mesh import CutMesh as CutMesh
    from cpmkit.forms.galerkin.cut_mesh import cut_along_boundaries as cut_along_boundaries
    from cpmkit.formulas.expressions import Expression as Expression
    from cpmkit.formulas.expressions import FormulaJets as FormulaJets
    from cpmkit.formulas.expressions import formula_jets as formula_jets
    from cpmkit.formulas.steps import COORDINATES as COORDINATES
    from cpmkit.formulas.steps import FUNCTIONS as FUNCTIONS
    from cpmkit.formulas.steps import formula_tree as formula_tree
    from cpmkit.grid.lattice import cell_levels as cell_levels
    from cpmkit.grid.lattice import needed_spacing as needed_spacing
    from cpmkit.hookspecs import hookimpl as hookimpl
    from cpmkit.linear.operators import Border as Border
    from cpmkit.linear.operators import CsrOperator as CsrOperator
    from cpmkit.linear.operators import LinearSolver as LinearSolver
    from cpmkit.linear.operators import Operator as Operator
    from cpmkit.linear.operators import PreparedSolver as PreparedSolver
    from cpmkit.linear.operators import Stiffness as Stiffness
    from cpmkit.linear.residuals import SolveReport as SolveReport
    from cpmkit.linear.residuals import judge as judge
    from cpmkit.manifold.abilities import MOST_EDGES as MOST_EDGES
    from cpmkit.manifold.abilities import Advice as Advice
    from cpmkit.manifold.abilities import HasAdvice as HasAdvice
    from cpmkit.manifold.abilities import HasCreases as HasCreases
    from cpmkit.manifold.abilities import HasFacets as HasFacets
    from cpmkit.manifold.abilities import HasGivenMesh as HasGivenMesh
    from cpmkit.manifold.abilities import HasLeft as HasLeft
    from cpmkit.manifold.abilities import HasLocalMinima as HasLocalMinima
    from cpmkit.manifold.abilities import HasMembers as HasMembers
    from cpmkit.manifold.abilities import HasMesh as HasMesh
    from cpmkit.manifold.abilities import HasNormals as HasNormals
    from cpmkit.manifold.abilities import HasTangents as HasTangents
    from cpmkit.manifold.abilities import HasTranslation as HasTranslation
    from cpmkit.manifold.abilities import HasValues as HasValues
    from cpmkit.manifold.abilities import advice_of as advice_of
    from cpmkit.manifold.abilities import edge_limit_of as edge_limit_of
    from cpmkit.manifold.abilities import local_minima_of as local_minima_of
    from cpmkit.manifold.abilities import members_of as members_of
    from cpmkit.manifold.abilities import warnings_of as warnings_of
    from cpmkit.manifold.local_source import LocalSource as LocalSource
    from cpmkit.manifold.local_source import localize as localize
    from cpmkit.manifold.orientation import Chain as Chain
    from cpmkit.manifold.orientation import link_chains as link_chains
    from cpmkit.manifold.source import ClosestPoints as ClosestPoints
    from cpmkit.manifold.source import ClosestPointSource as ClosestPointSource
    from cpmkit.manifold.source import check_source as check_source
    from cpmkit.manifold.source import source_repr as source_repr
    from cpmkit.manifold.tangent_space import outward_conormals as outward_conormals
    from cpmkit.manifold.tangent_space import unit_normals as unit_normals
    from cpmkit.manifold.tangent_space import unit_tangents as unit_tangents
    from cpmkit.manifold.vector_algebra import as_rotation as as_rotation
    from cpmkit.manifold.vector_algebra import dots as dots
    from cpmkit.manifold.vector_algebra import in_three_dimensions as in_three_dimensions
    from cpmkit.manifold.vector_algebra import norms as norms
    from cpmkit.manifold.vector_algebra import rotate as rotate
    from cpmkit.manifold.vector_algebra import unit as unit
    from cpmkit.mesh.mesh import Mesh as Mesh
    from cpmkit.mesh.mesh import edge_support as edge_support
    from cpmkit.mesh.mesh import rectangle as rectangle
    from cpmkit.mesh.mesh import vertex_normals as vertex_normals
    from cpmkit.mesh.mixed_cells import Polyline as Polyline
    from cpmkit.mesh.mixed_cells import chain_segments as chain_segments
    from cpmkit.mesh.mixed_cells import number_edges as number_edges
    from cpmkit.mesh.mixed_cells import rotate_triangles as rotate_triangles
    from cpmkit.plugins import read_ply_points as read_ply_points
    from cpmkit.plugins import source as source
    from cpmkit.runtime.arrays import as_colour as as_colour
    from cpmkit.runtime.arrays import as_points as as_points
    from cpmkit.runtime.arrays import as_positions as as_positions
    from cpmkit.runtime.arrays import as_vector as as_vector
    from cpmkit.runtime.arrays import check_size as check_size
    from cpmkit.runtime.arrays import length as length
    from cpmkit.runtime.arrays import one_row_each as one_row_each
    from cpmkit.runtime.arrays import positive as positive
    from cpmkit.runtime.arrays import whole as whole
    from cpmkit.runtime.compilation import compiled as compiled
    from cpmkit.runtime.compilation import inlined as inlined
    from cpmkit.runtime.compilation import run_parcels as run_parcels
    from cpmkit.runtime.compilation import thread_count as thread_count
    from cpmkit.scene.boundary import Boundary as Boundary
    from cpmkit.scene.boundary import BoundarySet as BoundarySet
    from cpmkit.scene.boundary import named_sides as named_sides
    from cpmkit.scene.conditions import Condition as Condition
    from cpmkit.scene.conditions import Dirichlet as Dirichlet
    from cpmkit.scene.conditions import Neumann as Neumann
    from cpmkit.scene.data import Data as Data
    from cpmkit.scene.data import evaluate_data as evaluate_data
    from cpmkit.scene.data import takes_time as takes_time
    from cpmkit.scene.edge_conditions import conditions_along as conditions_along
    from cpmkit.scene.equations import Equation as Equation
    from cpmkit.scene.equations import Laplace as Laplace
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
    from cpmkit.scene.scene import conditions_depend_on_time as conditions_depend_on_time
    from cpmkit.scene.special_data import VertexData as VertexData
    from cpmkit.scene.surface_input import Surface as Surface
    from cpmkit.scene.surface_input import as_source as as_source
    from cpmkit.solution.display_mesh import DisplayMesh as DisplayMesh
    from cpmkit.solving import solve as solve
    from cpmkit.testing import ConformanceCase as ConformanceCase
    from cpmkit.testing import parametrize_with_laws as parametrize_with_laws
    from cpmkit.testing import run_laws as run_laws
    from cpmkit.types import SIDES as SIDES
    from cpmkit.types import Bools as Bools
    from cpmkit.types import Floats as Floats
    from cpmkit.types import Ints as Ints
    from cpmkit.types import Progress as Progress
    from cpmkit.types import Side as Side
    from cpmkit.types import no_progress as no_progress

#: The names by their use and by the module that defines them.
GROUPS: dict[str, dict[str, tuple[str, ...]]] = {
    "Types": {
        "manifold.source": ("ClosestPointSource", "ClosestPoints"),
        "types": ("Bools", "Floats", "Ints", "Progress", "Side"),
    },
    "Abilities of sources": {
        "manifold.abilities": (
            "Advice",
            "HasAdvice",
            "HasCreases",
            "HasFacets",
            "HasGivenMesh",
            "HasLeft",
            "HasLocalMinima",
            "HasMembers",
            "HasMesh",
            "HasNormals",
            "HasTangents",
            "HasTranslation",
            "HasValues",
            "MOST_EDGES",
            "advice_of",
            "edge_limit_of",
            "local_minima_of",
            "members_of",
        ),
    },
    "Errors": {
        "errors": (
            "ConvergenceError",
            "CpmkitError",
            "CpmkitWarning",
            "InputError",
            "MissingDependencyError",
            "ResolutionError",
            "SceneError",
            "place",
            "shown",
        ),
    },
    "Checking input": {
        "manifold.source": ("check_source",),
        "manifold.vector_algebra": ("as_rotation",),
        "runtime.arrays": (
            "as_colour",
            "as_points",
            "as_positions",
            "as_vector",
            "check_size",
            "length",
            "one_row_each",
            "positive",
            "whole",
        ),
    },
    "Reading and writing files": {
        "files.array_files": ("read_array", "read_bytes"),
        "files.whole_files": ("existing_file", "write_png", "written_whole"),
        "plugins": ("read_ply_points",),
    },
    "Formulas": {
        "formulas.expressions": ("Expression", "FormulaJets", "formula_jets"),
        "formulas.steps": ("COORDINATES", "FUNCTIONS", "formula_tree"),
    },
    "Compiled kernels and threads": {
        "runtime.compilation": ("compiled", "inlined", "run_parcels", "thread_count"),
    },
    "Vectors and meshes": {
        "manifold.orientation": ("Chain", "link_chains"),
        "manifold.source": ("source_repr",),
        "manifold.vector_algebra": ("dots", "in_three_dimensions", "norms", "rotate", "unit"),
        "mesh.mesh": ("Mesh", "rectangle"),
        "mesh.mixed_cells": ("Polyline", "chain_segments", "number_edges", "rotate_triangles"),
    },
    "Closest points seen from a place": {
        "grid.lattice": ("cell_levels",),
        "manifold.local_source": ("LocalSource", "localize"),
        "manifold.tangent_space": ("outward_conormals", "unit_normals", "unit_tangents"),
    },
    "Making and solving scenes": {
        "facade": ("Solution",),
        "plugins": ("source",),
        "scene.boundary": ("Boundary",),
        "scene.conditions": ("Dirichlet", "Neumann"),
        "scene.equations": ("Laplace",),
        "scene.special_data": ("VertexData",),
        "scene.surface_input": ("Surface", "as_source"),
        "solving": ("solve",),
    },
    "Scenes, and the laws of their conditions": {
        "scene.conditions": ("Condition",),
        "scene.data": ("Data", "evaluate_data", "takes_time"),
        "scene.edge_conditions": ("conditions_along",),
        "scene.equations": ("Equation", "Terms"),
        "scene.laws": ("Flux", "Interface", "Law", "Mixed", "Nonlinear", "OneSided", "Spectral", "Support", "Value"),
        "scene.point_values": ("small_boundary_warnings",),
        "scene.scene": ("Scene",),
        "types": ("SIDES",),
    },
    "Linear solvers": {
        "linear.operators": ("LinearSolver", "Operator", "PreparedSolver"),
        "linear.residuals": ("SolveReport", "judge"),
    },
    "Forms and back ends": {
        "forms.choice": ("Backend",),
        "forms.contract": ("Discretized",),
        "forms.form_records": ("FormTraits", "StateFlux"),
        "forms.galerkin.cut_mesh": ("CutMesh", "cut_along_boundaries"),
        "grid.lattice": ("needed_spacing",),
        "linear.operators": ("Border", "CsrOperator", "Stiffness"),
        "manifold.abilities": ("warnings_of",),
        "mesh.mesh": ("edge_support", "vertex_normals"),
        "scene.boundary": ("BoundarySet", "named_sides"),
        "scene.scene": ("conditions_depend_on_time",),
        "solution.display_mesh": ("DisplayMesh",),
        "types": ("no_progress",),
    },
    "Hooks": {
        "hookspecs": ("hookimpl",),
    },
    "Testing": {
        "testing": ("ConformanceCase", "parametrize_with_laws", "run_laws"),
    },
}

if not TYPE_CHECKING:  # else every name, even a misspelt one, would exist for a type checker
    _lazy, __dir__ = lazy_names(
        __name__,
        (entry for group in GROUPS.values() for entry in group.items()),
        "cpmkit",
        "; docs/reference/plugin-api.md has what it offers",
    )
    _NEW_NAMES = {"support_of": "cpmkit.plugin.edge_support", "NamesLeft": "cpmkit.plugin.HasLeft"}
    __getattr__ = deprecated_names(__name__, _NEW_NAMES, _lazy)
