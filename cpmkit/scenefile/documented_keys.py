"""What a factory takes, read off its signature and its docstring: keys, types, defaults, and a sentence on each."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cpmkit.runtime.deprecation import DeprecatedMember

#: Sections of a docstring in which parameters are told.
TOLD_SECTIONS = ("Parameters", "Attributes")
#: A link of Sphinx.
LINK = re.compile(r":[\w:]+:`~?([^`]+)`")
#: What keys are that many factories share, and that are told where they are taken.
SHARED_KEYS = {
    "order": "Overrides the discretisation's order for this condition.",
    "resolution": "How many cells the lattice of samples has along the longest side of the bounds.",
    "bounds": "The lower and upper corner of a box that holds the source.",
    "rotation": "Turns it about the origin: an angle in radians, in space a vector along the axis, or a matrix.",
    "scale": "Multiplies all coordinates, before the translation.",
    "translation": "A vector that is added to all points.",
    "trim": "A formula in x, y, z: the part where it is at most zero is kept.",
}


@dataclass(frozen=True)
class Key:
    """One key of a kind: what it accepts, its default, and a sentence.

    Attributes
    ----------
    name : str
    type : str
        In words, or as it is declared.
    declared : str
        As the signature has it.
    needed : bool
        Whether it has no default.
    default : object
        Where it is not needed.
    summary : str
        One sentence, empty where the factory tells none.
    """

    name: str
    type: str
    declared: str
    needed: bool
    default: Any
    summary: str
    told = DeprecatedMember("summary")

    def __str__(self) -> str:
        default = "needed" if self.needed else f"default {self.default!r}"
        return f"{self.name} ({self.type or 'any'}, {default})" + (f": {self.summary}" if self.summary else "")


def keys_of(make: Callable[..., Any]) -> tuple[Key, ...]:
    """Return the keys that a factory, or a class, takes."""
    summary = {name: words for section in TOLD_SECTIONS for name, words in _told_in(make, section).items()}
    found = []
    for name, parameter in inspect.signature(make).parameters.items():
        if parameter.kind in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL):
            continue
        needed = parameter.default is parameter.empty
        declared = "" if parameter.annotation is parameter.empty else str(parameter.annotation).strip("'")
        types, words = summary.get(name, ("", ""))
        words = words or SHARED_KEYS.get(name, "")
        default = None if needed or callable(parameter.default) else parameter.default
        found.append(Key(name, types or declared, declared, needed, default, words))
    return tuple(found)


def first_sentence(text: str | None) -> str:
    """Return the first sentence of a docstring, on one line, with plain names in place of its links."""
    paragraph = " ".join(inspect.cleandoc(text or "").split("\n\n")[0].split())
    paragraph = LINK.sub(lambda found: found[1].rpartition(".")[2], paragraph)
    ended = re.match(r"(.*?[.!?])(?= [A-Z`]|$)", paragraph)
    return ended[1] if ended else paragraph


def _told_in(make: Callable[..., Any], section: str) -> dict[str, tuple[str, str]]:
    """Return the type and the first sentence of each parameter that a section of a docstring tells."""
    doc = inspect.cleandoc(make.__doc__ or "")
    begun = re.search(rf"^{section}\n-+\n", doc, re.MULTILINE)
    if not begun:
        return {}
    body = re.split(r"\n\n\w[\w ]*\n-+\n", doc[begun.end() :])[0]
    found: dict[str, tuple[str, str]] = {}
    for entry in re.split(r"\n(?=\S)", body):
        head, _, words = entry.partition("\n")
        names, _, types = head.partition(" : ")
        for name in names.split(","):
            found[name.strip()] = (types.strip(), first_sentence(words))
    return found
