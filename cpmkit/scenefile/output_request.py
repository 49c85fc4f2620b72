"""What a scene file asks to be written: inside one folder, which is inside the working directory."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath

from cpmkit.errors import SceneError, shown
from cpmkit.files.whole_files import MOST_FILE_NAME_BYTES, check_name
from cpmkit.runtime.arrays import as_vector, whole

#: Bytes of a file's name with its folders.
MOST_OUTPUT_BYTES = 1000
#: Pixels of a picture's width.
WIDTH_PIXELS = (16, 16_384)

#: What a picture can show.
PICTURE_FIELDS = ("solution", "error")


@dataclass(frozen=True)
class PictureRequest:
    """A picture: its file in the output folder, its width in pixels, and the camera.

    Parameters
    ----------
    file : str
        Name of a PNG.
    width : int
        Pixels.
    view, up : three numbers, optional
        The direction from the model towards the camera, and the one that points up in the picture.
    curves : bool
        Draw the boundaries.
    frames : bool
        Draw each frame too, of a problem in time, into files with numbers in their names.
    field : str
        ``solution``, or ``error``: its estimated error.
    """

    file: str = "picture.png"
    width: int = 1200
    view: tuple[float, ...] | None = None
    up: tuple[float, ...] | None = None
    curves: bool = True
    frames: bool = False
    field: str = "solution"

    def __post_init__(self) -> None:
        relative_name(self.file, "file of the picture")
        whole(self.width, "the picture's width in pixels", *WIDTH_PIXELS)
        if self.field not in PICTURE_FIELDS:
            accepted = " or ".join(map(repr, PICTURE_FIELDS))
            raise SceneError(f"field of the picture must be {accepted}, got {shown(self.field)}.")
        if self.frames and self.field != PICTURE_FIELDS[0]:
            raise SceneError("field = 'error' of the picture is the error at the end; leave out frames, or field.")
        for name in ("view", "up"):
            if getattr(self, name) is not None:
                object.__setattr__(
                    self, name, tuple(as_vector(getattr(self, name), 3, f"{name} of the picture").tolist())
                )


@dataclass(frozen=True)
class OutputRequest:
    """Where results go: a folder relative to the working directory, files in it, and a picture.

    Raises
    ------
    SceneError
        If a name is no relative path, leads out of the folder, or is longer than file systems take.
    """

    folder: Path
    files: tuple[str, ...]
    picture: PictureRequest | None

    def __post_init__(self) -> None:
        for file in self.files:
            relative_name(file, "a file of [output]")

    @property
    def wants_error(self) -> bool:
        """True where a picture shows the error."""
        return self.picture is not None and self.picture.field == "error"

    @property
    def wants_frames(self) -> bool:
        """True where the frames of a problem in time are written or drawn."""
        drawn = self.picture is not None and self.picture.frames
        return drawn or any(file.lower().endswith(".pvd") for file in self.files)


def relative_name(name: object, what: str) -> str:
    """Return the name of a file, perhaps in folders of its own, that stays inside the folder it is put in.

    Raises
    ------
    SceneError
        If it is no text, absolute, has a ``..`` in it, or a part longer than file systems take.
    """
    if not isinstance(name, str) or not name.strip(" ./\\"):
        raise SceneError(f"{what} must be a name, got {shown(name)}.")
    parts = {*PurePosixPath(name).parts, *PureWindowsPath(name).parts}  # what leads out on either leads out on both
    if name.startswith("/") or PureWindowsPath(name).anchor or ".." in parts:
        inside = "the working directory" if what.startswith("folder") else "the output folder"
        remedy = "; leave it out and give --output, which takes any folder" if what.startswith("folder") else ""
        raise SceneError(f"{what} must be a relative path inside {inside}, got {shown(name)}{remedy}.")
    try:
        lengths = [len(part.encode()) for part in PurePosixPath(name).parts]
    except UnicodeEncodeError as error:
        raise SceneError(f"{what} must be a name that UTF-8 can hold, got {shown(name)}.") from error
    if "\0" in name or max(lengths) > MOST_FILE_NAME_BYTES or sum(lengths) > MOST_OUTPUT_BYTES:
        raise SceneError(
            f"{what} must be a name of at most {MOST_FILE_NAME_BYTES} bytes, with folders {MOST_OUTPUT_BYTES}, and "
            f"without NUL, got {shown(name)}."
        )
    return name


def output_folder(name: object) -> Path:
    """Return the folder that a scene file names: a relative path inside the working directory.

    Raises
    ------
    SceneError
        If it is anything else.
    """
    return Path(name if name == "." else relative_name(name, "folder of [output]"))


def check_links(path: Path, folder: Path, what: str) -> None:
    """Refuse a path in a folder that links lead out of it.

    Raises
    ------
    InputError
        Naming both; ``what`` says what the path is. Or if file systems here cannot hold its name.
    """
    check_name(path)
    try:
        inside = Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))
    except OSError as error:  # the working directory is gone
        raise SceneError(f"{what}, {shown(str(path))}, cannot be found: {error.strerror}.") from error
    if not inside:
        raise SceneError(
            f"{what} must be inside {shown(str(folder))}, and a link leads {shown(str(path))} out of it; remove the "
            "link, or give --output, which takes any folder."
        )
