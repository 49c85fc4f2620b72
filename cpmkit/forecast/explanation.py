"""What a solve will build, why each part is there, and what it will cost, before it is built."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from typing import Any

from cpmkit.forecast.parts import Explanation
from cpmkit.forecast.rough import guessed
from cpmkit.forms.choice import FORMS, every_option, module_of, options_of
from cpmkit.forms.options import Options
from cpmkit.linear.solver_options import SolverOptions
from cpmkit.manifold.mixed_dimension import mixed_joint_sentences
from cpmkit.protocols import Progress, no_progress
from cpmkit.runtime.options import document_options
from cpmkit.scene.scene import Scene


@document_options(Options, *FORMS.values(), SolverOptions)
def explain(
    scene: Scene,
    spacing: float | None = None,
    *,
    rehearse: bool = False,
    progress: Progress = no_progress,
    **options: Any,
) -> Explanation:
    """Say what :func:`cpmkit.solve` with the same arguments will build, why, and at what cost.

    A guess from the size of the manifold and its boundaries; with ``rehearse`` it is counted on coarse lattices.

    Raises
    ------
    InputError, SceneError, ResolutionError
        As ``solve`` would.
    """
    target, rest = options_of(scene, spacing, options)
    solver = SolverOptions.of(rest, every_option()).solver
    module_of(target.form).check(scene, target)
    told = mixed_joint_sentences(scene.surface, target.spacing)
    if not rehearse:
        return replace(guessed(scene, target, solver), told=tuple(told))
    explained: Explanation = import_module(f"cpmkit.forecast.of_{target.form}").explained(
        scene, target, solver, progress
    )
    return replace(explained, told=(*told, *explained.told))
