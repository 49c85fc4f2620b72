"""Records, gathered into series: one method, degree and order over all spacings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.studies.records import Record

#: Fewer spacings give no order.
FEWEST = 2
NAMES = {"cpm": "closest point method", "nearest": "nearest point", "ball": "ball", "fem": "finite elements"}


@dataclass(frozen=True)
class Entry:
    """What a series holds at one spacing.

    Attributes
    ----------
    spacing : float
    error : float
        The largest at any sample point; of several origins the root mean square.
    rms_error : float
        The root mean square over the sample points, and over the origins.
    unknowns, iterations, cpu_seconds : float
        Means over the origins.
    """

    spacing: float
    error: float
    rms_error: float
    unknowns: float
    iterations: float
    cpu_seconds: float


@dataclass(frozen=True)
class Series:
    """One method, degree and order over all spacings that are recorded without an error.

    Attributes
    ----------
    method : str
    degree, order : int or None
        None where the method has none.
    label : str
        Names what distinguishes the series from the others.
    entries : sequence of Entry
        The coarsest first.
    """

    method: str
    degree: int | None
    order: int | None
    label: str
    entries: Sequence[Entry]

    @property
    def spacings(self) -> list[float]:
        """Of the entries."""
        return [entry.spacing for entry in self.entries]

    @property
    def errors(self) -> list[float]:
        """Of the entries."""
        return [entry.error for entry in self.entries]

    @property
    def fitted_order(self) -> float | None:
        """Least-squares slope of log(error) over log(spacing); None of less than two spacings."""
        if len(self.entries) < FEWEST or min(self.errors) <= 0:
            return None
        return float(np.polyfit(np.log(self.spacings), np.log(self.errors), 1)[0])


def gather(records: Sequence[Record]) -> list[Series]:
    """Return the series of records in the order in which they first appear; runs with errors are left out."""
    good = [record for record in records if "error" not in record]
    keys = list(dict.fromkeys(_key(record) for record in good))
    return [_series(key, keys, [record for record in good if _key(record) == key]) for key in keys]


def _key(record: Record) -> tuple[Any, ...]:
    return record["method"], record["degree"], record["order"]


def _series(key: tuple[Any, ...], keys: Sequence[tuple[Any, ...]], records: Sequence[Record]) -> Series:
    spacings = sorted({record["spacing"] for record in records}, reverse=True)
    entries = [_entry(spacing, [record for record in records if record["spacing"] == spacing]) for spacing in spacings]
    method, degree, order = key
    return Series(method, degree, order, _label(key, keys), entries)


def _entry(spacing: float, records: Sequence[Record]) -> Entry:
    def of(name: str) -> Any:
        return np.array([record[name] for record in records], dtype=np.float64)

    unknowns, iterations, seconds = (float(of(name).mean()) for name in ("unknowns", "iterations", "cpu_seconds"))
    rms = float(np.sqrt(np.mean(of("rms_error") ** 2)))
    return Entry(spacing, float(np.sqrt(np.mean(of("max_error") ** 2))), rms, unknowns, iterations, seconds)


def _label(key: tuple[Any, ...], keys: Sequence[tuple[Any, ...]]) -> str:
    """Return the method's name where methods differ, and degree and order where these do or nothing else does."""
    method, degree, order = key
    degrees = {other[1] for other in keys if other[1] is not None}
    parts = [NAMES.get(method, method)] if len({other[0] for other in keys}) > 1 else []
    parts += [f"degree {degree}"] if degree is not None and len(degrees) > 1 else []
    parts += [f"order {order}"] if order is not None else []
    return ", ".join(parts) or NAMES.get(method, method)
