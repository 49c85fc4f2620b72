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
    """Return ``function`` compiled by numba; it releases the interpreter's lock and is cached on disk where possible.

    The cached code is renewed when the file of ``function`` changes, but not when the file of a kernel that it calls
    changes: touch the callers' files after a change of such a kernel. ``further`` are options of numba.
    """
    njit, options = _njit(), {"nogil": True, "error_model": "numpy", **further}
    try:
        kernel: Function = njit(cache=True, **options)(function)
    except RuntimeError:  # numba found no folder that it may write to: compile once a process instead
        _warn_of_no_cache()
        kernel = njit(**options)(function)
    return kernel


def compiled_reordered(function: Function) -> Function:
    """Return ``function`` compiled with sums in any order, so that scalar products use vector instructions."""
    return compiled(function, fastmath={"reassoc", "contract", "nsz"})


def _njit() -> Any:
    """Return numba's decorator, without the cache folder that a file in the working directory may name."""
    # Numba reads .numba_config.yaml in the working directory, and would run compiled code from the folder named there.
    os.environ.setdefault("NUMBA_CACHE_DIR", "")
    from numba import njit

    _register_listener()
    return njit


@cache
def _register_listener() -> None:
    """Register a listener that reports each compilation, which takes seconds, to the logger and to the progress."""
    from numba.core import event

    event.register("numba:compile", _compilation_listener(event.Listener))


def _compilation_listener(base: type) -> Any:
    """Return a listener, of class ``base``, of numba's events that reports compiled kernels, not cached ones."""

    def on_start(_: object, started: Any) -> None:
        """Report the kernel whose compilation has started."""
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
    """Warn, once a process, that compiled kernels cannot be kept on disk."""
    warnings.warn(
        "There is no folder in which compiled kernels can be kept, so that each run compiles them anew, which takes "
        "some twenty seconds; name one that may be written to in the environment variable NUMBA_CACHE_DIR.",
        CpmkitWarning,
        stacklevel=2,
    )


def inlined(function: Function) -> Function:
    """Return ``function`` compiled for inlining into each kernel that calls it, so that the call takes no time."""
    kernel: Function = _njit()(nogil=True, error_model="numpy", forceinline=True)(function)
    return kernel
