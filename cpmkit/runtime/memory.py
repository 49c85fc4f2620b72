"""Memory: the limit of this process, its peak, the release of freed memory, and objects pickled without caches."""

from __future__ import annotations

import ctypes
import errno
import gc
import os
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from inspect import getattr_static
from pathlib import Path
from typing import Any

#: Bytes of one entry of a sparse matrix: a float64 and an int32 index.
ENTRY_BYTES = 12


@dataclass(frozen=True)
class MemoryLimit:
    """The bytes that this process may have or still get, and the beginning of a sentence that names the cause."""

    bytes: int
    subject: str

    def __str__(self) -> str:
        return f"{self.subject} {self.bytes / 2**30:.3g} GiB"


def machine_bytes() -> int:
    """Return the physical memory of the machine in bytes, ``sys.maxsize`` where the system does not report it."""
    if "SC_PHYS_PAGES" not in getattr(os, "sysconf_names", {}):
        return sys.maxsize
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def memory_limit() -> MemoryLimit:
    """Return the smallest limit: memory of the machine, of control groups (containers), or left by ``ulimit``."""
    fifth_of_second = int(time.monotonic() / 0.2)
    groups = _group_limits(Path("/proc/self/cgroup"), Path("/sys/fs/cgroup"), fifth_of_second)
    limits = [MemoryLimit(machine_bytes(), "this machine has"), *groups, *_process_limits()]
    return min(limits, key=lambda limit: limit.bytes)


def available_bytes() -> int:
    """Return the bytes of :func:`memory_limit`, which this process may have or, under ``ulimit``, still get."""
    return memory_limit().bytes


def is_out_of_memory(error: BaseException) -> bool:
    """Return whether an error means that memory ran out: for an array, a thread, or a library to load."""
    if isinstance(error, MemoryError) or getattr(error, "errno", None) == errno.ENOMEM:
        return True
    phrases = "failed to map segment", "Cannot allocate memory", "can't start new thread"
    return isinstance(error, (ImportError, RuntimeError)) and any(phrase in str(error) for phrase in phrases)


def _process_limits() -> Iterator[MemoryLimit]:
    """Yield the limits of the memory that this process can still get under ``ulimit -v`` and ``ulimit -d``."""
    try:
        import resource
    except ImportError:  # Windows
        return
    for name, option, row in (("RLIMIT_AS", "-v", "VmSize"), ("RLIMIT_DATA", "-d", "VmData")):
        soft, _ = resource.getrlimit(getattr(resource, name, resource.RLIMIT_DATA))
        if soft != resource.RLIM_INFINITY:
            yield MemoryLimit(max(soft - (_status_bytes(row) or 0), 0), f"`ulimit {option}` leaves this process")


def _status_bytes(row: str) -> int | None:
    """Return the value in bytes of a row of /proc/self/status, None if there is no such row."""
    lines = _read_text(Path("/proc/self/status")).splitlines()
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{row}:")), None)


@lru_cache(maxsize=1)
def _group_limits(own: Path, groups: Path, moment: int) -> list[MemoryLimit]:
    """Return the limits of this process's control groups, version 1 and 2, and of the groups that contain them.

    ``own`` is the file that lists the groups of the process, ``groups`` the folder of all groups. ``moment`` is only a
    key of the cache: calls with the same ``moment`` read the files once, since reading takes a twentieth of the time of
    small solves.
    """
    del moment
    texts = [_read_text(file).strip() for file in _group_files(own, groups)]
    subject = "the control group of this process (its container) has"
    return [MemoryLimit(int(text), subject) for text in texts if text.isdecimal()]  # a file may say "max"


@cache
def _group_files(own: Path, groups: Path) -> tuple[Path, ...]:
    """Return the files in ``groups`` that may contain limits of the groups listed in the file ``own``; cached."""
    files: list[Path] = []
    lines = _read_text(own).splitlines()
    for number, controllers, path in (line.split(":", 2) for line in lines if line.count(":") >= 2):
        if number == "0" and not controllers:
            roots, file = [groups, groups / "unified"], "memory.max"
        elif "memory" in controllers.split(","):
            roots, file = [groups / "memory"], "memory.limit_in_bytes"
        else:
            continue
        inner = Path(path.lstrip("/"))
        files += [root / part / file for root in roots for part in (inner, *inner.parents)]
    return tuple(file for file in files if file.parent.exists())


def _read_text(file: Path) -> str:
    """Return the text of a file of the kernel, empty if it cannot be read."""
    try:
        with file.open("rb", buffering=0) as read:  # a few lines, which a solve reads a dozen times
            return read.readall().decode("utf-8", errors="replace")
    except OSError:
        return ""


def release_memory() -> None:
    """Return freed memory of a process of 512 MiB or more to the system, if the C library supports it (glibc does).

    The library keeps freed memory in gaps that are too small for larger arrays: after tables of many sizes they are a
    tenth of the used memory.
    """
    # Smaller processes keep freed memory: released pages would have to be allocated and cleared again.
    if (_status_bytes("VmRSS") or 0) >= 2**29:
        trim_heap()


def trim_heap() -> None:
    """Return all freed memory to the system on Linux, if the C library supports it; else do nothing."""
    if sys.platform.startswith("linux"):
        with suppress(OSError, AttributeError):  # a program without shared libraries, or another C library
            ctypes.CDLL(None).malloc_trim(0)


def reset_peak_memory() -> int | None:
    """Reset the peak of this process's memory to the memory now in use, and return the number of bytes in use.

    Garbage is collected, and freed memory released, before. The result is None where the system reports no peak (only
    Linux does).
    """
    gc.collect()
    trim_heap()
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return None
    return _status_bytes("VmRSS")


def peak_growth_bytes(before: int | None) -> int | None:
    """Return by how many bytes the peak exceeds ``before``, as :func:`reset_peak_memory` gave it; None if unknown."""
    peak = None if before is None else _status_bytes("VmHWM")
    return None if peak is None or before is None else max(peak - before, 0)


def state_without_cached(instance: object) -> dict[str, Any]:
    """Return the attributes of ``instance`` to pickle, by name: all but its cached properties, such as factors."""
    kind = type(instance)
    return {
        name: value
        for name, value in vars(instance).items()
        if not isinstance(getattr_static(kind, name, None), cached_property)
    }
