"""Figures of a study: error against spacing with fitted orders, and error against cost."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.studies.records import Series
from cpmkit.studies.tables import COSTS, attempts, front

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Okabe and Ito's colours for the colour-blind, without the yellow, which is too light for lines.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
STYLES = ("-", "--", "-.", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (3, 1)))
GREY = "#777777"


def convergence_figure(series: Sequence[Series], title: str) -> Figure:
    """Return a figure of error against spacing, log-log, with fitted orders in the legend and slopes 1 and 2 dotted."""
    figure, (axes,) = _figure(title, 1)
    _draw_slopes(axes, series)
    for number, each in enumerate(series):
        order = each.fitted_order
        fitted = "" if order is None else f" (fitted order {order:.2f})"
        _plot_series(axes, number, each.spacings, each.errors, each.label + fitted)
    axes.set(xlabel="spacing", ylabel="greatest error")
    _spacing_ticks(axes, series)
    return _with_legend(figure, columns=1)


def difference_figure(series: Sequence[Series], title: str) -> Figure:
    """Return a figure of rms differences from a reference against spacing, log-log.

    The left axes show the differences with their mean, the right axes without it.
    """
    figure, pair = _figure(title, 2)
    shown = {"rms_error": "mean kept", "rms_without_mean": "mean removed"}
    for axes, (quantity, name) in zip(pair, shown.items(), strict=True):
        for number, each in enumerate(series):
            _plot_series(axes, number, each.spacings, [entry.percent(quantity) for entry in each.entries], each.label)
        axes.set(xlabel="spacing", title=name)
        _spacing_ticks(axes, series)
    pair[0].set_ylabel(_escape_dollars(f"rms difference from {series[0].reference}, % of half the range"))
    return _with_legend(figure, columns=3)


def work_figure(series: Sequence[Series], title: str) -> Figure:
    """Return a figure of error against CPU seconds and against unknowns, log-log, side by side."""
    from matplotlib.ticker import NullFormatter

    figure, pair = _figure(title, 2)
    for axes, quantity in zip(pair, ("cpu_seconds", "unknowns"), strict=True):
        for number, each in enumerate(series):
            _plot_series(axes, number, [getattr(entry, quantity) for entry in each.entries], each.errors, each.label)
        axes.set(xlabel={"cpu_seconds": "CPU seconds"}.get(quantity, quantity))
        _log_scales(axes)
        axes.xaxis.set_minor_formatter(NullFormatter())
    pair[0].set_ylabel("greatest error")
    return _with_legend(figure, columns=3)


def trade_figure(series: Sequence[Series], title: str) -> Figure:
    """Return a figure of rms error against CPU seconds and against memory, log-log, with the Pareto fronts in grey."""
    made = attempts(series)
    fronts = {cost: front(made, cost) for cost in COSTS if front(made, cost)}
    figure, all_axes = _figure(title, len(fronts))
    for axes, (cost, best) in zip(all_axes, fronts.items(), strict=True):
        x, y = [each.cost(cost) for each in best], [each.error for each in best]
        axes.plot(x, y, color=GREY, linewidth=7, alpha=0.3, solid_capstyle="round", label="unbeaten")
        for number, each in enumerate(series):
            own = attempts([each])
            _plot_series(axes, number, [one.cost(cost) for one in own], [one.error for one in own], each.label)
        axes.set(xlabel=COSTS[cost])
        _log_scales(axes)
    all_axes[0].set_ylabel("rms error, share of the range")
    return _with_legend(figure, columns=2)


def _figure(title: str, count: int) -> tuple[Figure, Any]:
    """Return a figure with a title in lines of 68 characters for each of ``count`` axes side by side, and the axes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 5.4) if count == 1 else (5 * count, 4.8), layout="constrained")
    figure.suptitle(_escape_dollars(fill(title, 68 * count)), fontsize=11 if count == 1 else "large")
    return figure, figure.subplots(1, count, sharey=True, squeeze=False)[0]


def _escape_dollars(text: str) -> str:
    """Return text with escaped dollar signs, which matplotlib would read as the start of a formula."""
    return text.replace("$", r"\$")


def _plot_series(axes: Any, number: int, x: Sequence[float], y: Sequence[float], label: str) -> None:
    """Plot ``y`` over ``x`` in the colour, line style and marker of series ``number``."""
    axes.plot(
        x,
        y,
        color=COLOURS[number % len(COLOURS)],
        linestyle=STYLES[number % len(STYLES)],
        marker="os^DvPX"[number % 7],
        label=_escape_dollars(label),
    )


def _draw_slopes(axes: Any, series: Sequence[Series]) -> None:
    """Draw dotted lines of slopes 1 and 2 that end at the geometric mean of the errors at the coarsest spacings."""
    spacings = np.array(sorted({spacing for one in series for spacing in one.spacings}))
    coarsest = [one.errors[0] for one in series if one.errors[0] > 0]
    if len(spacings) == 1 or not coarsest:
        return
    start = np.exp(np.mean(np.log(coarsest)))
    for slope in (1, 2):
        errors = start * (spacings / spacings[-1]) ** slope
        axes.plot(spacings, errors, color=GREY, linestyle=":", linewidth=1.2)
        axes.annotate(
            f"slope {slope}", (spacings[0], errors[0]), (-4, 0), textcoords="offset points", color=GREY, ha="right",
            va="center", fontsize=9,
        )  # fmt: skip


def _spacing_ticks(axes: Any, series: Sequence[Series]) -> None:
    """Use logarithmic scales, with a tick at each spacing of the series and no minor ticks."""
    spacings = sorted({spacing for one in series for spacing in one.spacings})
    _log_scales(axes)
    axes.set_xticks(spacings, [f"{spacing:g}" for spacing in spacings])
    axes.minorticks_off()
    axes.set_xlim(spacings[0] / 1.6, spacings[-1] * 1.15)


def _log_scales(axes: Any) -> None:
    """Use a logarithmic scale in each direction in which lines have positive values, and draw the grid."""
    axes.grid(alpha=0.25)
    for name, change in (("x", axes.set_xscale), ("y", axes.set_yscale)):
        if any(np.any(np.asarray(getattr(line, f"get_{name}data")()) > 0) for line in axes.lines):
            change("log")


def _with_legend(figure: Figure, columns: int) -> Figure:
    """Draw the legend of the first axes, in ``columns`` columns below the figure, and return the figure."""
    lines, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(lines, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=9, handlelength=4)
    return figure
