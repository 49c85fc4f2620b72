"""The tables of the pages: a selection of a benchmark's raw table, as `reader_tables.toml` declares it.

``python docs/reader_tables.py`` prints them; the documentation's build calls :func:`write_all`, and pages include
``generated/tables/NAME.md``. Cells are texts throughout; numbers are rounded as they will be read.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
RAW, DECLARED = ROOT / "benchmarks" / "tables", ROOT / "docs" / "reader_tables.toml"
MOST_COLUMNS, MOST_ROWS = 7, 30
KEYS = {"raw", "table", "tables", "rows", "columns", "format", "names", "best", "caption"}
NUMBER = re.compile(r"[-+]?\d[\d,]*(\.\d*)?(e[-+]?\d+)?")
#: The exponent of a number, as Python prints it.
EXPONENT = re.compile(r"(?<=\d)e([-+])0*(\d+)\b")

Row = dict[str, str]


class TableError(ValueError):
    """A declaration that does not fit its raw table."""


def write_all(folder: Path) -> list[Path]:
    """Write every declared table into ``folder / "tables"``, which is made if need be, and return the files."""
    (folder / "tables").mkdir(parents=True, exist_ok=True)
    files = {folder / "tables" / f"{name}.md": markdown(name, given) for name, given in declarations().items()}
    for file, text in files.items():
        file.write_text(text, encoding="utf-8")
    return list(files)


def declarations() -> dict[str, Any]:
    """Return what `reader_tables.toml` declares, by the name of the table."""
    return tomllib.loads(DECLARED.read_text(encoding="utf-8"))


def markdown(name: str, given: Mapping[str, Any]) -> str:
    """Return one declared table, its caption above it."""
    try:
        rows, bold = reader_table(given)
    except TableError as error:
        raise TableError(f"docs/reader_tables.toml, {name}: {error}") from None
    heads = list(rows[0])
    right = [all(_is_number(row[head]) or not row[head] for row in rows) for head in heads]
    texts = [[f"**{row[head]}**" if (at, head) in bold else row[head] for head in heads] for at, row in enumerate(rows)]
    lines = [heads, ["--:" if each else "---" for each in right], *_without_repetition(texts)]
    caption = f"{given['caption']}\n\n" if "caption" in given else ""
    return caption + "".join(f"| {' | '.join(line)} |\n" for line in lines)


def reader_table(given: Mapping[str, Any]) -> tuple[list[Row], set[tuple[int, str]]]:
    """Return the rows of a declared table by its heads, and which cells are the best, by row and head."""
    if unknown := given.keys() - KEYS:
        raise TableError(f"{sorted(unknown)[0]!r} is no key of a declaration.")
    specs = {head: {"from": spec} if isinstance(spec, str) else spec for head, spec in given["columns"].items()}
    rows = selected_rows(given, specs)
    if len(specs) > MOST_COLUMNS or len(rows) > MOST_ROWS:
        raise TableError(f"{len(specs)} columns and {len(rows)} rows are above {MOST_COLUMNS} and {MOST_ROWS}.")
    styles = {head: spec.get("format", given.get("format", "plain")) for head, spec in specs.items()}
    shown = [{head: shown_text(cell, styles[head]) for head, cell in row.items()} for row in rows]
    return shown, {cell for rule in given.get("best", []) for cell in best_cells(shown, rule)}


def raw_tables(file: Path) -> list[tuple[str, list[Row]]]:
    """Return the tables of a file, each with the bold heading that it stands below; repeated columns get numbers."""
    if not file.exists():
        raise TableError(f"there is no raw table benchmarks/tables/{file.name}.")
    tables: list[tuple[str, list[Row]]] = []
    heading, head = "", []
    for line in file.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip().removeprefix("|").removesuffix("|").split("|")]
        if not line.startswith("|"):
            heading, head = (line.strip("*") if line.startswith("**") else heading), []
        elif not head:
            head = [f"{c} ({cells[:at].count(c) + 1})" if c in cells[:at] else c for at, c in enumerate(cells)]
            tables.append((heading, []))
        elif set(line) - set("|-: "):
            tables[-1][1].append(dict(zip(head, cells, strict=True)))
    return tables


def raw_rows(given: Mapping[str, Any]) -> list[Row]:
    """Return the rows of one raw table, or of several below each other with their labels as the column ``table``.

    A place is a table's number from 1, the heading of the first one below it, or both in a list.
    """
    found, rows = raw_tables(RAW / given["raw"]), []
    for label, place in given.get("tables", {"": given.get("table", 1)}).items():
        heading, number = {int: (None, place), str: (place, 1)}.get(type(place), place)
        fitting = [table for own, table in found if heading in (None, own)]
        if len(fitting) < number:
            raise TableError(f"the raw file has no table {place!r}.")
        rows += [{**row, "table": label} for row in fitting[number - 1]]
    return rows


def selected_rows(given: Mapping[str, Any], specs: Mapping[str, Mapping[str, Any]]) -> list[Row]:
    """Return the cells of the selected rows by their heads; raw rows become one if only their ``where`` differs."""
    raw, alternatives, names = raw_rows(given), given.get("rows", [{}]), given.get("names", {})
    for each in alternatives:
        if not any(_fits(row, each) for row in raw):
            raise TableError(f"no raw row has {each}.")
    rows: dict[tuple[str, ...], Row] = {}
    for row in raw:
        if any(_fits(row, each) for each in alternatives):
            fixed = {head: _value(row, spec, names) for head, spec in specs.items() if "where" not in spec}
            made = rows.setdefault(tuple(fixed.values()), dict.fromkeys(specs, "") | fixed)
            for head, spec in specs.items():
                if "where" in spec and not made[head] and _fits(row, spec["where"]):
                    made[head] = _value(row, spec, names)
    for head in specs:
        if not any(row[head] for row in rows.values()):
            raise TableError(f"no raw row has anything for the column {head!r}.")
    return list(rows.values())


def _fits(row: Row, wanted: Mapping[str, str]) -> bool:
    return all(re.fullmatch(pattern, _raw_cell(row, column)) for column, pattern in wanted.items())


def _raw_cell(row: Row, column: str) -> str:
    if column not in row:
        raise TableError(f"the raw table has no column {column!r}, only {', '.join(map(repr, row))}.")
    return row[column]


def _value(row: Row, spec: Mapping[str, Any], names: Mapping[str, str]) -> str:
    """Return a raw cell, or the parts of some that ``take`` finds as ``text`` puts them, by its name for readers."""
    cells = [_raw_cell(row, each) for each in ([spec["from"]] if isinstance(spec["from"], str) else spec["from"])]
    text = " | ".join(cells) if any(cells) else ""
    if "take" in spec and text:
        found = re.search(spec["take"], text)
        if not found:
            raise TableError(f"{spec['take']!r} finds nothing in {text!r} of the raw column {spec['from']!r}.")
        text = spec.get("text", "{}").format(*found.groups())
    return names.get(text, text)


def shown_text(text: str, style: str) -> str:
    """Return a cell as it is read: exponents without zeros, numbers with two significant digits unless ``raw``.

    ``power`` is 1.3e-5; ``plain`` is that only below 0.001 and from 1e5 on.
    """
    if style == "raw" or not _is_number(text):
        return "0" if text == "0e+00" else EXPONENT.sub(lambda each: f"e{each[1].strip('+')}{each[2]}", text)
    digits = f"{_number(text):.1e}"
    mantissa, exponent = digits.split("e")
    if not float(mantissa):
        return "0"
    if style == "power" or not -4 < int(exponent) < 5:
        return f"{mantissa}e{int(exponent)}"
    return f"{float(digits):,.{max(0, 1 - int(exponent))}f}"


def best_cells(rows: Sequence[Row], rule: Mapping[str, Any]) -> Iterator[tuple[int, str]]:
    """Yield the best cells: ``among`` some heads of each row, or of each column ``of`` some heads.

    A column is compared ``within`` the rows that share the cells of other heads, if any are given. Where all are equal,
    or there is but one, none is best.
    """
    for head in [*rule.get("among", []), *rule.get("of", []), *rule.get("within", [])]:
        if head not in rows[0]:
            raise TableError(f"'best' names {head!r}, which is no column of the table.")
    groups = [[(at, head) for head in rule["among"]] for at in range(len(rows))] if "among" in rule else []
    shared = [tuple(row[head] for head in rule.get("within", [])) for row in rows]
    for head in rule.get("of", []):
        groups += [[(at, head) for at, own in enumerate(shared) if own == each] for each in dict.fromkeys(shared)]
    for group in groups:
        texts = {(at, head): rows[at][head] for at, head in group if rows[at][head]}
        values = {cell: _number(text) for cell, text in texts.items() if _is_number(text)}
        if values and len(set(texts.values())) > 1:
            best = (max if rule["pick"] == "max" else min)(values.values())
            yield from (cell for cell, value in values.items() if value == best)


def _is_number(text: str) -> bool:
    return NUMBER.fullmatch(text) is not None


def _number(text: str) -> float:
    return float(text.replace(",", ""))


def _without_repetition(rows: Sequence[Sequence[str]]) -> Iterator[Sequence[str]]:
    """Yield rows whose first cell is left out where it is that of the row above and no number."""
    for above, row in zip([None, *rows], rows, strict=False):
        yield ["", *row[1:]] if above and row[0] == above[0] and not _is_number(row[0]) else row


if __name__ == "__main__":
    for table_name, declared in declarations().items():
        print(f"## {table_name}\n\n{markdown(table_name, declared)}")
