"""Discretisation of a scene in the Galerkin form, on splines of one level or on refined splines."""

from __future__ import annotations

from dataclasses import replace

from cpmkit.forms.galerkin.adaptive_refinement import refine_adaptively
from cpmkit.forms.galerkin.dof_map import build_dof_map
from cpmkit.forms.galerkin.enrichment.enriched_space import EnrichedSpace
from cpmkit.forms.galerkin.form import Galerkin, galerkin
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.galerkin.scene_sampling import SampledScene, sample_scene
from cpmkit.forms.galerkin.space.energy import STABILISATIONS_OF_DEGREE
from cpmkit.forms.galerkin.space.function_space import FunctionSpace
from cpmkit.forms.galerkin.space.quantised_samples import QuantisedSamples
from cpmkit.forms.galerkin.space.spline_space import build_spline_space
from cpmkit.forms.galerkin.supported_scenes import check as check
from cpmkit.forms.options import Options
from cpmkit.mesh.cell_quadrature import Samples
from cpmkit.runtime.memory import release_memory
from cpmkit.scene.scene import Scene
from cpmkit.types import Progress, no_progress


def discretize(scene: Scene, options: Options[GalerkinOptions], progress: Progress = no_progress) -> Galerkin:
    """Return the discretisation of a scene; ``progress`` receives the stage and the share of it that is done.

    Raises
    ------
    InputError, SceneError, ResolutionError
        If the lattice's origin, a boundary or the spacing does not fit.
    """
    check(scene, options)
    if options.own.refine == "auto":
        return refine_adaptively(scene, options, progress)
    return discretize_on_one_level(scene, options, progress)


def discretize_on_one_level(
    scene: Scene, options: Options[GalerkinOptions], progress: Progress = no_progress
) -> Galerkin:
    """Return the discretisation of a scene on splines of one level, whatever the option ``refine``.

    Raises
    ------
    InputError, SceneError, ResolutionError
        As :func:`discretize` does.
    """
    check(scene, options)
    sampled = sample_scene(scene, options, progress)
    progress("space", 0.0)
    sampled, space = build_space(sampled, options)
    form = galerkin(scene, options, sampled, space)
    release_memory()
    progress("space", 1.0)
    return form


def build_space(sampled: SampledScene, options: Options[GalerkinOptions]) -> tuple[SampledScene, FunctionSpace]:
    """Return a sampled scene and its function space: splines of one spacing, with singular functions if it has any.

    The scene is returned with quantised samples, so that the samples themselves can be released.
    """
    samples, degree = sampled.samples, options.own.degree
    assert isinstance(samples, Samples)
    dof_map = build_dof_map(samples.points, sampled.corners, options.spacing, samples.cell, degree)
    sampled = replace(sampled, samples=QuantisedSamples.of(samples, dof_map))
    stabilisation = STABILISATIONS_OF_DEGREE[degree][options.own.stabilisation]
    parts = build_spline_space(dof_map, sampled.samples), sampled.interior, stabilisation
    return sampled, EnrichedSpace(*parts, sampled.singular) if sampled.singular else FunctionSpace(*parts)
