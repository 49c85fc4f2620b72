"""Colours of a side: one, or the stops of a gradient along the path."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Floats, InputError, as_colour, shown
from cpmkit_svg.scanner import NUMBER
from cpmkit_svg.xml_tree import Element

REFERENCE = re.compile(r"url\(\s*['\"]?#([^'\")]+)['\"]?\s*\)")
RGB = re.compile(r"rgb\(\s*(\d{1,3})\s*,\s*(\d{1,3})\s*,\s*(\d{1,3})\s*\)")
GRADIENTS = ("linearGradient", "radialGradient")
#: How often a gradient may take the stops of another.
MOST_REFERENCES = 10
HREFS = ("href", "http://www.w3.org/1999/xlink href")


@dataclass(frozen=True, eq=False)
class Stops:
    """Colours (k, 3) at shares (k,) of a path's length, ascending."""

    offsets: Floats
    colours: Floats

    def at(self, shares: Floats) -> Floats:
        """Return the colours (n, 3) at shares (n,) of the length."""
        return np.stack([np.interp(shares, self.offsets, channel) for channel in self.colours.T], axis=1)


def properties(element: Element) -> dict[str, str]:
    """Return the attributes of an element, and what its attribute ``style`` says in their place."""
    own = dict(element.attributes)
    for one in own.pop("style", "").split(";"):
        name, colon, value = one.partition(":")
        if colon:
            own[name.strip()] = value.strip()
    return own


def stops_of(given: str, named: Mapping[str, Element], what: str) -> Stops | None:
    """Return the colours that an attribute gives, None for ``none``.

    Raises
    ------
    InputError
        If it is neither a colour nor a gradient of the drawing with stops.
    """
    if given.strip() == "none":
        return None
    reference = REFERENCE.match(given.strip())
    if reference is None:
        return Stops(np.zeros(1), _colour(given, what)[None])
    gradient = named.get(reference[1])
    for _ in range(MOST_REFERENCES):
        if gradient is None or gradient.name not in GRADIENTS:
            raise InputError(f"{what} names {shown(reference[1])}, which is no gradient of the drawing.")
        found = [properties(one) for one in gradient.children if one.name == "stop"]
        if found:
            return _stops(found, f"gradient {shown(reference[1])}")
        other = next((gradient.attributes[key] for key in HREFS if key in gradient.attributes), "")
        gradient = named.get(other.removeprefix("#")) if other.startswith("#") else None
    raise InputError(f"{what} names {shown(reference[1])}, whose stops are nowhere.")


def _stops(found: list[dict[str, str]], what: str) -> Stops:
    for one in found:
        if one.get("stop-opacity", "1") not in ("1", "1.0", "100%"):
            raise InputError(f"{what} has a stop that lets light through; curves hold opaque colours.")
    offsets = [_share(one.get("offset", "0"), what) for one in found]
    colours = [_colour(one.get("stop-color", "black"), f"stop-color of {what}") for one in found]
    return Stops(np.maximum.accumulate(np.clip(offsets, 0, 1)), np.array(colours))


def _share(text: str, what: str) -> float:
    number = NUMBER.fullmatch(text.strip().removesuffix("%"))
    if number is None:
        raise InputError(f"offset of {what} must be a number or a percentage, got {shown(text)}.")
    return float(number.group()) / (100 if text.strip().endswith("%") else 1)


def _colour(text: str, what: str) -> Floats:
    numbers = RGB.fullmatch(text.strip())
    if numbers:
        return as_colour([min(int(one), 255) / 255 for one in numbers.groups()], what)
    return as_colour(text, what)
