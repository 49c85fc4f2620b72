"""Which form discretises a scene, and its options, read off what is given for all of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from cpmkit.errors import InputError, shown
from cpmkit.forms.collocation.options import CollocationOptions
from cpmkit.forms.options import Options
from cpmkit.grid.fitting import needed_spacing
from cpmkit.protocols import ClosestPointSource
from cpmkit.runtime.declared import Declared, Option, declared, take

#: The options of each form, by its name.
FORMS: dict[str, type[Declared]] = {"collocation": CollocationOptions}
#: The form that is taken unless another is asked for.
DEFAULT_FORM: str = Options.form


def options_of(
    surface: ClosestPointSource, spacing: float | None, given: Mapping[str, Any]
) -> tuple[Options[Any], dict[str, Any]]:
    """Return the options among the keyword arguments ``given``, and the other arguments.

    Raises
    ------
    InputError
        If there is no spacing, an option is of another form, or a value is not accepted.
    """
    own, rest = take(form_options(given.get("form", DEFAULT_FORM), given), given)
    return take(Options, rest, spacing=needed_spacing(surface, spacing), own=own)


def every_option() -> dict[str, Option]:
    """Return the options of all forms, and those that they share, by their names."""
    return {name: one for kind in FORMS.values() for name, one in (declared(Options) | declared(kind)).items()}


def form_options(form: Any, names: Iterable[str] = ()) -> type[Declared]:
    """Return the class of a form's options.

    Raises
    ------
    InputError
        If there is no such form, or one of ``names`` is an option of another form only.
    """
    if not isinstance(form, str) or form not in FORMS:
        raise InputError(f"form must be {' or '.join(map(repr, FORMS))}, got {shown(form)}.")
    own = declared(FORMS[form])
    for name in names:
        others = [other for other, kind in FORMS.items() if name in declared(kind) and name not in own]
        if others:
            raise InputError(
                f"{name} is an option of the form {others[0]!r}, got form={form!r}, which takes {', '.join(own)}; "
                f"leave it out, or use form={others[0]!r}."
            )
    return FORMS[form]
