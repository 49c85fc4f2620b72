"""Adaptive refinement: solve, mark patches by the residual, subdivide their cells, until little is gained."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from cpmkit.forms.galerkin import residual_marking
from cpmkit.forms.galerkin.dof_map import build_dof_map
from cpmkit.forms.galerkin.form import Galerkin, galerkin
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.galerkin.refinement.hierarchical_splines import level_splines
from cpmkit.forms.galerkin.refinement.refined_space import RefinedDofMap, RefinedSpace, build_refined_space
from cpmkit.forms.galerkin.refinement.regions import Regions
from cpmkit.forms.galerkin.scene_sampling import InsertedScene, insert_scene, sample_inserted
from cpmkit.forms.galerkin.space.energy import STABILISATIONS
from cpmkit.forms.options import Options
from cpmkit.linear.constant_functions import ConstantFunctions
from cpmkit.linear.operators import Bordered
from cpmkit.linear.solver_options import make_solver
from cpmkit.mesh.cell_quadrature import Samples
from cpmkit.runtime.memory import release_memory
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Progress, no_progress

#: Relative residual of the solutions that serve for marking: the error of the marking residual itself is larger.
MARKING_TOLERANCE = 1e-6
#: Up to so many unknowns the systems of these solutions are factorised.
MOST_FACTORISED = 1_500
#: Most passes of solve, mark and subdivide: two a level are usual.
MOST_PASSES = 12
#: Refinement ends where patches that may still be subdivided hold less than this share of the marked squares,
OPEN_SHARE = 0.5
#: where more than this share of all patches is marked, so that a smaller spacing serves better,
MOST_MARKED_SHARE = 0.1
#: or where level 0 would keep less than this share of its unknowns.
LEAST_FIRST_SHARE = 0.1
#: Nothing is refined where refinement is expected to save less than this factor of unknowns.
LEAST_GAIN = 3.0


def discretize_in_regions(
    scene: Scene, options: Options[GalerkinOptions], inserted: InsertedScene, regions: Regions, passes: int = 0
) -> Galerkin:
    """Return the discretisation of a scene on splines that are refined in ``regions``.

    The boundaries are inserted already; ``passes`` is the number of solves that led to the regions.
    """
    sampled = sample_inserted(scene, options, inserted, regions)
    samples = sampled.samples
    assert isinstance(samples, Samples)
    first = build_dof_map(samples.points, sampled.corners, options.spacing, samples.cell)
    levels = level_splines(first, samples.points, sampled.corners, samples.cell, regions)
    stabilisation = STABILISATIONS[options.own.stabilisation]
    space = build_refined_space(samples, sampled.interior, sampled.corners, levels, regions, stabilisation, passes)
    return galerkin(scene, options, replace(sampled, samples=space.splines.samples), space)


def solve_for_marking(form: Galerkin) -> Floats:
    """Return the solution (n, channels) of a steady scene, with a relative residual that suffices for marking."""
    stiffness = form.stiffness(form.scene.problem.terms())
    free = form.free_constants(stiffness)
    operator: Any = stiffness if free is None else Bordered(stiffness, free)
    b = form.load(form.scene.problem.terms().f) + form.condition_load(stiffness)
    chosen = "direct" if form.size <= MOST_FACTORISED or form.traits.iterative_solver != "multigrid" else "multigrid"
    prepared = make_solver(chosen, {}).prepare(operator, form.levels(operator))
    values, _ = ConstantFunctions.of(operator, form.constant).solve(prepared, b, MARKING_TOLERANCE)
    return form.remove_constants(operator, b, values)[0]


def refine_adaptively(scene: Scene, options: Options[GalerkinOptions], progress: Progress = no_progress) -> Galerkin:
    """Return the discretisation of a scene on splines that are finer where its solution needs them.

    The scene is solved, patches with large residuals are marked, and those are subdivided. This ends at the first solve
    if refinement is expected to save too few unknowns; later if most of the marked residual is on the finest level, too
    many patches are marked, or level 0 would keep less than a tenth of its unknowns.
    """
    progress("samples", 0.0)
    inserted, most = insert_scene(scene, options), options.own.refine_levels
    regions = Regions(options.spacing, scene.surface.dim)
    progress("refinement", 0.0)
    form = discretize_in_regions(scene, options, inserted, regions)
    first_size, gain = form.size, 0.0
    for passes in range(1, MOST_PASSES + 1):
        squares = residual_marking.residual_squares(form, solve_for_marking(form))
        space, dof_map = refined_parts(form)
        if passes == 1:
            gain = residual_marking.expected_gain(form, squares)
            if gain < LEAST_GAIN:
                return _with_report(form, gain, passes)
        marked = residual_marking.mark_patches(squares)
        open_patches = marked & (dof_map.levels < most)
        spread = marked.sum() > MOST_MARKED_SHARE * len(marked)
        if spread or squares[open_patches].sum() < OPEN_SHARE * squares[marked].sum():
            break
        regions = space.regions.with_subdivided(dof_map.levels[open_patches], dof_map.cells[open_patches], most)
        finer = discretize_in_regions(scene, options, inserted, regions, passes)
        if refined_parts(finer)[0].level_sizes[0] < LEAST_FIRST_SHARE * first_size:
            break
        form = finer
        release_memory()
        progress("refinement", passes / MOST_PASSES)
    progress("refinement", 1.0)
    return _with_report(form, gain)


def refined_parts(form: Galerkin) -> tuple[RefinedSpace, RefinedDofMap]:
    """Return the space of a form on refined splines, and the dof map of the space."""
    assert isinstance(form.space, RefinedSpace)
    assert isinstance(form.space.dof_map, RefinedDofMap)
    return form.space, form.space.dof_map


def _with_report(form: Galerkin, gain: float, passes: int | None = None) -> Galerkin:
    """Return the form with the expected ``gain`` and, if given, the number of ``passes`` stored in its space."""
    space, _ = refined_parts(form)
    space = replace(space, gain=gain, passes=space.passes if passes is None else passes)
    return galerkin(form.scene, form.options, form.sampled, space)
