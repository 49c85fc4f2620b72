"""The records of a study: one JSON object a line, only ever appended to."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cpmkit.errors import InputError

Record = dict[str, Any]
FILE = "records.jsonl"


def read_records(file: Path) -> list[Record]:
    """Return the records of a file, none if there is no such file; a last line that was not finished is left out.

    Raises
    ------
    InputError
        If a line within the file is not a JSON object.
    """
    if not file.is_file():
        return []
    *lines, _ = file.read_bytes().split(b"\n")
    records = []
    for number, line in enumerate(lines, 1):
        try:
            record = json.loads(line)
        except ValueError:
            record = None
        if not isinstance(record, dict):
            raise InputError(f"line {number} of {file} is not a JSON object; remove that line, its run is made again.")
        records.append(record)
    return records


def append_record(file: Path, record: Mapping[str, Any]) -> None:
    """Append one line, written at once; whatever interrupts this, the lines before it stay whole."""
    line = json.dumps(record, allow_nan=False, default=float).encode() + b"\n"
    handle = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
    try:
        os.write(handle, line)
        os.fsync(handle)
    finally:
        os.close(handle)


def drop_unfinished_line(file: Path) -> None:
    """Cut off a last line that an interrupted write left without its end."""
    if not file.is_file():
        return
    content = file.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole < len(content):
        os.truncate(file, whole)


def of_content(records: Sequence[Record], content: str) -> list[Record]:
    """Return the records that belong to a study of this content."""
    return [record for record in records if record.get("content") == content]
