"""The records of a study as a page of Markdown."""

from __future__ import annotations

from collections.abc import Sequence

from cpmkit.studies.records import Record
from cpmkit.studies.series import Series


def page(records: Sequence[Record], series: Sequence[Series], figures: Sequence[str], left_out: int) -> str:
    """Return the whole page: errors and orders, figures, costs, and the runs that ended with errors."""
    title = records[0]["title"]
    parts = [f"# {title}", orders_table(series), told_of_errors(records)]
    parts += [f"![{title}]({figure})" for figure in figures]
    parts += ["## What it cost", costs_table(series)]
    failed = [record for record in records if "error" in record]
    if failed:
        parts += ["## Runs that ended with an error", "\n".join(f"- {_named(one)}: {one['error']}" for one in failed)]
    if left_out:
        parts.append(f"{left_out} records belong to the study file as it was before, and are left out.")
    return "\n\n".join(parts) + "\n"


def orders_table(series: Sequence[Series]) -> str:
    """Return the errors of each series at each spacing, and the fitted order."""
    spacings = sorted({spacing for one in series for spacing in one.spacings}, reverse=True)
    lines = [_row(["", *(f"{spacing:g}" for spacing in spacings), "order"]), _rule(1, len(spacings) + 1)]
    for one in series:
        errors = dict(zip(one.spacings, one.errors, strict=True))
        cells = [f"{errors[spacing]:.2e}" if spacing in errors else "" for spacing in spacings]
        order = one.fitted_order
        lines.append(_row([one.label, *cells, "" if order is None else f"{order:.2f}"]))
    return "\n".join(lines)


def told_of_errors(records: Sequence[Record]) -> str:
    """Return what the errors are."""
    origins = {record["origin"] for record in records if record["origin"] is not None}
    error = "the greatest error at any sample point"
    if origins:
        error = f"the root mean square, over {len(origins)} positions of the grid, of {error}"
    return f"By spacing: {error}. The order is the least-squares slope over all spacings."


def costs_table(series: Sequence[Series]) -> str:
    """Return unknowns, iterations and seconds of each series at each spacing."""
    lines = [_row(["", "spacing", "greatest error", "rms error", "unknowns", "iterations", "CPU seconds"]), _rule(1, 6)]
    for one in series:
        for entry in one.entries:
            cells = [f"{entry.spacing:g}", f"{entry.error:.2e}", f"{entry.rms_error:.2e}"]
            cells += [f"{entry.unknowns:,.0f}", f"{entry.iterations:.0f}", f"{entry.cpu_seconds:.1f}"]
            lines.append(_row([one.label, *cells]))
    return "\n".join(lines)


def told(record: Record) -> str:
    """Return one line on a run."""
    if "error" in record:
        return f"{_named(record)}: {record['error']}"
    seconds = sum(record["seconds"].values())
    return (
        f"{_named(record)}: greatest error {record['max_error']:.2e}, {record['unknowns']:,} unknowns, {seconds:.1f} s"
    )


def _named(record: Record) -> str:
    keys = ("degree", "order", "spacing", "origin")
    return ", ".join([record["method"], *(f"{key} {record[key]}" for key in keys if record[key] is not None)])


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _rule(left: int, right: int) -> str:
    return "|" + "---|" * left + "--:|" * right
