"""What may be asked for in place of a spacing: an error, a time, a memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cpmkit.errors import InputError, shown
from cpmkit.runtime.arrays import positive
from cpmkit.runtime.options import DeclaredOptions, option

NORMS = ("rms", "max")
#: Units in which a memory may be written, in bytes.
MEMORY_UNITS = {"kib": 2**10, "mib": 2**20, "gib": 2**30, "kb": 10**3, "mb": 10**6, "gb": 10**9}


def _positive_or_none(value: Any, what: str) -> float | None:
    return None if value is None else positive(value, what)


def _tolerance(value: Any, what: str) -> float | None:
    if value is not None and positive(value, what) >= 1:
        raise InputError(
            f"{what} is an error as a share of the solution's range and must be below 1, got {value:g}; use 1e-3."
        )
    return None if value is None else float(value)


def _norm(value: Any, what: str) -> str:
    if not isinstance(value, str) or value not in NORMS:
        raise InputError(f"{what} must be {' or '.join(map(repr, NORMS))}, got {shown(value)}.")
    return value


def _estimate(value: Any, what: str) -> Any:
    if value is not None and not isinstance(value, bool) and value != "tight":
        raise InputError(f"{what} must be True, False, 'tight' or None, got {shown(value)}.")
    return value


def read_memory(value: Any, what: str = "memory") -> float | None:
    """Return bytes: of a number, or of text such as ``"2 GiB"``.

    Raises
    ------
    InputError
        If it is neither.
    """
    if not isinstance(value, str):
        return _positive_or_none(value, what)
    text = value.strip().lower()
    for unit, size in MEMORY_UNITS.items():
        if text.endswith(unit):
            try:
                return positive(float(text[: -len(unit)]), what) * size
            except ValueError:
                break
    raise InputError(f"{what} must be a number of bytes, or text such as '2 GiB' or '500 MB', got {shown(value)}.")


@dataclass(frozen=True)
class AccuracyTarget(DeclaredOptions):
    """What a solution is to reach, or to cost at most.

    Raises
    ------
    InputError
        If a value is not accepted.
    """

    tolerance: float | None = option(
        None,
        "In place of a spacing: the largest error that the solution may have, as a share of its range; of eigenvalues, "
        "of each. What was done to reach it is in ``solution.trade``.",
        _tolerance,
    )
    norm: str = option(
        "rms", "In which ``tolerance`` is meant: ``rms``, the root mean square, or ``max``, the largest error.", _norm
    )
    seconds: float | None = option(
        None,
        "In place of a spacing: how long it may take in all, on this machine; the finest solution for which that is "
        "enough is returned. Beside ``tolerance`` a limit.",
        _positive_or_none,
    )
    memory: float | None = option(
        None,
        "In place of a spacing: bytes, or text such as ``'2 GiB'``; the finest solution for which that is enough is "
        "returned. Beside ``tolerance`` or ``seconds`` a limit.",
        read_memory,
    )

    estimate: Any = option(
        None,
        "Whether the error is estimated at once, ``True``, with a further solve at the root of two times the spacing, "
        "``'tight'``, never, ``False``, or when ``solution.error`` is first read, ``None``.",
        _estimate,
    )

    @property
    def anything(self) -> bool:
        """Whether an error, a time or a memory is asked for."""
        return any(one is not None for one in (self.tolerance, self.seconds, self.memory))

    @property
    def target(self) -> str:
        """What is asked for, as the user wrote it but for units; empty where it is nothing."""
        names = [name for name in ("tolerance", "seconds", "memory") if getattr(self, name) is not None]
        return " and ".join(f"{name}={getattr(self, name):g}" for name in names)

    def check_spacing(self, spacing: float | None) -> None:
        """Refuse a spacing beside what decides on one.

        Raises
        ------
        InputError
            If so.
        """
        names = [name for name in ("tolerance", "seconds", "memory") if getattr(self, name) is not None]
        if names and spacing is not None:
            raise InputError(
                f"got spacing={spacing:g} and {names[0]}={getattr(self, names[0]):g}, and each decides how fine the "
                "lattice is; give one of them. The residual of linear systems is solver_tolerance."
            )
        if not names and self.norm != "rms":
            raise InputError(f"norm={self.norm!r} says how tolerance is meant, and there is none; give tolerance.")
