"""Progress of a solve: the callback in use, and progress bars on a terminal or in a notebook."""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TextIO

from cpmkit.errors import InputError, shown
from cpmkit.types import Progress, no_progress

#: A callback, ``False`` for no progress, ``True`` for a bar; None for a bar where a person sees it and work takes long.
ShownProgress = Progress | bool | None
#: Seconds after which a bar appears if the user did not request it: shorter work needs none.
SILENT_SECONDS = 2.0
#: Seconds between two drawings of the bar, as fast as the eye can follow.
REDRAWING_SECONDS = 0.1

#: The callbacks in use, the innermost last; compilers, which have no callback as an argument, report to it.
_callbacks: list[Progress] = []


class ProgressLine:
    """A :data:`~cpmkit.types.Progress` callback that writes to a stream; a context manager.

    On a terminal it shows the current stage as a bar. On any stream it writes one line with the seconds of each stage
    that took longer than a second. ``clock`` returns the time in seconds; ``stream`` is usually ``sys.stderr``.
    """

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.perf_counter) -> None:
        self._stream = stream
        self._clock = clock
        self._is_terminal = stream.isatty()
        self._stage: str | None = None
        self._since = clock()
        self._drawn = self._since - REDRAWING_SECONDS

    def __call__(self, stage: str, fraction: float) -> None:
        """Show that ``fraction`` of ``stage`` is done; a fraction of 1, or a new stage, ends the current stage."""
        if stage != self._stage:
            self.finish()
            self._stage = stage
        now = self._clock()
        if self._is_terminal and now - self._drawn >= REDRAWING_SECONDS:
            self._drawn = now
            share = min(max(fraction, 0.0), 1.0)
            bar = "#" * round(share * 30)
            self._write(f"\r{stage:<12} [{bar:.<30}] {share:4.0%}")
        if fraction >= 1:
            self.finish()

    def finish(self) -> None:
        """End the current stage, if there is one: erase its line and, if it took over a second, write its time."""
        if self._stage is None:
            return
        now = self._clock()
        if self._is_terminal:
            self._write("\r\x1b[K")
        if now - self._since > 1.0:
            self._write(f"{self._stage:<12} {now - self._since:.1f} s\n")
        self._stage, self._since, self._drawn = None, now, now - REDRAWING_SECONDS

    def __enter__(self) -> ProgressLine:
        return self

    def __exit__(self, *_: object) -> None:
        self.finish()

    def _write(self, text: str) -> None:
        with suppress(OSError):  # no reader, or a full disk, must not end a solve
            self._stream.write(text)
            self._stream.flush()


@contextmanager
def shown_progress(target: ShownProgress, clock: Callable[[], float] = time.perf_counter) -> Iterator[Progress]:
    """Yield the progress callback in use during the block: ``target`` itself, a bar, or one that does nothing.

    ``target`` True shows a bar at once, None after two seconds if a person reads the standard error stream, False
    never. ``clock`` returns seconds. Raises InputError for any other ``target`` that is not callable.
    """
    if not callable(target) and target is not None and not isinstance(target, bool):
        raise InputError(f"progress must be True, False or a function of a stage and a share, got {shown(target)}.")
    bar = DelayedBar(0.0 if target else SILENT_SECONDS, clock)
    if callable(target):
        show: Progress = target
    elif target is False or sys.stderr is None or not (target or _is_interactive()):
        show = no_progress
    else:
        show = bar
    _callbacks.append(show)
    try:
        yield show
    finally:
        _callbacks.remove(show)
        bar.close()


def report_progress(stage: str, fraction: float) -> None:
    """Call the innermost callback in use, if there is any, with a stage and the fraction of it that is done."""
    if _callbacks:
        _callbacks[-1](stage, fraction)


class DelayedBar:
    """A progress callback that shows a bar after ``silent`` seconds; :meth:`close` removes it."""

    def __init__(self, silent: float, clock: Callable[[], float]) -> None:
        self._since, self._silent, self._clock = clock(), silent, clock
        self._show: Progress | None = None
        self._close: Callable[[], object] = lambda: None

    def __call__(self, stage: str, fraction: float) -> None:
        """Show that ``fraction`` of ``stage`` is done, if the time without a bar is over."""
        if self._show is None:
            if self._clock() - self._since < self._silent:
                return
            line = ProgressLine(sys.stderr)
            self._show, self._close = _tqdm_bar() or (line, line.finish)
        with suppress(OSError):  # a missing reader must not end a solve
            self._show(stage, fraction)

    def close(self) -> None:
        """Remove the bar if it is shown."""
        with suppress(OSError):
            self._close()


def _tqdm_bar() -> tuple[Progress, Callable[[], object]] | None:
    """Return the callback and the end of a progress bar of tqdm, in a notebook a widget; None without tqdm."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it warns of a notebook without widgets, and writes text
            from tqdm.auto import tqdm
    except ImportError:
        return None
    words = "{desc:<12} {percentage:3.0f}% |{bar}| {elapsed}"
    bar = tqdm(total=1.0, leave=False, bar_format=words, file=sys.stderr)

    def show(stage: str, fraction: float) -> None:
        bar.set_description_str(stage, refresh=False)
        bar.n = round(min(max(fraction, 0.0), 1.0), 3)
        bar.update(0)
        bar.refresh()

    return show, bar.close


def _is_interactive() -> bool:
    """Return whether a person reads the standard error stream, on a terminal or in a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return type(shell).__name__ == "ZMQInteractiveShell" or sys.stderr.isatty()
