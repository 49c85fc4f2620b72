"""Series of records: one method with its options over all spacings or accuracy targets."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.studies.records import Record
from cpmkit.studies.sweep import Run

#: Least number of spacings from which an order is fitted.
LEAST_SPACINGS = 2
#: Spacings that differ by a smaller share are equal.
SAME_SPACING_SHARE = 1e-9
METHOD_WORDS = {
    "cpm": "closest point method",
    "collocation": "collocation form",
    "galerkin": "Galerkin form",
    "plain": "without sheets",
    "nearest": "nearest point",
    "ball": "ball",
    "fem": "finite elements",
    "fem-pinned": "finite elements, nearest vertices",
    "fem-refined": "finite elements, refined mesh",
}


@dataclass(frozen=True)
class Entry:
    """Errors and costs of a series at one spacing or accuracy target.

    Attributes
    ----------
    spacing : float
        With an accuracy target the mean of the resulting spacings.
    error : float
        The largest error at any sample point; with several origins the root mean square of their largest errors.
    rms_error, rms_without_mean : float
        Root mean square of errors over sample points and origins, with and without the mean error.
    half_range : float
        Half the range of the reference.
    shift : float
        Largest correction of the mean; nan where it was not computed.
    unknowns, twins, queries, iterations, cpu_seconds : float
        Means over the origins; nan where a method has no such count.
    bytes : float
        Peak memory, mean; nan where it is not recorded.
    target : float
        Accuracy target in place of a spacing; nan without one.
    """

    spacing: float
    error: float
    rms_error: float
    rms_without_mean: float
    half_range: float
    shift: float
    unknowns: float
    twins: float
    queries: float
    iterations: float
    cpu_seconds: float
    bytes: float
    target: float

    def percent(self, quantity: str) -> float:
        """Return an error, or the shift, in percent of the half range; nan where that is zero."""
        return 100 * float(getattr(self, quantity)) / self.half_range if self.half_range > 0 else math.nan


@dataclass(frozen=True)
class Series:
    """The results of one method with given options, over spacings or accuracy targets.

    Attributes
    ----------
    method : str
    options : mapping
        Values of the method's options that a study varies.
    label : str
        The method and the options in which it differs from other series.
    entries : sequence of Entry
        Results, the coarsest spacing, largest tolerance or shortest time first.
    reference : str or None
        The back end whose solution is the reference; None where the solution is known.
    target : str
        ``tolerance`` or ``seconds`` in place of spacings, else empty.
    """

    method: str
    options: Mapping[str, Any]
    label: str
    entries: Sequence[Entry]
    reference: str | None
    target: str = ""

    @property
    def spacings(self) -> list[float]:
        """Spacings of the entries."""
        return [entry.spacing for entry in self.entries]

    @property
    def errors(self) -> list[float]:
        """Largest errors of the entries."""
        return [entry.error for entry in self.entries]

    @property
    def fitted_order(self) -> float | None:
        """Least-squares slope of log(error) over log(spacing); None with fewer than two spacings or a zero error."""
        if len(self.entries) < LEAST_SPACINGS or min(self.errors) <= 0:
            return None
        across = np.log(self.spacings) - np.mean(np.log(self.spacings))
        if np.ptp(across) < SAME_SPACING_SHARE:
            return None
        return float(across @ np.log(self.errors) / (across @ across))


def gather(records: Sequence[Record]) -> list[Series]:
    """Return the series of records, in the order in which they first appear; runs with errors are left out."""
    good = [record for record in records if "error" not in record]
    keys = list(dict.fromkeys(_series_key(record) for record in good))
    return [_series(key, keys, [record for record in good if _series_key(record) == key]) for key in keys]


def _series_key(record: Record) -> tuple[Any, ...]:
    """Return the method, the options and the kind of accuracy target of a record, which identify its series."""
    run = Run.of(record)
    return run.method, run.options, next(iter(run.target), "")


def _series(key: tuple[Any, ...], keys: Sequence[tuple[Any, ...]], records: Sequence[Record]) -> Series:
    """Return the series of the records with this key; ``keys`` are those of all series."""
    method, options, target = key
    fineness = f"asked_{target}" if target else "spacing"
    given = sorted({record[fineness] for record in records}, reverse=target != "seconds")
    entries = [_entry([record for record in records if record[fineness] == one], target) for one in given]
    return Series(method, dict(options), _label(key, keys), entries, records[0].get("reference"), target)


def _entry(records: Sequence[Record], target: str) -> Entry:
    """Return the entry of a series at one spacing or target, from the records of all origins.

    Errors are root mean squares over the origins, other quantities are means; ``target`` is empty for a spacing.
    """

    def of(name: str) -> Any:
        return np.array([record.get(name) for record in records], dtype=np.float64)

    rms = {name: float(np.sqrt(np.mean(of(name) ** 2))) for name in ("max_error", "rms_error", "rms_without_mean")}
    names = ("spacing", "half_range", "unknowns", "twins", "iterations", "cpu_seconds", "bytes")
    means = {name: float(of(name).mean()) for name in names}
    if not target:
        means["spacing"] = records[0]["spacing"]  # a mean of equal numbers may differ from them
    value = float(records[0][f"asked_{target}"]) if target else math.nan
    queries = float(of("closest_point_queries").mean())
    return Entry(
        error=rms.pop("max_error"), shift=_largest_shift(records), queries=queries, target=value, **rms, **means
    )


def _largest_shift(records: Sequence[Record]) -> float:
    """Return the largest correction of a mean in the records; nan if none has a correction."""
    shifts = [abs(value) for record in records for one in record.get("imbalances", ()) for value in one["shift"]]
    return max(shifts, default=float("nan"))


def _label(key: tuple[Any, ...], keys: Sequence[tuple[Any, ...]]) -> str:
    """Return the label of a series: the method if methods differ, and the options that differ between its series.

    If none differs, the label is the order of the method, or else the method.
    """
    (method, options, target), methods = key, {other for other, *_ in keys}
    own = [dict(other) for one, other, _ in keys if one == method]
    differ = [name for name, _ in options if len({other[name] for other in own}) > 1]
    name = "with sheets" if method == "cpm" and "plain" in methods else METHOD_WORDS.get(method, method)
    parts = [name] if len(methods) > 1 else []
    parts += [f"{name} {value}" for name, value in options if name in differ]
    parts = parts or [f"{name} {value}" for name, value in options if name == "order"]
    label = ", ".join(parts) or name
    return f"{label}, {target} asked" if target else label
