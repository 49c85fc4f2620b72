"""Tables of the records of a study in Markdown, and Pareto fronts of error and cost."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from cpmkit.errors import printable
from cpmkit.studies.records import Record, Series
from cpmkit.studies.sweep import TARGETS, listed_options


def table_row(cells: Sequence[str]) -> str:
    """Return a row of a Markdown table with the texts ``cells``."""
    return f"| {' | '.join(cells)} |"


def table_rule(left: int, right: int) -> str:
    """Return the line below the head of a Markdown table: ``left`` left-aligned and ``right`` right-aligned columns."""
    return "|" + "---|" * left + "--:|" * right


def _markdown_table(rows: Sequence[Sequence[str]], left: int) -> str:
    """Return a Markdown table of ``rows``, the heads first, with ``left`` left-aligned columns."""
    head, *lines = map(table_row, rows)
    return "\n".join([head, table_rule(left, len(rows[0]) - left), *lines])


def _format_number(value: float, spec: str) -> str:
    """Return a number formatted by ``spec`` for a cell of a table, an empty text for nan."""
    return "" if math.isnan(value) else format(value, spec)


def orders_table(series: Sequence[Series]) -> str:
    """Return a Markdown table of the largest errors of each series at each spacing, and the fitted orders."""
    spacings = sorted({spacing for each in series for spacing in each.spacings}, reverse=True)
    rows = [["", *(f"{spacing:g}" for spacing in spacings), "order"]]
    for each in series:
        errors, order = dict(zip(each.spacings, each.errors, strict=True)), each.fitted_order
        cells = [_format_number(errors.get(spacing, math.nan), ".2e") for spacing in spacings]
        rows.append([each.label, *cells, "" if order is None else f"{order:.2f}"])
    return _markdown_table(rows, 1)


def error_sentence(records: Sequence[Record]) -> str:
    """Return sentences that define the errors and the orders in :func:`orders_table` of these records."""
    origins = {record["origin"] for record in records if record["origin"] is not None}
    error = "the greatest error at any sample point"
    if origins:
        error = f"the root mean square, over {len(origins)} positions of the grid, of {error}"
    return f"By spacing: {error}. The order is the least-squares slope over all spacings."


def costs_table(studies: Sequence[tuple[str, Sequence[Series]]]) -> str:
    """Return a Markdown table of errors, unknowns, queries, iterations, seconds and memory of each series and spacing.

    ``studies`` has the title of each study, shown where there are several, and its series; rows descend in spacing.
    """
    heads = ["greatest error", "rms error", "unknowns", "queries", "iterations", "CPU seconds", "MiB"]
    titled = len(studies) > 1
    rows = [[*["problem"] * titled, "", "spacing", *heads]]
    for title, series in studies:
        entries = [(entry, each.label) for each in series for entry in each.entries]
        for entry, label in sorted(entries, key=lambda row: -row[0].spacing):
            errors = [f"{entry.spacing:.6g}", f"{entry.error:.2e}", f"{entry.rms_error:.2e}"]
            counts = [f"{entry.unknowns:,.0f}", _format_number(entry.queries, ",.0f"), f"{entry.iterations:.0f}"]
            costs = [f"{entry.cpu_seconds:.2f}", _format_number(entry.bytes / 2**20, ".3g")]
            rows.append([*[title] * titled, label, *errors, *counts, *costs])
    return _markdown_table(rows, 1 + titled)


def run_sentence(record: Record) -> str:
    """Return a line on a record: the error, unknowns and seconds of the run, or the message with which it ended."""
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
    """Return the name of a record's run: its method, and the parameters that a study varies.

    If the run had a target (tolerance, seconds), it is named in place of the spacing that followed from it.
    """
    target = {name: record.get(f"asked_{name}") for name in TARGETS}
    how = {**record, **target} | ({} if set(target.values()) == {None} else {"spacing": None})
    parameters = (
        f"{key} {how[key]}" for key in (*listed_options(), "spacing", *target, "origin") if how.get(key) is not None
    )
    return ", ".join([printable(record["method"]), *parameters])


def comparison_table(studies: Sequence[tuple[str, Sequence[Series]]]) -> str:
    """Return a Markdown table of differences from a reference, in percent of half its range, methods side by side.

    ``studies`` has the title of each study and its series. Empty columns are left out. Unknowns, and the share of twins
    (second unknowns at a node) among them, are those of the first method with a result, ``cpm`` before others.
    """
    quantities = {"rms_error": "rms mean kept", "rms_without_mean": "rms mean removed"}
    quantities |= {"error": "largest", "shift": "mean put right by"}
    ordered = sorted((each for _, series in studies for each in series), key=lambda each: each.method != "cpm")
    labels = list(dict.fromkeys(each.label for each in ordered))  # the column of twins is that of the first
    columns = [f"{name}, {label}" for name in quantities.values() for label in labels]
    rows = [["", "spacing", "unknowns", "twins", *columns]]
    for title, series in studies:
        found = {(each.label, entry.spacing): entry for each in series for entry in each.entries}
        for spacing in sorted({spacing for _, spacing in found}, reverse=True):
            entries = [found.get((label, spacing)) for label in labels]
            values = [math.nan if each is None else each.percent(name) for name in quantities for each in entries]
            first = next(entry for entry in entries if entry is not None)
            sizes = [f"{first.unknowns:,.0f}", _format_number(first.twins / first.unknowns, ".1%")]
            rows.append([title, f"{spacing:g}", *sizes, *(_format_number(value, ".2f") for value in values)])
    filled = [k for k in range(len(rows[0])) if any(cells[k] for cells in rows[1:])]
    return _markdown_table([[cells[k] for k in filled] for cells in rows], 1)


def differences_sentence(series: Sequence[Series]) -> str:
    """Return the sentence that defines the differences in :func:`comparison_table` of these series."""
    return (
        f"Differences from the solution of the back end {series[0].reference!r}, whose own error is not known, in "
        "percent of half its range: the root mean square, with the mean difference kept in and removed; the largest; "
        "and by how much the mean was corrected before. Unknowns, and the share of twins (second unknowns at a node) "
        "among them, are those of the first method."
    )


#: The costs of an attempt: name of the attribute, and heading of its column.
COSTS = {"seconds": "CPU seconds", "mebibytes": "MiB"}


#: A difference from a reference of at most this share of its range is rounding.
SAME_SHARE = 1e-13


@dataclass(frozen=True)
class Attempt:
    """One entry of a series, with its error and its costs: the result of one method at one resolution."""

    #: label, setting: The method with its options; its spacing or accuracy target.
    label: str
    setting: str
    #: Root mean square error as a share of the solution's range; in the unit of the solution where it is constant.
    error: float
    #: seconds, mebibytes: CPU seconds and peak memory; nan where they were not recorded.
    seconds: float
    mebibytes: float


def attempts(series: Sequence[Series]) -> list[Attempt]:
    """Return the entries of all series as attempts, which are compared in error and cost.

    Entries that are the reference itself are left out, such as ``fem-refined`` on a mesh that is fine enough.
    """
    made = []
    for each in series:
        for entry in each.entries:
            unit = 2 * entry.half_range if entry.half_range > 0 else 1.0
            if each.reference is not None and entry.rms_error <= SAME_SHARE * unit:
                continue
            setting = f"{each.target} {entry.target:g}" if each.target else f"spacing {entry.spacing:g}"
            made.append(Attempt(each.label, setting, entry.rms_error / unit, entry.cpu_seconds, entry.bytes / 2**20))
    return made


def pareto_front(made: Sequence[Attempt], cost: str) -> list[Attempt]:
    """Return the Pareto front of ``made``, cheapest first: attempts with errors below those of all that cost no more.

    ``cost`` is a key of :data:`COSTS`. Attempts whose cost is nan are left out, and so are repeats of equal attempts.
    """
    best: list[Attempt] = []
    priced = [attempt for attempt in made if not math.isnan(getattr(attempt, cost))]
    for attempt in sorted(priced, key=lambda attempt: (getattr(attempt, cost), attempt.error)):
        if not best or attempt.error < best[-1].error:
            best.append(attempt)
    return best


def cheapest_by_decade(made: Sequence[Attempt], cost: str) -> dict[int, Attempt]:
    """Return, for each decade of the errors on the Pareto front, the cheapest attempt with an error of at most 10^k.

    The keys are the integers k, the largest first; ``cost`` is a key of :data:`COSTS`. Errors below 1e-16 are rounding
    and count as 1e-16.
    """
    on_front = pareto_front(made, cost)
    if not on_front:
        return {}
    first, last = (math.ceil(math.log10(max(on_front[k].error, 1e-16))) for k in (0, -1))
    powers = [power for power in range(first, last - 1, -1) if on_front[-1].error <= 10.0**power]
    return {power: next(each for each in on_front if each.error <= 10.0**power) for power in powers}


def cheapest_table(made: Sequence[Attempt]) -> str:
    """Return a Markdown table of the attempts that reach each decade of the error at the least cost of each kind."""
    found = {cost: cheapest_by_decade(made, cost) for cost in COSTS if pareto_front(made, cost)}
    heads = [head for cost in found for head in (f"least {COSTS[cost]}", COSTS[cost])]
    lines = [table_row(["rms error below, of the range", *heads]), "|--:|" + "---|--:|" * len(found)]
    for power in sorted({power for winners in found.values() for power in winners}, reverse=True):
        cells = []
        for cost, winners in found.items():
            best = winners.get(power)
            cells += ["", ""] if best is None else [f"{best.label}, {best.setting}", f"{getattr(best, cost):.3g}"]
        lines.append(table_row([f"1e{power:d}", *cells]))
    return "\n".join(lines)


def pareto_table(made: Sequence[Attempt]) -> str:
    """Return a Markdown table of the attempts on the Pareto fronts of error and each cost, the largest error first."""
    fronts = {cost: pareto_front(made, cost) for cost in COSTS}
    rows = [["", "", "unbeaten in", "rms error, of the range", *COSTS.values()]]
    for each in sorted({each for on_front in fronts.values() for each in on_front}, key=lambda each: -each.error):
        where = " and ".join(COSTS[cost] for cost, on_front in fronts.items() if each in on_front)
        costs = [_format_number(getattr(each, cost), ".3g") for cost in COSTS]
        rows.append([each.label, each.setting, where, f"{each.error:.2e}", *costs])
    return _markdown_table(rows, 3)
