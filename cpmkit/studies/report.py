"""Reports of studies: figures of errors and costs, pages with tables, and tables of several studies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import InputError, MissingDependencyError, printable
from cpmkit.files.whole_files import written_whole
from cpmkit.runtime.messages import install_command
from cpmkit.studies import tables
from cpmkit.studies.records import RECORDS_FILE, Record, Series, group_into_series, read_records

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: Okabe and Ito's colours for the colour-blind, without the yellow, which is too light for lines.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
STYLES = ("-", "--", "-.", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (3, 1)))
GREY = "#777777"


def convergence_figure(series: Sequence[Series], title: str) -> Figure:
    """Return a figure of largest errors over spacing, log-log, with fitted orders and dotted slopes 1 to 3."""
    figure, (axes,) = _empty_figure(title, 1)
    _draw_slopes(axes, series)
    for number, each in enumerate(series):
        order = each.fitted_order
        fitted = "" if order is None else f" (fitted order {order:.2f})"
        _plot_series(axes, number, each.spacings, each.errors, each.label + fitted)
    axes.set(xlabel="spacing", ylabel="greatest error")
    _set_spacing_ticks(axes, series)
    return _add_legend(figure, columns=1)


def difference_figure(series: Sequence[Series], title: str) -> Figure:
    """Return a figure of rms differences from a reference over spacing, in % of half its range, mean kept or not."""
    figure, pair = _empty_figure(title, 2)
    shown = {"rms_error": "mean kept", "rms_without_mean": "mean removed"}
    for axes, (quantity, name) in zip(pair, shown.items(), strict=True):
        for number, each in enumerate(series):
            _plot_series(axes, number, each.spacings, [entry.percent(quantity) for entry in each.entries], each.label)
        axes.set(xlabel="spacing", title=name)
        _set_spacing_ticks(axes, series)
    pair[0].set_ylabel(_escape_dollars(f"rms difference from {series[0].reference}, % of half the range"))
    return _add_legend(figure, columns=3)


def work_figure(series: Sequence[Series], title: str) -> Figure:
    """Return a figure of largest errors over CPU seconds and over unknowns, log-log, side by side."""
    from matplotlib.ticker import NullFormatter

    figure, pair = _empty_figure(title, 2)
    for axes, quantity in zip(pair, ("cpu_seconds", "unknowns"), strict=True):
        for number, each in enumerate(series):
            _plot_series(axes, number, [getattr(entry, quantity) for entry in each.entries], each.errors, each.label)
        axes.set(xlabel={"cpu_seconds": "CPU seconds"}.get(quantity, quantity))
        _set_log_scales(axes)
        axes.xaxis.set_minor_formatter(NullFormatter())
    pair[0].set_ylabel("greatest error")
    return _add_legend(figure, columns=3)


def pareto_figure(series: Sequence[Series], title: str) -> Figure:
    """Return a figure of the errors of :class:`tables.Attempt` over each recorded cost, with Pareto fronts in grey."""
    made = tables.attempts(series)
    fronts = {cost: tables.pareto_front(made, cost) for cost in tables.COSTS if tables.pareto_front(made, cost)}
    figure, all_axes = _empty_figure(title, max(len(fronts), 1))
    for axes, (cost, best) in zip(all_axes, fronts.items(), strict=False):
        x, y = [getattr(each, cost) for each in best], [each.error for each in best]
        axes.plot(x, y, color=GREY, linewidth=7, alpha=0.3, solid_capstyle="round", label="unbeaten")
        for number, each in enumerate(series):
            own = tables.attempts([each])
            _plot_series(axes, number, [getattr(one, cost) for one in own], [one.error for one in own], each.label)
        axes.set(xlabel=tables.COSTS[cost])
        _set_log_scales(axes)
    all_axes[0].set_ylabel("rms error, share of the range")
    return _add_legend(figure, columns=2)


def _empty_figure(title: str, count: int) -> tuple[Figure, Any]:
    """Return a figure of ``count`` axes side by side, and the array of these (count,), with a common vertical scale."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependencyError(f"Figures need matplotlib; {install_command('view')} adds it.") from error
    figure = Figure(figsize=(6.4, 5.4) if count == 1 else (5 * count, 4.8), layout="constrained")
    figure.suptitle(_escape_dollars(fill(title, 68 * count)), fontsize=11 if count == 1 else "large")
    return figure, figure.subplots(1, count, sharey=True, squeeze=False)[0]


def _escape_dollars(text: str) -> str:
    """Return text with escaped dollar signs, which matplotlib would read as the start of a formula."""
    return text.replace("$", r"\$")


def _plot_series(axes: Any, number: int, x: Sequence[float], y: Sequence[float], label: str) -> None:
    """Add a line of ``y`` over ``x`` to ``axes``, in the colour, style and marker of series ``number``, from 0."""
    axes.plot(
        x,
        y,
        color=COLOURS[number % len(COLOURS)],
        linestyle=STYLES[number % len(STYLES)],
        marker="os^DvPX"[number % 7],
        label=_escape_dollars(label),
    )


def _draw_slopes(axes: Any, series: Sequence[Series]) -> None:
    """Add dotted lines of slopes 1 to 3 that end at the mean of positive coarsest errors, if spacings differ."""
    spacings = np.array(sorted({spacing for one in series for spacing in one.spacings}))
    coarsest = [one.errors[0] for one in series if one.errors[0] > 0]
    if len(spacings) == 1 or not coarsest:
        return
    start = np.exp(np.mean(np.log(coarsest)))
    for slope in (1, 2, 3):
        errors = start * (spacings / spacings[-1]) ** slope
        axes.plot(spacings, errors, color=GREY, linestyle=":", linewidth=1.2)
        axes.annotate(
            f"slope {slope}", (spacings[0], errors[0]), (-4, 0), textcoords="offset points", color=GREY, ha="right",
            va="center", fontsize=9,
        )  # fmt: skip


def _set_spacing_ticks(axes: Any, series: Sequence[Series]) -> None:
    """Set the scales of ``axes`` as :func:`_set_log_scales`, with a tick at each spacing, and no minor ticks."""
    spacings = sorted({spacing for one in series for spacing in one.spacings})
    _set_log_scales(axes)
    axes.set_xticks(spacings, [f"{spacing:g}" for spacing in spacings])
    axes.minorticks_off()
    axes.set_xlim(spacings[0] / 1.6, spacings[-1] * 1.15)


def _set_log_scales(axes: Any) -> None:
    """Draw the grid of ``axes``, with a logarithmic scale in each direction in which any drawn value is positive."""
    axes.grid(alpha=0.25)
    for name, change in (("x", axes.set_xscale), ("y", axes.set_yscale)):
        if any(np.any(np.asarray(getattr(line, f"get_{name}data")()) > 0) for line in axes.lines):
            change("log")


def _add_legend(figure: Figure, columns: int) -> Figure:
    """Draw the legend of the first axes, in ``columns`` columns below the figure, and return the figure."""
    lines, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(lines, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=9, handlelength=4)
    return figure


@dataclass(frozen=True)
class Report:
    """The report of a study."""

    title: str  #: Title of the study.
    series: Sequence[Series]  #: Results of each method with each set of options.
    failed: int  #: Number of runs that ended with an error.
    files: Sequence[Path]  #: The page and its figures.

    @property
    def by_spacing(self) -> list[Series]:
        """The series over spacings; the others are over accuracy targets."""
        return [each for each in self.series if not each.target]

    @property
    def compares(self) -> bool:
        """True if errors are differences from the solution of another back end instead of a known solution."""
        return self.series[0].reference is not None

    @property
    def compares_costs(self) -> bool:
        """Whether there are several methods or an accuracy target, so that costs can be compared."""
        return any(each.target for each in self.series) or len({each.method for each in self.series}) > 1


def write_report(folder: Path, content: str | None = None) -> Report:
    """Write ``report.md`` and its PNG figures from the records in ``folder``, into it, and return the report.

    ``content`` is the content hash of the study file whose records are used, by default that of the last record.
    Raises InputError if records cannot be read, there is none with this hash, all runs failed, or a file cannot be
    written; MissingDependencyError without matplotlib.
    """
    every = read_records(folder / RECORDS_FILE)
    wanted = content or (every[-1]["content"] if every else None)
    records = [record for record in every if record["content"] == wanted]
    if not records:
        reason = f"{len(every)} records, none of the study file as it is now" if every else "no records"
        raise InputError(f"{folder / RECORDS_FILE} holds {reason}; run `cpmkit study run` first.")
    series = group_into_series(records)
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
    if report.compares_costs:
        figures["trade.png"] = pareto_figure(series, title)
    for name, figure in figures.items():
        with written_whole(folder / name) as file:
            figure.savefig(file, dpi=110)
    report = replace(report, files=[folder / "report.md", *(folder / name for name in figures)])
    with written_whole(folder / "report.md") as file:
        file.write_text(_report_page(report, records, list(figures), len(every) - len(records)), encoding="utf-8")
    return report


def _one_line(text: str) -> str:
    """Return text in one line, with control characters escaped, and bars as for a cell of a Markdown table."""
    return printable(" ".join(text.split())).replace("|", r"\|")


def pareto_tables(report: Report) -> str:
    """Return Markdown tables: the cheapest attempt for each decade of error, and the Pareto front of error and cost."""
    made = tables.attempts(report.series)
    return "\n\n".join([tables.cheapest_table(made), "Unbeaten in error and cost:", tables.pareto_table(made)])


def error_tables(reports: Sequence[Report]) -> str:
    """Return Markdown tables of errors by spacing: one for all reports with a reference, and one for each other."""
    compared = [(report.title, report.by_spacing) for report in reports if report.compares and report.by_spacing]
    parts = [tables.comparison_table(compared)] if compared else []
    for report in reports:
        if not report.compares:
            parts += [report.title] * (len(reports) > 1)
            parts += [tables.orders_table(report.by_spacing)] * bool(report.by_spacing)
    return "\n\n".join(parts)


def _report_page(report: Report, records: Sequence[Record], figures: Sequence[str], left_out: int) -> str:
    """Return the page in Markdown: errors, ``figures`` (files), costs, failures, and number of records ``left_out``."""
    errors_line = tables.differences_sentence(report.series) if report.compares else tables.error_sentence(records)
    parts = [f"# {report.title}", error_tables([report]), errors_line]
    parts += [f"![{report.title}]({figure})" for figure in figures]
    if report.compares_costs:
        parts += ["## Which buys which error for what", pareto_tables(report)]
    parts += ["## What it cost, with errors in the unit of u", tables.costs_table([(report.title, report.series)])]
    failed = [record for record in records if "error" in record]
    if failed:
        parts += [
            "## Runs that ended with an error",
            "\n".join(f"- {tables.run_name(run)}: {_one_line(run['error'])}" for run in failed),
        ]
    if left_out:
        parts.append(f"{left_out} records belong to the study file as it was before, and are left out.")
    return "\n\n".join(parts) + "\n"
