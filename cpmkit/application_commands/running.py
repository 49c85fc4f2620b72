"""What the commands of applications share: options, reading the scene, progress, and what is written and told."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from cpmkit.command_group import progress_callback, traceback_option
from cpmkit.command_options import as_shown, how_fine, json_option, scene_argument, spacing_option

if TYPE_CHECKING:
    from cpmkit.facade import Solution

Command = TypeVar("Command", bound=Callable[..., Any])


@dataclass(frozen=True)
class AccuracyTarget:
    """What every command of an application is asked for on its command line.

    Attributes
    ----------
    command : str
        Its name, which says how the scene is read.
    scene : Path
        The scene file.
    spacing : float or None
        Overrides the file's.
    output : Path or None
        Overrides the file's folder.
    look : tuple of str
        KEY=VALUE each, overrides of the picture.
    as_json, quiet : bool
        What is shown.
    accuracy : dict
        What is asked for in place of a spacing.
    """

    command: str
    scene: Path
    spacing: float | None
    output: Path | None
    look: tuple[str, ...]
    as_json: bool
    quiet: bool
    accuracy: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Made:
    """What an application has made.

    Attributes
    ----------
    solution : Solution
        What is saved.
    drawn : Solution
        What the picture shows.
    found : dict
        Plain values for JSON, beside the summary of the solution.
    told : list of str
        The same in lines for people.
    """

    solution: Solution
    drawn: Solution
    found: dict[str, Any]
    told: list[str]


def application_options(command: Command) -> Command:
    """Give a command the scene and the options that all of them take."""
    options: list[Callable[[Any], Any]] = [
        scene_argument,
        spacing_option,
        click.option(
            "--output",
            type=click.Path(file_okay=False, path_type=Path),
            metavar="FOLDER",
            help="Where results go; overrides the file's folder.",
        ),
        click.option(
            "--look",
            multiple=True,
            metavar="KEY=VALUE",
            help="How the picture of the file looks, such as width=600, up=y; overrides the file's. May be given "
            "several times.",
        ),
        json_option,
        click.option("--quiet", is_flag=True, help="Show neither progress nor a summary; warnings are still shown."),
        traceback_option,
    ]
    for option in reversed(options):
        command = option(command)
    return command


def run(target: AccuracyTarget, make: Callable[[dict[str, Any]], Made]) -> None:
    """Read the scene, make the application, write what [output] asks for, and tell it.

    ``make`` gets the keyword arguments of the application's function, with ``surface``, ``spacing`` and ``progress``.
    """
    from cpmkit.runtime.messages import collected_warnings
    from cpmkit.saving.results import check_request, write_results
    from cpmkit.scenefile.application_files import load_application

    with collected_warnings() as heard, progress_callback(target.scene, target.quiet) as progress:
        begun = time.perf_counter()
        try:
            loaded = load_application(target.scene, target.command)
            folder, request = target.output or loaded.output.folder, as_shown(loaded.output, None, target.look, None)
            check_request(request, loaded.scene.surface, folder)
            spacing, options = how_fine(loaded, target.spacing, **target.accuracy)
            made = make({**options, **loaded.given, "surface": loaded.scene, "spacing": spacing, "progress": progress})
        except Exception:
            _warn(heard, err=True)
            raise
        solution = replace(made.solution, seconds={"make": time.perf_counter() - begun})  # of all its solves
        warnings = list(dict.fromkeys([*heard, *solution.warnings]))
        written = write_results(solution, request, folder, progress, warnings, made.drawn)
    if target.as_json:
        click.echo(json.dumps({**written.summary, **made.found}, indent=2))
    elif not target.quiet:
        click.echo("\n".join(_lines(made, written.summary, folder)))
    if not target.as_json:
        _warn(warnings, err=target.quiet)
    written.check()


def _lines(made: Made, summary: dict[str, Any], folder: Path) -> Iterable[str]:
    solution, seconds = made.solution, summary["seconds"]
    stages = ", ".join(f"{stage} {spent:.1f}" for stage, spent in seconds.items())
    files = [*summary["files"], *([summary["picture"]["file"]] if summary["picture"] else [])]
    yield f"unknowns   {solution.discretized.size:,} at spacing {solution.spacing:.4g}"
    yield f"seconds    {sum(seconds.values()):.1f} ({stages})"
    yield from (f"error      {line}" for line in str(solution.estimated or "").splitlines())
    yield from (f"way        {line}" for line in str(solution.solve_history or "").splitlines())
    yield from made.told
    yield from (f"written    {Path(folder, file)}" for file in files)


def _warn(sentences: Iterable[str], err: bool = False) -> None:
    for sentence in sentences:
        click.echo(f"warning    {sentence}", err=err)
