"""The files that [output] of a scene file requests: solutions, the picture, and last the summary that lists them."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cpmkit.errors import CpmkitError, InputError
from cpmkit.files.whole_files import check_place, explain_system_error
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.mesh.mixed_cells import mesh_method
from cpmkit.saving.mesh_files import MESH_WRITERS
from cpmkit.saving.saved_solutions import FILMS, PAGE, check_file, draw_frames, frames_folder, save, write_summary
from cpmkit.scene.compound_equations import Eigen
from cpmkit.scene.scene import Scene
from cpmkit.scenefile.look import VERTICES, OutputRequest, check_links
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Progress
from cpmkit.view import check_picture, picture
from cpmkit.view.pictures import check_channels


@dataclass(frozen=True)
class WrittenResults:
    """The outcome of writing the files that [output] of a scene file requests."""

    #: Summary of the solution, with the keys ``folder``, ``files`` (those written), ``unwritten`` (reasons of others),
    #: ``picture`` (its file and the description of its camera), and the seconds of writing.
    summary: dict[str, Any]
    #: The exceptions of the files that could not be written, by the names of the files.
    failures: Mapping[str, Exception]

    def check(self) -> None:
        """Raise InputError, with the reasons, if a file was not written; raise a defect of cpmkit unchanged."""
        for error in self.failures.values():
            if not isinstance(error, (CpmkitError, MemoryError)):
                raise error
        if self.failures:
            missing = "; ".join(sentence.removesuffix(".") for sentence in self.summary["unwritten"].values())
            drawn = self.summary["picture"]
            written = ", ".join([*self.summary["files"], *([drawn["file"]] if drawn else [])])
            outcome = f"written into {self.summary['folder']} were {written}" if written else "nothing was written"
            raise InputError(f"{missing}; {outcome}.")


def check_request(
    request: OutputRequest, surface: ClosestPointSource, folder: Path, channels: int | None = None
) -> None:
    """Check before anything is solved that the requested files and the picture can be written into ``folder``.

    ``channels`` is the number of channels of the solution if it is known; a picture of another channel is refused.
    Raises InputError or MissingDependencyError if a file cannot be made of a solution on ``surface``, or be written.
    """
    for file in request.files:
        check_file(file, surface, _mesh_choice(file, request))
        if request.wants_error and file.lower().endswith(FILMS):
            raise InputError(f"{file!r} shows frames, and field = 'error' the error at the end; leave out one of them.")
    target = request.picture
    if target is not None:
        check_picture(target.file, target)
        if channels is not None:
            check_channels(target, channels, surface.dim)
        mesh_method(surface)
    for file in (*request.files, *([] if target is None else [target.file])):
        check_links((folder / file).parent, folder, f"the folder of {file!r}")
        check_place(folder / file)
        if file.lower().endswith(".pvd"):
            frames = frames_folder(folder / file)
            check_links(frames, folder, f"the folder of the frames of {file!r}")
            check_place(frames / "frame.vtp")


def solution_channels(scene: Scene) -> int:
    """Return the number of channels of a solution of the scene; for an eigenvalue problem the number of modes."""
    return scene.problem.count if isinstance(scene.problem, Eigen) else scene.channels


def write_results(
    solution: SolutionRecord,
    request: OutputRequest,
    folder: Path,
    progress: Progress,
    warnings: Sequence[str] | None = None,
    drawn_as: SolutionRecord | None = None,
) -> WrittenResults:
    """Write all files of ``request`` into ``folder``, which is created; existing files are replaced.

    The result has the summary and the failures. A failure of a file does not prevent the others, and every written file
    is whole. The summary is written last. If given, ``warnings`` replace those of the solution in it, and pictures and
    pages show ``drawn_as``; ``progress`` is called with the stages ``write`` and ``picture``.
    """
    summaries = [file for file in request.files if file.lower().endswith(".json")]
    others = [file for file in request.files if file not in summaries]
    failures: dict[str, Exception] = {}
    seconds, shown = dict(solution.seconds), drawn_as or solution
    target = request.picture
    drawn: dict[str, Any] | None = None
    start = time.perf_counter()
    for index, file in enumerate(others):
        progress("write", index / len(others))
        with _collect_failures(failures, file):
            suffix = Path(file).suffix.lower()
            look = target.look if target is not None and suffix in (*FILMS, PAGE) else {}
            saved = shown if suffix == PAGE else solution
            save(saved, _create_folder(folder / file), _mesh_choice(file, request), **look)
        seconds["write"] = time.perf_counter() - start
    if target is not None:
        progress("picture", 0.0)
        start = time.perf_counter()
        with _collect_failures(failures, target.file):
            place = _create_folder(folder / target.file)
            drawn = {"file": target.file, "camera": picture(shown, place, **target.look).camera}
            if target.frames:
                frames = draw_frames(shown, place, target)
                drawn["frames"] = [str(frame.relative_to(folder)) for frame in frames]
        seconds["picture"] = time.perf_counter() - start
    summary = {
        **solution.summary(),
        **({} if warnings is None else {"warnings": list(warnings)}),
        "folder": str(folder),
        "files": [file for file in request.files if file not in failures],
        "unwritten": {file: _failure_sentence(folder / file, error) for file, error in failures.items()},
        "picture": drawn,
        "seconds": seconds,
    }
    for file in summaries:
        with _collect_failures(failures, file):
            write_summary(summary, _create_folder(folder / file))
    lost = {file: _failure_sentence(folder / file, error) for file, error in failures.items()}
    files = [file for file in summary["files"] if file not in failures]
    return WrittenResults({**summary, "files": files, "unwritten": lost}, failures)


@contextmanager
def _collect_failures(failures: dict[str, Exception], file: str) -> Iterator[None]:
    """Catch an exception of the block, and put it into ``failures``, in place, under the name ``file``."""
    try:
        yield
    except Exception as error:
        failures[file] = error


def _failure_sentence(file: Path, error: Exception) -> str:
    """Return the sentence that explains why a file could not be written because of ``error``."""
    if isinstance(error, MemoryError):
        return f"{file} cannot be written: memory ran out."
    return str(error) if isinstance(error, CpmkitError) else f"{file} cannot be written: {type(error).__name__}."


def _mesh_choice(file: str, request: OutputRequest) -> str:
    """Return the mesh of ``file``: ``request.vertices``, "own" or "display", for formats of meshes, else "display"."""
    return request.vertices if Path(file).suffix.lower() in MESH_WRITERS else VERTICES[0]


def _create_folder(path: Path) -> Path:
    """Create the folder of ``path``, and return ``path``; raise InputError if the system refuses."""
    with explain_system_error(f"The folder {path.parent} cannot be made"):
        path.parent.mkdir(parents=True, exist_ok=True)
    return path
