"""Handing memory that was freed back to the system.

The C library keeps what is freed for what is asked for next, between what is still in use, where larger arrays do not
fit: where tables of many sizes are made and let go it keeps a tenth as much as is in use.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

#: A process that holds less keeps it: what is handed back must be asked for, and cleared, anew.
LEAST_BYTES = 2**29
#: What the system tells of this process, in pages: the second number is what it holds in memory.
PAGES = Path("/proc/self/statm")


def hand_back() -> None:
    """Hand freed memory of a large process back to the system, where the C library can (glibc's)."""
    if _held() >= LEAST_BYTES:
        trim()


def trim() -> None:
    """Hand freed memory back to the system, however little there is, where the C library can."""
    found = _trim()
    if found is not None:
        found(0)


def _held() -> int:
    try:
        with PAGES.open("rb", buffering=0) as read:
            return int(read.readall().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError):  # no system that tells it
        return 0


@cache
def _trim() -> Callable[[int], int] | None:
    """Return the C library's ``malloc_trim``; None where it has none."""
    if not sys.platform.startswith("linux"):
        return None
    try:
        trim: Callable[[int], int] | None = getattr(ctypes.CDLL(None), "malloc_trim", None)
    except OSError:  # a program that was linked without shared libraries
        return None
    return trim
