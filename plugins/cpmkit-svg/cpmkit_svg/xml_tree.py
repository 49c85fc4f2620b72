"""XML read with the standard library's parser into a small tree: no document types, no entities, nothing beside it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from cpmkit.plugin import InputError, existing_file, read_bytes, shown

#: What a drawing may be in size: bytes, elements, elements within each other.
MOST_BYTES, MOST_ELEMENTS, MOST_DEPTH = 16 * 2**20, 100_000, 200
#: The namespace of SVG, as the parser puts it before names.
SVG = "http://www.w3.org/2000/svg "


@dataclass
class Element:
    """An element: its name, attributes by name, children in order, and the text right in it.

    Names of other namespaces than SVG keep theirs before a space.
    """

    name: str
    attributes: dict[str, str]
    children: list[Element] = field(default_factory=list)
    text: str = ""

    def self_and_descendants(self) -> Iterator[Element]:
        """Yield the element and all within it, in the order of the file."""
        yield self
        for child in self.children:
            yield from child.self_and_descendants()


def read_xml(path: str | Path) -> Element:
    """Return the root of an SVG file.

    Raise InputError if the file is missing, cannot be read, is too large, no well-formed XML, has a document type or
    entities, too many elements or too many within each other, or its root is not svg.
    """
    file = existing_file(path)
    if file.stat().st_size > MOST_BYTES:
        raise InputError(f"{shown(file.name)} is larger than {MOST_BYTES >> 20} MiB, which no drawing of curves is.")
    builder, parser = _Builder(file.name), expat.ParserCreate(namespace_separator=" ")
    parser.StartDoctypeDeclHandler = builder.refuse_doctype
    parser.StartElementHandler, parser.EndElementHandler = builder.start_element, builder.end_element
    parser.CharacterDataHandler = builder.add_text
    try:
        parser.Parse(read_bytes(file), True)
    except (expat.ExpatError, LookupError, ValueError) as error:  # the last two: an encoding that Python lacks
        raise InputError(f"{shown(file.name)} is no well-formed XML: {error}.") from error
    except OSError as error:
        raise InputError(f"{shown(file.name)} cannot be read: {error.strerror or error}.") from error
    root = builder.root
    if root is None or root.name != "svg":
        raise InputError(f"{shown(file.name)} holds {shown(root.name) if root else 'nothing'} where svg was expected.")
    return root


class _Builder:
    """Handlers of parser events that build the tree of elements."""

    def __init__(self, name: str) -> None:
        self.name, self.root, self.open, self.count = name, None, [], 0  # type: ignore[var-annotated]

    def refuse_doctype(self, *_: object) -> None:
        """Raise InputError: a document type, and with it every entity, is refused."""
        raise InputError(
            f"{shown(self.name)} has a document type, which may name other files and entities; take the line "
            "<!DOCTYPE ...> out of it."
        )

    def start_element(self, name: str, attributes: dict[str, str]) -> None:
        """Add an element to the open element and open it; raise InputError if there are too many, or too deep ones."""
        self.count += 1
        if self.count > MOST_ELEMENTS or len(self.open) >= MOST_DEPTH:
            raise InputError(
                f"{shown(self.name)} has more than {MOST_ELEMENTS} elements, or {MOST_DEPTH} in each other."
            )
        element = Element(name.removeprefix(SVG), attributes)
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)

    def end_element(self, _: str) -> None:
        """Close the element that is open."""
        self.open.pop()

    def add_text(self, words: str) -> None:
        """Add text to the element that is open."""
        self.open[-1].text += words
