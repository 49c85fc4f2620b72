"""A whole SVG file as curves in the plane, y upwards, with the colours of their sides."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cpmkit.plugin import Floats, InputError, shown
from cpmkit_svg.flattening import flatten_cubics
from cpmkit_svg.gradients import Stops, properties, stops_of
from cpmkit_svg.path_data import subpaths
from cpmkit_svg.scanner import Scanner
from cpmkit_svg.shapes import SHAPES, parse_length, shape_path_data
from cpmkit_svg.transforms import compose_maps, parse_transform
from cpmkit_svg.xml_tree import Element, read_xml

#: Elements that are gone through, and those that draw nothing where they stand.
GROUPS = ("svg", "g", "a")
SILENT = (
    "defs",
    "linearGradient",
    "radialGradient",
    "title",
    "desc",
    "metadata",
    "symbol",
    "marker",
    "clipPath",
    "mask",
)
#: What the elements within a group take from it.
INHERITED = ("stroke", "display", "visibility", "data-left", "data-right")


@dataclass(frozen=True, eq=False)
class DrawnCurve:
    """A subpath of a drawing.

    Attributes
    ----------
    name : str
        The element's id, or its kind and number; with the number of the subpath after a point where it has several.
    element : str
        The id alone, empty where it has none.
    points : (n, 2) float64
        Along it, y upwards; the last of a closed one is the first.
    closed : bool
    left, right : Stops, optional
        Colours on its sides, at your left and right hand as it is drawn; None for ``none``.
    coloured : bool
        Whether the curve has a colour on a side.
    """

    name: str
    element: str
    points: Floats
    closed: bool
    left: Stops | None
    right: Stops | None
    coloured: bool


@dataclass(frozen=True, eq=False)
class Drawing:
    """Curves on a canvas, whose lower left and upper right corners are the rows of ``canvas`` (2, 2)."""

    canvas: Floats
    curves: tuple[DrawnCurve, ...]


def read_drawing(path: str | Path) -> Drawing:
    """Return the canvas and the curves of an SVG file.

    Raise InputError if the file is no SVG that :func:`~cpmkit_svg.xml_tree.read_xml` reads, has neither a viewBox nor
    width and height, draws what is no curve (text, images, copies by ``use``, rectangles with round corners), has style
    sheets, or an attribute is damaged.
    """
    root = read_xml(path)
    try:
        if any(node.name == "style" and node.text.strip() for node in root.self_and_descendants()):
            raise InputError("style sheets are not read; write colours as attributes of the paths.")
        named = {node.attributes["id"]: node for node in root.self_and_descendants() if "id" in node.attributes}
        canvas = _canvas(root.attributes)
        upright = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, canvas.sum(axis=0)[1]]])
        curves = tuple(_curves(root, upright, {}, named, [0]))
    except InputError as error:
        raise InputError(f"{shown(Path(path).name)}: {error}") from error
    return Drawing(canvas, curves)


def _canvas(attributes: Mapping[str, str]) -> Floats:
    """Return the lower and upper corners (2, 2) of the canvas, y downwards, from the root's ``attributes``.

    They are those of the viewBox, else (0, 0) and (width, height). Raise InputError if both are missing, or those read
    are damaged or not above zero.
    """
    if "viewBox" in attributes:
        x, y, width, height = Scanner(attributes["viewBox"], "viewBox").numbers(4)
    elif {"width", "height"} <= set(attributes):
        x, y, width, height = 0.0, 0.0, *(parse_length(attributes[key], f"{key} of svg") for key in ("width", "height"))
    else:
        raise InputError("the drawing has neither a viewBox nor width and height; give it a viewBox.")
    if not (width > 0 and height > 0):
        raise InputError(f"the canvas must have a width and a height above zero, got {width:g} and {height:g}.")
    return np.array([[x, y], [x + width, y + height]])


def _curves(
    element: Element, outer: Floats, above: Mapping[str, str], named: Mapping[str, Element], count: list[int]
) -> Iterator[DrawnCurve]:
    """Yield the curves of an element and its descendants, with properties inherited, in the order of the file.

    Elements that are not displayed, not visible, of another namespace or only definitions have none. ``outer`` (2, 3)
    maps the coordinates in which the element stands to the drawing's, as matrix and then translation; ``above`` are
    inherited properties, ``named`` the elements by id; ``count[0]`` is increased for each visible shape. Raise
    InputError if an element draws what is no curve, or an attribute is damaged.
    """
    own = {**above, **properties(element)}
    label = f"{element.name} {shown(own['id'])}" if "id" in element.attributes else element.name
    if " " in element.name or element.name in SILENT or element.name == "style" or own.get("display") == "none":
        return
    place = compose_maps(outer, parse_transform(own.get("transform", ""), label))
    if element.name in GROUPS:
        passed = {key: own[key] for key in INHERITED if key in own}
        for child in element.children:
            yield from _curves(child, place, passed, named, count)
    elif element.name not in SHAPES:
        raise InputError(f"{label} is no curve; accepted are {', '.join((*SHAPES, *GROUPS))}: make paths of the rest.")
    elif own.get("visibility", "visible") == "visible":
        count[0] += 1
        yield from _shape_curves(element, own, place, named, f"{element.name} {count[0]}")


def _shape_curves(
    element: Element, own: Mapping[str, str], place: Floats, named: Mapping[str, Element], number: str
) -> Iterator[DrawnCurve]:
    """Yield the subpaths of a shape ``element``, mapped by ``place`` (2, 3), with the colours of their sides.

    ``own`` are its properties, inherited ones among them, ``named`` the elements by id, ``number`` is its name if it
    has no id. Raise InputError if an attribute is damaged.
    """
    identity = element.attributes.get("id", "")
    name = identity or number
    parts = subpaths(shape_path_data(element.name, own, name), f"path data of {shown(name)}")
    stroke = own.get("stroke", "none")
    given = [own.get(f"data-{side}", stroke) for side in ("left", "right")]
    left, right = (stops_of(node, named, f"the colour of {shown(name)}") for node in given)
    right = left if given[0] == given[1] else right
    for k, part in enumerate(parts):
        points = flatten_cubics(part.cubics @ place[:, :2].T + place[:, 2])
        called = name if len(parts) == 1 else f"{name}.{k}"
        yield DrawnCurve(called, identity, points, part.closed, left, right, bool(left or right))
