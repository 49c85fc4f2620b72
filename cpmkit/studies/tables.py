"""Tables of the records of a study, in Markdown."""

from __future__ import annotations

import math
from collections.abc import Sequence

from cpmkit.errors import printable
from cpmkit.studies.record_series import Entry, Series
from cpmkit.studies.records import Record
from cpmkit.studies.sweep import TARGETS, listed_options


def orders_table(series: Sequence[Series]) -> str:
    """Return a Markdown table of the errors of each series at each spacing, and the fitted order."""
    spacings = sorted({spacing for each in series for spacing in each.spacings}, reverse=True)
    lines = [table_row(["", *(f"{spacing:g}" for spacing in spacings), "order"]), table_rule(1, len(spacings) + 1)]
    for each in series:
        errors = dict(zip(each.spacings, each.errors, strict=True))
        cells = [f"{errors[spacing]:.2e}" if spacing in errors else "" for spacing in spacings]
        order = each.fitted_order
        lines.append(table_row([each.label, *cells, "" if order is None else f"{order:.2f}"]))
    return "\n".join(lines)


def error_sentence(records: Sequence[Record]) -> str:
    """Return the sentence that explains the errors of a table."""
    origins = {record["origin"] for record in records if record["origin"] is not None}
    error = "the greatest error at any sample point"
    if origins:
        error = f"the root mean square, over {len(origins)} positions of the grid, of {error}"
    return f"By spacing: {error}. The order is the least-squares slope over all spacings."


def costs_table(studies: Sequence[tuple[str, Sequence[Series]]]) -> str:
    """Return a Markdown table of errors, unknowns, queries, iterations, seconds and memory of each series and spacing.

    Parameters
    ----------
    studies : sequence of (str, sequence of Series)
        The title of each study, shown where there are several, and its series.
    """
    heads = ["greatest error", "rms error", "unknowns", "queries", "iterations", "CPU seconds", "MiB"]
    titled = len(studies) > 1
    lines = [table_row([*["problem"] * titled, "", "spacing", *heads]), table_rule(1 + titled, 1 + len(heads))]
    for title, series in studies:
        rows = [(entry, each.label) for each in series for entry in each.entries]
        for entry, label in sorted(rows, key=_coarsest_first):
            lines.append(table_row([*[title] * titled, label, *_cost_cells(entry)]))
    return "\n".join(lines)


def _coarsest_first(row: tuple[Entry, str]) -> float:
    """Return the key by which rows of the table of costs are sorted, the coarsest spacing first."""
    return -row[0].spacing


def _cost_cells(entry: Entry) -> list[str]:
    """Return the cells of an entry in the table of costs, from its spacing on; empty for unknown numbers."""
    queries = "" if math.isnan(entry.queries) else f"{entry.queries:,.0f}"
    cells = [f"{entry.spacing:.6g}", f"{entry.error:.2e}", f"{entry.rms_error:.2e}", f"{entry.unknowns:,.0f}", queries]
    mebibytes = "" if math.isnan(entry.bytes) else f"{entry.bytes / 2**20:.3g}"
    return [*cells, f"{entry.iterations:.0f}", f"{entry.cpu_seconds:.2f}", mebibytes]


def run_sentence(record: Record) -> str:
    """Return a line on a record: the error and cost of the run, or the message with which it ended."""
    if "error" in record:
        return f"{run_name(record)}: {printable(record['error'])}"
    cost = f"{record['unknowns']:,} unknowns, {sum(record['seconds'].values()):.1f} s"
    if record["reference"] is None:
        return f"{run_name(record)}: greatest error {record['max_error']:.2e}, {cost}"
    if record["half_range"] == 0:
        return f"{run_name(record)}: rms difference {record['rms_error']:.2e} from a constant, {cost}"
    rms = 100 * record["rms_error"] / record["half_range"]
    return f"{run_name(record)}: rms difference {rms:.2f} % of half the range, {cost}"


def run_name(record: Record) -> str:
    """Return the name of a record's run: its method and its parameters."""
    target = {name: record.get(f"asked_{name}") for name in TARGETS}
    how = {**record, **target} | ({} if set(target.values()) == {None} else {"spacing": None})
    parameters = (
        f"{key} {how[key]}" for key in (*listed_options(), "spacing", *target, "origin") if how.get(key) is not None
    )
    return ", ".join([printable(record["method"]), *parameters])


def table_row(cells: Sequence[str]) -> str:
    """Return a row of a Markdown table."""
    return f"| {' | '.join(cells)} |"


def table_rule(left: int, right: int) -> str:
    """Return the line below the head of a Markdown table: ``left`` left-aligned and ``right`` right-aligned columns."""
    return "|" + "---|" * left + "--:|" * right


#: Columns for each method: attribute of an entry, and heading.
SHOWN_ENTRIES = {
    "rms_error": "rms mean kept",
    "rms_without_mean": "rms mean removed",
    "error": "largest",
    "shift": "mean put right by",
}


def comparison_table(studies: Sequence[tuple[str, Sequence[Series]]]) -> str:
    """Return a Markdown table of differences from a reference, in percent of half its range, methods side by side.

    Empty columns are left out.

    Parameters
    ----------
    studies : sequence of (str, sequence of Series)
        The title of each study and its series.
    """
    ordered = sorted((each for _, series in studies for each in series), key=lambda each: each.method != "cpm")
    labels = list(dict.fromkeys(each.label for each in ordered))  # the column of twins is that of the first
    columns = [f"{name}, {label}" for name in SHOWN_ENTRIES.values() for label in labels]
    rows = [["", "spacing", "unknowns", "twins", *columns]]
    for title, series in studies:
        found = {(each.label, entry.spacing): entry for each in series for entry in each.entries}
        for spacing in sorted({spacing for _, spacing in found}, reverse=True):
            entries = [found.get((label, spacing)) for label in labels]
            values = [math.nan if each is None else each.percent(name) for name in SHOWN_ENTRIES for each in entries]
            shown = ("" if math.isnan(value) else f"{value:.2f}" for value in values)
            rows.append([title, f"{spacing:g}", *_size_cells(entries), *shown])
    filled = [k for k in range(len(rows[0])) if any(cells[k] for cells in rows[1:])]
    header, *lines = [table_row([cells[k] for k in filled]) for cells in rows]
    return "\n".join([header, table_rule(1, len(filled) - 1), *lines])


def differences_sentence(series: Sequence[Series]) -> str:
    """Return the sentence that explains the numbers of :func:`comparison_table`."""
    return (
        f"Differences from the solution of the back end {series[0].reference!r}, whose own error is not known, in "
        "percent of half its range: the root mean square, with the mean difference kept in and removed; the largest; "
        "and by how much the mean was put right before, where it leaked. Unknowns and the share of twins among them "
        "are those of the first method."
    )


def _size_cells(entries: Sequence[Entry | None]) -> list[str]:
    """Return cells with the unknowns, and the share of twins (second unknowns at a node), of the first method.

    ``entries`` has an entry for each method at one spacing, None for a method without a result.
    """
    first = next(entry for entry in entries if entry is not None)
    share = first.twins / first.unknowns
    return [f"{first.unknowns:,.0f}", "" if math.isnan(share) else f"{share:.1%}"]
