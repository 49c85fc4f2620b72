"""The renderer that needs no OpenGL: faces drawn from back to front with matplotlib.

It draws everything in the plane, and stands in where OpenGL does not answer. The colour bar of
either renderer is drawn here.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.protocols import Floats
from cpmkit.view.drawing import AMBIENT, CURVE_RADIUS, INK, LIGHT, PIN_RADIUS, STROKE_RADIUS, Drawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Width of the lines along the edges of faces, in points; thinner ones let the background through between two faces.
SEAM_POINTS = 1.0

#: Dots an inch of the figures; only the ratio to the size of the type matters.
DOTS_PER_FIGURE_INCH = 100


def render(drawing: Drawing, path: Path) -> None:
    """Draw and write a PNG file."""
    from matplotlib.collections import PolyCollection

    figure, axes = _page(drawing)
    shapes, colours = _shapes(drawing)
    axes.add_collection(
        PolyCollection(shapes, facecolors=colours, edgecolors=colours, linewidths=SEAM_POINTS, snap=False)
    )
    figure.savefig(path, dpi=DOTS_PER_FIGURE_INCH, facecolor="white")


def add_colour_bar(drawing: Drawing, rendered: Path, path: Path) -> None:
    """Put the colour bar beside a picture of the model that another renderer drew; write a PNG file."""
    from matplotlib.image import imread

    figure, axes = _page(drawing)
    width, height = drawing.half
    axes.imshow(imread(rendered), extent=(-width, width, -height, height), interpolation="nearest")
    figure.savefig(path, dpi=DOTS_PER_FIGURE_INCH, facecolor="white")


def _page(drawing: Drawing) -> tuple[Figure, Axes]:
    """Return a figure of the picture's size with axes in the camera's plane and, for values, a colour bar."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    width, height = drawing.pixels.tolist()
    total = int(drawing.width)
    figure = Figure(figsize=(total / DOTS_PER_FIGURE_INCH, height / DOTS_PER_FIGURE_INCH), dpi=DOTS_PER_FIGURE_INCH)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, width / total, 1))
    axes.set_axis_off()
    axes.set_xlim(-drawing.half[0], drawing.half[0])
    axes.set_ylim(-drawing.half[1], drawing.half[1])
    if len(drawing.span):
        _add_bar(figure, drawing.span, width / total)
    return figure, axes


def _add_bar(figure: Figure, span: Floats, left: float) -> None:
    """Draw the colour bar in the part of the figure that is right of ``left``."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    column = figure.add_axes((left + 0.1 * (1 - left), 0.15, 0.16 * (1 - left), 0.7))
    figure.colorbar(ScalarMappable(Normalize(*span), "viridis"), cax=column)
    column.tick_params(labelsize=figure.get_figwidth() * DOTS_PER_FIGURE_INCH / 90)


def _shapes(drawing: Drawing) -> tuple[list[Any], Floats]:
    """Return polygons in the camera's plane from back to front, and their colours."""
    place = drawing.camera.project(drawing.points)
    unit = drawing.half[0]
    faces = [place[drawing.triangles], _ribbons(place[drawing.segments], STROKE_RADIUS * unit)]
    colours = [_shaded(drawing), drawing.colours[drawing.segments].mean(axis=1)]
    near = _typical_size(place, drawing)  # lifts boundaries over the faces that they lie in
    curve = drawing.camera.project(drawing.curve_points)[drawing.curve_cells]
    pins = _discs(drawing.camera.project(drawing.pins), PIN_RADIUS * unit)
    for shapes in (_ribbons(curve, CURVE_RADIUS * unit), pins):
        faces.append(shapes + np.array([0, 0, near]))
        colours.append(np.tile(INK, (len(shapes), 1)))
    depth = np.concatenate([shape[:, :, 2].mean(axis=1) for shape in faces])
    order = np.argsort(depth, kind="stable")
    flat = [polygon for shape in faces for polygon in shape[:, :, :2]]
    return [flat[index] for index in order], np.concatenate(colours)[order]


def _shaded(drawing: Drawing) -> Floats:
    """Return (t, 3) colours of the triangles under the light."""
    colours: Floats = drawing.colours[drawing.triangles].mean(axis=1)
    if not len(drawing.normals):
        return colours
    normal = drawing.normals[drawing.triangles].mean(axis=1) @ drawing.axes.T
    a, b, c = (drawing.points[drawing.triangles[:, k]] for k in range(3))
    away = np.cross(b - a, c - a) @ drawing.axes[2] < 0  # both sides of a face are lit
    normal = np.where(away[:, None], -normal, normal) / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    light = np.array(LIGHT) / np.linalg.norm(LIGHT)
    return np.asarray(colours * (AMBIENT + (1 - AMBIENT) * np.maximum(normal @ light, 0))[:, None])


def _ribbons(segments: Floats, half_width: float) -> Floats:
    """Return (s, 4, 3) rectangles that face the viewer along segments (s, 2, 3)."""
    along = (segments[:, 1] - segments[:, 0])[:, :2]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = np.divide(along, length, out=np.zeros_like(along), where=length > 0)
    offset = half_width * np.stack([-along[:, 1], along[:, 0], np.zeros(len(along))], axis=1)
    start, end = segments[:, 0], segments[:, 1]
    return np.stack([start - offset, end - offset, end + offset, start + offset], axis=1)


def _discs(centres: Floats, radius: float) -> Floats:
    """Return (p, 24, 3) polygons around ``centres``."""
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    circle = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(24)], axis=1)
    return centres[:, None] + circle


def _typical_size(place: Floats, drawing: Drawing) -> float:
    ends = np.concatenate([drawing.triangles[:, :2], drawing.segments])
    if not len(ends):
        return 0.0
    return float(np.median(np.linalg.norm(place[ends[:, 1]] - place[ends[:, 0]], axis=1)))
