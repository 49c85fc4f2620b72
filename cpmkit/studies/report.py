"""From the records of studies to pages with tables and figures, written beside them, and to a table of them all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cpmkit.errors import InputError, printable
from cpmkit.files.whole_files import written_whole
from cpmkit.studies.figures import convergence_figure, difference_figure, trade_figure, work_figure
from cpmkit.studies.pareto import attempts, front_table, winners_table
from cpmkit.studies.record_series import Series, gather
from cpmkit.studies.records import RECORDS_FILE, Record, of_content, read_records
from cpmkit.studies.tables import (
    comparison_table,
    costs_table,
    error_sentence,
    orders_table,
    run_name,
    told_of_differences,
)

REPORT_PAGE, CONVERGENCE_FIGURE, WORK_FIGURE = "report.md", "convergence.png", "work.png"
TRADE_FIGURE = "trade.png"
DOTS_PER_INCH = 110


@dataclass(frozen=True)
class Report:
    """What a report says and where it is.

    Attributes
    ----------
    title : str
        Of the study.
    series : sequence of Series
        Methods and their options.
    failed : int
        Runs that ended with an error.
    files : sequence of Path
        The page and its figures.
    """

    title: str
    series: Sequence[Series]
    failed: int
    files: Sequence[Path]

    @property
    def by_spacing(self) -> list[Series]:
        """The series of spacings; others ask for an error or a time."""
        return [one for one in self.series if not one.target]

    @property
    def compares(self) -> bool:
        """True where errors are differences from a reference."""
        return self.series[0].reference is not None


def write_report(folder: Path, content: str | None = None) -> Report:
    """Write tables and figures of the records in ``folder``.

    Parameters
    ----------
    folder : Path
        Where a study was run.
    content : str, optional
        Only records of a study file with this content; unless given, that of the last record.

    Raises
    ------
    InputError
        If there is no such record, or no run without an error.
    """
    every = read_records(folder / RECORDS_FILE)
    records = of_content(every, content or every[-1]["content"]) if every else []
    if not records:
        reason = f"{len(every)} records, none of the study file as it is now" if every else "no records"
        raise InputError(f"{folder / RECORDS_FILE} holds {reason}; run `cpmkit study run` first.")
    series = gather(records)
    if not series:
        raise InputError(
            f"all {len(records)} runs of {folder / RECORDS_FILE} ended with errors, first {records[0]['error']!r}."
        )
    title, failed = _one_line(records[0]["title"]), sum("error" in record for record in records)
    compares = series[0].reference is not None
    by_spacing = [one for one in series if not one.target]
    figures = {}
    if by_spacing:
        figures[CONVERGENCE_FIGURE] = (difference_figure if compares else convergence_figure)(by_spacing, title)
    if len({(one.method, one.options.get("degree")) for one in by_spacing}) > 1:
        figures[WORK_FIGURE] = work_figure(by_spacing, title)
    if trades(series):
        figures[TRADE_FIGURE] = trade_figure(series, title)
    for name, figure in figures.items():
        with written_whole(folder / name) as file:
            figure.savefig(file, dpi=DOTS_PER_INCH)
    report = Report(title, series, failed, [folder / REPORT_PAGE, *(folder / name for name in figures)])
    with written_whole(folder / REPORT_PAGE) as file:
        file.write_text(_page(report, records, list(figures), len(every) - len(records)), encoding="utf-8")
    return report


def _one_line(text: str) -> str:
    """Return what a record tells without control characters, and with bars that do not end a table's cell."""
    return printable(" ".join(text.split())).replace("|", r"\|")


def trades(series: Sequence[Series]) -> bool:
    """Tell whether there is something to choose from: several methods, or an error or a time that was asked for."""
    return any(one.target for one in series) or len({one.method for one in series}) > 1


def trade_of(report: Report) -> str:
    """Return who gets below each decade of error for the least, and what no other attempt beats."""
    made = attempts(report.series)
    return "\n\n".join([winners_table(made), "Unbeaten in error and cost:", front_table(made)])


def table_of(reports: Sequence[Report]) -> str:
    """Return the tables of one study or of several: studies with a reference share one, each other has its own."""
    compared = [(report.title, report.by_spacing) for report in reports if report.compares and report.by_spacing]
    tables = [comparison_table(compared)] if compared else []
    for report in reports:
        if not report.compares:
            tables += [report.title] * (len(reports) > 1)
            tables += [orders_table(report.by_spacing)] * bool(report.by_spacing)
    return "\n\n".join(tables)


def costs_of(reports: Sequence[Report]) -> str:
    """Return one table of errors and costs of all studies, spacing by spacing, with the methods below one another."""
    return costs_table([(report.title, report.series) for report in reports])


def _page(report: Report, records: Sequence[Record], figures: Sequence[str], left_out: int) -> str:
    """Return the whole page: errors and orders, figures, costs, and the runs that ended with errors."""
    errors_line = told_of_differences(report.series) if report.compares else error_sentence(records)
    parts = [f"# {report.title}", table_of([report]), errors_line]
    parts += [f"![{report.title}]({figure})" for figure in figures]
    if trades(report.series):
        parts += ["## Which buys which error for what", trade_of(report)]
    parts += ["## What it cost", costs_table([(report.title, report.series)])]
    failed = [record for record in records if "error" in record]
    if failed:
        parts += [
            "## Runs that ended with an error",
            "\n".join(f"- {run_name(run)}: {_one_line(run['error'])}" for run in failed),
        ]
    if left_out:
        parts.append(f"{left_out} records belong to the study file as it was before, and are left out.")
    return "\n\n".join(parts) + "\n"
