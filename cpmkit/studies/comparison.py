"""Differences of methods from a reference, of one study or of several, as a table."""

from __future__ import annotations

import math
from collections.abc import Sequence

from cpmkit.studies.series import Entry, Series
from cpmkit.studies.tables import table_row, table_rule

#: What is shown of each method, by the name that an entry has for it.
SHOWN_ENTRIES = {
    "rms_error": "rms mean kept",
    "rms_without_mean": "rms mean removed",
    "error": "largest",
    "shift": "mean put right by",
}


def comparison_table(studies: Sequence[tuple[str, Sequence[Series]]]) -> str:
    """Return differences from a reference, in percent of half its range, methods side by side; no empty columns.

    Parameters
    ----------
    studies : sequence of (str, sequence of Series)
        The title of each study and its series.
    """
    ordered = sorted((one for _, series in studies for one in series), key=lambda one: one.method != "cpm")
    labels = list(dict.fromkeys(one.label for one in ordered))  # twins are those of the first
    columns = [f"{name}, {label}" for name in SHOWN_ENTRIES.values() for label in labels]
    rows = [["", "spacing", "unknowns", "twins", *columns]]
    for title, series in studies:
        found = {(one.label, entry.spacing): entry for one in series for entry in one.entries}
        for spacing in sorted({spacing for _, spacing in found}, reverse=True):
            entries = [found.get((label, spacing)) for label in labels]
            values = [math.nan if one is None else one.percent(name) for name in SHOWN_ENTRIES for one in entries]
            shown = ("" if math.isnan(value) else f"{value:.2f}" for value in values)
            rows.append([title, f"{spacing:g}", *_size(entries), *shown])
    filled = [k for k in range(len(rows[0])) if any(cells[k] for cells in rows[1:])]
    header, *lines = [table_row([cells[k] for k in filled]) for cells in rows]
    return "\n".join([header, table_rule(1, len(filled) - 1), *lines])


def told_of_differences(series: Sequence[Series]) -> str:
    """Return what the numbers of the table are."""
    return (
        f"Differences from the solution of the back end {series[0].reference!r}, whose own error is not known, in "
        "percent of half its range: the root mean square, with the mean difference kept in and removed; the largest; "
        "and by how much the mean was put right before, where it leaked. Unknowns and the share of twins among them "
        "are those of the first method."
    )


def _size(entries: Sequence[Entry | None]) -> list[str]:
    """Return the unknowns, and the share of twins, of the first method that got through."""
    first = next(entry for entry in entries if entry is not None)
    share = first.twins / first.unknowns
    return [f"{first.unknowns:,.0f}", "" if math.isnan(share) else f"{share:.1%}"]
