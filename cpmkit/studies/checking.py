"""Checks of a study before anything is solved, and the time step that its sweep gives a scene."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

from cpmkit.errors import SceneError
from cpmkit.families.evolution.schedule import ROUNDED_STEP_SHARE
from cpmkit.plugins import factory
from cpmkit.scene.scene import Scene
from cpmkit.studies.baselines import check_fixable
from cpmkit.studies.studyfile import Study
from cpmkit.studies.sweep import BASELINES, REFINED, lattice_methods


def check_study(study: Study) -> None:
    """Raise if a study cannot be run: if its scene, formula, sweep or a back end is not accepted.

    Raises
    ------
    SceneError
        If the scene, the formula or the sweep is not accepted, or the scene's solution is not one function.
    PluginError
        If a method or the reference is neither built in nor offered by a plugin.
    """
    check_comparable(study.scene)
    if study.sweep.spacings is not None:
        at_spacing(study.scene, study.sweep.step_per_spacing, study.sweep.spacings[0])
    if study.solution is not None and study.solution.takes_time and end_of(study.scene) is None:
        raise SceneError(f"u of [exact] depends on t, and the problem {study.scene.problem.kind!r} has no time.")
    for method in study.sweep.methods:
        if method in BASELINES:
            check_fixable(study.scene, method)
    others = [method for method in study.sweep.methods if method not in (*lattice_methods(), *BASELINES)]
    others = ["fem" if method == REFINED else method for method in others]
    for backend in [*others, *([] if study.exact.reference is None else [study.exact.reference])]:
        factory(backend, "cpmkit_backends")


def check_comparable(scene: Scene) -> None:
    """Raise if the solution of a scene is not a single function with one channel.

    Raises
    ------
    SceneError
        If the scene has several channels, or its solution is eigenfunctions, whose factors are arbitrary.
    """
    if scene.problem.family == "eigen":
        raise SceneError("a study compares one function, and an eigenvalue problem has many; solve it without [exact].")
    if scene.channels != 1:
        raise SceneError(f"a study compares one channel, and the scene has {scene.channels}; make a study of each.")


def at_spacing(scene: Scene, step_per_spacing: float | None, spacing: float | None) -> Scene:
    """Return the scene with equal time steps of at most ``step_per_spacing`` times the spacing.

    If one of the two is None, the scene is returned as it is.

    Raises
    ------
    SceneError
        If the scene's problem has no time step.
    """
    if step_per_spacing is None or spacing is None:
        return scene
    problem: Any = scene.problem
    if not {"step", "until"} <= {field.name for field in fields(problem)}:
        raise SceneError(f"step_per_spacing of [sweep] is for problems with a time step, not for {problem.kind!r}.")
    steps = math.ceil(problem.duration / (step_per_spacing * spacing) - ROUNDED_STEP_SHARE)
    return replace(scene, problem=replace(problem, step=problem.duration / max(steps, 1)))


def end_of(scene: Scene) -> float | None:
    """Return the final time of the scene's problem, None if it has no time."""
    return getattr(scene.problem, "until", None)
