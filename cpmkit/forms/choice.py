"""Which form discretises a scene, and its options, read off what is given for all of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import Any

from cpmkit.errors import InputError, shown
from cpmkit.forms.collocation.options import CollocationOptions, refuse_removed
from cpmkit.forms.galerkin.options import FAMILIES, GalerkinOptions
from cpmkit.forms.options import AUTO, Options
from cpmkit.grid.fitting import needed_spacing
from cpmkit.manifold.abilities import has_finite_feet
from cpmkit.manifold.local_source import largest_dim
from cpmkit.runtime.messages import did_you_mean
from cpmkit.runtime.options import DeclaredOptions, Option, declared_options, either_option, split_options
from cpmkit.scene.equations_in_time import Wave
from cpmkit.scene.scene import Scene

#: The options of each form, by its name.
FORMS: dict[str, type[DeclaredOptions]] = {"collocation": CollocationOptions, "galerkin": GalerkinOptions}
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
    own, rest = split_options(FORMS[form], given)
    target, rest = split_options(
        Options, rest, spacing=needed_spacing(scene.surface, spacing), own=own, form=form, reason=reason
    )
    return target, {name: value for name, value in rest.items() if name != "form"}


def choose_form(scene: Scene, given: Mapping[str, Any]) -> tuple[str, str]:
    """Return the form that discretises a scene, and why it is that one.

    Raises
    ------
    InputError
        If there is no such form, or one of the options ``given`` is of another form only.
    """
    target = given.get("form", AUTO)
    named = form_named(target, given)
    if named is not None:
        return named, "as asked" if target != AUTO else f"the only one with {_deciding(given)}"
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

    Of an option that several forms have, as ``degree``, a value that only one accepts says it, where values are given.

    Raises
    ------
    InputError
        If there is no such form, or the options belong to another one, or to several.
    """
    if not isinstance(form, str) or (form not in FORMS and form != AUTO):
        near = did_you_mean(form, (*FORMS, AUTO))
        raise InputError(f"form must be {', '.join(map(repr, FORMS))} or {AUTO!r}, got {shown(form)}{near}.")
    refuse_removed(names)
    chosen = None if form == AUTO else form
    for name in sorted(names, key=lambda name: len(_having(name))):  # what one form has says more than a value
        having, fitting = _having(name), _fitting(name, names)
        if len(fitting) == 1 and chosen is None:
            chosen = fitting[0]
        elif having and chosen is not None and chosen not in having:
            raise InputError(
                f"{name} is an option of the form {having[0]!r}, got form={chosen!r}, which takes "
                f"{', '.join(declared_options(FORMS[chosen]))}; leave it out, or use form={having[0]!r}."
            )
    return chosen


def own_options(given: Mapping[str, Any]) -> tuple[DeclaredOptions, tuple[str, ...]]:
    """Return the options that belong to the form among those ``given`` without a scene, and the names it accepts.

    Where neither ``form`` nor another option decides, the options of every form are accepted, and none is given.
    """
    named = form_named(given.get("form", AUTO), given)
    kinds = [FORMS[named]] if named is not None else list(FORMS.values())
    return split_options(kinds[0], given)[0], tuple(name for kind in kinds for name in declared_options(kind))


def _having(name: str) -> list[str]:
    """Return the forms that have an option."""
    return [form for form, kind in FORMS.items() if name in declared_options(kind)]


def _fitting(name: str, given: Iterable[str]) -> list[str]:
    """Return those of them that accept the value that is ``given`` of it, or all of them."""
    having = _having(name)
    if len(having) < 2 or not isinstance(given, Mapping):
        return having
    return [form for form in having if declared_options(FORMS[form])[name].accepts(given[name])]


def _deciding(given: Mapping[str, Any]) -> str:
    """Return the first option that only one form has, or takes, in words."""
    deciding = [name for name in given if len(_fitting(name, given)) == 1]
    name = min(deciding, key=lambda name: len(_having(name)))
    return f"the option {name!r}" if len(_having(name)) == 1 else f"{name}={given[name]!r}"


def every_option() -> dict[str, Option]:
    """Return the options of all forms, and those that they share, by their names; accepted is what one form accepts."""
    found = dict(declared_options(Options))
    for kind in FORMS.values():
        for name, one in declared_options(kind).items():
            found[name] = (
                either_option(found[name], one) if name in found and name not in declared_options(Options) else one
            )
    return found
