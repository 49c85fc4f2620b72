"""The commands ``cpmkit vectors``, ``map`` and ``paint``; solvers are imported when a command runs."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from cpmkit.commands.group import progress_callback, traceback_option
from cpmkit.commands.options import (
    accuracy_options,
    as_shown,
    how_fine,
    json_option,
    scene_argument,
    spacing_option,
    with_error,
)

if TYPE_CHECKING:
    from cpmkit.facade import Solution


Command = TypeVar("Command", bound=Callable[..., Any])


@dataclass(frozen=True)
class CommandArguments:
    """The arguments that all commands of applications have.

    Attributes
    ----------
    command : str
        The name of the command, which determines how the scene file is read.
    scene : Path
        The scene file.
    spacing : float or None
        Spacing in place of that of the file.
    output : Path or None
        Folder of results in place of that of the file.
    look : tuple of str
        Options of the picture, KEY=VALUE each.
    as_json, quiet : bool
        Whether to print JSON, and whether to print no summary.
    accuracy : dict
        Accuracy target in place of a spacing.
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
class ApplicationResult:
    """The result of an application, as a command prints and writes it.

    Attributes
    ----------
    solution : Solution
        The solution that is saved.
    picture : Solution
        The solution that the picture shows.
    values : dict
        Plain values for JSON, beside the summary of the solution.
    lines : list of str
        The same values as printed lines.
    """

    solution: Solution
    picture: Solution
    values: dict[str, Any]
    lines: list[str]


def application_options(command: Command) -> Command:
    """Return the command with the scene as argument and the options that all commands of applications have."""
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


def run_application(target: CommandArguments, solve: Callable[[dict[str, Any]], ApplicationResult]) -> None:
    """Read the scene, run the application, write the files of [output], and print a summary.

    ``solve`` gets the keyword arguments of the application's function, with ``surface``, ``spacing`` and ``progress``.
    """
    from cpmkit.runtime.messages import collected_warnings
    from cpmkit.saving.results import check_request, write_results
    from cpmkit.scenefile.application_files import load_application

    with collected_warnings() as issued, progress_callback(target.scene, target.quiet) as progress:
        begun = time.perf_counter()
        try:
            loaded = load_application(target.scene, target.command)
            folder, request = target.output or loaded.output.folder, as_shown(loaded.output, None, target.look, None)
            check_request(request, loaded.scene.surface, folder)
            spacing, options = how_fine(loaded, target.spacing, **target.accuracy)
            result = solve(
                {**options, **loaded.arguments, "surface": loaded.scene, "spacing": spacing, "progress": progress}
            )
        except Exception:
            _warn(issued, err=True)
            raise
        solution = replace(result.solution, seconds={"make": time.perf_counter() - begun})  # of all its solves
        warnings = list(dict.fromkeys([*issued, *solution.warnings]))
        written = write_results(solution, request, folder, progress, warnings, result.picture)
    if target.as_json:
        click.echo(json.dumps({**written.summary, **result.values}, indent=2))
    elif not target.quiet:
        click.echo("\n".join(_lines(result, written.summary, folder)))
    if not target.as_json:
        _warn(warnings, err=target.quiet)
    written.check()


def _lines(result: ApplicationResult, summary: dict[str, Any], folder: Path) -> Iterable[str]:
    """Yield the printed lines of a result: unknowns, seconds, error, way to the accuracy target, values and files."""
    solution, seconds = result.solution, summary["seconds"]
    stages = ", ".join(f"{stage} {spent:.1f}" for stage, spent in seconds.items())
    files = [*summary["files"], *([summary["picture"]["file"]] if summary["picture"] else [])]
    yield f"unknowns   {solution.discretized.size:,} at spacing {solution.spacing:.4g}"
    yield f"seconds    {sum(seconds.values()):.1f} ({stages})"
    yield from (f"error      {line}" for line in str(solution.estimated or "").splitlines())
    yield from (f"way        {line}" for line in str(solution.solve_history or "").splitlines())
    yield from result.lines
    yield from (f"written    {Path(folder, file)}" for file in files)


def _warn(sentences: Iterable[str], err: bool = False) -> None:
    """Print sentences as warnings, on standard error if ``err``."""
    for sentence in sentences:
        click.echo(f"warning    {sentence}", err=err)


@click.command("map")
@application_options
def map_to_target(**keys: Any) -> None:
    """Relax a map from a scene's surface to its [target] to least stretch, and write the files of [output].

    Each [[landmark]] fixes the image of a point or of a curve; [map] holds the initial map and the criterion of rest.
    Files hold the coordinates of the images; the picture shows the target's colours, or the texture of [map],
    on the surface.
    """
    run_application(CommandArguments("map", **keys), _solve_map)


def _solve_map(arguments: dict[str, Any]) -> ApplicationResult:
    """Return the harmonic map that :func:`map_to_target` computes, with its energy and, if it has one, its degree."""
    from cpmkit.applications import harmonic_map
    from cpmkit.errors import CpmkitError

    texture = arguments.pop("texture", None)
    result = harmonic_map(**arguments)
    try:
        degree = result.degree
    except CpmkitError:  # only closed surfaces have a degree
        degree = None
    lines = [
        f"energy     {result.energy[0]:.6g} at first, {result.energy[-1]:.6g} after {len(result.energy) - 1} steps, "
        f"{'at' if result.at_rest else 'not at'} rest",
        *([] if degree is None else [f"degree     {degree}"]),
    ]
    values = {"energy": result.energy.tolist(), "at_rest": result.at_rest, "degree": degree}
    return ApplicationResult(result.solution, result.drawable(texture), values, lines)


@click.command()
@application_options
@accuracy_options
def paint(
    tolerance: float | None,
    norm: str | None,
    seconds: float | None,
    memory: str | None,
    estimate: bool | None,
    **keys: Any,
) -> None:
    """Diffuse the colours of a scene's curves over its surface, and write the files of [output].

    Each [[curve]] has a colour on each side, or several along it. The conditions of the scene's boundaries and edge are
    kept.
    """
    accuracy = {"tolerance": tolerance, "norm": norm, "seconds": seconds, "memory": memory}
    run_application(CommandArguments("paint", **keys, accuracy=accuracy), partial(_solve_paint, estimate))


def _solve_paint(estimate: bool | None, arguments: dict[str, Any]) -> ApplicationResult:
    """Return the colours that :func:`paint` computes, with an error estimate as :func:`with_error` decides."""
    from cpmkit.applications import diffusion_curves

    solution = with_error(diffusion_curves(**arguments).solution, estimate)
    return ApplicationResult(solution, solution, {}, [])


@click.command()
@application_options
def vectors(**keys: Any) -> None:
    """Extend directions over a scene's surface by parallel transport, and write the files of [output].

    Each [[direction]] of the scene gives a direction at a point or along a curve. Its boundaries are barriers. The
    singularities of the field are printed with their indices, on surfaces that have triangles.
    """
    run_application(CommandArguments("vectors", **keys), _solve_vectors)


def _solve_vectors(arguments: dict[str, Any]) -> ApplicationResult:
    """Return the field that :func:`vectors` computes, with its singularities on a surface with triangles."""
    from cpmkit.applications import vector_field
    from cpmkit.errors import CpmkitError

    field = vector_field(**arguments)
    try:
        places = [{"index": point.index, "place": point.place.tolist()} for point in field.singularities]
    except CpmkitError:  # no triangles
        return ApplicationResult(field.solution, field.drawable(), {}, [])
    lines = [
        *(f"index      {point['index']:+d} at ({', '.join(f'{x:.3g}' for x in point['place'])})" for point in places),
        f"indices    {sum(point['index'] for point in places):+d} in all",
    ]
    return ApplicationResult(field.solution, field.drawable(), {"singularities": places}, lines)
