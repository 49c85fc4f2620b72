"""The group of commands: built-in ones and those of plugins, their progress, and the messages of their errors."""

from __future__ import annotations

import errno
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

import click

from cpmkit.errors import CpmkitError, PluginError, shown
from cpmkit.plugins import COMMANDS_GROUP
from cpmkit.runtime.memory import is_out_of_memory, memory_limit

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
        """Return the command of a name, None if there is none; a plugin's command is imported here."""
        built_in = super().get_command(ctx, cmd_name)
        point = _plugin_commands().get(cmd_name)
        return built_in if built_in or point is None else _load(point)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the built-in commands with their help, and the commands of plugins with their distributions.

        Plugins are not imported for this.
        """
        with formatter.section("Commands"):
            formatter.write_dl([(name, command.get_short_help_str(200)) for name, command in self.commands.items()])
        others = [name for name in self.list_commands(ctx) if name not in self.commands]
        plugged = [(name, _distribution_text(_plugin_commands()[name])) for name in others]
        if plugged:
            with formatter.section("Commands of plugins"):
                formatter.write_dl(plugged)

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; an error is turned into a sentence and an exit code."""
        try:
            return super().invoke(ctx)
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except KeyboardInterrupt as error:
            click.echo(f"\nInterrupted{_at_stage(ctx)}.", err=True)
            raise click.exceptions.Exit(130) from error  # 128 and the number of the signal
        except Exception as error:
            if getattr(error, "errno", None) == errno.EPIPE:  # the reader closed the pipe; click ends quietly
                raise
            if ctx.meta.get(TRACEBACK_KEY):
                click.echo(traceback.format_exc(), err=True)
            raise _error_sentence(ctx, error) from error


def _error_sentence(ctx: click.Context, error: Exception) -> click.ClickException:
    """Return the exception of click that prints an error as one sentence and has its exit code."""
    if isinstance(error, CpmkitError):
        return click.ClickException(str(error))
    if is_out_of_memory(error):
        return click.ClickException(f"Memory ran out{_at_stage(ctx)}: {memory_limit()}; a larger spacing needs less.")
    if isinstance(error, OSError) and error.strerror:
        name = f": {shown(error.filename)}" if error.filename else ""
        return click.ClickException(f"The system refused{_at_stage(ctx)}: {error.strerror}{name}.")
    error_text = f"{type(error).__name__}: {shown(str(error))}" if str(error) else type(error).__name__
    return UnexpectedError(
        f"{error_text}{_at_stage(ctx)}. This is a bug in cpmkit or in a plugin; the option --traceback shows where it "
        "arose, for a report."
    )


def _at_stage(ctx: click.Context) -> str:
    """Return the stage and the file of the running command in words; empty if neither is known."""
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
    """Yield a callback for the progress of work on ``file``: shown unless ``quiet``, and remembered for errors."""
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
    """Return the distribution of a plugin's command, or its module, in words."""
    return f"from {point.dist.name} {point.dist.version}" if point.dist else f"from {point.value}"


def _load(point: EntryPoint) -> click.Command:
    """Return the command of a plugin; raise PluginError if it does not import or is no command of click."""
    try:
        command = point.load()
    except Exception as error:
        raise PluginError(
            f"The command {point.name!r} ({_distribution_text(point)}) does not import: {error}"
        ) from error
    if not isinstance(command, click.Command):
        raise PluginError(
            f"The command {point.name!r} ({_distribution_text(point)}) is {command!r}, not a click command."
        )
    return command
