"""The records of a study, one JSON object per line of a file, and series: one method over all spacings or targets."""

from __future__ import annotations

import errno
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.errors import InputError
from cpmkit.files import plain_values
from cpmkit.files.whole_files import explain_system_error
from cpmkit.forms.choice import RENAMED_OPTIONS, every_option
from cpmkit.studies.sweep import TARGETS, Run, listed_options

Record = dict[str, Any]
RECORDS_FILE = "records.jsonl"
#: Upper bound of numbers in a record: figures cannot show larger ones.
LARGEST_RECORDED = 1e100
COUNT_KIND, SIZE_KIND = plain_values.whole_numbers(0, LARGEST_RECORDED), plain_values.numbers(0, LARGEST_RECORDED)
SPACING_KIND = plain_values.numbers(1 / LARGEST_RECORDED, LARGEST_RECORDED)
SHIFT_KIND = plain_values.list_of(plain_values.numbers(-LARGEST_RECORDED, LARGEST_RECORDED))
#: Entries of every record that identify the run.
RUN_ENTRIES = {
    **dict.fromkeys(("title", "content", "method"), plain_values.TEXT),
    "spacing": plain_values.or_none(SPACING_KIND),
    "origin": plain_values.or_none(COUNT_KIND),
}
#: Measured entries, of runs that ended without an error.
MEASURED_ENTRIES = {
    **dict.fromkeys(("max_error", "rms_error", "cpu_seconds"), SIZE_KIND),
    "spacing": SPACING_KIND,
    "unknowns": plain_values.whole_numbers(1, LARGEST_RECORDED),
    "iterations": COUNT_KIND,
}
OPTIONAL_ENTRIES = {
    **dict.fromkeys(("study", "error"), plain_values.TEXT),
    **dict.fromkeys(("reference", "status"), plain_values.or_none(plain_values.TEXT)),
    **dict.fromkeys(("rms_without_mean", "half_range"), SIZE_KIND),
    **dict.fromkeys(("estimate", "bytes"), plain_values.or_none(SIZE_KIND)),
    **{f"asked_{name}": plain_values.or_none(SPACING_KIND) for name in TARGETS},
    "twins": plain_values.or_none(COUNT_KIND),
    "imbalances": plain_values.list_of(
        plain_values.ValueKind(
            "a table with the list of numbers shift",
            lambda entry: isinstance(entry, Mapping) and SHIFT_KIND.accepts(entry.get("shift")),
        )
    ),
    "seconds": plain_values.table_of(SIZE_KIND),
    "bytes_are": plain_values.or_none(plain_values.choice_of("measured", "predicted", "foretold")),  # the last: former
}


def read_records(file: Path) -> list[Record]:
    """Return the records of a file, none if the file does not exist; an unfinished last line is ignored.

    Raises InputError if the file cannot be read, or a line is not a record; the message names the line and the fault.
    """
    *lines, _ = _read_bytes(file).split(b"\n")
    return [_parse_record(line, f"line {count} of {file}") for count, line in enumerate(lines, 1)]


def _parse_record(line: bytes, where: str) -> Record:
    """Return the record in a ``line``, former option names replaced; raise InputError, which names it by ``where``."""
    try:
        record = json.loads(line)
    except (ValueError, RecursionError):
        record = None
    if not isinstance(record, dict):
        raise InputError(f"{where} is not a JSON object; remove that line, its run is made again.")
    record = {RENAMED_OPTIONS.get(name, name): value for name, value in record.items()}
    accepts = {name: every_option()[name].accepts for name in listed_options()}
    options = {
        name: plain_values.or_none(plain_values.ValueKind("a value that it takes", check))
        for name, check in accepts.items()
    }
    try:
        plain_values.check_fields(
            record, RUN_ENTRIES | ({} if "error" in record else MEASURED_ENTRIES), where, OPTIONAL_ENTRIES | options
        )
    except InputError as error:
        raise InputError(f"{str(error).removesuffix('.')}; remove that line, its run is made again.") from error
    return record


def append_record(file: Path, record: Mapping[str, Any]) -> None:
    """Append ``record`` to ``file`` as a line of JSON, in one write: an interruption leaves earlier lines whole.

    Raises InputError if the file cannot be written, ValueError if a number is not finite.
    """
    line = json.dumps(record, allow_nan=False, default=float).encode() + b"\n"
    with explain_system_error(f"{file} cannot be written"), file.open("ab", buffering=0) as opened:
        if opened.write(line) < len(line):  # a full disk accepts a part of the line
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os.fsync(opened.fileno())


def drop_unfinished_line(file: Path) -> None:
    """Remove an unfinished last line, left by an interrupted write, if any; raise InputError if the system refuses."""
    content = _read_bytes(file)
    whole_lines = content.rfind(b"\n") + 1
    if whole_lines < len(content):
        with explain_system_error(f"{file} cannot be written"):
            os.truncate(file, whole_lines)


def _read_bytes(file: Path) -> bytes:
    """Return the bytes of a file of records, none if it does not exist; raise InputError if it cannot be read."""
    try:
        return file.read_bytes()
    except FileNotFoundError:
        return b""
    except (OSError, ValueError) as error:
        raise InputError(f"{file} cannot be read: {getattr(error, 'strerror', None) or error}.") from error


#: Names of methods in labels.
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
    """Errors and costs of a series at one spacing or accuracy target."""

    spacing: float  #: With an accuracy target the mean of the resulting spacings.
    #: The largest error at any sample point; with several origins the root mean square of their largest errors.
    error: float
    #: rms_error, rms_without_mean: Root mean square of errors over sample points and origins, with and without the mean
    #: error.
    rms_error: float
    rms_without_mean: float
    half_range: float  #: Half the range of the reference.
    shift: float  #: Largest correction of the mean; nan where it was not computed.
    #: unknowns, twins, queries, iterations, cpu_seconds: Means over the origins; nan where a method has no such count.
    unknowns: float
    twins: float
    queries: float
    iterations: float
    cpu_seconds: float
    bytes: float  #: Peak memory, mean; nan where it is not recorded.
    target: float  #: Accuracy target in place of a spacing; nan without one.

    def percent(self, quantity: str) -> float:
        """Return the field ``quantity``, an error or ``shift``, in percent of the half range; nan without a range."""
        return 100 * float(getattr(self, quantity)) / self.half_range if self.half_range > 0 else math.nan


@dataclass(frozen=True)
class Series:
    """The results of one method with given options, over spacings or accuracy targets."""

    method: str
    options: Mapping[str, Any]  #: Values of the method's options that a study varies.
    label: str  #: The method and the options in which it differs from other series.
    entries: Sequence[Entry]  #: Results, the coarsest spacing, largest tolerance or shortest time first.
    reference: str | None  #: The back end whose solution is the reference; None where the solution is known.
    target: str = ""  #: ``tolerance`` or ``seconds`` in place of spacings, else empty.

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
        """Least-squares slope of log(error) over log(spacing); None if all spacings are equal or an error is zero."""
        if len(self.entries) < 2 or min(self.errors) <= 0:
            return None
        across = np.log(self.spacings) - np.mean(np.log(self.spacings))
        if np.ptp(across) < 1e-9:  # equal spacings
            return None
        return float(across @ np.log(self.errors) / (across @ across))


def group_into_series(records: Sequence[Record]) -> list[Series]:
    """Return the series of records, in the order of their first records; runs that failed are left out."""
    good = [record for record in records if "error" not in record]
    keys = list(dict.fromkeys(_series_key(record) for record in good))
    return [_make_series(key, keys, [record for record in good if _series_key(record) == key]) for key in keys]


def _series_key(record: Record) -> tuple[Any, ...]:
    """Return (method, options as pairs, name of the accuracy target or ""), which identify a record's series."""
    run = Run.from_record(record)
    return run.method, run.options, next(iter(run.target), "")


def _make_series(key: tuple[Any, ...], keys: Sequence[tuple[Any, ...]], records: Sequence[Record]) -> Series:
    """Return the series of ``records``, all with this ``key``; its label names what differs between all ``keys``."""
    method, options, target = key
    fineness = f"asked_{target}" if target else "spacing"
    given = sorted({record[fineness] for record in records}, reverse=target != "seconds")
    entries = [_make_entry([record for record in records if record[fineness] == one], target) for one in given]
    return Series(method, dict(options), _series_label(key, keys), entries, records[0].get("reference"), target)


def _make_entry(records: Sequence[Record], target: str) -> Entry:
    """Return the entry of a series at one spacing or accuracy target; ``records`` has one for each lattice position.

    Errors are root mean squares over the positions, ``shift`` is the largest, other quantities are means. ``target`` is
    the name of the accuracy target, empty for a spacing.
    """

    def of(name: str) -> Any:
        return np.array([record.get(name) for record in records], dtype=np.float64)

    rms = {name: float(np.sqrt(np.mean(of(name) ** 2))) for name in ("max_error", "rms_error", "rms_without_mean")}
    names = ("spacing", "half_range", "unknowns", "twins", "iterations", "cpu_seconds", "bytes")
    means = {name: float(of(name).mean()) for name in names}
    if not target:
        means["spacing"] = records[0]["spacing"]  # a mean of equal numbers may differ from them
    shifts = [abs(value) for record in records for each in record.get("imbalances", ()) for value in each["shift"]]
    return Entry(
        error=rms.pop("max_error"),
        shift=max(shifts, default=math.nan),
        queries=float(of("closest_point_queries").mean()),
        target=float(records[0][f"asked_{target}"]) if target else math.nan,
        **rms,
        **means,
    )


def _series_label(key: tuple[Any, ...], keys: Sequence[tuple[Any, ...]]) -> str:
    """Return the label of a series: its method if methods differ, and the options in which series of the method differ.

    If neither differs, the label is the option ``order``, or the method if it has no order. An accuracy target comes
    last. ``key`` of the series, and the ``keys`` of all series, are results of :func:`_series_key`.
    """
    (method, options, target), methods = key, {other for other, *_ in keys}
    own = [dict(other) for one, other, _ in keys if one == method]
    differ = [name for name, _ in options if len({other[name] for other in own}) > 1]
    name = "with sheets" if method == "cpm" and "plain" in methods else METHOD_WORDS.get(method, method)
    parts = [name] if len(methods) > 1 else []
    parts += [f"{name} {value}" for name, value in options if name in differ]
    parts = parts or [f"{name} {value}" for name, value in options if name == "order"]
    label = ", ".join(parts) or name
    return f"{label}, target {target}" if target else label
