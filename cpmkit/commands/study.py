"""The commands ``cpmkit study run`` and ``cpmkit study report``; solvers are imported when a command runs."""

from __future__ import annotations

from pathlib import Path

import click

from cpmkit.commands.group import progress_callback, traceback_option


@click.group()
def study() -> None:
    """Run a convergence study, and turn its records into tables and figures.

    A study is a TOML file: a scene whose solution is known, or solved by other means, and what is varied.
    """


@study.command("run")
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="STUDY.toml")
@click.option(
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="FOLDER",
    help="Where records go; the name of the study in the working directory if left out.",
)
@click.option("--cheap", is_flag=True, help="Only the study's cheap spacings.")
@click.option(
    "--spacing",
    "spacings",
    type=float,
    multiple=True,
    metavar="H",
    help="Only this one of the study's spacings; may be given several times.",
)
@click.option("--quiet", is_flag=True, help="Show neither progress nor results; errors are still shown.")
@traceback_option
def run_study(file: Path, output: Path | None, cheap: bool, spacings: tuple[float, ...], quiet: bool) -> None:
    """Make the runs of a study that are not recorded yet.

    One line is recorded for each run as soon as it is made, so a study that is stopped goes on where it was.
    """
    from cpmkit.studies.run_one import run_study as run
    from cpmkit.studies.studyfile import load_study
    from cpmkit.studies.tables import run_sentence

    folder = output or Path(file.stem)
    with progress_callback(file, quiet) as progress:
        recorded = None if quiet else lambda record: click.echo(run_sentence(record), err=True)
        outcome = run(load_study(file), folder, cheap=cheap, spacings=spacings, progress=progress, recorded=recorded)
    if not quiet:
        click.echo(f"runs       {outcome.made} made, {outcome.failed} with errors, {outcome.skipped} recorded before")
        click.echo(f"written    {outcome.file}")


@study.command("report")
@click.argument(
    "studies", type=click.Path(exists=True, path_type=Path), nargs=-1, required=True, metavar="STUDY.toml|FOLDER..."
)
@click.option(
    "--table",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE.md",
    help="Also write the table that is printed to this file.",
)
@click.option(
    "--costs",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE.md",
    help="Also write one table of errors and costs, method below method, to this file.",
)
@traceback_option
def report_study(studies: tuple[Path, ...], table: Path | None, costs: Path | None) -> None:
    """Turn the records of studies into pages of tables and figures.

    Given a study file, the records are looked for in the folder of its name in the working directory. The page
    report.md and the figures are written beside them. Studies with a reference share one printed table.
    """
    from cpmkit.files.whole_files import written_whole
    from cpmkit.studies.report import error_tables, pareto_tables, write_report
    from cpmkit.studies.studyfile import load_study
    from cpmkit.studies.tables import costs_table

    reports = [
        write_report(study) if study.is_dir() else write_report(Path(study.stem), load_study(study).content)
        for study in studies
    ]
    text = error_tables(reports)
    click.echo(text)
    for report in reports:
        if report.compares_costs:
            click.echo(f"\n**{report.title}**\n\n{pareto_tables(report)}")
    target = {table: text, costs: costs_table([(report.title, report.series) for report in reports])}
    pages = {page: content for page, content in target.items() if page is not None}
    for page, content in pages.items():
        with written_whole(page) as file:
            file.write_text(content + "\n", encoding="utf-8")
    for report in reports:
        if report.failed:
            click.echo(f"\n{report.failed} runs ended with errors, which {report.files[0]} shows.")
    for written in [*(file for report in reports for file in report.files), *pages]:
        click.echo(f"written    {written}")
