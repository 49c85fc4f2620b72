"""Compilation of kernels by numba, which is imported when the first kernel is defined."""

from __future__ import annotations

import logging
import os
import warnings
from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

from cpmkit.errors import CpmkitWarning
from cpmkit.runtime.progress import report_progress

Function = TypeVar("Function", bound=Callable[..., Any])

#: Name of the stage of progress while a kernel is compiled.
COMPILING_STAGE = "compile"
logger = logging.getLogger("cpmkit")


def compiled(function: Function, **further: Any) -> Function:
    """Return ``function`` compiled by numba, at its first call; it releases the interpreter's lock.

    The code is cached on disk; without a folder for it, a CpmkitWarning is issued and each process compiles anew. The
    cache is renewed when the file of ``function`` changes, but not when the file of a kernel that it calls changes:
    touch the callers' files after a change of such a kernel. ``further`` are options of numba.
    """
    njit, options = _njit(), {"nogil": True, "error_model": "numpy", **further}
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
                "Kernels are compiled at their first use, which takes some twenty seconds; they are kept on disk."
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
    kernel: Function = _njit()(nogil=True, error_model="numpy", forceinline=True)(function)
    return kernel
