"""From the records of a study to a page with tables and figures, written beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cpmkit.errors import InputError
from cpmkit.files import written_whole
from cpmkit.studies.figures import convergence_figure, work_figure
from cpmkit.studies.records import FILE, of_content, read_records
from cpmkit.studies.series import Series, gather
from cpmkit.studies.tables import page

PAGE, CONVERGENCE, WORK = "report.md", "convergence.png", "work.png"
DOTS_PER_INCH = 110


@dataclass(frozen=True)
class Report:
    """What a report says and where it is.

    Attributes
    ----------
    series : sequence of Series
        Methods, degrees and orders.
    failed : int
        Runs that ended with an error.
    files : sequence of Path
        The page and its figures.
    """

    series: Sequence[Series]
    failed: int
    files: Sequence[Path]


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
    every = read_records(folder / FILE)
    records = of_content(every, content or every[-1]["content"]) if every else []
    if not records:
        reason = f"{len(every)} records, none of the study file as it is now" if every else "no records"
        raise InputError(f"{folder / FILE} holds {reason}; run `cpmkit study run` first.")
    series = gather(records)
    if not series:
        raise InputError(f"all {len(records)} runs of {folder / FILE} ended with errors, first {records[0]['error']!r}")
    figures = {CONVERGENCE: convergence_figure(series, records[0]["title"])}
    if len({(one.method, one.degree) for one in series}) > 1:
        figures[WORK] = work_figure(series, records[0]["title"])
    for name, figure in figures.items():
        with written_whole(folder / name) as file:
            figure.savefig(file, dpi=DOTS_PER_INCH)
    with written_whole(folder / PAGE) as file:
        file.write_text(page(records, series, list(figures), len(every) - len(records)), encoding="utf-8")
    failed = sum("error" in record for record in records)
    return Report(series, failed, [folder / PAGE, *(folder / name for name in figures)])
