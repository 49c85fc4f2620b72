"""Showing a person how far a solve has come."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from typing import TextIO

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
