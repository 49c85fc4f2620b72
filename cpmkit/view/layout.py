"""The page of a picture: the model, a title above it and the colour bar beside it; written with matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.protocols import Floats
from cpmkit.view.colours import Bar

#: Width of the colour bar's column, with and without a label, and the height of a title, as shares of the whole width.
LABELLED_BAR_WIDTH, BAR_WIDTH, TITLE_HEIGHT = 0.16, 0.12, 0.055
#: Size of the letters at the bar, as a share of the whole width; in pixels at least, as far as the bar's column, which
#: is as many letters wide, takes no more than a share of the whole.
LETTER_SIZE, LEAST_LETTER, LARGEST_BAR_SHARE = 1 / 65, 10.0, 0.35
#: How much larger a title's letters are, and how wide one is on the mean, as a share of its size.
TITLE_LETTERS, LETTER_BREADTH = 1.3, 0.6
#: Dots an inch of the figures; only the ratio to the size of the type matters.
DOTS_PER_INCH, POINTS_PER_INCH = 100, 72


def letter_size(width: int, share: float) -> float:
    """Return the size of letters in pixels, in a picture of ``width`` whose bar has this share of it where it is large.

    They are read down to about 10 pixels; in narrower pictures they and the bar's column take more of the width.
    """
    return max(LETTER_SIZE * width, min(LEAST_LETTER, LETTER_SIZE * width * LARGEST_BAR_SHARE / share))


def model_width(width: int, bar: bool, label: str) -> int:
    """Return how many pixels of the whole ``width`` are the model's."""
    share = LABELLED_BAR_WIDTH if label else BAR_WIDTH
    return width - round(share * letter_size(width, share) / LETTER_SIZE) if bar else width


def composed(model: Floats, bar: Bar | None, title: str, width: int) -> Any:
    """Return the whole picture (rows, columns, 3) as bytes: the model (r, c, 3), with title and bar."""
    parts = [_bytes(model)]
    if bar is not None:
        letters = letter_size(width, LABELLED_BAR_WIDTH if bar.label else BAR_WIDTH)
        parts.append(_bar(bar, len(model), width - model.shape[1], letters))
    whole = np.concatenate(parts, axis=1)
    if title:
        whole = np.concatenate([titled(title, whole.shape[1], width), whole])
    return whole


def grid(tiles: Sequence[Floats], titles: Sequence[str], columns: int) -> Floats:
    """Return a sheet (rows, columns, 3), from 0 to 1, of pictures of one size, each under its title."""
    width = tiles[0].shape[1]
    cells = [
        np.concatenate([titled(title, width, 2 * width) / 255, tile]) for tile, title in zip(tiles, titles, strict=True)
    ]
    cells += [np.ones_like(cells[0])] * (-len(cells) % columns)
    rows = [np.concatenate(cells[k : k + columns], axis=1) for k in range(0, len(cells), columns)]
    return np.concatenate(rows)


def titled(title: str, columns: int, width: int) -> Any:
    """Return a strip of bytes (r, columns, 3) with a title, in letters that suit a picture of ``width``."""
    letters = max(LETTER_SIZE * width, LEAST_LETTER)
    figure = _figure(round(TITLE_HEIGHT * letters / LETTER_SIZE), columns)
    size = min(TITLE_LETTERS * letters, columns / (LETTER_BREADTH * len(title))) * POINTS_PER_INCH / DOTS_PER_INCH
    figure.text(0.5, 0.45, title, ha="center", va="center", fontsize=size)
    return _drawn(figure)


def write_png(picture: Any, path: Path) -> None:
    """Write bytes (rows, columns, 3) as a PNG file, in full colours."""
    from PIL import Image

    Image.fromarray(picture).save(path, "PNG", optimize=True)


@lru_cache(maxsize=1)
def _bar(bar: Bar, rows: int, columns: int, letters: float) -> Any:
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
    return _drawn(figure)


def _figure(rows: int, columns: int) -> Any:
    from matplotlib.figure import Figure

    return Figure(figsize=(columns / DOTS_PER_INCH, rows / DOTS_PER_INCH), dpi=DOTS_PER_INCH, facecolor="white")


def _drawn(figure: Any) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()


def _bytes(picture: Floats) -> Any:
    return np.round(255 * np.clip(picture, 0, 1)).astype(np.uint8)
