"""The one way in which plugins compile kernels: numba, imported when the first kernel is made."""

from __future__ import annotations

import logging
import os
import warnings
from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

from cpmkit.errors import CpmkitWarning
from cpmkit.runtime.progress import tell_under_way

Function = TypeVar("Function", bound=Callable[..., Any])

#: Told of by the logger ``cpmkit``, once a process that compiles.
COMPILED_SENTENCE = "Kernels are compiled at their first use, which takes some twenty seconds; they are kept on disk."
#: The stage of progress while one is compiled.
COMPILING_STAGE = "compile"
logger = logging.getLogger("cpmkit")

#: Told where compiled kernels cannot be kept.
NOT_KEPT_SENTENCE = (
    "There is no folder in which compiled kernels can be kept, so that each run compiles them anew, which takes some "
    "twenty seconds; name one that may be written to in the environment variable NUMBA_CACHE_DIR."
)


def compiled(function: Function) -> Function:
    """Return ``function`` compiled by numba, without the interpreter's lock, kept on disk where possible.

    The kept code is renewed when its own file changes, not when that of a kernel which it calls does: who changes such
    a kernel touches the files that call it.
    """
    return _kept(function)


def compiled_reordered(function: Function) -> Function:
    """Return the same with sums in whatever order is quick: scalar products take vectors of the processor."""
    return _kept(function, fastmath={"reassoc", "contract", "nsz"})


def _kept(function: Function, **further: Any) -> Function:
    njit, options = _njit(), {"nogil": True, "error_model": "numpy", **further}
    try:
        kernel: Function = njit(cache=True, **options)(function)
    except RuntimeError:  # numba found no folder that it may write to: compile once a process instead
        _tell_once()
        kernel = njit(**options)(function)
    return kernel


def _njit() -> Any:
    """Return numba's decorator; kernels are kept in no folder that a file in the working directory names."""
    # Numba reads .numba_config.yaml there, and runs the compiled code in the folder that it names.
    os.environ.setdefault("NUMBA_CACHE_DIR", "")
    from numba import njit

    _listen_once()
    return njit


@cache
def _listen_once() -> None:
    """Let compilations be told: they take seconds, at the first use of a kernel alone."""
    from numba.core import event

    event.register("numba:compile", _compilations(event.Listener))


def _compilations(base: type) -> Any:
    """Return a listener that tells the logger and the work under way of kernels that are compiled, not of kept ones."""

    def on_start(_: object, started: Any) -> None:
        if not heard:
            logger.info(COMPILED_SENTENCE)
        heard.append(str(started.data["dispatcher"].py_func.__name__))
        logger.debug("The kernel %s is compiled.", heard[-1])
        tell_under_way(COMPILING_STAGE, 0.0)

    heard: list[str] = []
    return type("Compilations", (base,), {"on_start": on_start, "on_end": lambda *_: None})()


@cache
def _tell_once() -> None:
    warnings.warn(NOT_KEPT_SENTENCE, CpmkitWarning, stacklevel=2)


def inlined(function: Function) -> Function:
    """Return ``function`` compiled into each kernel that calls it: a call costs as much as a small body."""
    part: Function = _njit()(nogil=True, error_model="numpy", forceinline=True)(function)
    return part
