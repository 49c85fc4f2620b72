"""The one way in which kernels are compiled, and the one pool of threads that runs them."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any, TypeVar

from cpmkit.errors import InputError

#: Queries handed to a thread at a time: small enough that a busy core does not hold up the rest.
PARCEL = 4096

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Return ``function`` compiled by numba, without the interpreter's lock, kept on disk where possible.

    Kernels that call each other live in one file: the kept code is renewed when its own file
    changes, not when another one does.
    """
    from numba import njit

    options = {"nogil": True, "error_model": "numpy"}
    try:
        kernel: Function = njit(cache=True, **options)(function)
    except RuntimeError:  # numba found no folder that it may write to: compile once a process instead
        kernel = njit(**options)(function)
    return kernel


def thread_count() -> int:
    """Return the number of threads: ``CPMKIT_THREADS`` if it is set, else one a core.

    Raises
    ------
    InputError
        If the environment variable is not a whole number above zero.
    """
    asked = os.environ.get("CPMKIT_THREADS")
    if not asked:
        return os.cpu_count() or 1
    if not asked.isdecimal() or int(asked) < 1:
        raise InputError(f"The environment variable CPMKIT_THREADS must be a whole number above zero, got {asked!r}.")
    return int(asked)


@lru_cache(maxsize=1)
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="cpmkit-mesh")


if hasattr(os, "register_at_fork"):  # a forked child inherits the pool but none of its threads
    os.register_at_fork(after_in_child=_pool.cache_clear)


def run_in_parcels(kernel: Callable[[int, int], Any], count: int) -> None:
    """Call ``kernel(start, stop)`` for parcels that cover ``range(count)``, on the pool of threads."""
    threads = thread_count()
    if threads == 1 or count <= PARCEL:
        kernel(0, count)
        return
    starts = range(0, count, PARCEL)
    for _ in _pool(threads).map(lambda start: kernel(start, min(start + PARCEL, count)), starts):
        pass
