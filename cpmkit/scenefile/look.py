"""Options of pictures, films and pages; files and pictures that a scene file asks for."""

from __future__ import annotations

import inspect
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, Literal, Self, TypedDict

import numpy as np
from numpy.typing import NDArray

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.files.whole_files import MOST_FILE_NAME_BYTES, check_name
from cpmkit.runtime.arrays import as_vector, whole
from cpmkit.runtime.messages import did_you_mean
from cpmkit.runtime.options import Function, check_key_types, check_one_of


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
    ties : bool
        Whether to draw the ties of the Galerkin form, as dark lines and dots: creases, junctions, and borders between
        parts that are near in space but not along the manifold.
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
    ties: bool = False
    field: str = "solution"
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
        """Check the options, and convert sequences to tuples. Raises InputError if a value is not accepted."""
        texts_and_flags = ("title", "label", "unit", "cmap", "curves", "twins", "ties", "edges", "vectors")
        check_key_types(Look, "a picture", {name: getattr(self, name) for name in texts_and_flags})
        whole(self.width, "width in pixels", 16, 16_384)
        check_one_of(self.field, ("solution", "error"), "field of a picture")
        if self.light is not None:
            check_one_of(self.light, ("flat", "shaded"), "light of a picture")
        if self.view is not None:
            self._set("view", tuple(as_vector(self.view, 3, "view").tolist()))
        if isinstance(self.up, str):
            check_one_of(self.up, ("x", "y", "z"), "up of a picture, unless it is three numbers,")
        elif self.up is not None:
            self._set("up", tuple(as_vector(self.up, 3, "up").tolist()))
        if self.clim is not None:
            low, high = as_vector(self.clim, 2, "clim").tolist()
            if low >= high:
                raise InputError(f"clim must be two numbers, the lower first, got {low:g} and {high:g}.")
            self._set("clim", (low, high))
        if self.channel is not None:
            whole(self.channel, "channel")
        if isinstance(self.isolines, (int, np.integer)):
            count = 10 if self.isolines is True else whole(int(self.isolines), "isolines", 0, 1000)
            self._set("isolines", count)
        else:
            self._set("isolines", tuple(as_vector(self.isolines, np.size(self.isolines), "isolines").tolist()))

    @classmethod
    def from_options(cls, options: Mapping[str, Any], label: str = "a picture", also: Sequence[str] = ()) -> Self:
        """Return the look with these ``options``; ``also`` are other options that ``label`` accepts, for messages.

        Raises InputError if there is no such option, or a value is not accepted.
        """
        accepted = [field.name for field in fields(cls)]
        for name in options:
            if name not in accepted:
                hint, names = did_you_mean(name, (*also, *accepted)), ", ".join((*also, *accepted))
                raise InputError(f"{label} has no option {name!r}{hint}; accepted are {names}.")
        return cls(**options)

    def levels(self, ends: Sequence[float]) -> list[float]:
        """Return the values of the isolines: evenly spaced inside the ``ends`` (2,) of the colour bar, or as given."""
        if isinstance(self.isolines, int):
            return [float(level) for level in np.linspace(ends[0], ends[1], self.isolines + 2)[1:-1]]
        return list(self.isolines)

    def _set(self, name: str, value: Any) -> None:
        """Set the field ``name`` of the frozen instance to ``value``."""
        object.__setattr__(self, name, value)


def document_look(function: Function) -> Function:
    """Return ``function``, changed in place: its signature and docstring list the options of a picture by name."""
    *parameters, _ = inspect.signature(function).parameters.values()
    look = [option.replace(kind=option.KEYWORD_ONLY) for option in inspect.signature(Look).parameters.values()]
    summaries = inspect.cleandoc(Look.__doc__ or "").partition("----------\n")[2].partition("\n\nRaises")[0]
    doc = inspect.cleandoc(function.__doc__ or "")
    function.__doc__ = f"{doc}\n\nOther Parameters\n----------------\n{summaries}\n"
    vars(function).update(__signature__=inspect.Signature([*parameters, *look]))
    return function


#: A sequence of numbers.
Numbers = Sequence[float] | NDArray[Any]


class LookKeywords(TypedDict, total=False):
    """Keyword arguments of a picture for type checkers, the fields of :class:`cpmkit.scenefile.look.Look`."""

    width: int
    view: Numbers | None
    up: Literal["x", "y", "z"] | Numbers | None
    curves: bool
    twins: bool
    ties: bool
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


#: The mesh in output files: the display mesh of pictures, or the mesh from which the surface was made.
VERTICES = ("display", "own")


@dataclass(frozen=True)
class PictureRequest(Look):
    """A picture, with all options of :class:`~cpmkit.scenefile.look.Look`.

    Parameters
    ----------
    file : str
        Name of a PNG.
    frames : bool
        Whether to draw each frame of an equation in time too, into numbered files.
    """

    file: str = "picture.png"
    frames: bool = False

    def __post_init__(self) -> None:
        """Check the options; raise SceneError if ``file`` leaves the folder, or frames of an error are requested."""
        relative_name(self.file, "file of the picture")
        super().__post_init__()
        if self.frames and self.field != "solution":
            raise SceneError("field = 'error' of the picture is the error at the end; leave out frames, or field.")

    @property
    def look(self) -> dict[str, Any]:
        """The options of :class:`Look` by name, without ``file`` and ``frames``."""
        return {field.name: getattr(self, field.name) for field in fields(Look)}


@dataclass(frozen=True)
class OutputRequest:
    """The output folder, relative to the working directory, the files in it, their mesh ``vertices``, and a picture.

    Raises SceneError if a name is no relative path in the folder or is too long, or ``vertices`` is not accepted.
    """

    folder: Path
    files: tuple[str, ...]
    picture: PictureRequest | None
    vertices: str = VERTICES[0]

    def __post_init__(self) -> None:
        """Raise SceneError if ``vertices`` or the name of a file is not accepted."""
        check_one_of(self.vertices, VERTICES, "vertices")
        for file in self.files:
            relative_name(file, "a file of [output]")

    @property
    def wants_error(self) -> bool:
        """True if the picture shows the estimated error."""
        return self.picture is not None and self.picture.field == "error"

    @property
    def wants_frames(self) -> bool:
        """True if the frames of an equation in time are to be written or drawn."""
        drawn = self.picture is not None and self.picture.frames
        return drawn or any(file.lower().endswith((".pvd", ".gif", ".mp4")) for file in self.files)


def relative_name(name: object, label: str) -> str:
    """Return the relative path ``name`` of a file if it stays inside the folder into which the file is written.

    Raises SceneError if it is not text, is absolute, contains ``..``, is too long, or is not valid; ``label`` is its
    name in messages.
    """
    if not isinstance(name, str) or not name.strip(" ./\\"):
        raise SceneError(f"{label} must be a name, got {shown(name)}.")
    parts = {*PurePosixPath(name).parts, *PureWindowsPath(name).parts}  # refused everywhere if refused on one system
    if name.startswith("/") or PureWindowsPath(name).anchor or ".." in parts:
        inside = "the working directory" if label.startswith("folder") else "the output folder"
        remedy = "; leave it out and give --output, which takes any folder" if label.startswith("folder") else ""
        raise SceneError(f"{label} must be a relative path inside {inside}, got {shown(name)}{remedy}.")
    try:
        lengths = [len(part.encode()) for part in PurePosixPath(name).parts]
    except UnicodeEncodeError as error:
        raise SceneError(f"{label} must be a name that UTF-8 can hold, got {shown(name)}.") from error
    if "\0" in name or max(lengths) > MOST_FILE_NAME_BYTES or sum(lengths) > 1000:
        raise SceneError(
            f"{label} must be a name of at most {MOST_FILE_NAME_BYTES} bytes, with folders 1000, and "
            f"without NUL, got {shown(name)}."
        )
    return name


def check_links(path: Path, folder: Path, label: str) -> None:
    """Check that the output ``path``, links resolved, is inside ``folder``; ``label`` is its name in messages.

    Raises SceneError if it is not, or the working directory is gone; InputError if the file system refuses the name.
    """
    check_name(path)
    try:
        inside = Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))
    except OSError as error:  # the working directory is gone
        raise SceneError(f"{label}, {shown(str(path))}, cannot be found: {error.strerror}.") from error
    if not inside:
        raise SceneError(
            f"{label} must be inside {shown(str(folder))}, and a link leads {shown(str(path))} out of it; remove the "
            "link, or give --output, which takes any folder."
        )
