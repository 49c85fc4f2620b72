"""A pool of threads shared by the process, and work divided into parcels for it.

Parcels are small and assigned to threads as these become free: with parcels of half the work all would wait for a core
that another process uses. The work releases the interpreter's lock, as compiled kernels and SciPy's sparse products do.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

from cpmkit.errors import InputError


def processors() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def thread_count() -> int:
    """Return the number of threads: ``CPMKIT_THREADS``, or the number of cores that this process may use.

    Raises InputError if ``CPMKIT_THREADS`` is set and not a whole number above zero.
    """
    setting = os.environ.get("CPMKIT_THREADS")
    if not setting:
        return processors()
    if not setting.isdecimal() or int(setting) < 1:
        raise InputError(f"CPMKIT_THREADS must be a whole number above zero, got {setting!r}.")
    return int(setting)


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Return the process's pool of this number of threads."""
    return ThreadPoolExecutor(threads, thread_name_prefix="cpmkit")


if hasattr(os, "register_at_fork"):  # a forked child inherits the pool but none of its threads
    os.register_at_fork(after_in_child=_pool.cache_clear)


def run_parcels(work: Callable[[int, int], object], count: int, size: int = 4096) -> None:
    """Call ``work(start, stop)`` on all threads for consecutive parts of ``range(count)``, each of at most ``size``.

    It returns when all parts are done, and raises the exception of a part. The default size is for closest point
    queries: so few that a busy core does not delay the others.
    """
    starts = range(0, count, size)
    threads = thread_count()
    if threads == 1 or len(starts) < 2:
        for start in starts:
            work(start, min(start + size, count))
        return
    for done in _pool(threads).map(lambda start: work(start, min(start + size, count)), starts):
        del done
