"""Keys of scene files: those of factories, read from signatures and docstrings, and those of applications."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from cpmkit.runtime.deprecation import DeprecatedMember

#: Summaries of keys that many factories share and that their docstrings leave out.
SHARED_KEYS = {
    "order": "Overrides the discretisation's order for this condition.",
    "resolution": "How many cells the lattice of samples has along the longest side of the bounds.",
    "bounds": "The lower and upper corner of a box that holds the source.",
    "rotation": "Turns it about the origin: an angle in radians, in space a vector along the axis, or a matrix.",
    "scale": "Multiplies all coordinates, before the translation.",
    "translation": "A vector that is added to all points.",
    "trim": "A formula in x, y, z: the part where it is at most zero is kept.",
}
#: Names of Python's plain types in JSON schemas.
JSON_TYPES = {"float": "number", "int": "integer", "str": "string", "bool": "boolean", "None": "null"}


@dataclass(frozen=True)
class Key:
    """A key of a kind in scene files."""

    name: str
    type: str  #: Type in words, or as declared.
    declared: str  #: Type in the signature.
    needed: bool  #: True if the key has no default.
    default: Any  #: object: the default; None if there is none or it is a function.
    summary: str  #: One sentence, "" if the docstring has none.
    told = DeprecatedMember("summary")

    def __str__(self) -> str:
        default = "needed" if self.needed else f"default {self.default!r}"
        return f"{self.name} ({self.type or 'any'}, {default})" + (f": {self.summary}" if self.summary else "")


def keys_of(make: Callable[..., Any]) -> tuple[Key, ...]:
    """Return the keys in scene files of the kind that a factory or class makes: its parameters by name.

    Keys are in the order of the signature, without ``*args`` and ``**keywords``. Types and summaries come from the
    sections Parameters and Attributes of the docstring, or else from the signature and :data:`SHARED_KEYS`.
    """
    documented = {**_documented_parameters(make, "Parameters"), **_documented_parameters(make, "Attributes")}
    keys = []
    for name, parameter in inspect.signature(make).parameters.items():
        if parameter.kind in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL):
            continue
        needed = parameter.default is parameter.empty
        annotation = "" if parameter.annotation is parameter.empty else parameter.annotation
        declared = annotation.__name__ if isinstance(annotation, type) else str(annotation).strip("'")
        types, summary = documented.get(name, ("", ""))
        summary = summary or SHARED_KEYS.get(name, "")
        default = None if needed or callable(parameter.default) else parameter.default
        keys.append(Key(name, types or JSON_TYPES.get(declared, declared), declared, needed, default, summary))
    return tuple(keys)


def first_sentence(text: str | None) -> str:
    """Return the first sentence of a docstring, or its first paragraph, on one line; links become plain names."""
    paragraph = " ".join(inspect.cleandoc(text or "").split("\n\n")[0].split())
    paragraph = re.sub(r":[\w:]+:`~?([^`]+)`", lambda link: link[1].rpartition(".")[2], paragraph)
    sentence = re.match(r"(.*?[.!?])(?= [A-Z`]|$)", paragraph)
    return sentence[1] if sentence else paragraph


def _documented_parameters(make: Callable[..., Any], section: str) -> dict[str, tuple[str, str]]:
    """Return pairs (type, first sentence) of parameters in a ``section`` of ``make``'s docstring, by name, or {}."""
    doc = inspect.cleandoc(make.__doc__ or "")
    heading = re.search(rf"^{section}\n-+\n", doc, re.MULTILINE)
    if not heading:
        return {}
    body = re.split(r"\n\n\w[\w ]*\n-+\n", doc[heading.end() :])[0]
    parameters: dict[str, tuple[str, str]] = {}
    for entry in re.split(r"\n(?=\S)", body):
        head, _, words = entry.partition("\n")
        names, _, types = head.partition(" : ")
        for name in names.split(","):
            parameters[name.strip()] = (types.strip(), first_sentence(words))
    return parameters


#: JSON schemas of values.
_PLACE = {"description": "A point, or a list of points.", "type": "array"}
_IMAGE = {"description": "A point of the target, or of a curve one formula a coordinate.", "type": "array"}
_DIRECTION = {
    "description": "tangent, backwards, left or right; a vector; or one formula a coordinate.",
    "type": ["string", "array"],
}
_COLOURS = {
    "description": "A colour; colours along the curve; { formula = [...] }; { neumann = 0 } where nothing passes.",
    "type": ["string", "array", "object"],
}


@dataclass(frozen=True)
class ApplicationKeys:
    """The tables and keys of an application in scene files, with the JSON schema of each key's value."""

    entry: str  #: Name of the list of tables; each table describes a curve, with the keys of its kind, or points.
    #: on_curve, at_points: Further keys of a table that describes a curve, and all keys of one that describes points.
    on_curve: dict[str, Any]
    at_points: dict[str, Any] = field(default_factory=dict)
    table: str = ""  #: Name of the table of the application's options.
    options: dict[str, Any] = field(default_factory=dict)  #: The keys of that table.
    has_target: bool = False  #: Whether the table [target] is needed.

    @property
    def tables(self) -> tuple[str, ...]:
        """The names of the tables of the application."""
        return (self.entry, *([self.table] if self.table else []), *(["target"] if self.has_target else []))


#: The keys of each application, by its command.
APPLICATIONS = {
    "vectors": ApplicationKeys(
        "direction",
        dict.fromkeys(("along", "left", "right"), _DIRECTION),
        {"at": _PLACE, "vector": {"description": "At all of these points, or one for each.", "type": "array"}},
        "vectors",
        {"transport": {"description": "How vectors go on.", "enum": ["parallel", "paper"]}},
    ),
    "map": ApplicationKeys(
        "landmark",
        {"to": _IMAGE},
        {"at": _PLACE, "to": _IMAGE},
        "map",
        {
            "initial": {"description": "nearest; one formula a coordinate; or { values = FILE }, a row a vertex."},
            "method": {"enum": ["implicit", "explicit"]},
            "step": {"description": "Of time.", "type": "number"},
            "most_steps": {"description": "After which the run ends.", "type": "integer"},
            "rest": {
                "description": "It ends where a step lowers the energy by less than this share of it.",
                "type": "number",
            },
            "texture": {
                "description": "Of the target: one formula a channel, three for a colour, or { values = FILE }."
            },
        },
        has_target=True,
    ),
    "paint": ApplicationKeys(
        "curve",
        {
            "name": {"description": "For reports.", "type": "string"},
            **dict.fromkeys(("both", "left", "right"), _COLOURS),
        },
    ),
}
