"""How much memory a solve needs, and how much this process may have."""

from __future__ import annotations

import ctypes
import errno
import gc
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

#: Bytes of one entry of a sparse matrix: a float64 and an int32 index.
ENTRY_BYTES = 12
#: Where the kernel shows control groups.
CONTROL_GROUPS = Path("/sys/fs/cgroup")
OWN_CONTROL_GROUPS = Path("/proc/self/cgroup")
#: What control groups say is read anew after so many seconds.
FRESH_SECONDS = 0.2
#: Limits that ``ulimit`` sets: their names, its option, and the row of /proc/self/status that counts against each.
ULIMITS = (("RLIMIT_AS", "-v", "VmSize"), ("RLIMIT_DATA", "-d", "VmData"))
#: What errors of other types say where memory ran out.
OUT_OF_MEMORY_PHRASES: dict[type[BaseException], tuple[str, ...]] = {
    ImportError: ("failed to map segment", "Cannot allocate memory"),
    RuntimeError: ("can't start new thread",),
}


@dataclass(frozen=True)
class Limit:
    """Memory that this process may have, and how a sentence says who sets that limit."""

    bytes: int
    says: str

    def __str__(self) -> str:
        return f"{self.says} {self.bytes / 2**30:.3g} GiB"


def machine_bytes() -> int:
    """Return the physical memory of the machine in bytes; a number that refuses nothing where the system tells none."""
    if "SC_PHYS_PAGES" not in getattr(os, "sysconf_names", {}):
        return sys.maxsize
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def memory_limit() -> Limit:
    """Return the tightest limit: of the machine, the control groups (containers), or ``ulimit``."""
    groups = _group_limits(OWN_CONTROL_GROUPS, CONTROL_GROUPS, int(time.monotonic() / FRESH_SECONDS))
    limits = [Limit(machine_bytes(), "this machine has"), *groups, *_process_limits()]
    return min(limits, key=lambda limit: limit.bytes)


def available_bytes() -> int:
    """Return the memory that this process may have in bytes."""
    return memory_limit().bytes


def ran_out(error: BaseException) -> bool:
    """Return whether an error says that memory ran out: an allocation, a thread, or a library that found no room."""
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
        return True
    return any(sign in str(error) for sign in OUT_OF_MEMORY_PHRASES.get(type(error), ()))


def _process_limits() -> Iterator[Limit]:
    """Yield what ``ulimit`` leaves to this process beside what it has already."""
    try:
        import resource
    except ImportError:  # Windows
        return
    for name, option, row in ULIMITS:
        soft, _ = resource.getrlimit(getattr(resource, name, resource.RLIMIT_DATA))
        if soft != resource.RLIM_INFINITY:
            yield Limit(max(soft - _in_use(row), 0), f"`ulimit {option}` leaves this process")


def _in_use(row: str) -> int:
    """Return a row of /proc/self/status in bytes, 0 where there is none."""
    lines = _text_of(Path("/proc/self/status")).splitlines()
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{row}:")), 0)


@lru_cache(maxsize=1)
def _group_limits(own: Path, groups: Path, moment: int) -> list[Limit]:
    """Return the limits of this process's control groups, version 1 and 2, and of those that they are in.

    Small solves ask several times within a ``moment``, and a twentieth of their time would go into reading.
    """
    del moment
    texts = [_text_of(file).strip() for file in _group_files(own, groups)]
    # what is no number is no such file, or says max
    return [
        Limit(int(text), "the control group of this process (its container) has") for text in texts if text.isdecimal()
    ]


@cache
def _group_files(own: Path, groups: Path) -> tuple[Path, ...]:
    """Return the files that may hold these limits, listed once: they are asked time and again."""
    files: list[Path] = []
    lines = _text_of(own).splitlines()
    for number, controllers, path in (line.split(":", 2) for line in lines if line.count(":") >= 2):
        if number == "0" and not controllers:
            roots, file = [groups, groups / "unified"], "memory.max"
        elif "memory" in controllers.split(","):
            roots, file = [groups / "memory"], "memory.limit_in_bytes"
        else:
            continue
        inner = Path(path.lstrip("/"))
        files += [root / part / file for root in roots for part in (inner, *inner.parents)]
    return tuple(one for one in files if one.parent.exists())


def _text_of(file: Path) -> str:
    """Return what a file of the kernel says, nothing where there is none."""
    try:
        with file.open("rb", buffering=0) as read:  # a few lines, asked for a dozen times a solve
            return read.readall().decode("utf-8", errors="replace")
    except OSError:
        return ""


def peak_bytes(rows: float, unknowns: float, dim: int, degree: int, channels: int, solver: str) -> float:
    """Return the bytes of tables and vectors at the peak of a solve.

    Parameters
    ----------
    rows : float
        Rows of E: outer nodes, and ghosts where E u is needed.
    unknowns : float
        Rows of N.
    dim, degree, channels : int
        Of the space, the interpolation, and the right-hand sides.
    solver : str
        ``direct`` assembles the matrix and factorises it.
    """
    stencil: int = (degree + 1) ** dim
    tables = rows * (stencil * ENTRY_BYTES + 10 * dim * 8) + unknowns * 2 * dim * (ENTRY_BYTES + 8)
    if solver == "direct":
        # About 2.1 entries of A a stencil entry in the plane and 2.3 in space; SuperLU's fill was measured.
        fill = 14 if dim == 2 else 60
        return tables + unknowns * stencil * ENTRY_BYTES * 2.2 + unknowns * fill * stencil
    return tables + unknowns * channels * 8 * 12


def bytes_per_unknown(dim: int, degree: int, solver: str = "reference") -> float:
    """Return the bytes that an unknown needs at the peak of a solve of one channel."""
    return peak_bytes(rows_per_unknown(dim), 1.0, dim, degree, 1, solver)


def rows_per_unknown(dim: int) -> float:
    """Return about how many rows of E a band has for each unknown."""
    return 1.3 if dim == 3 else 1.5


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


#: What the kernel tells of this process, and where it is asked to forget the peak so far.
STATUS, CLEAR_REFS = Path("/proc/self/status"), Path("/proc/self/clear_refs")
FORGET_PEAK = "5"


def forget_peak() -> int | None:
    """Let the peak start from what is in use now, freed memory handed back; return that in bytes, None if untold."""
    gc.collect()
    trim()
    try:
        CLEAR_REFS.write_text(FORGET_PEAK)
    except OSError:
        return None
    return _row("VmRSS")


def bytes_since(before: int | None) -> int | None:
    """Return by how many bytes the peak since :func:`forget_peak` is above what was in use then, None if untold."""
    peak = None if before is None else _row("VmHWM")
    return None if peak is None or before is None else max(peak - before, 0)


def _row(name: str) -> int | None:
    try:
        lines = STATUS.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return None
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith(f"{name}:")), None)
