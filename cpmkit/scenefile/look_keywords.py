"""Options of pictures, films and pages as type checkers and editors see them; a test holds them to the look's own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, TypedDict

from numpy.typing import NDArray

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
