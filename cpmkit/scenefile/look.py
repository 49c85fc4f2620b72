"""Options of pictures, films and pages, in Python and in scene files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, Self, TypedDict

import numpy as np
from numpy.typing import NDArray

from cpmkit.errors import InputError, shown
from cpmkit.runtime.arrays import as_vector, whole
from cpmkit.runtime.messages import did_you_mean

#: Fields that a picture can show.
PICTURE_FIELDS = ("solution", "error")
#: Shading of surfaces.
LIGHTS = ("flat", "shaded")
#: Names of upward directions.
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Look:
    """Options of a picture.

    Three channels are shown as red, green and blue, clipped to [0, 1]; otherwise one channel is shown by a colour map.

    Parameters
    ----------
    width : int
        Width in pixels; the height follows from the model.
    view : three numbers, optional
        Direction from the model to the camera; not used in the plane.
    up : "x", "y", "z" or three numbers, optional
        Upward direction. By default z, or y if the model stands on its lowest y and not on its lowest z.
    curves : bool
        Whether to draw boundaries, as dark lines and dots.
    twins : bool
        Whether to draw dots at lattice nodes that several sheets of the surface share.
    field : "solution" or "error"
        The solution, or its estimated error in the unit of the solution (the largest of several channels), which is
        computed first if it is not known.
    channel : int, optional
        Number of the channel to show, from 0.
    light : "flat" or "shaded", optional
        ``"flat"``: the colours of the colour bar, with dark lines that show the shape. ``"shaded"``: light from above
        and the left. By default flat with a colour bar, shaded where channels are colours.
    cmap : str
        Name of a colour map of matplotlib.
    clim : two numbers, optional
        Values at the ends of the colour bar; by default the extremes of the solution.
    title, label, unit : str
        Text above the picture, and beside the colour bar.
    isolines : int, bool or sequence of numbers
        Number of isolines, evenly spaced between the ends of the colour bar, ten if true; or their values.
    edges : bool
        Whether to draw the edges of the mesh.
    vectors : bool
        Whether the channels are components of vectors, drawn as arrows over their lengths.

    Raises
    ------
    InputError
        If an option has a value that is not accepted.
    """

    width: int = 1200
    view: tuple[float, ...] | None = None
    up: str | tuple[float, ...] | None = None
    curves: bool = True
    twins: bool = False
    field: str = PICTURE_FIELDS[0]
    channel: int | None = None
    light: str | None = None
    cmap: str = "viridis"
    clim: tuple[float, float] | None = None
    title: str = ""
    label: str = ""
    unit: str = ""
    isolines: int | bool | Sequence[float] = 0
    edges: bool = False
    vectors: bool = False

    def __post_init__(self) -> None:
        """Check the options, and convert sequences to tuples."""
        whole(self.width, "width in pixels", 16, 16_384)
        _one_of(self.field, PICTURE_FIELDS, "field of a picture")
        if self.light is not None:
            _one_of(self.light, LIGHTS, "light of a picture")
        if self.view is not None:
            self._set("view", tuple(as_vector(self.view, 3, "view").tolist()))
        if isinstance(self.up, str):
            _one_of(self.up, AXES, "up of a picture, unless it is three numbers,")
        elif self.up is not None:
            self._set("up", tuple(as_vector(self.up, 3, "up").tolist()))
        if self.clim is not None:
            low, high = as_vector(self.clim, 2, "clim").tolist()
            if low >= high:
                raise InputError(f"clim must be two numbers, the lower first, got {low:g} and {high:g}.")
            self._set("clim", (low, high))
        if self.channel is not None:
            whole(self.channel, "channel")
        for name in ("title", "label", "unit", "cmap"):
            if not isinstance(getattr(self, name), str):
                raise InputError(f"{name} of a picture must be text, got {shown(getattr(self, name))}.")
        for name in ("curves", "twins", "edges", "vectors"):
            if not isinstance(getattr(self, name), (bool, np.bool_)):
                raise InputError(f"{name} of a picture must be true or false, got {shown(getattr(self, name))}.")
        if isinstance(self.isolines, (int, np.integer)):
            self._set(
                "isolines",
                10 if self.isolines is True else whole(int(self.isolines), "isolines", 0, 1000),
            )
        else:
            self._set("isolines", tuple(as_vector(self.isolines, np.size(self.isolines), "isolines").tolist()))

    @classmethod
    def of(cls, options: Mapping[str, Any], label: str = "a picture", also: Sequence[str] = ()) -> Self:
        """Return the look with these ``options``.

        ``also`` are further options that ``label`` accepts, for suggestions in error messages.

        Raises
        ------
        InputError
            If there is no such option, or a value is not accepted.
        """
        accepted = [field.name for field in fields(cls)]
        for name in options:
            if name not in accepted:
                hint, names = did_you_mean(name, (*also, *accepted)), ", ".join((*also, *accepted))
                raise InputError(f"{label} has no option {name!r}{hint}; accepted are {names}.")
        return cls(**options)

    def levels(self, ends: Sequence[float]) -> list[float]:
        """Return the values of the isolines, for a colour bar between the two ``ends``."""
        if isinstance(self.isolines, int):
            return [float(level) for level in np.linspace(ends[0], ends[1], self.isolines + 2)[1:-1]]
        return list(self.isolines)

    def _set(self, name: str, value: Any) -> None:
        """Set a field of the frozen instance."""
        object.__setattr__(self, name, value)


def _one_of(value: object, accepted: Sequence[str], label: str) -> None:
    """Raise InputError if ``value`` is none of the ``accepted``; ``label`` is its name in the message."""
    if value not in accepted:
        hint = did_you_mean(value, accepted)
        raise InputError(f"{label} must be {' or '.join(map(repr, accepted))}, got {shown(value)}{hint}.")


#: A sequence of numbers.
Numbers = Sequence[float] | NDArray[Any]


class LookKeywords(TypedDict, total=False):
    """Keyword arguments of a picture for type checkers, the fields of :class:`cpmkit.scenefile.look.Look`."""

    width: int
    view: Numbers | None
    up: Literal["x", "y", "z"] | Numbers | None
    curves: bool
    twins: bool
    field: Literal["solution", "error"]
    channel: int | None
    light: Literal["flat", "shaded"] | None
    cmap: str
    clim: Numbers | None
    title: str
    label: str
    unit: str
    isolines: int | bool | Numbers
    edges: bool
    vectors: bool


class SavingKeywords(LookKeywords, total=False):
    """Keyword arguments of a saved film or page."""

    fps: float
