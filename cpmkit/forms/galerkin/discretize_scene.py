"""Discretisation of a scene in the Galerkin form, on splines of one level or on refined splines."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np

from cpmkit.forms.galerkin.conditions.imposed_conditions import needs_rims
from cpmkit.forms.galerkin.dof_map import build_dof_map
from cpmkit.forms.galerkin.enrichment.enriched_space import EnrichedSpace
from cpmkit.forms.galerkin.form import Galerkin, galerkin
from cpmkit.forms.galerkin.options import SOLID_STABILISATIONS, STABILISATIONS, GalerkinOptions
from cpmkit.forms.galerkin.options import check_scene as check
from cpmkit.forms.galerkin.refinement.refined_space import RefinedDofMap, build_refined_space, level_splines
from cpmkit.forms.galerkin.refinement.regions import Regions
from cpmkit.forms.galerkin.scene_sampling import InsertedScene, insert_scene, sample_scene
from cpmkit.forms.galerkin.solids.solid_sampling import sample_solid
from cpmkit.forms.galerkin.solve_memory import SolveMemory
from cpmkit.forms.galerkin.space.function_space import FunctionSpace
from cpmkit.forms.galerkin.space.quantised_samples import SAMPLES_AT_ONCE, QuantisedSamples
from cpmkit.forms.galerkin.space.spline_space import build_spline_space, spline_slopes, spline_values
from cpmkit.forms.galerkin.unions.discretize_union import discretize_union
from cpmkit.forms.options import Options
from cpmkit.linear.constant_functions import ConstantFunctions
from cpmkit.linear.operators import Bordered
from cpmkit.linear.solver_options import make_solver
from cpmkit.runtime.memory import release_memory
from cpmkit.scene.data import Functional, evaluate_data
from cpmkit.scene.edge_conditions import check_parts_used
from cpmkit.scene.scene import Scene
from cpmkit.types import Bools, Floats, Progress, no_progress

#: Marked patches hold this share of the sum of squares.
MARKED_SHARE = 0.5
#: The gradient of the diffusivity is a difference over this share of the spacing.
SLOPE_STEP_SHARE = 1e-3
#: The order with which local errors fall with the size of patches.
ORDER = 3.0
#: Relative residual of the solutions that serve for marking: the error of the marking residual itself is larger.
MARKING_TOLERANCE = 1e-6
#: Most passes of solve, mark and subdivide: two a level are usual.
MOST_PASSES = 12
#: Refinement ends if patches that may still be subdivided have less than this share of the sum of marked squares,
OPEN_SHARE = 0.5
#: or if more than this share of all patches is marked, so that a smaller spacing serves better.
MOST_MARKED_SHARE = 0.1
#: Nothing is refined where refinement is expected to save less than this factor of unknowns.
LEAST_GAIN = 3.0


def discretize(scene: Scene, options: Options[GalerkinOptions], progress: Progress = no_progress) -> Any:
    """Return the discretisation of a scene; ``progress`` receives the stage and the share of it that is done.

    Raises SceneError if the form cannot solve the scene, InputError, SceneError or ResolutionError if the lattice's
    origin, a boundary, a condition or the spacing does not fit, and with ``refine="auto"`` the errors of solves too.
    """
    form = discretize_part(scene, options, progress)
    forms = form.forms if scene.surface.manifold_dim is None else (form,)
    if any(needs_rims(part.scene) for part in forms):
        check_parts_used(scene.edge, [condition.law for part in forms for condition in part.conditions])
    return form


def discretize_part(scene: Scene, options: Options[GalerkinOptions], progress: Progress) -> Any:
    """Return the discretisation of a scene as :func:`discretize`, without a check that all parts of the edge occur."""
    check(scene, options)
    SolveMemory(scene, options).check_samples_fit()
    progress("samples", 0.0)
    if scene.surface.manifold_dim is None:
        return discretize_union(scene, options, progress, discretize_part)
    if scene.surface.manifold_dim == scene.surface.dim:
        return discretize_solid(scene, options, progress)
    inserted = insert_scene(scene, options)
    if options.own.refine == "auto":
        return refine_adaptively(scene, options, inserted, progress)
    progress("samples", 0.5)
    sampled = sample_scene(scene, options, inserted)
    del inserted
    progress("samples", 1.0)
    progress("space", 0.0)
    samples: Any = sampled.samples
    degree = options.own.degree
    dof_map = build_dof_map(samples.points, sampled.corners, options.spacing, samples.cell, degree, sampled.tied)
    sampled = replace(sampled, samples=QuantisedSamples.of(samples, dof_map))
    del samples  # quantised: the samples themselves are released
    stabilisation = STABILISATIONS[degree][options.own.stabilisation]
    parts = build_spline_space(dof_map, sampled.samples), sampled.interior, stabilisation
    space = EnrichedSpace(*parts, sampled.singular) if sampled.singular else FunctionSpace(*parts)
    form = galerkin(scene, options, sampled, space)
    release_memory()
    progress("space", 1.0)
    return form


def discretize_solid(scene: Scene, options: Options[GalerkinOptions], progress: Progress) -> Galerkin:
    """Return the discretisation of a scene on a solid; ``progress`` receives the stage and the share that is done."""
    sampled = sample_solid(scene, options)
    progress("samples", 1.0)
    progress("space", 0.0)
    samples: Any = sampled.samples
    sampled = replace(sampled, samples=QuantisedSamples.of(samples, sampled.dof_map))
    splines = build_spline_space(sampled.dof_map, sampled.samples, np.arange(sampled.patches.cut))
    parts = splines, sampled.interior, SOLID_STABILISATIONS[options.own.stabilisation]
    space = EnrichedSpace(*parts, sampled.singular, sampled.near_tips) if sampled.singular else FunctionSpace(*parts)
    form = galerkin(scene, options, sampled, space)
    release_memory()
    progress("space", 1.0)
    return form


def refine_adaptively(
    scene: Scene, options: Options[GalerkinOptions], inserted: InsertedScene, progress: Progress
) -> Galerkin:
    """Return the discretisation of a scene on splines that are finer where the scene's solution needs them.

    ``inserted`` is the manifold's mesh with the boundaries. At most `MOST_PASSES` times the scene is solved, and the
    patches with large residuals are marked and subdivided. This ends earlier if the first solve shows that refinement
    would save too few unknowns, if most of the marked residual is on the finest level, or if too many patches are
    marked. ``progress`` receives the share that is done.
    """
    regions, most = Regions(options.spacing, scene.surface.dim), options.own.refine_levels
    progress("refinement", 0.0)
    form = discretize_in_regions(scene, options, inserted, regions)
    gain, solves = 0.0, 0
    for passes in range(1, MOST_PASSES + 1):
        squares = residual_squares(form, solve_for_marking(form))
        if passes == 1:
            gain = expected_gain(form, squares)
            if gain < LEAST_GAIN:
                solves = 1
                break
        marked, dof_map = mark_patches(squares), cast("RefinedDofMap", form.space.dof_map)
        open_patches = marked & (dof_map.levels < most)
        spread = marked.sum() > MOST_MARKED_SHARE * len(marked)
        if spread or squares[open_patches].sum() < OPEN_SHARE * squares[marked].sum():
            break
        regions = regions.with_subdivided(dof_map.levels[open_patches], dof_map.cells[open_patches], most)
        form, solves = discretize_in_regions(scene, options, inserted, regions), passes
        release_memory()
        progress("refinement", passes / MOST_PASSES)
    progress("refinement", 1.0)
    space: Any = form.space  # refined
    return galerkin(scene, options, form.sampled, replace(space, gain=gain, passes=solves))


def discretize_in_regions(
    scene: Scene, options: Options[GalerkinOptions], inserted: InsertedScene, regions: Regions
) -> Galerkin:
    """Return the discretisation of a scene with inserted boundaries, on splines that are refined in ``regions``."""
    sampled = sample_scene(scene, options, inserted, regions)
    samples: Any = sampled.samples
    first = build_dof_map(samples.points, sampled.corners, options.spacing, samples.cell, tied=sampled.tied)
    levels = level_splines(first, samples.points, sampled.corners, samples.cell, regions)
    stabilisation = STABILISATIONS[2][options.own.stabilisation]
    interior, tied = sampled.interior, sampled.tied
    space = build_refined_space(samples, interior, sampled.corners, levels, regions, stabilisation, tied)
    return galerkin(scene, options, replace(sampled, samples=space.splines.samples), space)


def solve_for_marking(form: Galerkin) -> Floats:
    """Return the solution (n, channels) of a steady scene, with a relative residual that suffices for marking."""
    stiffness = form.stiffness(form.scene.problem.terms())
    free = form.free_constants(stiffness)
    operator: Any = stiffness if free is None else Bordered(stiffness, free)
    b = form.load(form.scene.problem.terms().f) + form.condition_load(stiffness)
    prepared = make_solver(form.traits.iterative_solver, {}).prepare(operator, form.levels(operator))
    values, _ = ConstantFunctions.from_functions(operator, form.constant).solve(prepared, b, MARKING_TOLERANCE)
    return form.remove_constants(operator, b, values)[0]


def residual_squares(form: Galerkin, u: Floats) -> Floats:
    """Return for each patch (p,) the integral over it of the square of h_l^2 times the residual of ``u`` (n, channels).

    h_l is the spacing of the patch, in units of h. The residual is f + div(a grad u) - c u, f without a functional. The
    squares of each channel are divided by their integral over the manifold, so that units of channels do not matter,
    and then summed over channels. The result indicates where the local error is large, not how large it is.
    """
    terms, points = form.scene.problem.terms(), form.points.copy()
    function = terms.f.beside if isinstance(terms.f, Functional) else terms.f
    f = evaluate_data(function, points, u.shape[1], "the right-hand side f")
    c = evaluate_data(terms.c, points, 1, "the factor c")
    a = evaluate_data(terms.diffusivity, points, 1, "the diffusivity")
    residual = f + a * _laplacian(form, u) - c * form.at_points(u)
    if callable(terms.diffusivity):
        step = SLOPE_STEP_SHARE * form.spacing * np.eye(points.shape[1])
        values = [evaluate_data(terms.diffusivity, points + shift, 1, "the diffusivity") for shift in (*step, *-step)]
        ahead, behind = np.split(np.concatenate(values, axis=1), 2, axis=1)
        gradient = (ahead - behind) / (2 * SLOPE_STEP_SHARE * form.spacing)
        residual += np.einsum("qd,qcd->qc", gradient, form.gradient(u))
    squares = residual**2
    sums = form.point_weights @ squares
    shares = squares @ (1 / np.where(sums > 0, sums, 1.0)) * form.point_weights
    dof_map = form.space.dof_map
    patches = np.arange(len(dof_map.cells))
    return (
        np.bincount(dof_map.patch[: len(shares)], shares, minlength=len(patches)) / dof_map.magnification(patches) ** 4
    )


def _laplacian(form: Galerkin, u: Floats) -> Floats:
    """Return Lap u (p, channels) at samples of a surface: the sum of the second derivatives along two tangents.

    It is tr(P H P), H the Hessian of the splines, of degree 2, and P the tangential projection; u is (n, channels).
    """
    dof_map, samples = form.space.dof_map, form.sampled.samples
    coefficients, laplacian = form.space.to_coefficients(u), np.zeros((form.sampled.interior, u.shape[1]))
    for start in range(0, len(laplacian), SAMPLES_AT_ONCE):
        some = slice(start, min(start + SAMPLES_AT_ONCE, len(laplacian)))
        patch, normals = dof_map.patch[some], samples.normals_at(some)[:, 0]
        t = dof_map.magnify(patch, samples.points_at(some)) / dof_map.spacing - dof_map.cells[patch] + 0.5
        # by the order of the derivative (q, axis, spline)
        splines = spline_values(t, 2), spline_slopes(t, 2), np.broadcast_to([1.0, -2.0, 1.0], (*t.shape, 3))
        of_patch = coefficients[dof_map.unknowns[patch]].reshape(len(t), 3, 3, 3, -1)
        for i, j in np.ndindex(3, 3):
            x, y, z = (splines[(axis == i) + (axis == j)][:, axis] for axis in range(3))
            second = np.einsum("qabcs,qa,qb,qc->qs", of_patch, x, y, z, optimize=True)
            laplacian[some] += (float(i == j) - normals[:, i] * normals[:, j])[:, None] * second
        laplacian[some] *= (dof_map.magnification(patch)[:, None] / dof_map.spacing) ** 2
    return laplacian


def mark_patches(squares: Floats) -> Bools:
    """Return whether (p,) each patch is marked: the fewest whose ``squares`` (p,) have half the sum (Doerfler)."""
    order = np.argsort(-squares, kind="stable")
    total = np.cumsum(squares[order])
    marked = np.zeros(len(squares), dtype=bool)
    if total[-1] > 0:
        marked[order[: int(np.searchsorted(total, MARKED_SHARE * total[-1])) + 1]] = True
    return marked


def expected_gain(form: Galerkin, squares: Floats) -> float:
    """Return the factor by which patches of adapted sizes are expected to reduce the unknowns at the same error.

    Let patches of areas w_p have the ``squares`` (p,) e_p, which fall like h^(2 k), k = 3, while unknowns grow like
    h^-2. The unknowns are fewest for a given sum of squares if h_p^2 is proportional to (w_p / e_p)^(1 / (k + 1)). The
    gain is ``(sum w)(sum e)^(1/k) / (sum w^(k/(k+1)) e^(1/(k+1)))^((k+1)/k)``, or 1 where all squares are zero.
    """
    dof_map, k = form.space.dof_map, ORDER
    area = np.bincount(dof_map.patch, form.sampled.samples.weights, minlength=len(dof_map.cells))
    if not squares.sum() > 0:
        return 1.0
    best = np.sum(area ** (k / (k + 1)) * squares ** (1 / (k + 1))) ** ((k + 1) / k)
    return float(area.sum() * squares.sum() ** (1 / k) / best)
