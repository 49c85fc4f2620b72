"""The run of a benchmark whose rows are printed as they are measured, and written as a table if all of them are."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import cpmkit as ck
from cpmkit.studies.tables import table_row, table_rule


def print_and_write(
    rows: Callable[[bool], Iterable[Sequence[str]]],
    head: Sequence[str],
    table: Path,
    description: str | None,
    quick: str,
) -> None:
    """Print the cells of ``rows(is_quick)`` below ``head``, and write ``table`` unless the command line has --quick.

    ``description`` is the text of --help, ``quick`` that of --quick.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help=quick)
    is_quick, lines = parser.parse_args().quick, [table_row(head), table_rule(2, 5)]
    print(*lines, sep="\n")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ck.CpmkitWarning)
        for cells in rows(is_quick):
            lines.append(table_row(cells))
            print(lines[-1], flush=True)
    if not is_quick:
        table.write_text("\n".join(lines) + "\n", encoding="utf-8")
