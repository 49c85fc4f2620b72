"""What can and cannot be resolved: errors and estimates as something gets small, by both forms.

Run ``python benchmarks/envelope.py``, which writes tables/envelope.md and docs/images/envelope.png, or with names
of families, of which it prints the table alone. ``--keep FILE`` keeps outcomes there, and what is there is not solved
again. It needs ``pip install . ./plugins/* matplotlib`` and this repository's
folder ``tests`` beside it. The scenes are those of tests/extremes/envelope_scenes.py.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

sys.path[:0] = [str(Path(__file__).parents[1] / "tests")]

from extremes.envelope_outcomes import FORMS, RESOLVED, Outcome, outcome  # noqa: E402
from extremes.envelope_scenes import FAMILIES, Family  # noqa: E402

from cpmkit.studies.tables import table_row, table_rule  # noqa: E402

HERE, DOCS = Path(__file__).parent, Path(__file__).parents[1] / "docs"


def rows(families: Sequence[Family], keep: Path | None) -> dict[tuple[str, str], list[Outcome]]:
    """Return the outcomes of all sizes, by the names of the family and the form."""
    kept = json.loads(keep.read_text(encoding="utf-8")) if keep and keep.exists() else {}
    for family in families:
        if family.name not in kept:
            scenes = [family.make(size) for size in family.sizes]
            kept[family.name] = {form: [astuple(outcome(known, form)) for known in scenes] for form in FORMS}
            print(family.name, kept[family.name], file=sys.stderr, flush=True)
        if keep:
            keep.write_text(json.dumps(kept), encoding="utf-8")
    return {
        (family.name, form): [Outcome(*one) for one in kept[family.name][form]] for family in families for form in FORMS
    }


def table(families: Sequence[Family], found: dict[tuple[str, str], list[Outcome]]) -> list[str]:
    """Return the lines of the table."""
    lines = [table_row(["what is small", "form", "errors in % at", "below 1 %"]), table_rule(4, 0)]
    for family in families:
        for form in FORMS:
            outcomes = found[family.name, form]
            sizes = [f"{size:g}: {one}" for size, one in zip(family.sizes, outcomes, strict=True)]
            kept = [size for size, one in zip(family.sizes, outcomes, strict=True) if one.error < RESOLVED]
            span = f"{min(kept):g} to {max(kept):g} {family.unit}" if kept else "none of these"
            lines.append(table_row([f"{family.name}, {family.unit}", form, ", ".join(sizes), span]))
    return lines


def draw(families: Sequence[Family], found: dict[tuple[str, str], list[Outcome]], path: Path) -> None:
    """Draw errors over sizes, one small chart a family."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, charts = plt.subplots(4, 4, figsize=(13, 10.5), constrained_layout=True)
    colours = dict(zip(FORMS, ("#0b5fa5", "#c8641c"), strict=True))
    for family, chart in zip(families, charts.flat, strict=True):
        for form in FORMS:
            outcomes = found[family.name, form]
            errors = [100 * one.error for one in outcomes]
            chart.loglog(family.sizes, errors, color=colours[form], lw=1, zorder=1)
            for size, one in zip(family.sizes, outcomes, strict=True):
                _mark(chart, size, one, colours[form])
        chart.axhline(100 * RESOLVED, color="0.6", lw=0.8, ls=":")
        chart.set_title(family.name, fontsize=10)
        chart.set_xlabel(family.unit, fontsize=8)
        chart.set_ylim(1e-4, 300)
        chart.set_xticks(family.sizes, labels=[f"{size:g}" for size in family.sizes])
        chart.xaxis.set_minor_locator(plt.NullLocator())
        chart.tick_params(labelsize=8)
    for chart in charts[:, 0]:
        chart.set_ylabel("error, % of the range", fontsize=8)
    _legend(figure, plt, colours)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _mark(chart: Any, size: float, one: Outcome, colour: str) -> None:
    if one.state == "refused":
        chart.plot(size, 150, marker="x", color=colour, ls="", clip_on=False)
        return
    face = "white" if one.state == "warned" else colour
    chart.plot(size, 100 * one.error, marker="o", ms=5, color=colour, mfc=face, ls="")
    if one.state == "silent":
        chart.plot(size, 100 * one.error, marker="o", ms=11, color="red", mfc="none", ls="")


def _legend(figure: Any, plt: Any, colours: dict[str, str]) -> None:
    def line(label: str, **look: Any) -> Any:
        return plt.Line2D([], [], label=label, **look)

    handles = [line(form, color=colour) for form, colour in colours.items()]
    handles += [
        line("covered by the estimate", marker="o", color="k", ls=""),
        line("warned of", marker="o", color="k", mfc="white", ls=""),
        line("refused", marker="x", color="k", ls=""),
        line("neither", marker="o", ms=11, color="red", mfc="none", ls=""),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=6, fontsize=9, frameon=False)


def main(arguments: Sequence[str]) -> None:
    """Solve all families, or those that are named; all of them are also written."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="of families; all if left out")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="where outcomes are kept, and found again")
    given = parser.parse_args(arguments)
    families = [family for family in FAMILIES if not given.names or family.name in given.names]
    found = rows(families, given.keep)
    lines = "\n".join(table(families, found)) + "\n"
    print(lines, end="")
    if not given.names:
        (HERE / "tables" / "envelope.md").write_text(lines, encoding="utf-8")
        draw(families, found, DOCS / "images" / "envelope.png")


if __name__ == "__main__":
    main(sys.argv[1:])
