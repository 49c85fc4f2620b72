"""Handing memory that was freed back to the system.

The C library keeps what is freed for what is asked for next, between what is still in use, where larger arrays do not
fit: where tables of many sizes are made and let go it keeps a tenth as much as is in use.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from functools import cache


def hand_back() -> None:
    """Hand freed memory back to the system, where the C library can (glibc's); a few milliseconds."""
    trim = _trim()
    if trim is not None:
        trim(0)


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
