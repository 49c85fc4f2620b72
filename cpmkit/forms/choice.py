"""Which form discretises a scene, and its options, read off what is given for all of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import Any

from cpmkit.errors import InputError, shown
from cpmkit.forms.collocation.options import CollocationOptions
from cpmkit.forms.galerkin.options import FAMILIES, GalerkinOptions
from cpmkit.forms.options import AUTO, Options
from cpmkit.grid.fitting import needed_spacing
from cpmkit.manifold.abilities import has_finite_feet
from cpmkit.manifold.local_source import largest_dim
from cpmkit.runtime.declared import Declared, Option, declared, take
from cpmkit.scene.equations_in_time import Wave
from cpmkit.scene.scene import Scene

#: The options of each form, by its name.
FORMS: dict[str, type[Declared]] = {"collocation": CollocationOptions, "galerkin": GalerkinOptions}
#: Where each is discretised.
MODULES = {"collocation": "cpmkit.forms.collocation.form", "galerkin": "cpmkit.forms.galerkin.discretizing"}
#: The form that ``auto`` means where nothing in the scene or the options decides.
DEFAULT_FORM = "galerkin"


def module_of(form: str) -> Any:
    """Return a form's module: ``check(scene, options)`` refuses, ``discretize(scene, options, progress)`` makes."""
    return import_module(MODULES[form])


def options_of(scene: Scene, spacing: float | None, given: Mapping[str, Any]) -> tuple[Options[Any], dict[str, Any]]:
    """Return the options among the keyword arguments ``given``, and the other arguments.

    Raises
    ------
    InputError
        If there is no spacing, an option is of another form, or a value is not accepted.
    """
    form, reason = choose_form(scene, given)
    own, rest = take(FORMS[form], given)
    asked, rest = take(Options, rest, spacing=needed_spacing(scene.surface, spacing), own=own, form=form, reason=reason)
    return asked, {name: value for name, value in rest.items() if name != "form"}


def choose_form(scene: Scene, given: Mapping[str, Any]) -> tuple[str, str]:
    """Return the form that discretises a scene, and why it is that one.

    Raises
    ------
    InputError
        If there is no such form, or one of the options ``given`` is of another form only.
    """
    asked = given.get("form", AUTO)
    named = form_named(asked, given)
    if named is not None:
        return named, "as asked" if asked != AUTO else f"the only one with the option {_deciding(given)!r}"
    surface, family, kind = scene.surface, scene.problem.family, scene.problem.kind
    if surface.manifold_dim is None:
        return "collocation", "the manifold has parts of several dimensions"
    if largest_dim(surface) in (0, surface.dim):
        return "collocation", "the manifold is neither a curve nor a surface"
    if has_finite_feet(surface):
        return "collocation", "closest points are single samples, over which nothing can be integrated"
    if isinstance(scene.problem, Wave) and scene.problem.scheme == "leapfrog":
        return "collocation", "the only one with explicit steps"
    if family not in FAMILIES:
        return "collocation", f"the form 'galerkin' does not yet carry {kind!r}"
    if any(one.order is not None for one in scene.conditions):
        return "collocation", "the only one with orders of conditions"
    return DEFAULT_FORM, "the one for curves and surfaces"


def form_named(form: Any, names: Iterable[str] = ()) -> str | None:
    """Return the form that is asked for, or the only one that has all the options ``names``; None where neither says.

    Raises
    ------
    InputError
        If there is no such form, or the options belong to another one, or to several.
    """
    if not isinstance(form, str) or (form not in FORMS and form != AUTO):
        raise InputError(f"form must be {', '.join(map(repr, FORMS))} or {AUTO!r}, got {shown(form)}.")
    chosen = None if form == AUTO else form
    for name in names:
        having = [other for other, kind in FORMS.items() if name in declared(kind)]
        if len(having) == 1 and chosen is None:
            chosen = having[0]
        elif having and chosen is not None and chosen not in having:
            raise InputError(
                f"{name} is an option of the form {having[0]!r}, got form={chosen!r}, which takes "
                f"{', '.join(declared(FORMS[chosen]))}; leave it out, or use form={having[0]!r}."
            )
    return chosen


def own_options(given: Mapping[str, Any]) -> tuple[Declared, tuple[str, ...]]:
    """Return the options that belong to the form among those ``given`` without a scene, and the names it accepts.

    Where neither ``form`` nor another option decides, the options of every form are accepted, and none is given.
    """
    named = form_named(given.get("form", AUTO), given)
    kinds = [FORMS[named]] if named is not None else list(FORMS.values())
    return take(kinds[0], given)[0], tuple(name for kind in kinds for name in declared(kind))


def _deciding(given: Mapping[str, Any]) -> str:
    """Return the first option that only one form has."""
    return next(name for name in given if sum(name in declared(kind) for kind in FORMS.values()) == 1)


def every_option() -> dict[str, Option]:
    """Return the options of all forms, and those that they share, by their names."""
    return {name: one for kind in FORMS.values() for name, one in (declared(Options) | declared(kind)).items()}
