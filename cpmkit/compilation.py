"""The one way in which plugins compile kernels: numba, imported when the first kernel is made."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Return ``function`` compiled by numba, without the interpreter's lock, kept on disk where possible.

    Kernels that call each other live in one file: the kept code is renewed when its own file
    changes, not when another one does.
    """
    # Else numba takes the folder from a file .numba_config.yaml in the working directory, and runs what lies there.
    os.environ.setdefault("NUMBA_CACHE_DIR", "")
    from numba import njit

    options = {"nogil": True, "error_model": "numpy"}
    try:
        kernel: Function = njit(cache=True, **options)(function)
    except RuntimeError:  # numba found no folder that it may write to: compile once a process instead
        kernel = njit(**options)(function)
    return kernel


def inlined(function: Function) -> Function:
    """Return ``function`` compiled into each kernel that calls it: a call costs as much as a small body."""
    from numba import njit

    part: Function = njit(nogil=True, error_model="numpy", forceinline=True)(function)
    return part
