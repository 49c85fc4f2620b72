"""Output of a scene file: files and pictures inside a folder, which is inside the working directory."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.files.whole_files import MOST_FILE_NAME_BYTES, check_name
from cpmkit.scenefile.look import PICTURE_FIELDS, Look

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
        """Check the file name and the options."""
        relative_name(self.file, "file of the picture")
        try:
            super().__post_init__()
        except InputError as error:
            raise SceneError(str(error)) from error
        if not isinstance(self.frames, bool):
            raise SceneError(f"frames of the picture must be true or false, got {shown(self.frames)}.")
        if self.frames and self.field != PICTURE_FIELDS[0]:
            raise SceneError("field = 'error' of the picture is the error at the end; leave out frames, or field.")

    @property
    def look(self) -> dict[str, Any]:
        """The options of the look, without the file and the frames."""
        return {field.name: getattr(self, field.name) for field in fields(Look)}

    def with_look(self, options: dict[str, Any]) -> PictureRequest:
        """Return the picture with some ``options`` of its look replaced.

        Raises
        ------
        InputError
            If there is no such option, or a value is not accepted.
        """
        return PictureRequest(file=self.file, frames=self.frames, **vars(Look.of({**self.look, **options})))


@dataclass(frozen=True)
class OutputRequest:
    """The output folder, relative to the working directory, the files in it, their mesh ``vertices``, and a picture.

    Raises
    ------
    SceneError
        If a name is not a relative path, leads out of the folder, or is too long for file systems.
    """

    folder: Path
    files: tuple[str, ...]
    picture: PictureRequest | None
    vertices: str = VERTICES[0]

    def __post_init__(self) -> None:
        check_vertices(self.vertices)
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


def check_vertices(vertices: object) -> None:
    """Raise InputError if ``vertices`` is neither ``"display"`` nor ``"own"``."""
    if vertices not in VERTICES:
        raise InputError(f"vertices must be {' or '.join(map(repr, VERTICES))}, got {shown(vertices)}.")


def relative_name(name: object, label: str) -> str:
    """Return the relative path ``name`` of a file if it stays inside the folder into which the file is written.

    Raises
    ------
    SceneError
        If it is not text, is absolute, contains ``..``, or is too long for file systems; ``label`` is its name.
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


def output_folder(name: object) -> Path:
    """Return the output folder that a scene file names, a relative path inside the working directory.

    Raises
    ------
    SceneError
        If the path is absolute or leads out of the working directory.
    """
    return Path(name if name == "." else relative_name(name, "folder of [output]"))


def check_links(path: Path, folder: Path, label: str) -> None:
    """Raise if symbolic links lead ``path`` out of a ``folder``.

    Raises
    ------
    InputError
        In this case, or if the file system does not accept the name; ``label`` is the name of the path.
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
