"""Compiled kernels: compilation by numba, imported when the first is defined, and a pool of threads for their work.

Work is divided into small parcels, assigned to threads as these become free: with large parcels, all threads would wait
for one whose core another process uses. The work releases the interpreter's lock, as compiled kernels and SciPy's
sparse products do.
"""

from __future__ import annotations

import logging
import os
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any, TypeVar

from cpmkit.errors import CpmkitWarning, InputError
from cpmkit.runtime.progress import report_progress

Function = TypeVar("Function", bound=Callable[..., Any])

#: Options of numba for all kernels. None is passed to C as a callback: the wrapper for that took a tenth of the time.
OPTIONS = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}

#: Name of the stage of progress while a kernel is compiled.
COMPILING_STAGE = "compile"
logger = logging.getLogger("cpmkit")


def compiled(function: Function, **further: Any) -> Function:
    """Return ``function`` compiled by numba, at its first call; it releases the interpreter's lock.

    The code is cached on disk; without a folder for it, a CpmkitWarning is issued and each process compiles anew. The
    cache is renewed when the file of ``function`` changes, but not when the file of a kernel that it calls changes:
    touch the callers' files after a change of such a kernel. ``further`` are options of numba.

    Some lines of a kernel take seconds to compile: an array that is assigned to a part of another (in place of a loop
    over numbers), sorting, `numpy.where` and `numpy.searchsorted`, which NumPy does before the kernel is called, and
    a large global array, which each kernel that reads it contains. A counter that starts at 0 and is passed to another
    kernel is of two types, for which that is compiled twice; one that starts at ``np.int64(0)`` is not.
    """
    njit, options = _njit(), {**OPTIONS, **further}
    try:
        kernel: Function = njit(cache=True, **options)(function)
    except RuntimeError:  # numba found no folder that it may write to: compile once a process instead
        _warn_of_no_cache()
        kernel = njit(**options)(function)
    return kernel


def compiled_reordered(function: Function) -> Function:
    """Return ``function`` compiled as :func:`compiled` does, with sums in any order: they use vector instructions."""
    return compiled(function, fastmath={"reassoc", "contract", "nsz"})


def _njit() -> Any:
    """Return numba's decorator after setting NUMBA_CACHE_DIR to "", if it is not set, and registering the listener."""
    # Numba reads .numba_config.yaml in the working directory, and would run compiled code from the folder named there.
    os.environ.setdefault("NUMBA_CACHE_DIR", "")
    from numba import njit

    _register_listener()
    return njit


@cache
def _register_listener() -> None:
    """Register with numba, once a process, a listener that reports each compilation to logger and progress."""
    from numba.core import event

    event.register("numba:compile", _compilation_listener(event.Listener))


def _compilation_listener(base: type) -> Any:
    """Return a listener of numba's events, of a subclass of ``base``, that reports each compilation."""

    def on_start(_: object, started: Any) -> None:
        """Report the kernel whose compilation has started; ``started`` is numba's event."""
        if not kernels:
            logger.info(
                "Kernels are compiled at their first use, which takes up to some minutes; they are kept on disk."
            )
        kernels.append(str(started.data["dispatcher"].py_func.__name__))
        logger.debug("The kernel %s is compiled.", kernels[-1])
        report_progress(COMPILING_STAGE, 0.0)

    kernels: list[str] = []
    return type("Compilations", (base,), {"on_start": on_start, "on_end": lambda *_: None})()


@cache
def _warn_of_no_cache() -> None:
    """Issue a CpmkitWarning, once a process, that compiled kernels cannot be kept on disk."""
    warnings.warn(
        "There is no folder in which compiled kernels can be kept, so that each run compiles them anew, which takes "
        "some twenty seconds; name one that may be written to in the environment variable NUMBA_CACHE_DIR.",
        CpmkitWarning,
        stacklevel=2,
    )


def inlined(function: Function) -> Function:
    """Return ``function`` compiled, without a cache, for inlining into kernels, so that the call takes no time."""
    kernel: Function = _njit()(**OPTIONS, forceinline=True)(function)
    return kernel


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

    The function returns when all parts are done, or raises the exception of a part, while others may still run. The
    default size is for closest point queries: so few that a busy core does not delay the others.
    """
    starts = range(0, count, size)
    threads = thread_count()
    if threads == 1 or len(starts) < 2:
        for start in starts:
            work(start, min(start + size, count))
        return
    for done in _pool(threads).map(lambda start: work(start, min(start + size, count)), starts):
        del done
