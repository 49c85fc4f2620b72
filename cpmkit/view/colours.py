"""The colours of values, and a picture with its title and the colour bar that explains them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from cpmkit.errors import InputError, MissingDependencyError, shown
from cpmkit.runtime.messages import did_you_mean, install_command
from cpmkit.types import Floats

#: The dark colour of lines.
INK = np.array((0.12, 0.12, 0.14))


@dataclass(frozen=True, eq=False)
class Bar:
    """A colour bar, which maps values to colours."""

    ends: Floats  #: (2,): the values at its ends.
    table: Floats  #: (256, 3): its colours, from 0 to 1.
    label: str  #: The text beside the bar.

    def colours(self, values: Floats) -> Floats:
        """Return the colours (n, 3), from 0 to 1, of values (n,)."""
        return np.asarray(self.table[np.round((len(self.table) - 1) * self.shares(values)).astype(np.int64)])

    def ink_colours(self, values: Floats) -> Floats:
        """Return colours (n, 3), dark grey on bright colours of values (n,) and light grey on dark ones."""
        luminance = self.colours(values) @ np.array((0.3, 0.59, 0.11))
        return np.where(luminance[:, None] > 0.25, INK, np.array((0.9, 0.9, 0.9)))

    def shares(self, values: Floats) -> Floats:
        """Return the places of values of any shape on the bar: 0 at or below its first end, 1 at or above the last."""
        return np.asarray(np.clip((values - self.ends[0]) / (self.ends[1] - self.ends[0]), 0, 1))


def make_bar(
    values: Floats, clim: tuple[float, float] | None = None, cmap: str = "viridis", label: str = "", unit: str = ""
) -> Bar:
    """Return the colour bar from the least to the greatest of ``values`` or between ``clim``, wider if both are equal.

    ``cmap`` is a colour map of matplotlib; ``label`` and ``unit`` are the text beside the bar. Raises InputError if
    there is no such colour map, and MissingDependencyError without matplotlib.
    """
    ends = np.array([values.min(), values.max()] if clim is None else clim, dtype=np.float64)
    size = float(np.abs(ends).max())
    if ends[1] - ends[0] <= 1e-12 * size:
        ends = ends.mean() + 0.05 * (size or 1.0) * np.array([-1.0, 1.0])
    try:
        from matplotlib import colormaps
    except ImportError as error:
        raise MissingDependencyError(f"Colours need matplotlib; {install_command('view')} adds it.") from error
    if cmap not in colormaps:
        suggestion = did_you_mean(cmap, colormaps)
        raise InputError(
            f"cmap must name one of matplotlib's colour maps, such as 'coolwarm', got {shown(cmap)}{suggestion}."
        )
    table = np.asarray(colormaps[cmap](np.linspace(0, 1, 256)), dtype=np.float64)[:, :3]
    return Bar(ends, table, f"{label} [{unit}]".strip() if unit else label)


#: Size of letters at the bar, as a share of the whole width, and their least size in pixels.
LETTER_SIZE, LEAST_LETTER = 1 / 65, 10.0
#: Mean width of a letter as a share of its size.
LETTER_BREADTH = 0.6


def letter_size(width: int, share: float) -> float:
    """Return the size of letters in pixels in a picture of ``width`` pixels.

    ``share`` is the share of the width that the colour bar takes in large pictures. In narrow pictures letters have 10
    pixels, to be legible, and fewer only where the bar, which grows with its letters, would exceed 0.35 of the width.
    """
    return max(LETTER_SIZE * width, min(LEAST_LETTER, LETTER_SIZE * width * 0.35 / share))


def bar_share(label: str) -> float:
    """Return the share of the width that the colour bar takes in large pictures: more with a ``label`` than without."""
    return 0.16 if label else 0.12


def model_width(width: int, bar: bool, label: str) -> int:
    """Return the model's width in pixels in a picture of ``width`` pixels, with a bar with ``label`` if ``bar``."""
    share = bar_share(label)
    return width - round(share * letter_size(width, share) / LETTER_SIZE) if bar else width


def compose_picture(model: Floats, bar: Bar | None, title: str, width: int) -> Any:
    """Return the picture (rows, width, 3) uint8: the model (r, c, 3), from 0 to 1, and, if any, title and bar."""
    parts = [as_bytes(model)]
    if bar is not None:
        letters = letter_size(width, bar_share(bar.label))
        parts.append(_draw_bar(bar, len(model), width - model.shape[1], letters))
    whole = np.concatenate(parts, axis=1)
    return np.concatenate([title_strip(title, whole.shape[1], width), whole]) if title else whole


def picture_sheet(tiles: Sequence[Floats], titles: Sequence[str], columns: int) -> Floats:
    """Return a sheet (r, c, 3), from 0 to 1, of equal ``tiles``, row by row in ``columns``, each under its title."""
    width = tiles[0].shape[1]
    cells = [
        np.concatenate([title_strip(title, width, 2 * width) / 255, tile])
        for tile, title in zip(tiles, titles, strict=True)
    ]
    cells += [np.ones_like(cells[0])] * (-len(cells) % columns)
    rows = [np.concatenate(cells[k : k + columns], axis=1) for k in range(0, len(cells), columns)]
    return np.concatenate(rows)


def title_strip(title: str, columns: int, width: int) -> Any:
    """Return a strip (r, columns, 3) uint8 with a title, not empty, in letters for a picture of ``width`` pixels."""
    letters = max(LETTER_SIZE * width, LEAST_LETTER)
    figure = _pixel_figure(round(3.575 * letters), columns)
    size = min(1.3 * letters, columns / (LETTER_BREADTH * len(title)))
    figure.text(0.5, 0.45, title, ha="center", va="center", fontsize=size)
    return _render_figure(figure)


@lru_cache(maxsize=1)
def _draw_bar(bar: Bar, rows: int, columns: int, letters: float) -> Any:
    """Return a colour bar with ticks and label as uint8 (rows, columns, 3); ``letters`` is their size in pixels."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    figure = _pixel_figure(rows, columns)
    column = figure.add_axes((0.1, 0.12, 0.12 if bar.label else 0.16, 0.76))
    drawn = figure.colorbar(ScalarMappable(Normalize(*bar.ends), ListedColormap(bar.table)), cax=column)
    drawn.formatter.set_useOffset(False)  # a common summand would be larger than the column
    drawn.update_ticks()
    longest = max(len(label.get_text()) for label in column.get_yticklabels())
    size = min(letters, 0.65 * columns / (LETTER_BREADTH * max(longest, 1)))
    column.tick_params(labelsize=size)
    column.yaxis.get_offset_text().set_fontsize(letters)
    if bar.label:
        column.set_ylabel(bar.label, fontsize=min(1.1 * letters, rows / (LETTER_BREADTH * len(bar.label))))
    return _render_figure(figure)


def _pixel_figure(rows: int, columns: int) -> Any:
    """Return a white figure of ``rows`` by ``columns`` pixels; a pixel is a point, the unit of sizes of letters."""
    from matplotlib.figure import Figure

    return Figure(figsize=(columns / 72, rows / 72), dpi=72, facecolor="white")


def _render_figure(figure: Any) -> Any:
    """Return a figure of matplotlib, rendered, as uint8 (rows, columns, 3)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()


def as_bytes(colours: Floats) -> Any:
    """Return ``colours``, of any shape, from 0 to 1 and clipped there, as uint8 from 0 to 255."""
    return np.round(255 * np.clip(colours, 0, 1)).astype(np.uint8)
