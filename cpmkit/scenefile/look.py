"""How a picture looks: what every picture, film and page takes, in Python and in scene files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, Self, TypedDict

import numpy as np
from numpy.typing import NDArray

from cpmkit.errors import InputError, shown
from cpmkit.runtime.arrays import as_vector, whole
from cpmkit.runtime.messages import did_you_mean

#: Pixels of a picture's width.
WIDTH_PIXELS = (16, 16_384)
#: What a picture can show.
PICTURE_FIELDS = ("solution", "error")
LIGHTS = ("flat", "shaded")
AXES = ("x", "y", "z")
#: How many isolines ``isolines = true`` draws, and the most that are drawn.
ISOLINES, MOST_ISOLINES = 10, 1000


@dataclass(frozen=True)
class Look:
    """How a picture looks.

    Three channels are shown as the colour that they are, clipped to [0, 1]; of any other number one is shown in the
    colours of a bar.

    Parameters
    ----------
    width : int
        Of the whole picture in pixels; the height follows from the model.
    view : three numbers, optional
        The direction from the model to the camera. Not used in the plane.
    up : "x", "y", "z" or three numbers, optional
        What points upwards. Unless given z, or y where the model stands on its lowest y and does not on its lowest z.
    curves : bool
        Whether boundaries are drawn, as dark lines and dots.
    twins : bool
        Whether dots show where nodes are doubled, because several sheets of the surface share them.
    field : "solution" or "error"
        The solution, or its estimated error in the solution's own unit, of several channels the largest, which is made
        first where there is none yet.
    channel : int, optional
        Which of several is shown, from 0.
    light : "flat" or "shaded", optional
        ``"flat"``: every pixel has its colour of the bar, and dark lines show the shape. ``"shaded"``: light from the
        left and above darkens the rest. Unless given flat beside a bar, shaded where channels are colours.
    cmap : str
        Any of matplotlib's colour maps.
    clim : two numbers, optional
        The values at the ends of the bar; the least and the greatest of the solution unless given.
    title, label, unit : str
        Above the picture, and beside the bar.
    isolines : int, bool or sequence of numbers
        How many, evenly between the ends of the bar, ten if true; or at which values.
    edges : bool
        Whether the edges of the mesh are drawn.
    vectors : bool
        Whether the channels are the coordinates of vectors, drawn as arrows over their lengths.

    Raises
    ------
    InputError
        If one is not what is accepted.
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
        whole(self.width, "width in pixels", *WIDTH_PIXELS)
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
                ISOLINES if self.isolines is True else whole(int(self.isolines), "isolines", 0, MOST_ISOLINES),
            )
        else:
            self._set("isolines", tuple(as_vector(self.isolines, np.size(self.isolines), "isolines").tolist()))

    @classmethod
    def of(cls, options: Mapping[str, Any], label: str = "a picture", also: Sequence[str] = ()) -> Self:
        """Return the look of ``label`` with these options; ``also`` names arguments of its own, as which one is meant.

        Raises
        ------
        InputError
            If there is none of such a name, or one is not what is accepted.
        """
        accepted = [field.name for field in fields(cls)]
        for name in options:
            if name not in accepted:
                near, every = did_you_mean(name, (*also, *accepted)), ", ".join((*also, *accepted))
                raise InputError(f"{label} has no option {name!r}{near}; accepted are {every}.")
        return cls(**options)

    def levels(self, ends: Sequence[float]) -> list[float]:
        """Return the values of the isolines between the ``ends`` of the bar."""
        if isinstance(self.isolines, int):
            return [float(level) for level in np.linspace(ends[0], ends[1], self.isolines + 2)[1:-1]]
        return list(self.isolines)

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)


def _one_of(value: object, accepted: Sequence[str], label: str) -> None:
    if value not in accepted:
        near = did_you_mean(value, accepted)
        raise InputError(f"{label} must be {' or '.join(map(repr, accepted))}, got {shown(value)}{near}.")


#: Numbers of a fixed or any count.
Numbers = Sequence[float] | NDArray[Any]


class LookKeywords(TypedDict, total=False):
    """How a picture looks; see :class:`cpmkit.scenefile.look.Look`."""

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
    """How a saved film or page looks."""

    fps: float
