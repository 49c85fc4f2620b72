"""Lines over a drawing (outlines, edges, isolines, arrows), and the page with its title and colour bar."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.solution.display_mesh import DisplayMesh
from cpmkit.types import Floats, Ints
from cpmkit.view.colours import INK, Bar
from cpmkit.view.drawing import Drawing, Shapes, in_space, lines

if TYPE_CHECKING:
    from cpmkit.solution.record import SolutionRecord


#: Half the width of outlines, isolines, edges and the shafts of arrows, as shares of the picture's half width.
OUTLINE_WIDTH, ISOLINE_WIDTH, EDGE_WIDTH, SHAFT_WIDTH = 0.0016, 0.002, 0.0008, 0.0022
#: Distance of lines in front of the surface, as a share of the picture's half width.
LIFT = 0.004
EDGE_COLOUR = (0.35, 0.35, 0.38)

#: Arrows start on a grid of ARROW_CELLS cells across the picture. The longest arrow is this share of a cell, the
#: shortest this share of the longest, and vectors below this share of the longest vector have no arrow.
ARROW_CELLS, LONGEST_ARROW, SHORTEST_SHARE, LEAST_VECTOR = 26, 0.9, 0.45, 1e-6
#: Segments of a shaft; length of a head as a share of its arrow, and half its breadth as a share of its length.
SHAFT_STEPS, HEAD_SHARE, HEAD_BREADTH = 6, 0.35, 0.4


def outlines(drawing: Drawing) -> Shapes:
    """Return the silhouette: edges between a triangle whose front is visible and a triangle whose back is visible.

    Front and back follow from the order of corners; two triangles that list their common edge in the same direction
    have opposite orientations.
    """
    triangles, half = drawing.triangles[: drawing.mesh_triangles], drawing.camera.half[0]
    a, b, c = (drawing.points[triangles[:, k], :2] for k in range(3))
    front = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0] > 0
    edges, members, counts = _edges(triangles)
    rising = np.concatenate([triangles[:, 0] < triangles[:, 1], triangles[:, 1] < triangles[:, 2],
                             triangles[:, 2] < triangles[:, 0]])  # fmt: skip
    alike = np.bincount(members, np.tile(front, 3) == rising, len(edges))  # 1 where both triangles show the same side
    turning = edges[(counts == 2) & (alike != 1)]
    return _lines(drawing, drawing.points, turning, OUTLINE_WIDTH * half, INK, lift=0.25 * LIFT)


def mesh_edges(drawing: Drawing) -> Shapes:
    """Return all edges of the mesh as lines."""
    edges = _edges(drawing.triangles[: drawing.mesh_triangles])[0]
    return _lines(drawing, drawing.points, edges, EDGE_WIDTH * drawing.camera.half[0], EDGE_COLOUR)


def isolines(drawing: Drawing, values: Floats, levels: Sequence[float], bar: Bar) -> Shapes:
    """Return lines where ``values`` (v,) at the mesh's vertices, linear in each triangle, equal one of ``levels``."""
    triangles = drawing.triangles[: drawing.mesh_triangles]
    segments_of_level = [np.zeros((0, 2, 3))]
    for level in levels:
        above = values[triangles] > level
        crossed = triangles[above.any(axis=1) & ~above.all(axis=1)]
        up = values[crossed] > level
        lone = np.argmax(
            up == (up.sum(axis=1) == 1)[:, None], axis=1
        )  # the corner on the other side of the level than the two others
        rows = np.arange(len(crossed))
        tip, ends = crossed[rows, lone], [crossed[rows, (lone + k) % 3] for k in (1, 2)]
        shares = [(level - values[tip]) / (values[end] - values[tip]) for end in ends]
        points = drawing.points
        segments_of_level.append(
            np.stack(
                [points[tip] + s[:, None] * (points[e] - points[tip]) for s, e in zip(shares, ends, strict=True)], 1
            )
        )
    segments, half = np.concatenate(segments_of_level), drawing.camera.half[0]
    colours = np.repeat(bar.contrasting(np.array([0.0, *levels])), [len(part) for part in segments_of_level], axis=0)
    return lines(segments[:, 0], segments[:, 1], ISOLINE_WIDTH * half, LIFT * half, colours)


def arrows(drawing: Drawing, solution: SolutionRecord, mesh: DisplayMesh, vectors: Floats, bar: Bar) -> Shapes:
    """Return arrows along ``vectors`` (v, d) at some of the mesh's vertices; the arrows follow the surface.

    Short vectors have arrows of a least length, so that they are visible; the colours of ``bar`` show the lengths.
    """
    half = drawing.camera.half[0]
    cell = 2 * half / ARROW_CELLS
    sizes = np.linalg.norm(vectors, axis=1)
    seeds = _one_point_per_cell(mesh.points, cell)
    seeds = seeds[sizes[seeds] > LEAST_VECTOR * sizes.max(initial=0.0)]
    if not len(seeds):
        return Shapes.join([])
    shares = SHORTEST_SHARE + (1 - SHORTEST_SHARE) * sizes[seeds] / sizes.max()
    lengths = LONGEST_ARROW * cell * shares
    steps = np.linspace(-0.5, 0.5, SHAFT_STEPS + 1)[:, None]
    along = (lengths / sizes[seeds])[:, None] * vectors[seeds]
    path = mesh.points[seeds][:, None] + steps * along[:, None]
    on_surface = solution.scene.surface.closest_point(np.ascontiguousarray(path.reshape(-1, path.shape[2]))).points
    place = drawing.camera.project(in_space(on_surface)).reshape(len(seeds), -1, 3)
    colours = bar.contrasting(sizes[seeds])
    starts, ends = (part.reshape(-1, 3) for part in (place[:, :-1], place[:, 1:]))
    shafts = lines(starts, ends, SHAFT_WIDTH * half, LIFT * half, np.repeat(colours, SHAFT_STEPS, axis=0))
    return Shapes.join([shafts, _heads(place[:, -1], place[:, -2], HEAD_SHARE * lengths, colours, LIFT * half)])


def _heads(tips: Floats, before: Floats, lengths: Floats, colours: Floats, lift: float) -> Shapes:
    """Return the heads of arrows: triangles that point from ``before`` (k, 3) to just beyond ``tips`` (k, 3).

    ``lengths`` (k,) are those of the heads, and ``colours`` is (k, 3).
    """
    ahead = tips - before
    whole = np.maximum(np.linalg.norm(ahead, axis=1), 1e-300)
    ahead *= (lengths / whole)[:, None]
    across = HEAD_BREADTH * np.column_stack([-ahead[:, 1], ahead[:, 0], np.zeros(len(ahead))])
    points = np.stack([tips + 0.4 * ahead, tips - 0.6 * ahead + across, tips - 0.6 * ahead - across], axis=1)
    cells = np.arange(3 * len(tips)).reshape(-1, 3)
    return Shapes(points.reshape(-1, 3) + [0, 0, lift], np.repeat(colours, 3, axis=0), cells)


def _one_point_per_cell(points: Floats, cell: float) -> Ints:
    """Return, for each cell of a cubic grid that has points (n, d), the index of the point nearest to its centre."""
    scaled = points / cell
    cells = np.floor(scaled)
    order = np.argsort(np.linalg.norm(scaled - cells - 0.5, axis=1), kind="stable")
    return order[np.unique(cells[order], axis=0, return_index=True)[1]]


def _edges(triangles: Ints) -> tuple[Ints, Ints, Ints]:
    """Return the edges (e, 2) of triangles (t, 3), the edge (3 t,) of each of their sides, and triangle counts (e,).

    A count is the number of triangles at an edge; the sides are ordered by their number in the triangle.
    """
    sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    edges, members, counts = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    return edges, members.ravel(), counts


def _lines(drawing: Drawing, points: Floats, edges: Ints, width: float, colour: object, lift: float = LIFT) -> Shapes:
    """Return lines along ``edges`` (e, 2) of ``points`` (v, 3), in front of the surface by ``lift`` half widths."""
    return lines(points[edges[:, 0]], points[edges[:, 1]], width, lift * drawing.camera.half[0], colour)


#: Width of the colour bar's column, with and without a label, and the height of a title, as shares of the whole width.
LABELLED_BAR_WIDTH, BAR_WIDTH, TITLE_HEIGHT = 0.16, 0.12, 0.055
#: Size of letters at the bar, as a share of the whole width; their least size in pixels; and the largest share of the
#: width that the bar's column takes to allow for that size.
LETTER_SIZE, LEAST_LETTER, LARGEST_BAR_SHARE = 1 / 65, 10.0, 0.35
#: Size of a title's letters over those at the bar, and mean width of a letter as a share of its size.
TITLE_LETTERS, LETTER_BREADTH = 1.3, 0.6
#: Dots an inch of the figures; only the ratio to points an inch matters.
DOTS_PER_INCH, POINTS_PER_INCH = 100, 72


def letter_size(width: int, share: float) -> float:
    """Return the size of letters in pixels in a picture of ``width`` pixels.

    ``share`` is the share of the width that the colour bar takes in large pictures. Letters are legible down to about
    10 pixels; in narrow pictures they and the bar therefore take more of the width.
    """
    return max(LETTER_SIZE * width, min(LEAST_LETTER, LETTER_SIZE * width * LARGEST_BAR_SHARE / share))


def model_width(width: int, bar: bool, label: str) -> int:
    """Return the width in pixels that a colour bar leaves to the model in a picture of ``width`` pixels."""
    share = LABELLED_BAR_WIDTH if label else BAR_WIDTH
    return width - round(share * letter_size(width, share) / LETTER_SIZE) if bar else width


def compose(model: Floats, bar: Bar | None, title: str, width: int) -> Any:
    """Return the whole picture (rows, columns, 3) as bytes: the model (r, c, 3) with title and colour bar."""
    parts = [_bytes(model)]
    if bar is not None:
        letters = letter_size(width, LABELLED_BAR_WIDTH if bar.label else BAR_WIDTH)
        parts.append(_bar(bar, len(model), width - model.shape[1], letters))
    whole = np.concatenate(parts, axis=1)
    if title:
        whole = np.concatenate([title_strip(title, whole.shape[1], width), whole])
    return whole


def picture_sheet(tiles: Sequence[Floats], titles: Sequence[str], columns: int) -> Floats:
    """Return a sheet (rows, columns, 3), from 0 to 1, of equal pictures in ``columns``, each under its title."""
    width = tiles[0].shape[1]
    cells = [
        np.concatenate([title_strip(title, width, 2 * width) / 255, tile])
        for tile, title in zip(tiles, titles, strict=True)
    ]
    cells += [np.ones_like(cells[0])] * (-len(cells) % columns)
    rows = [np.concatenate(cells[k : k + columns], axis=1) for k in range(0, len(cells), columns)]
    return np.concatenate(rows)


def title_strip(title: str, columns: int, width: int) -> Any:
    """Return a strip of bytes (r, columns, 3) with a title, in letters that suit a picture of ``width``."""
    letters = max(LETTER_SIZE * width, LEAST_LETTER)
    figure = _figure(round(TITLE_HEIGHT * letters / LETTER_SIZE), columns)
    size = min(TITLE_LETTERS * letters, columns / (LETTER_BREADTH * len(title))) * POINTS_PER_INCH / DOTS_PER_INCH
    figure.text(0.5, 0.45, title, ha="center", va="center", fontsize=size)
    return _as_bytes(figure)


def write_png(picture: Any, path: Path) -> None:
    """Write bytes (rows, columns, 3) as a PNG file, in full colours."""
    from PIL import Image

    Image.fromarray(picture).save(path, "PNG", optimize=True)


@lru_cache(maxsize=1)
def _bar(bar: Bar, rows: int, columns: int, letters: float) -> Any:
    """Return a colour bar with ticks and label as bytes (rows, columns, 3), in letters of this size in pixels."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    figure = _figure(rows, columns)
    room = 0.16 * (0.75 if bar.label else 1.0)
    column = figure.add_axes((0.1, 0.12, room, 0.76))
    figure.colorbar(ScalarMappable(Normalize(*bar.ends), ListedColormap(bar.table)), cax=column)
    size = letters * POINTS_PER_INCH / DOTS_PER_INCH
    column.tick_params(labelsize=size)
    column.yaxis.get_offset_text().set_fontsize(size)
    if bar.label:
        tallest = rows / (LETTER_BREADTH * len(bar.label)) * POINTS_PER_INCH / DOTS_PER_INCH
        column.set_ylabel(bar.label, fontsize=min(1.1 * size, tallest))
    return _as_bytes(figure)


def _figure(rows: int, columns: int) -> Any:
    """Return an empty white figure of matplotlib with this size in pixels."""
    from matplotlib.figure import Figure

    return Figure(figsize=(columns / DOTS_PER_INCH, rows / DOTS_PER_INCH), dpi=DOTS_PER_INCH, facecolor="white")


def _as_bytes(figure: Any) -> Any:
    """Return a figure of matplotlib as bytes (rows, columns, 3)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()


def _bytes(picture: Floats) -> Any:
    """Return colours from 0 to 1 as bytes."""
    return np.round(255 * np.clip(picture, 0, 1)).astype(np.uint8)
