"""From a scene and its options to the form: on splines of one level, or of several where that is asked for and pays."""

from __future__ import annotations

from cpmkit.forms.galerkin import form
from cpmkit.forms.galerkin.form import Galerkin
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.galerkin.refinement.adaptive_refinement import refine_adaptively
from cpmkit.forms.options import Options
from cpmkit.scene.scene import Scene
from cpmkit.types import Progress, no_progress

check = form.check


def discretize(scene: Scene, options: Options[GalerkinOptions], progress: Progress = no_progress) -> Galerkin:
    """Discretise a scene on splines; ``progress`` is told the stage and the share of it that is done.

    Raises
    ------
    InputError, SceneError, ResolutionError
        If the lattice's origin, a boundary or the spacing does not fit.
    """
    if options.own.refine == "auto":
        check(scene, options)
        return refine_adaptively(scene, options, progress)
    return form.discretize(scene, options, progress)
