"""Reports of studies: pages with tables and figures beside the records, and tables of several studies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cpmkit.errors import InputError, printable
from cpmkit.files.whole_files import written_whole
from cpmkit.studies.figures import convergence_figure, difference_figure, trade_figure, work_figure
from cpmkit.studies.records import RECORDS_FILE, Record, Series, gather, of_content, read_records
from cpmkit.studies.tables import (
    attempts,
    comparison_table,
    costs_table,
    differences_sentence,
    error_sentence,
    front_table,
    orders_table,
    run_name,
    winners_table,
)


@dataclass(frozen=True)
class Report:
    """The report of a study.

    Attributes
    ----------
    title : str
        Title of the study.
    series : sequence of Series
        Results of each method with each set of options.
    failed : int
        Number of runs that ended with an error.
    files : sequence of Path
        The page and its figures.
    """

    title: str
    series: Sequence[Series]
    failed: int
    files: Sequence[Path]

    @property
    def by_spacing(self) -> list[Series]:
        """The series over spacings; the others are over accuracy targets."""
        return [each for each in self.series if not each.target]

    @property
    def compares(self) -> bool:
        """Whether errors are differences from the solution of another back end."""
        return self.series[0].reference is not None

    @property
    def trades(self) -> bool:
        """Whether there are several methods or an accuracy target, so that costs can be compared."""
        return any(each.target for each in self.series) or len({each.method for each in self.series}) > 1


def write_report(folder: Path, content: str | None = None) -> Report:
    """Write a page with tables and figures of the records in ``folder``, and return the report.

    Parameters
    ----------
    folder : Path
        Folder of the records.
    content : str, optional
        Content hash of the study file whose records are used; by default that of the last record.

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
    report, figures = Report(title, series, failed, []), {}
    by_spacing = report.by_spacing
    if by_spacing:
        figures["convergence.png"] = (difference_figure if report.compares else convergence_figure)(by_spacing, title)
    if len({(each.method, each.options.get("degree")) for each in by_spacing}) > 1:
        figures["work.png"] = work_figure(by_spacing, title)
    if report.trades:
        figures["trade.png"] = trade_figure(series, title)
    for name, figure in figures.items():
        with written_whole(folder / name) as file:
            figure.savefig(file, dpi=110)
    report = replace(report, files=[folder / "report.md", *(folder / name for name in figures)])
    with written_whole(folder / "report.md") as file:
        file.write_text(_page(report, records, list(figures), len(every) - len(records)), encoding="utf-8")
    return report


def _one_line(text: str) -> str:
    """Return text in one line, without control characters, and with bars escaped for a cell of a table."""
    return printable(" ".join(text.split())).replace("|", r"\|")


def trade_of(report: Report) -> str:
    """Return Markdown tables: the cheapest attempt for each decade of error, and the Pareto front of error and cost."""
    made = attempts(report.series)
    return "\n\n".join([winners_table(made), "Unbeaten in error and cost:", front_table(made)])


def table_of(reports: Sequence[Report]) -> str:
    """Return Markdown tables of errors: one table for all studies with a reference, and one for each other study."""
    compared = [(report.title, report.by_spacing) for report in reports if report.compares and report.by_spacing]
    tables = [comparison_table(compared)] if compared else []
    for report in reports:
        if not report.compares:
            tables += [report.title] * (len(reports) > 1)
            tables += [orders_table(report.by_spacing)] * bool(report.by_spacing)
    return "\n\n".join(tables)


def costs_of(reports: Sequence[Report]) -> str:
    """Return one Markdown table of errors and costs of all studies, ordered by spacing, with a row for each method."""
    return costs_table([(report.title, report.series) for report in reports])


def _page(report: Report, records: Sequence[Record], figures: Sequence[str], left_out: int) -> str:
    """Return the page in Markdown: errors and orders, ``figures``, costs, and the runs that ended with errors.

    ``left_out`` is the number of records that belong to other versions of the study file.
    """
    errors_line = differences_sentence(report.series) if report.compares else error_sentence(records)
    parts = [f"# {report.title}", table_of([report]), errors_line]
    parts += [f"![{report.title}]({figure})" for figure in figures]
    if report.trades:
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
