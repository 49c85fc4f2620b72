"""Showing a person how far a solve has come."""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO

from cpmkit.errors import InputError, shown
from cpmkit.protocols import Progress, no_progress

#: Stages shorter than so many seconds are not shown.
QUIET_SECONDS = 1.0

#: Seconds between two drawings of the bar.
REDRAWING_SECONDS = 0.1

BAR_CHARACTERS = 30


class ProgressLine:
    """A :data:`~cpmkit.protocols.Progress` callback that writes to a stream; a context manager.

    On a terminal the stage at work is a bar that redraws itself. Elsewhere nothing moves. Either
    way a stage that took longer than a second leaves one line with its seconds.

    Parameters
    ----------
    stream : text stream
        Where to write, as a rule ``sys.stderr``.
    clock : callable
        Returns seconds.
    """

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.perf_counter) -> None:
        self._stream = stream
        self._clock = clock
        self._moves = stream.isatty()
        self._stage: str | None = None
        self._since = clock()
        self._drawn = self._since - REDRAWING_SECONDS

    def __call__(self, stage: str, fraction: float) -> None:
        """Note that ``fraction`` of ``stage`` is done; 1, or another stage than before, ends a stage."""
        if stage != self._stage:
            self.finish()
            self._stage = stage
        now = self._clock()
        if self._moves and now - self._drawn >= REDRAWING_SECONDS:
            self._drawn = now
            share = min(max(fraction, 0.0), 1.0)
            bar = "#" * round(share * BAR_CHARACTERS)
            self._write(f"\r{stage:<12} [{bar:.<{BAR_CHARACTERS}}] {share:4.0%}")
        if fraction >= 1:
            self.finish()

    def finish(self) -> None:
        """End the stage at work; the next one counts from here."""
        if self._stage is None:
            return
        now = self._clock()
        if self._moves:
            self._write("\r\x1b[K")
        if now - self._since > QUIET_SECONDS:
            self._write(f"{self._stage:<12} {now - self._since:.1f} s\n")
        self._stage, self._since, self._drawn = None, now, now - REDRAWING_SECONDS

    def __enter__(self) -> ProgressLine:
        return self

    def __exit__(self, *_: object) -> None:
        self.finish()

    def _write(self, text: str) -> None:
        with suppress(OSError):  # nobody reads, or the disk is full: that ends no solve
            self._stream.write(text)
            self._stream.flush()


#: A callback, ``False`` for no progress, ``True`` for a bar; None for one where a person looks on, if it takes long.
ShownProgress = Progress | bool | None
#: Of what takes less than so many seconds no bar is shown unless one is asked for.
SILENT_SECONDS = 2.0

#: The callbacks of the work under way, the innermost last: compilers, which nobody hands one, tell it what they do.
_under_way: list[Progress] = []


@contextmanager
def shown_progress(target: ShownProgress, clock: Callable[[], float] = time.perf_counter) -> Iterator[Progress]:
    """Yield a callback for the progress of the work in the block, as it was asked for.

    Raises
    ------
    InputError
        If it is asked for in another way.
    """
    if not callable(target) and target is not None and not isinstance(target, bool):
        raise InputError(f"progress must be True, False or a function of a stage and a share, got {shown(target)}.")
    if callable(target):
        show: Progress = target
    elif target is False or sys.stderr is None or not (target or _someone_looks()):
        show = no_progress
    else:
        show = LateBar(0.0 if target else SILENT_SECONDS, clock)
    _under_way.append(show)
    try:
        yield show
    finally:
        _under_way.remove(show)
        if isinstance(show, LateBar):
            show.close()


def tell_under_way(stage: str, fraction: float) -> None:
    """Tell the innermost work under way, if there is any, what is done for it."""
    if _under_way:
        _under_way[-1](stage, fraction)


class LateBar:
    """A bar that appears when the work takes longer than ``silent`` seconds, and leaves no trace."""

    def __init__(self, silent: float, clock: Callable[[], float]) -> None:
        self._since, self._silent, self._clock = clock(), silent, clock
        self._bar: Any = None

    def __call__(self, stage: str, fraction: float) -> None:
        """Note that ``fraction`` of ``stage`` is done."""
        if self._bar is None:
            if self._clock() - self._since < self._silent:
                return
            self._bar = _tqdm_bar() or ProgressLine(sys.stderr)
        if isinstance(self._bar, ProgressLine):
            self._bar(stage, fraction)
            return
        with suppress(OSError):  # nobody reads: that ends no solve
            self._bar.set_description_str(stage, refresh=False)
            self._bar.n = round(min(max(fraction, 0.0), 1.0), 3)
            self._bar.update(0)
            self._bar.refresh()

    def close(self) -> None:
        """Take the bar away."""
        if self._bar is not None:
            with suppress(OSError):
                (self._bar.finish if isinstance(self._bar, ProgressLine) else self._bar.close)()


def _tqdm_bar() -> Any:
    """Return a bar of tqdm, in a notebook a widget; None where it is not installed."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a notebook without widgets it says so, and takes text
            from tqdm.auto import tqdm
    except ImportError:
        return None
    return tqdm(total=1.0, leave=False, bar_format="{desc:<12} {percentage:3.0f}% |{bar}| {elapsed}", file=sys.stderr)


def _someone_looks() -> bool:
    """Tell whether a person reads the standard error stream: on a terminal, or in a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return type(shell).__name__ == "ZMQInteractiveShell" or sys.stderr.isatty()
