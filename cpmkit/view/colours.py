"""The colours of values, and the bar that explains them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.errors import InputError, MissingDependencyError, shown
from cpmkit.runtime.messages import did_you_mean, install_command
from cpmkit.types import Floats

#: Ends of a bar that differ by a smaller share of their size are equal; the bar is then extended by the second share.
EQUAL_SHARE, BAR_ABOUT_ONE_VALUE = 1e-12, 0.05
#: Colours of lines: dark, and light on colours with a luminance below DARK; weights of red, green and blue in it.
INK, CHALK, DARK, LUMINANCE = np.array((0.12, 0.12, 0.14)), np.array((0.9, 0.9, 0.9)), 0.25, np.array((0.3, 0.59, 0.11))
#: Number of colours of a bar.
BAR_COLOURS = 256


@dataclass(frozen=True, eq=False)
class Bar:
    """A colour bar.

    Attributes
    ----------
    ends : (2,) float64
        The values at its ends.
    cmap : str
        The name of the colour map in matplotlib.
    table : (BAR_COLOURS, 3) float64
        Its colours, from 0 to 1.
    label : str
        The text beside the bar.
    """

    ends: Floats
    cmap: str
    table: Floats
    label: str

    def colours(self, values: Floats) -> Floats:
        """Return the colours (n, 3) of values (n,)."""
        return np.asarray(self.table[np.round((len(self.table) - 1) * self.shares(values)).astype(np.int64)])

    def contrasting(self, values: Floats) -> Floats:
        """Return colours (n, 3), dark or light, that are visible on the colours of values (n,)."""
        bright = self.colours(values) @ LUMINANCE > DARK
        return np.where(bright[:, None], INK, CHALK)

    def shares(self, values: Floats) -> Floats:
        """Return the places (n,) of values (n,) on the bar, from 0 to 1."""
        return np.asarray(np.clip((values - self.ends[0]) / (self.ends[1] - self.ends[0]), 0, 1))


def make_bar(
    values: Floats, clim: tuple[float, float] | None = None, cmap: str = "viridis", label: str = "", unit: str = ""
) -> Bar:
    """Return the colour bar from the least to the greatest of ``values``, or between the ends ``clim``.

    If the ends are equal, the bar is extended on both sides.
    """
    label = f"{label} [{unit}]".strip() if unit else label
    ends = np.array([values.min(), values.max()] if clim is None else clim, dtype=np.float64)
    middle, size = ends.mean(), float(np.abs(ends).max())
    if ends[1] - ends[0] <= EQUAL_SHARE * size:
        half = BAR_ABOUT_ONE_VALUE * (size or 1.0)
        ends = np.array([middle - half, middle + half])
    return Bar(ends, cmap, colour_table(cmap), label)


def value_colours(values: Floats) -> Floats:
    """Return colours (v, 3) of values (v,), in viridis from the least to the greatest value."""
    return make_bar(values).colours(values)


def colour_table(cmap: str) -> Floats:
    """Return the colours (BAR_COLOURS, 3), from 0 to 1, of one of matplotlib's colour maps.

    Raises
    ------
    InputError
        If matplotlib has no colour map of that name.
    MissingDependencyError
        If matplotlib is not installed.
    """
    try:
        from matplotlib import colormaps
    except ImportError as error:
        raise MissingDependencyError(f"Colours need matplotlib; {install_command('view')} adds it.") from error
    if cmap not in colormaps:
        suggestion = did_you_mean(cmap, colormaps)
        raise InputError(
            f"cmap must name one of matplotlib's colour maps, such as 'coolwarm', got {shown(cmap)}{suggestion}."
        )
    return np.asarray(colormaps[cmap](np.linspace(0, 1, BAR_COLOURS)), dtype=np.float64)[:, :3]
