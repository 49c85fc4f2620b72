"""The peak of this process's memory, where the system tells it (Linux)."""

from __future__ import annotations

import gc
from pathlib import Path

from cpmkit.runtime.freed_memory import trim

#: What the kernel tells of this process, and where it is asked to forget the peak so far.
STATUS, CLEAR_REFS = Path("/proc/self/status"), Path("/proc/self/clear_refs")
FORGET_PEAK = "5"


def forget_peak() -> int | None:
    """Let the peak start from what is in use now, freed memory handed back; return that in bytes, None if untold."""
    gc.collect()
    trim()
    try:
        CLEAR_REFS.write_text(FORGET_PEAK)
    except OSError:
        return None
    return _row("VmRSS")


def bytes_since(before: int | None) -> int | None:
    """Return by how many bytes the peak since :func:`forget_peak` is above what was in use then, None if untold."""
    peak = None if before is None else _row("VmHWM")
    return None if peak is None or before is None else max(peak - before, 0)


def _row(name: str) -> int | None:
    try:
        lines = STATUS.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return None
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith(f"{name}:")), None)
