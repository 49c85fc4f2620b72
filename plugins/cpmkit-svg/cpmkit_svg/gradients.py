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
    """Colours (k, 3), red, green and blue from 0 to 1, at shares ``offsets`` (k,) of a path's length, ascending."""

    offsets: Floats
    colours: Floats

    def colours_at(self, shares: Floats) -> Floats:
        """Return the colours (n, 3) at shares (n,) of the length: linear between stops, constant beyond them."""
        return np.stack([np.interp(shares, self.offsets, channel) for channel in self.colours.T], axis=1)


def properties(element: Element) -> dict[str, str]:
    """Return the attributes of an element by name; entries of its attribute ``style`` take their place."""
    own = dict(element.attributes)
    for entry in own.pop("style", "").split(";"):
        name, colon, value = entry.partition(":")
        if colon:
            own[name.strip()] = value.strip()
    return own


def stops_of(given: str, named: Mapping[str, Element], label: str) -> Stops | None:
    """Return the colours of an attribute's text ``given``, a colour or gradient among ``named``; None for ``none``.

    ``named`` are the drawing's elements by id; ``label`` names the attribute in errors. Raise InputError if the text is
    neither a colour nor ``url(#id)`` of a gradient with stops, of its own or through others, or a stop is damaged or
    not opaque.
    """
    if given.strip() == "none":
        return None
    reference = REFERENCE.match(given.strip())
    if reference is None:
        return Stops(np.zeros(1), _parse_colour(given, label)[None])
    gradient = named.get(reference[1])
    for _ in range(MOST_REFERENCES):
        if gradient is None or gradient.name not in GRADIENTS:
            raise InputError(f"{label} names {shown(reference[1])}, which is no gradient of the drawing.")
        entries = [properties(entry) for entry in gradient.children if entry.name == "stop"]
        if entries:
            return _parse_stops(entries, f"gradient {shown(reference[1])}")
        other = next((gradient.attributes[key] for key in HREFS if key in gradient.attributes), "")
        gradient = named.get(other.removeprefix("#")) if other.startswith("#") else None
    raise InputError(f"{label} names {shown(reference[1])}, whose stops are nowhere.")


def _parse_stops(entries: list[dict[str, str]], label: str) -> Stops:
    """Return the stops of a gradient, the properties of each of which are an entry of ``entries``.

    Offsets are clipped to [0, 1] and never decrease. Raise InputError, which names ``label``, if a stop is not opaque
    or damaged.
    """
    for entry in entries:
        if entry.get("stop-opacity", "1") not in ("1", "1.0", "100%"):
            raise InputError(f"{label} has a stop that lets light through; curves hold opaque colours.")
    offsets = [_parse_share(entry.get("offset", "0"), label) for entry in entries]
    colours = [_parse_colour(entry.get("stop-color", "black"), f"stop-color of {label}") for entry in entries]
    return Stops(np.maximum.accumulate(np.clip(offsets, 0, 1)), np.array(colours))


def _parse_share(text: str, label: str) -> float:
    """Return a stop's offset, a number or percentage, as a share; raise InputError, naming ``label``, if neither."""
    number = NUMBER.fullmatch(text.strip().removesuffix("%"))
    if number is None:
        raise InputError(f"offset of {label} must be a number or a percentage, got {shown(text)}.")
    return float(number.group()) / (100 if text.strip().endswith("%") else 1)


def _parse_colour(text: str, label: str) -> Floats:
    """Return (3,) red, green and blue from 0 to 1 of a colour's text; raise InputError, naming ``label``, if none."""
    numbers = RGB.fullmatch(text.strip())
    if numbers:
        return as_colour([min(int(entry), 255) / 255 for entry in numbers.groups()], label)
    return as_colour(text, label)
