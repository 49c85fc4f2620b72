"""What commands share: their group, with those of plugins, their progress, messages of errors, and options."""

from __future__ import annotations

import errno
import json
import math
import sys
import tomllib
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from cpmkit.errors import CpmkitError, PluginError, shown
from cpmkit.plugins import COMMANDS_GROUP
from cpmkit.runtime.memory import is_out_of_memory, memory_limit

if TYPE_CHECKING:
    from cpmkit.facade import Solution
    from cpmkit.scenefile.look import OutputRequest
    from cpmkit.scenefile.scene_files import SceneFile


#: Keys in the context of a command: its file, its stage, and whether tracebacks are shown.
FILE_KEY, STAGE_KEY, TRACEBACK_KEY = "cpmkit.file", "cpmkit.stage", "cpmkit.traceback"


class UnexpectedError(click.ClickException):
    """An error that cpmkit did not raise on purpose: a defect."""

    exit_code = 3


class CommandGroup(click.Group):
    """The built-in commands in their own order, then those of plugins, which are imported when called.

    An error of a command is printed as one sentence. The exit code is 1 for an error that cpmkit raises on purpose and
    for failures of memory or the system, 3 for other errors, which are defects, and 130 for an interruption.
    """

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        """Return the names of all commands, without importing plugins."""
        return [*self.commands, *(name for name in _plugin_commands() if name not in self.commands)]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command ``cmd_name`` or None; raise PluginError if a plugin's does not import or is no command."""
        built_in = super().get_command(ctx, cmd_name)
        point = _plugin_commands().get(cmd_name)
        if built_in or point is None:
            return built_in
        named = f"The command {point.name!r} ({_distribution_text(point)})"
        try:
            command = point.load()
        except Exception as error:
            raise PluginError(f"{named} does not import: {error}") from error
        if not isinstance(command, click.Command):
            raise PluginError(f"{named} is {command!r}, not a click command.")
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the built-in commands with their help, and those of plugins, not imported, with their distributions."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, command.get_short_help_str(200)) for name, command in self.commands.items()])
        others = [name for name in self.list_commands(ctx) if name not in self.commands]
        plugged = [(name, _distribution_text(_plugin_commands()[name])) for name in others]
        if plugged:
            with formatter.section("Commands of plugins"):
                formatter.write_dl(plugged)

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command and return its result; raise errors, except of a closed pipe, as click's with an exit code."""
        try:
            return super().invoke(ctx)
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except KeyboardInterrupt as error:
            click.echo(f"\nInterrupted{_stage_text(ctx)}.", err=True)
            raise click.exceptions.Exit(130) from error  # 128 and the number of the signal
        except Exception as error:
            if getattr(error, "errno", None) == errno.EPIPE:  # the reader closed the pipe; click ends quietly
                raise
            if ctx.meta.get(TRACEBACK_KEY):
                click.echo(traceback.format_exc(), err=True)
            raise _click_error(ctx, error) from error


def _click_error(ctx: click.Context, error: Exception) -> click.ClickException:
    """Return the exception of click that prints an error as one sentence and has its exit code."""
    if isinstance(error, CpmkitError):
        return click.ClickException(str(error))
    if is_out_of_memory(error):
        return click.ClickException(f"Memory ran out{_stage_text(ctx)}: {memory_limit()}; a larger spacing needs less.")
    if isinstance(error, OSError) and error.strerror:
        name = f": {shown(error.filename)}" if error.filename else ""
        return click.ClickException(f"The system refused{_stage_text(ctx)}: {error.strerror}{name}.")
    error_text = f"{type(error).__name__}: {shown(str(error))}" if str(error) else type(error).__name__
    return UnexpectedError(
        f"{error_text}{_stage_text(ctx)}. This is a bug in cpmkit or in a plugin; the option --traceback shows where "
        "it arose, for a report."
    )


def _stage_text(ctx: click.Context) -> str:
    """Return " during the stage ... of FILE" for the running command, or what is known: " for FILE", or ""."""
    stage, file = ctx.meta.get(STAGE_KEY), ctx.meta.get(FILE_KEY)
    if stage:
        return f" during the stage {stage!r}" + (f" of {file}" if file else "")
    return f" for {file}" if file else ""


#: The option ``--traceback``, noted in the context of a command.
traceback_option = click.option(
    "--traceback",
    is_flag=True,
    expose_value=False,
    callback=lambda ctx, _, value: ctx.meta.update({TRACEBACK_KEY: True} if value else {}),
    help="After an error also show where in the code it arose.",
)


@contextmanager
def progress_callback(file: Path, quiet: bool = False) -> Iterator[Callable[[str, float], None]]:
    """Yield a callback (stage, share from 0 to 1), shown unless ``quiet``; errors then name the stage and ``file``."""
    from cpmkit.runtime.progress import ProgressLine
    from cpmkit.types import no_progress

    meta = click.get_current_context().meta
    meta[FILE_KEY] = file
    closed = sys.stderr is None  # by the shell's 2>&-
    with nullcontext(no_progress) if quiet or closed else ProgressLine(sys.stderr) as show:

        def progress(stage: str, fraction: float) -> None:
            meta[STAGE_KEY] = stage
            show(stage, fraction)

        progress("read", 0.0)
        yield progress
        del meta[STAGE_KEY]  # a later failure belongs to no stage


def _plugin_commands() -> Mapping[str, EntryPoint]:
    """Return the entry points of the commands of plugins, by name and in the order of names."""
    return {point.name: point for point in sorted(entry_points(group=COMMANDS_GROUP), key=lambda point: point.name)}


def _distribution_text(point: EntryPoint) -> str:
    """Return "from DISTRIBUTION VERSION" of a plugin's entry point, or "from MODULE" if it has no distribution."""
    return f"from {point.dist.name} {point.dist.version}" if point.dist else f"from {point.value}"


Command = TypeVar("Command", bound=Callable[..., Any])
#: By default the error is estimated if the solve took at least so many seconds; the estimate takes a third as long.
ESTIMATED_SECONDS = 1.0


def _check_finite(ctx: click.Context, parameter: click.Parameter, value: float | None) -> float | None:
    """Return ``value`` of the option ``parameter``, or None; raise click.BadParameter if it is infinite or NaN."""
    if value is not None and not math.isfinite(value):
        raise click.BadParameter(f"{value} is not a finite number.", ctx, parameter)
    return value


scene_argument = click.argument(
    "scene", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="SCENE.toml"
)
spacing_option = click.option(
    "--spacing",
    type=click.FloatRange(min=0, min_open=True),
    callback=_check_finite,
    metavar="LENGTH",
    help="Distance between grid nodes, in the scene's unit; overrides the file's.",
)
json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print JSON on standard output, and nothing else there."
)


output_option = click.option(
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="FOLDER",
    help="Where results go; overrides the file's folder, which counts from the working directory.",
)


look_option = click.option(
    "--look",
    multiple=True,
    metavar="KEY=VALUE",
    help="How the picture of the file looks, such as cmap=magma, clim=[0,1], isolines=8, up=y; overrides the file's. "
    "May be given several times.",
)


def add_options(*options: Callable[[Command], Command]) -> Callable[[Command], Command]:
    """Return a decorator that adds several options of click to a command, in the order in which help lists them."""

    def decorate(command: Command) -> Command:
        """Return ``command`` with the options, the last one applied first."""
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


#: The options of an accuracy target, which replace a spacing, and of the error estimate.
accuracy_options = add_options(
    click.option(
        "--tolerance",
        type=click.FloatRange(0, 1, min_open=True, max_open=True),
        metavar="SHARE",
        help="In place of a spacing: the accepted error, as a share of the solution's range, such as 1e-3.",
    ),
    click.option(
        "--norm",
        type=click.Choice(["rms", "max"]),
        help="Norm of the tolerance: rms, the root mean square, or max, the largest error.",
    ),
    click.option(
        "--seconds",
        type=click.FloatRange(min=0, min_open=True),
        callback=_check_finite,
        metavar="SECONDS",
        help="In place of a spacing, or as a limit beside a tolerance: the time of the solve.",
    ),
    click.option(
        "--memory",
        metavar="SIZE",
        help="In place of a spacing, or as a limit: the memory of the solve, such as '2 GiB'.",
    ),
    click.option(
        "--estimate/--no-estimate",
        default=None,
        help="Estimate the error by solving at twice the spacing, or do not; by default if the solve took "
        f"more than {ESTIMATED_SECONDS:g} second.",
    ),
)


def print_warnings(sentences: Iterable[str], err: bool = False) -> None:
    """Print each of ``sentences`` as a warning, to standard error if ``err``."""
    for sentence in sentences:
        click.echo(f"warning    {sentence}", err=err)


def print_outcome(
    solution: Any,
    summary: Mapping[str, Any],
    warnings: Sequence[str],
    head: Iterable[str],
    lines: Iterable[str],
    as_json: bool,
    quiet: bool,
) -> None:
    """Print the outcome of a command: ``summary`` as JSON, else lines and ``warnings``; if ``quiet``, warnings alone.

    The lines are ``head``, seconds, the error and the solves that reached the accuracy target of ``solution``,
    ``lines``, and the files. ``summary`` is that of the written results. If ``quiet``, warnings go to standard error.
    """
    if as_json:
        click.echo(json.dumps(summary, indent=2))
        return
    if not quiet:
        seconds, picture = summary["seconds"], summary["picture"]
        stages = ", ".join(f"{stage} {spent:.1f}" for stage, spent in seconds.items())
        printed = [*head, f"seconds    {sum(seconds.values()):.1f} ({stages})"]
        printed += [f"error      {line}" for line in str(solution.estimated or "").splitlines()]
        printed += [f"history    {line}" for line in str(solution.solve_history or "").splitlines()]
        printed += [*lines, *(f"written    {Path(summary['folder'], file)}" for file in summary["files"])]
        if picture:
            printed.append(f"written    {Path(summary['folder'], picture['file'])} ({picture['camera']})")
        click.echo("\n".join(printed))
    print_warnings(warnings, err=quiet)


def spacing_and_options(loaded: SceneFile, spacing: float | None, **target: Any) -> tuple[float | None, dict[str, Any]]:
    """Return the spacing, None with an accuracy target in its place, and the options of ``solve``.

    ``spacing`` and ``target`` (accuracy target and other options, None if absent) of the command line take precedence
    over those of the scene file: a spacing over its whole accuracy target, and a target over its spacing.
    """
    from cpmkit.forms.options import AccuracyTarget
    from cpmkit.runtime.options import declared_options

    command_line = {name: value for name, value in target.items() if value is not None}
    deciding = [name for name in ("tolerance", "seconds", "memory") if name in command_line]
    options = dict(loaded.options)
    if spacing is not None:
        options = {name: value for name, value in options.items() if name not in declared_options(AccuracyTarget)}
    decided = spacing if deciding else spacing or loaded.spacing
    return decided, {**options, **command_line}


def add_estimate(solution: Solution, wanted: bool | None, drawn: bool = False) -> Solution:
    """Return a solution with an error estimate if ``wanted``, or by default if it is drawn or the solve took long.

    An estimate that it has stays. An error that cannot be estimated is left out by default, so that the solution is not
    lost; if ``wanted``, the CpmkitError is raised.
    """
    from dataclasses import replace

    from cpmkit.errors import CpmkitError

    if wanted is False or solution.estimated is not None:
        return solution
    if wanted is None and not drawn and sum(solution.seconds.values()) < ESTIMATED_SECONDS:
        return solution
    try:
        return replace(solution, estimated=solution.error)
    except CpmkitError:
        if wanted:
            raise
        return solution


def edit_look(request: OutputRequest, field: str | None, look: Sequence[str], estimate: bool | None) -> OutputRequest:
    """Return the requested output with the picture changed to ``field`` and to ``look`` (KEY=VALUE each), if given.

    Raises InputError if there is no picture to change, a key or value is not accepted, or the picture shows the error
    and ``estimate`` is False.
    """
    from dataclasses import replace

    from cpmkit.errors import InputError
    from cpmkit.scenefile.look import Look

    said = ([f"--field {field}"] if field else []) + [f"--look {text}" for text in look]
    if said and request.picture is None:
        raise InputError(
            f"{said[0]} says what the picture shows, and the scene asks for none; add picture to [output]."
        )
    if said and request.picture is not None:
        changes = dict(map(_parse_key_value, look)) | ({"field": field} if field else {})
        options = vars(Look.from_options({**request.picture.look, **changes}))
        request = replace(request, picture=replace(request.picture, **options))
    if request.wants_error and estimate is False:
        raise InputError("the picture shows the error, and --no-estimate leaves it out; give one of them.")
    return request


def _parse_key_value(text: str) -> tuple[str, Any]:
    """Return the key and the value, of TOML or else text, in ``KEY=VALUE``; raise InputError without key or ``=``."""
    from cpmkit.errors import InputError, shown

    key, sign, value = text.partition("=")
    if not sign or not key.strip():
        raise InputError(f"--look must be KEY=VALUE, such as cmap=magma, got {shown(text)}.")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value
