"""The records of a study: one JSON object per line, in a file to which lines are only appended."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cpmkit.errors import InputError
from cpmkit.files.plain_values import (
    TEXT,
    Kind,
    check_fields,
    list_of,
    numbers,
    one_of,
    or_none,
    table_of,
    whole_numbers,
)
from cpmkit.files.whole_files import explain_system_error
from cpmkit.forms.choice import RENAMED_OPTIONS, every_option
from cpmkit.studies.sweep import TARGET_ENTRIES, listed_options

Record = dict[str, Any]
RECORDS_FILE = "records.jsonl"
#: Upper bound of numbers in a record: figures cannot show larger ones.
LARGEST_RECORDED = 1e100
COUNT_KIND, SIZE_KIND = whole_numbers(0, LARGEST_RECORDED), numbers(0, LARGEST_RECORDED)
SPACING_KIND = numbers(1 / LARGEST_RECORDED, LARGEST_RECORDED)
#: Entries of every record that identify the run.
RUN_ENTRIES = {
    "title": TEXT,
    "content": TEXT,
    "method": TEXT,
    "spacing": or_none(SPACING_KIND),
    "origin": or_none(COUNT_KIND),
}
#: Measured entries, of runs that ended without an error.
MEASURED_ENTRIES = {
    "spacing": SPACING_KIND,
    "max_error": SIZE_KIND,
    "rms_error": SIZE_KIND,
    "unknowns": whole_numbers(1, LARGEST_RECORDED),
    "iterations": COUNT_KIND,
    "cpu_seconds": SIZE_KIND,
}
IMBALANCE_KIND = Kind(
    "a table with the list of numbers shift",
    lambda one: (
        isinstance(one, Mapping) and list_of(numbers(-LARGEST_RECORDED, LARGEST_RECORDED)).accepts(one.get("shift"))
    ),
)
#: How the bytes of memory in a record were obtained.
MEASURED, FORETOLD = "measured", "foretold"
OPTIONAL_ENTRIES = {
    "study": TEXT,
    "reference": or_none(TEXT),
    "error": TEXT,
    "rms_without_mean": SIZE_KIND,
    "half_range": SIZE_KIND,
    "twins": or_none(COUNT_KIND),
    "imbalances": list_of(IMBALANCE_KIND),
    "seconds": table_of(SIZE_KIND),
    **dict.fromkeys(TARGET_ENTRIES, or_none(SPACING_KIND)),
    "estimate": or_none(SIZE_KIND),
    "status": or_none(TEXT),
    "bytes": or_none(SIZE_KIND),
    "bytes_are": or_none(one_of(MEASURED, FORETOLD)),
}


def read_records(file: Path) -> list[Record]:
    """Return the records of a file, none if the file does not exist; an unfinished last line is ignored.

    Raises
    ------
    InputError
        If the file cannot be read, or a line is not a record; the message names the line and the fault.
    """
    *lines, _ = _bytes_of(file).split(b"\n")
    return [_parse_record(line, f"line {count} of {file}") for count, line in enumerate(lines, 1)]


def _parse_record(line: bytes, where: str) -> Record:
    """Return the record in a line; raise InputError, which names the line as ``where``, if it is not valid."""
    try:
        record = json.loads(line)
    except (ValueError, RecursionError):
        record = None
    if not isinstance(record, dict):
        raise InputError(f"{where} is not a JSON object; remove that line, its run is made again.")
    record = {RENAMED_OPTIONS.get(name, name): value for name, value in record.items()}
    accepts = {name: every_option()[name].accepts for name in listed_options()}
    options = {name: or_none(Kind("a value that it takes", check)) for name, check in accepts.items()}
    try:
        check_fields(
            record, RUN_ENTRIES | ({} if "error" in record else MEASURED_ENTRIES), where, OPTIONAL_ENTRIES | options
        )
    except InputError as error:
        raise InputError(f"{str(error).removesuffix('.')}; remove that line, its run is made again.") from error
    return record


def append_record(file: Path, record: Mapping[str, Any]) -> None:
    """Append a record as one line in a single write; earlier lines stay whole if the write is interrupted.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    line = json.dumps(record, allow_nan=False, default=float).encode() + b"\n"
    with explain_system_error(f"{file} cannot be written"), file.open("ab", buffering=0) as opened:
        if opened.write(line) < len(line):  # a full disk accepts a part of the line
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os.fsync(opened.fileno())


def drop_unfinished_line(file: Path) -> None:
    """Remove an unfinished last line, left by an interrupted write, if there is one.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    content = _bytes_of(file)
    whole_lines = content.rfind(b"\n") + 1
    if whole_lines < len(content):
        with explain_system_error(f"{file} cannot be written"):
            os.truncate(file, whole_lines)


def _bytes_of(file: Path) -> bytes:
    """Return the bytes of a file, none if it does not exist; raise InputError if it cannot be read."""
    try:
        return file.read_bytes()
    except FileNotFoundError:
        return b""
    except (OSError, ValueError) as error:
        raise InputError(f"{file} cannot be read: {getattr(error, 'strerror', None) or error}.") from error


def of_content(records: Sequence[Record], content: str) -> list[Record]:
    """Return the records that belong to the content hash ``content`` of a study file."""
    return [record for record in records if record["content"] == content]
