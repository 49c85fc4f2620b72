"""Checks of which scenes the Galerkin form can discretise; others are refused before anything is built."""

from __future__ import annotations

from cpmkit.errors import SceneError
from cpmkit.forms.galerkin.options import FAMILIES, GalerkinOptions
from cpmkit.forms.options import Options
from cpmkit.manifold.abilities import has_finite_feet
from cpmkit.scene.diffusivities import StateDiffusivity
from cpmkit.scene.laws import Nonlinear
from cpmkit.scene.scene import Scene


def check(scene: Scene, options: Options[GalerkinOptions]) -> None:
    """Raise if the form, with these options, cannot discretise a scene.

    Raises
    ------
    SceneError
        If the form cannot; the message has the reason and advice.
    """
    problem, surface = scene.problem, scene.surface
    if problem.family not in FAMILIES:
        raise SceneError(f"the form {options.form!r} does not yet solve {problem.kind!r}; use form='collocation'.")
    if problem.terms().velocity is not None and options.own.tips == "singular":
        raise SceneError(
            "tips='singular' takes no velocity: what u is like at the end of a boundary that is flown past is not "
            "known; use tips='extended'."
        )
    if problem.terms().velocity is not None and scene.has_tensor:
        raise SceneError(
            f"the form {options.form!r} takes no velocity beside a diffusivity that is a tensor; give one that is a "
            "number or a function that returns numbers."
        )
    if options.own.refine == "auto":
        check_refined(scene, options)
    orders = [condition.order for condition in scene.conditions if condition.order is not None]
    if orders:
        raise SceneError(
            f"conditions of the form {options.form!r} have no order, got order={orders[0]}; leave it out, or use "
            "form='collocation'."
        )
    if surface.manifold_dim not in range(1, surface.dim):
        raise SceneError(
            f"the form {options.form!r} takes curves and surfaces of one dimension, got a manifold of dimension "
            f"{surface.manifold_dim} in {surface.dim}D; use form='collocation'."
        )
    if has_finite_feet(surface):
        raise SceneError(
            f"the form {options.form!r} integrates over the manifold, and closest points on this one are single "
            "samples; fit a surface to them, or use form='collocation'."
        )


def check_refined(scene: Scene, options: Options[GalerkinOptions]) -> None:
    """Raise if a scene cannot be discretised on refined splines.

    Raises
    ------
    SceneError
        If it cannot; the message has the reason and the advice to use ``refine='off'``.
    """
    problem, terms = scene.problem, scene.problem.terms()
    reasons = {
        "no channels that are tied to each other": problem.family == "coupled",
        f"steady problems, got {problem.kind!r}: others move what asks for finer splines": problem.family != "steady",
        "surfaces, got a curve: a smaller spacing costs little there": scene.surface.manifold_dim == 1,
        "no velocity: upwinding goes by one spacing": terms.velocity is not None,
        "no diffusivity that is a tensor or depends on u": scene.has_tensor
        or isinstance(terms.diffusivity, StateDiffusivity),
        "no conditions that depend on u": any(isinstance(condition.law, Nonlinear) for condition in scene.conditions),
        f"splines of degree 2, got degree={options.own.degree}": options.own.degree != 2,
        "tips='extended' alone: the ends of boundaries are refined": options.own.tips == "singular",
    }
    for reason, holds in reasons.items():
        if holds:
            raise SceneError(f"refine='auto' takes {reason}; use refine='off'.")
