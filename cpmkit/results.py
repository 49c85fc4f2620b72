"""Writing what a scene file asks for: the files, the picture, and last the summary that names them."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cpmkit.errors import InputError
from cpmkit.evolution.series import draw_frames
from cpmkit.export import check_file, save, write_summary
from cpmkit.outputrequest import OutputRequest, PictureRequest
from cpmkit.protocols import ClosestPointSource, Progress
from cpmkit.surface_mesh import mesh_of
from cpmkit.view import check_picture, picture

if TYPE_CHECKING:
    from cpmkit.readable import ReadableSolution


def check_request(request: OutputRequest, surface: ClosestPointSource) -> None:
    """Check, before anything is solved, that everything asked for can be written.

    Raises
    ------
    InputError, MissingDependencyError
        If a file or the picture cannot be made of a solution on ``surface`` here.
    """
    for file in request.files:
        check_file(file, surface)
    if request.picture is not None:
        check_picture(request.picture.file, request.picture.width)
        mesh_of(surface)


def write_results(
    solution: ReadableSolution, request: OutputRequest, folder: Path, progress: Progress
) -> dict[str, Any]:
    """Write all that ``request`` asks for into ``folder``, made if need be; return the summary.

    The summary is the solution's, with the keys ``folder``, ``files``, ``picture`` (the file, its
    renderer and why it was not another) and the seconds that writing took.

    Raises
    ------
    InputError
        If the folder cannot be made, or a file cannot be written. Every file there is whole.
    """
    summaries = [file for file in request.files if file.endswith(".json")]
    others = [file for file in request.files if file not in summaries]
    written: dict[str, Any] = {"folder": str(folder), "files": list(request.files), "picture": None}
    seconds = dict(solution.seconds)

    start = time.perf_counter()
    for index, file in enumerate(others):
        progress("write", index / len(others))
        save(solution, _made(folder / file))
        seconds["write"] = time.perf_counter() - start
    if request.picture is not None:
        progress("picture", 0.0)
        start = time.perf_counter()
        written["picture"] = _draw(solution, request.picture, folder)
        seconds["picture"] = time.perf_counter() - start
    summary = {**solution.summary(), **written, "seconds": seconds}
    for file in summaries:
        write_summary(summary, _made(folder / file))
    return summary


def _draw(solution: ReadableSolution, asked: PictureRequest, folder: Path) -> dict[str, Any]:
    file = _made(folder / asked.file)
    options: dict[str, Any] = {"width": asked.width, "view": asked.view, "up": asked.up, "curves": asked.curves}
    drawn = picture(solution, file, **options)
    told = {"file": asked.file, "renderer": drawn.renderer, "reason": drawn.reason}
    if not asked.frames:
        return told
    frames = draw_frames(solution, file, **options)
    return {**told, "frames": [str(frame.file.relative_to(folder)) for frame in frames]}


def _made(path: Path) -> Path:
    """Return ``path``, whose folder exists afterwards."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"The folder {path.parent} cannot be made: {error.strerror}.") from error
    return path
