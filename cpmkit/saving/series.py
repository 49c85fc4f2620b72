"""The frames of a run in time as files: a .pvd index for ParaView with one .vtp a frame, and a picture a frame."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

from cpmkit.files.whole_files import explain_system_error, remove_leftovers, unfinished_name, written_whole
from cpmkit.saving.mesh_files import write_vtp
from cpmkit.scenefile.look import Look
from cpmkit.solution.frames import EvolvedRecord, frames_of
from cpmkit.view.film import frame_images
from cpmkit.view.layout import write_png

if TYPE_CHECKING:
    from cpmkit.solution.record import SolutionRecord

#: Of the folder beside the index.
FRAMES_SUFFIX = "_frames"


def save_series(solution: SolutionRecord, path: Path) -> None:
    """Write the index ``path`` and, in the folder ``<name>_frames`` beside it, one .vtp a frame.

    All frames are written before the first takes its place, and the index is written last: what an index names is
    there. Frames of an earlier series that are more in number are removed.

    Raises
    ------
    InputError
        If the solution has no frames, or a file cannot be written.
    """
    frames = frames_of(solution, path.name)
    assert isinstance(solution, EvolvedRecord)
    folder = frames_folder(path)
    unfinished = unfinished_name(folder)
    names = [_numbered(Path("frame.vtp"), number, len(frames)).name for number in range(len(frames))]
    try:
        with explain_system_error(f"{folder} cannot be written"):
            remove_leftovers(folder)
            unfinished.mkdir()
            for name, mesh in zip(names, solution.frame_meshes(), strict=True):
                write_vtp(mesh, unfinished / name)
            folder.mkdir(exist_ok=True)
            for name in names:
                os.replace(unfinished / name, folder / name)
            for stale in {file.name for file in folder.glob("frame-*.vtp")} - {*names}:
                (folder / stale).unlink(missing_ok=True)  # another thread may have removed it
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
    with written_whole(path) as index:
        text = _index([frame.time for frame in frames], [f"{folder.name}/{name}" for name in names])
        index.write_text(text, encoding="utf-8", errors="surrogateescape")


def frames_folder(path: Path) -> Path:
    """Return the folder beside the index ``path`` that holds the frames."""
    return path.with_name(path.stem + FRAMES_SUFFIX)


def draw_frames(solution: SolutionRecord, path: Path, look: Look) -> list[Path]:
    """Draw each frame into ``<name>-0000.png`` and so on, all in the same colours, and return these paths.

    Raises
    ------
    InputError
        If the solution has no frames.
    """
    count = len(frames_of(solution, "a picture of each frame"))
    files = [_numbered(path, number, count) for number in range(count)]
    for file, image in zip(files, frame_images(solution, look), strict=True):
        with written_whole(file) as unfinished:
            write_png(image, unfinished)
    return files


def _numbered(path: Path, number: int, count: int) -> Path:
    """Return ``path`` with a number of at least four digits, as many as the last of ``count`` needs."""
    digits = max(4, len(str(count - 1)))
    return path.with_name(f"{path.stem}-{number:0{digits}}{path.suffix}")


def _index(times: list[float], files: list[str]) -> str:
    entries = [
        f'    <DataSet timestep="{time!r}" part="0" file={quoteattr(file)}/>'
        for time, file in zip(times, files, strict=True)
    ]
    lines = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>", *entries]
    return "\n".join([*lines, "  </Collection>", "</VTKFile>", ""])
