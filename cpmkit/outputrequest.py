"""What a scene file asks to be written."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from cpmkit.arrays import as_vector
from cpmkit.errors import SceneError


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
    """

    file: str = "picture.png"
    width: int = 1200
    view: tuple[float, ...] | None = None
    up: tuple[float, ...] | None = None
    curves: bool = True
    frames: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.file, str):
            raise SceneError(f"the picture's file must be the name of a PNG, got {self.file!r}.")
        if isinstance(self.width, bool) or not isinstance(self.width, int):
            raise SceneError(f"the picture's width must be a number of pixels, got {self.width!r}.")
        for name in ("view", "up"):
            if getattr(self, name) is not None:
                object.__setattr__(
                    self, name, tuple(as_vector(getattr(self, name), 3, f"{name} of the picture").tolist())
                )


@dataclass(frozen=True)
class OutputRequest:
    """Where results go: a folder relative to the working directory, files in it, and a picture."""

    folder: Path
    files: tuple[str, ...]
    picture: PictureRequest | None

    def __post_init__(self) -> None:
        for file in self.files:
            if not isinstance(file, str):
                raise SceneError(f"files of [output] must be names of files, got {file!r}.")

    @property
    def wants_frames(self) -> bool:
        """True where the frames of a problem in time are written or drawn."""
        drawn = self.picture is not None and self.picture.frames
        return drawn or any(file.lower().endswith(".pvd") for file in self.files)
