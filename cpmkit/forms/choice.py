"""Choice of the form that discretises a scene, and the options that belong to the form."""

from __future__ import annotations

import traceback
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib import import_module
from typing import Any, Protocol

from cpmkit.errors import InputError, ResolutionError, SceneError, shown
from cpmkit.forms.collocation.options import CollocationOptions, refuse_removed
from cpmkit.forms.contract import Discretized
from cpmkit.forms.cost_model import CostModel
from cpmkit.forms.galerkin.options import FAMILIES, GalerkinOptions, reason_against
from cpmkit.forms.options import AUTO, Options
from cpmkit.grid.lattice import needed_spacing, other_solver_hint, round_up
from cpmkit.manifold.abilities import has_finite_feet, members_of
from cpmkit.manifold.meetings import meetings_of
from cpmkit.runtime import memory
from cpmkit.runtime.deprecation import current_keywords
from cpmkit.runtime.messages import did_you_mean
from cpmkit.runtime.options import DeclaredOptions, Option, declared_options, either_option, split_options
from cpmkit.scene.equations_in_time import Wave
from cpmkit.scene.junction import Junction, unsupported_junction
from cpmkit.scene.scene import Scene
from cpmkit.types import Progress

#: The options of each form, by its name.
FORMS: dict[str, type[DeclaredOptions]] = {"collocation": CollocationOptions, "galerkin": GalerkinOptions}
#: Old names of options, which work for one release, and the new names.
RENAMED_OPTIONS = {"strength": "stabilisation"}
#: The module of each form, see :func:`module_of`, and the module and class of its cost model.
MODULES = {"collocation": "cpmkit.forms.collocation.form", "galerkin": "cpmkit.forms.galerkin.discretize_scene"}
COST_MODELS = {
    "collocation": ("cpmkit.forms.collocation.collocation_cost", "CollocationCost"),
    "galerkin": ("cpmkit.forms.galerkin.galerkin_cost", "GalerkinCost"),
}
#: Where memory ran out at a spacing that seemed to fit, a spacing this many times as large is advised.
COARSER_SPACING_FACTOR = 1.5


def module_of(form: str) -> Any:
    """Return the module of the form named ``form``, "collocation" or "galerkin", with ``check`` and ``discretize``."""
    return import_module(MODULES[form])


def cost_model(scene: Scene, options: Options[Any]) -> CostModel[Any]:
    """Return the cost model of a scene in the form named by ``options.form``."""
    module, name = COST_MODELS[options.form]
    made: CostModel[Any] = getattr(import_module(module), name)(scene, options)
    return made


def options_of(scene: Scene, spacing: float | None, given: Mapping[str, Any]) -> tuple[Options[Any], dict[str, Any]]:
    """Return the options of a scene's discretisation, from arguments ``given`` by name, and the other arguments.

    ``spacing`` is None if not given. Raises InputError if it is needed, an option belongs to another form, or a value
    is not accepted; warns of old names of options.
    """
    given = current_keywords(given, RENAMED_OPTIONS)
    form, reason = choose_form(scene, given)
    own, rest = split_options(FORMS[form], given)
    target, rest = split_options(
        Options, rest, spacing=needed_spacing(scene.surface, spacing), own=own, form=form, reason=reason
    )
    return target, {name: value for name, value in rest.items() if name != "form"}


def choose_form(scene: Scene, given: Mapping[str, Any]) -> tuple[str, str]:
    """Return the name of the form that discretises a scene with the options ``given``, and in words the reason for it.

    Raises InputError as :func:`form_named` does, and SceneError if members of a union meet and the form 'galerkin'
    does not take the scene.
    """
    target = given.get("form", AUTO)
    named = form_named(target, given)
    if named is not None:
        return named, "as given" if target != AUTO else f"the only one with {_deciding_option(given)}"
    surface, family, kind = scene.surface, scene.problem.family, scene.problem.kind
    if has_finite_feet(surface):
        return "collocation", "closest points are single samples, over which nothing can be integrated"
    if isinstance(scene.problem, Wave) and scene.problem.scheme == "leapfrog":
        return "collocation", "the only one with explicit steps"
    if family not in FAMILIES:
        return "collocation", f"the form 'galerkin' does not yet solve {kind!r}"
    if any(condition.order is not None for condition in scene.conditions):
        return "collocation", "the only one with orders of conditions"
    if surface.manifold_dim in range(1, surface.dim):
        return "galerkin", "the default"
    reason = reason_against(scene, given)
    if reason and unsupported_junction(surface):
        raise SceneError(
            f"{unsupported_junction(surface)}; form='collocation' takes it, and what flows there depends on the "
            "spacing."
        )
    if reason and (scene.junctions != Junction() or meetings_of(surface)):
        raise SceneError(
            f"members of the union meet, and the form 'galerkin', which has laws for that, takes {reason}; change "
            "that, or use form='collocation', where the spacing decides what flows from one member to the other."
        )
    if reason:
        return "collocation", f"the form 'galerkin' takes {reason}"
    if surface.manifold_dim is None:
        return "galerkin", "the default"
    if len(members_of(surface)) > 1:
        return "collocation", "the only one for solids that may overlap"
    if not import_module("cpmkit.forms.galerkin.solids.skin").has_known_boundary(surface):
        return "collocation", "the boundary of the solid is known by its closest points alone"
    return "galerkin", "the default"


def form_named(form: Any, names: Iterable[str] = ()) -> str | None:
    """Return ``form`` if it is a form's name; if "auto", the form that the options ``names`` determine, None if none.

    An option of one form determines that form. If ``names`` maps options to values, an option of several forms, such as
    ``degree``, determines the form too if only one form accepts its value. Names that are no options of a form are
    ignored. Raises InputError if ``form`` names no form, or an option belongs to another form or is no longer offered.
    """
    if not isinstance(form, str) or (form not in FORMS and form != AUTO):
        near = did_you_mean(form, (*FORMS, AUTO))
        raise InputError(f"form must be {', '.join(map(repr, FORMS))} or {AUTO!r}, got {shown(form)}{near}.")
    refuse_removed(names)
    chosen = None if form == AUTO else form
    for name in sorted(names, key=lambda name: len(_forms_with(name))):  # options of one form decide before values
        having, accepting = _forms_with(name), _forms_accepting(name, names)
        if len(accepting) == 1 and chosen is None:
            chosen = accepting[0]
        elif having and chosen is not None and chosen not in having:
            raise InputError(
                f"{name} is an option of the form {having[0]!r}, got form={chosen!r}, which takes "
                f"{', '.join(declared_options(FORMS[chosen]))}; leave it out, or use form={having[0]!r}."
            )
    return chosen


def own_options(given: Mapping[str, Any]) -> tuple[DeclaredOptions, tuple[str, ...]]:
    """Return a form's own options with the values ``given``, and the names of all its own options; for scene files.

    If neither ``form`` nor another option determines the form, the options are those of the first form, and the names
    those of every form. Raises InputError as :func:`form_named` does, or if a value is not accepted.
    """
    named = form_named(given.get("form", AUTO), given)
    kinds = [FORMS[named]] if named is not None else list(FORMS.values())
    return split_options(kinds[0], given)[0], tuple(name for kind in kinds for name in declared_options(kind))


def _forms_with(name: str) -> list[str]:
    return [form for form, kind in FORMS.items() if name in declared_options(kind)]


def _forms_accepting(name: str, given: Iterable[str]) -> list[str]:
    """Return the names of the forms that have the option ``name`` and accept its value in ``given``.

    The value is not considered if only one form has the option, or ``given`` has names without values.
    """
    having = _forms_with(name)
    if len(having) < 2 or not isinstance(given, Mapping):
        return having
    return [form for form in having if declared_options(FORMS[form])[name].accepts(given[name])]


def _deciding_option(given: Mapping[str, Any]) -> str:
    """Return words for the option of ``given`` that determines the form: its name, and its value if several have it."""
    deciding = [name for name in given if len(_forms_accepting(name, given)) == 1]
    name = min(deciding, key=lambda name: len(_forms_with(name)))
    return f"the option {name!r}" if len(_forms_with(name)) == 1 else f"{name}={given[name]!r}"


def every_option() -> dict[str, Option]:
    """Return the options of all forms, common ones included, by name; a shared one accepts the values of each form."""
    options = dict(declared_options(Options))
    for kind in FORMS.values():
        for name, option in declared_options(kind).items():
            shared = name in options and name not in declared_options(Options)
            options[name] = either_option(options[name], option) if shared else option
    return options


@contextmanager
def explain_memory_error(scene: Scene, options: Options[Any] | None = None, solver: str = "auto") -> Iterator[None]:
    """Return a context that replaces errors of exhausted memory by a ResolutionError that advises a spacing that fits.

    Its message has the memory limit and, where it can be estimated, the memory needed. Arrays that the frames of the
    traceback refer to are released first. ``options`` are None for a form without a lattice, for which a coarser mesh
    is advised; ``solver`` is the linear solver's name, or "auto".
    """
    limit = memory.memory_limit()
    try:
        yield
    except Exception as error:
        if not memory.is_out_of_memory(error):
            raise
        traceback.clear_frames(error.__traceback__)
        raise ResolutionError(_memory_sentence(scene, options, solver, limit)) from error


def _memory_sentence(scene: Scene, options: Options[Any] | None, solver: str, limit: memory.MemoryLimit) -> str:
    """Return the message of an out-of-memory error: the memory needed, if known, the ``limit``, and what fits."""
    if options is None:
        return f"Memory ran out, and {limit}; a coarser mesh, or a larger spacing, needs less."
    spacing, needed, hint, fits = options.spacing, "", "", 0.0
    with suppress(MemoryError, ValueError, ArithmeticError):
        model = cost_model(scene, options)
        unknowns = model.band_unknowns(model.surface)
        chosen = model.choose_solver(solver, unknowns)
        size, fits = model.peak_bytes(unknowns, chosen), model.fitting_spacing(chosen, limit.bytes)
        hint = other_solver_hint(chosen, model.smaller_solver)
        needed = f"about {unknowns:.2g} unknowns need {size / 2**30:.2g} GiB or more with the solver {chosen!r}, and "
    fits = max(fits, round_up(COARSER_SPACING_FACTOR * spacing))
    return (
        f"Memory ran out at spacing={spacing:g}: {needed}{limit}, libraries included; "
        f"try spacing={fits:g} or more{hint}."
    )


class Backend(Protocol):
    """A form that a plugin supplies, returned by the plugin's factory in ``cpmkit_backends``.

    The families and linear solvers of the core solve its discretised scenes. ``discretize`` may have further keyword
    arguments: options of the form, which ``solve`` accepts and passes on.
    """

    def discretize(self, scene: Scene, spacing: float | None, *, progress: Progress) -> Discretized:
        """Return the discretised scene; ``spacing`` is None if not given, ``progress`` gets stages and shares done.

        Raises
        ------
        CpmkitError
            If the form cannot discretise the scene; the message names a form that can.
        """
