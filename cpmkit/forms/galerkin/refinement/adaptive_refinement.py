"""Solve, mark, part: from one spacing everywhere to splines that are finer where the solution asks for it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.galerkin.quadrature.samples import Samples
from cpmkit.forms.galerkin.refinement import residual_marking
from cpmkit.forms.galerkin.refinement.hierarchical_splines import level_splines
from cpmkit.forms.galerkin.refinement.refined import RefinedGalerkin
from cpmkit.forms.galerkin.refinement.refined_space import build_refined_space
from cpmkit.forms.galerkin.refinement.regions import Regions
from cpmkit.forms.galerkin.scene_sampling import InsertedScene, insert, sample_inserted
from cpmkit.forms.galerkin.space.dof_map import build_dof_map
from cpmkit.forms.options import Options
from cpmkit.linear.constant_functions import ConstantFunctions
from cpmkit.linear.operators import Bordered
from cpmkit.linear.solver_options import make_solver
from cpmkit.runtime.memory import release_memory
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Progress, no_progress

#: Solutions to mark by need not be better: the residual's own error is larger.
MARKING_TOLERANCE = 1e-6
#: Up to this many unknowns these are solved for by factors.
MOST_FACTORISED = 1_500
#: Passes of solve, mark, part: two a level are usual.
MOST_PASSES = 12
#: Refining ends where patches that may be parted hold less than this share of what is marked.
OPEN_SHARE = 0.5
#: Or where marked patches are more than this share of all: what is left is spread, and a smaller spacing serves better.
MOST_MARKED_SHARE = 0.1
#: Nor is it done so far that level 0 holds less than this share of its unknowns.
LEAST_FIRST_SHARE = 0.1
#: Splines of one size serve where sizes that differ would save less than this factor of unknowns.
LEAST_GAIN = 3.0


def discretize_in_regions(
    scene: Scene, options: Options[GalerkinOptions], found: InsertedScene, regions: Regions, passes: int = 0
) -> RefinedGalerkin:
    """Return a scene whose boundaries are inserted on the splines of ``regions``."""
    sampled = sample_inserted(scene, options, found, regions)
    samples = sampled.samples
    assert isinstance(samples, Samples)
    first = build_dof_map(samples.points, sampled.corners, options.spacing, samples.cell)
    levels = level_splines(first, samples.points, sampled.corners, samples.cell, regions)
    refined = build_refined_space(samples, sampled.corners, levels, regions)
    sampled = replace(sampled, samples=refined.space.samples)
    return RefinedGalerkin(scene, options, sampled, refined.space, refined, regions, passes)


def solve_for_marking(form: RefinedGalerkin) -> Floats:
    """Return the solution (n, channels) of a steady scene on a form's splines, well enough to mark by."""
    stiffness = form.stiffness(form.scene.problem.terms())
    free = form.free_constants(stiffness)
    operator: Any = stiffness if free is None else Bordered(stiffness, free)
    b = form.load(form.scene.problem.terms().f) + form.condition_load(stiffness)
    chosen = "direct" if form.size <= MOST_FACTORISED or form.traits.iterative_solver != "multigrid" else "multigrid"
    prepared = make_solver(chosen, {}).prepare(operator, form.levels(operator))
    values, _ = ConstantFunctions.of(operator, form.constant).solve(prepared, b, MARKING_TOLERANCE)
    return form.remove_constants(operator, b, values).values


def refine_adaptively(
    scene: Scene, options: Options[GalerkinOptions], progress: Progress = no_progress
) -> RefinedGalerkin:
    """Return a scene on splines that are finer where its solution asks for it.

    Solved, marked and parted again until what is marked lies mostly on patches of the finest level, or is spread over
    the manifold, or level 0 would hold less than a tenth of its unknowns.
    """
    progress("samples", 0.0)
    found, most = insert(scene, options), options.own.refine_levels
    regions = Regions(options.spacing, scene.surface.dim)
    progress("refinement", 0.0)
    form = discretize_in_regions(scene, options, found, regions)
    whole, gain = form.size, 0.0
    for passes in range(1, MOST_PASSES + 1):
        squares = residual_marking.residual_squares(form, solve_for_marking(form))
        if passes == 1:
            gain = residual_marking.expected_gain(form, squares)
            if gain < LEAST_GAIN:
                return replace(form, passes=passes, gain=gain)
        chosen = residual_marking.mark_patches(squares)
        dof_map = form.refined.dof_map
        open_patches = chosen & (dof_map.levels < most)
        spread = chosen.sum() > MOST_MARKED_SHARE * len(chosen)
        if spread or squares[open_patches].sum() < OPEN_SHARE * squares[chosen].sum():
            break
        regions = form.regions.with_parted(dof_map.levels[open_patches], dof_map.cells[open_patches], most)
        finer = discretize_in_regions(scene, options, found, regions, passes)
        if finer.level_sizes[0] < LEAST_FIRST_SHARE * whole:
            break
        form = finer
        release_memory()
        progress("refinement", passes / MOST_PASSES)
    progress("refinement", 1.0)
    return replace(form, gain=gain)
