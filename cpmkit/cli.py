"""The command ``cpmkit``. Whatever a command needs is imported when that command runs."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from contextlib import nullcontext
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

import click

from cpmkit.errors import CpmkitError, PluginError
from cpmkit.plugins import COMMANDS
from cpmkit.studies.commands import study


class CommandGroup(click.Group):
    """The built-in commands in their own order, then those of plugins, which are imported when called.

    An error that cpmkit raises on purpose ends the process with its one sentence and exit code 1;
    any other is a defect and shows its traceback.
    """

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        """Return all names, importing nothing."""
        return [*self.commands, *(name for name in _offered() if name not in self.commands)]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command; a plugin's is imported here."""
        built_in = super().get_command(ctx, cmd_name)
        point = _offered().get(cmd_name)
        return built_in if built_in or point is None else _load(point)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands; of a plugin's, which is not imported for this, only where it comes from."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, command.get_short_help_str(200)) for name, command in self.commands.items()])
        plugged = [(name, _origin(_offered()[name])) for name in self.list_commands(ctx) if name not in self.commands]
        if plugged:
            with formatter.section("Commands of plugins"):
                formatter.write_dl(plugged)

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command."""
        try:
            return super().invoke(ctx)
        except CpmkitError as error:
            raise click.ClickException(str(error)) from error


def _offered() -> Mapping[str, EntryPoint]:
    return {point.name: point for point in sorted(entry_points(group=COMMANDS), key=lambda point: point.name)}


def _origin(point: EntryPoint) -> str:
    return f"from {point.dist.name} {point.dist.version}" if point.dist else f"from {point.value}"


def _load(point: EntryPoint) -> click.Command:
    try:
        command = point.load()
    except Exception as error:
        raise PluginError(f"The command {point.name!r} ({_origin(point)}) does not import: {error}") from error
    if not isinstance(command, click.Command):
        raise PluginError(f"The command {point.name!r} ({_origin(point)}) is {command!r}, not a click command.")
    return command


def _finite(ctx: click.Context, parameter: click.Parameter, value: float | None) -> float | None:
    if value is not None and not math.isfinite(value):
        raise click.BadParameter(f"{value} is not a finite number.", ctx, parameter)
    return value


scene_argument = click.argument(
    "scene", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="SCENE.toml"
)
spacing_option = click.option(
    "--spacing",
    type=click.FloatRange(min=0, min_open=True),
    callback=_finite,
    metavar="LENGTH",
    help="Distance between grid nodes, in the scene's unit; overrides the file's.",
)
json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print JSON on standard output, and nothing else there."
)


@click.group(cls=CommandGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="cpmkit")
def main() -> None:
    """Solve PDEs on curves and surfaces by the closest point method.

    A scene is a TOML file: a surface, boundaries inside it with conditions on each side, an equation
    and a grid spacing. Start with `cpmkit explain SCENE.toml`, which says what would be built and at
    what cost, then `cpmkit solve SCENE.toml`.

    Exit codes: 0 done; 1 the scene or its solution failed; 2 the command line is wrong.
    """


@main.command()
@scene_argument
@spacing_option
@click.option(
    "--backend",
    default="cpm",
    metavar="NAME",
    help="What solves: cpm, the closest point method, or a back end of a plugin, such as fem. Of the file's "
    "[discretization] and [solver], another back end takes the spacing and the tolerance.",
)
@click.option(
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="FOLDER",
    help="Where results go; overrides the file's folder, which counts from the working directory.",
)
@click.option(
    "--checkpoint",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Of a problem in time: an .npz file in which the state of the run is kept, every 100 steps.",
)
@click.option(
    "--resume",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Go on from the checkpoint of an earlier run of the same scene.",
)
@json_option
@click.option("--quiet", is_flag=True, help="Show neither progress nor a summary; errors are still shown.")
def solve(
    scene: Path,
    spacing: float | None,
    backend: str,
    output: Path | None,
    checkpoint: Path | None,
    resume: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Solve a scene and write what it asks for: files, a picture, a summary.

    The output folder is made once the scene is solved, so a scene that fails leaves nothing behind.
    """
    from cpmkit import load_scene
    from cpmkit import solve as solve_scene
    from cpmkit.progress import ProgressLine
    from cpmkit.results import check_request, write_results

    meter = nullcontext(_silent) if quiet else ProgressLine(sys.stderr)
    with meter as progress:
        progress("read", 0.0)
        loaded = load_scene(scene)
        check_request(loaded.output, loaded.scene.surface)
        options = loaded.options if backend == "cpm" else _options_of(backend, loaded.options)
        options |= {key: file for key, file in (("checkpoint", checkpoint), ("resume", resume)) if file}
        solution = solve_scene(loaded.scene, spacing=spacing or loaded.spacing, progress=progress, **options)
        summary = write_results(solution, loaded.output, output or loaded.output.folder, progress)
    if as_json:
        click.echo(json.dumps(summary, indent=2))
    elif not quiet:
        click.echo(_told(solution, summary))


def _options_of(backend: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options for another back end: the file's others describe the lattice and its solver."""
    return {"backend": backend, **{name: value for name, value in options.items() if name == "tolerance"}}


def _silent(stage: str, fraction: float) -> None:
    del stage, fraction


def _told(solution: Any, summary: Mapping[str, Any]) -> str:
    """Return the summary of a solve for people."""
    work, report, seconds = solution.work, solution.report, summary["seconds"]
    stages = ", ".join(f"{stage} {spent:.1f}" for stage, spent in seconds.items())
    ghosts = f", of which ghosts {work.ghosts:,}" if hasattr(work, "ghosts") else ""
    lines = [
        f"unknowns   {work.unknowns:,}{ghosts}",
        f"solver     {report.solver}: {report.reason}",
        f"seconds    {sum(seconds.values()):.1f} ({stages})",
    ]
    lines += [f"warning    {warning}" for warning in solution.warnings]
    lines += [f"written    {Path(summary['folder'], file)}" for file in summary["files"]]
    if summary["picture"]:
        drawn = summary["picture"]
        why = f"; {drawn['reason']}" if drawn["reason"] else ""
        lines.append(f"written    {Path(summary['folder'], drawn['file'])} (drawn by {drawn['renderer']}{why})")
    return "\n".join(lines)


@main.command()
@scene_argument
@spacing_option
@json_option
def explain(scene: Path, spacing: float | None, as_json: bool) -> None:
    """Say what solving a scene would build, why, and at what cost.

    Nothing is solved and nothing is written.
    """
    from cpmkit import explain as explain_scene
    from cpmkit import load_scene
    from cpmkit.progress import ProgressLine

    with ProgressLine(sys.stderr) as progress:
        progress("read", 0.0)
        loaded = load_scene(scene)
        explanation = explain_scene(
            loaded.scene, spacing=spacing or loaded.spacing, progress=progress, **loaded.options
        )
    click.echo(json.dumps(explanation.as_dict(), indent=2) if as_json else str(explanation))


@main.command()
@json_option
def plugins(as_json: bool) -> None:
    """List the kinds of surfaces and curves that scenes can name.

    Names are read from the metadata of installed distributions; no plugin is imported.
    """
    from dataclasses import asdict

    from cpmkit.plugins import installed_kinds

    kinds = installed_kinds()
    if as_json:
        click.echo(json.dumps([asdict(kind) for kind in kinds], indent=2))
        return
    if not kinds:
        click.echo("No plugin is installed; `pip install ./plugins/*` in a clone of the repository adds them.")
    width = max((len(kind.kind) for kind in kinds), default=0) + 2
    for kind in kinds:
        click.echo(f"{kind.kind:<{width}}{kind.distribution} {kind.version}")


@main.command()
@click.argument("scene", required=False, type=click.Path(path_type=Path), metavar="[SCENE.toml]")
@json_option
@click.pass_context
def doctor(ctx: click.Context, scene: Path | None, as_json: bool) -> None:
    """Report what is installed, whether pictures can be drawn, and whether a scene loads.

    The first thing to send along with a question.
    """
    from cpmkit.doctor import diagnose

    diagnosis = diagnose(scene)
    click.echo(json.dumps(diagnosis.as_dict(), indent=2) if as_json else str(diagnosis))
    if diagnosis.scene:
        ctx.exit(1)


main.add_command(study)
