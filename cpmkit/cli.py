"""The command ``cpmkit``; each subcommand imports the modules that it needs when it runs."""

from __future__ import annotations

import io
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from cpmkit.commands import group
from cpmkit.commands.applications import distance, map_to_target, paint, vectors
from cpmkit.commands.study import study


@click.command()
@click.argument("name", metavar="NAME")
@group.traceback_option
def new(name: str) -> None:
    """Write a first scene, NAME.toml, to run and to change.

    It is an error if the file exists; it is then left alone.
    """
    from cpmkit.scenefile.examples import write_first_scene

    file = write_first_scene(name)
    click.echo(f"written    {file}; `cpmkit solve {file}` solves it")


@click.command()
@click.option(
    "--to",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="FOLDER",
    help="Copy all of them, with the curves that they name, to a new folder.",
)
@group.traceback_option
def examples(to: Path | None) -> None:
    """List the examples, scenes, those of applications and studies, or copy them to a folder."""
    from cpmkit.scenefile.examples import copy_examples, example_files, example_title

    if to is not None:
        click.echo(f"written    {copy_examples(to)}")
        return
    for name, file in example_files().items():
        click.echo(f"{name:<40}{example_title(file)}")


@click.command()
@click.argument("sort", type=click.Choice(["scene", "study", "vectors", "map", "paint"]), metavar="SORT")
@group.traceback_option
def schema(sort: str) -> None:
    """Print the JSON schema of files, with the kinds that are installed: SORT is scene, study, vectors, map or paint.

    Editors complete and check TOML by it: write it to a file, and begin a scene with the line `#:schema ./FILE`.
    """
    if sort == "study":
        from cpmkit.studies.studyfile import study_schema

        made = study_schema()
    else:
        from cpmkit.scenefile.kinds import scene_schema

        made = scene_schema(None if sort == "scene" else sort)
    click.echo(json.dumps(made, indent=1))


@click.group(cls=group.CommandGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="cpmkit")
@group.traceback_option
def main() -> None:
    """Solve PDEs on curves, surfaces and solids that are known by their closest points.

    A scene is a TOML file: a surface, boundaries inside it with conditions on each side, an equation
    and a grid spacing. Start with `cpmkit explain SCENE.toml`, which says what would be built and at
    what cost, then `cpmkit solve SCENE.toml`.

    Exit codes: 0 done; 1 the scene or its solution failed; 2 the command line is wrong; 3 a bug in cpmkit or
    in a plugin; 130 interrupted.
    """
    for stream in (sys.stdout, sys.stderr):  # names may have characters that the terminal's encoding lacks
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


@main.command()
@group.scene_argument
@group.spacing_option
@group.accuracy_options
@click.option(
    "--backend",
    default="cpm",
    metavar="NAME",
    help="The method: cpm, the closest point method, or a back end of a plugin, such as fem. Of the file's "
    "[discretization] and [solver], another back end takes the spacing and the tolerance, fem the degree too.",
)
@click.option("--degree", type=int, metavar="NUMBER", help="Degree of the polynomials; overrides the file's.")
@group.output_option
@click.option(
    "--checkpoint",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="For a problem in time: an .npz file in which the state of the run is saved every 100 steps.",
)
@click.option(
    "--resume",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Continue from the checkpoint of an earlier run of the same scene.",
)
@click.option(
    "--field",
    type=click.Choice(["solution", "error"]),
    help="What the picture of the file shows: the solution, or its estimated error; overrides the file's.",
)
@group.look_option
@group.json_option
@click.option(
    "--quiet", is_flag=True, help="Show neither progress nor a summary; warnings and errors go to standard error."
)
@group.traceback_option
def solve(
    scene: Path,
    spacing: float | None,
    estimate: bool | None,
    backend: str,
    degree: int | None,
    output: Path | None,
    checkpoint: Path | None,
    resume: Path | None,
    field: str | None,
    look: tuple[str, ...],
    as_json: bool,
    quiet: bool,
    **target: Any,
) -> None:
    """Solve a scene and write the files of its [output]: solutions, a picture, a summary.

    The output folder is created once the scene is solved, so that a scene that fails leaves no files. Existing files of
    the same names are replaced, each by a whole file.
    """
    from cpmkit import load_scene
    from cpmkit import solve as solve_scene
    from cpmkit.runtime.messages import collected_warnings
    from cpmkit.saving.results import check_request, solution_channels, write_results
    from cpmkit.solving import backend_independent_options

    with collected_warnings() as issued, group.progress_callback(scene, quiet) as progress:
        try:
            loaded = load_scene(scene)
            folder, request = output or loaded.output.folder, group.edit_look(loaded.output, field, look, estimate)
            check_request(request, loaded.scene.surface, folder, solution_channels(loaded.scene))
            spacing, options = group.spacing_and_options(loaded, spacing, **target, degree=degree)
            if backend != "cpm":
                options = {"backend": backend, **backend_independent_options(options, backend)}
            options |= {key: file for key, file in (("checkpoint", checkpoint), ("resume", resume)) if file}
            solution = solve_scene(loaded.scene, spacing=spacing, progress=progress, **options)
            solution = group.add_estimate(solution, estimate, request.wants_error)
        except Exception:
            group.print_warnings(issued, err=True)
            raise
        warnings = list(dict.fromkeys([*issued, *solution.warnings]))
        written = write_results(solution, request, folder, progress, warnings)
    work, report = solution.work, solution.report
    ghosts = f", of which ghosts {work.ghosts:,}" if hasattr(work, "ghosts") else ""
    form = written.summary.get("discretization", {}).get("form")  # back ends of plugins have none
    head = [
        *([f"form       {form}"] if form else []),
        f"unknowns   {work.unknowns:,}{ghosts}",
        f"solver     {report.solver}: {report.reason}",
    ]
    modes = written.summary.get("eigenvalues", [])
    lines = [f"eigenvalues {', '.join(f'{value:.6g}' for value in modes)}"] if modes else []
    group.print_outcome(solution, written.summary, warnings, head, lines, as_json, quiet)
    written.check()


@main.command()
@group.scene_argument
@group.spacing_option
@click.option("--dry-run", is_flag=True, help="Count on coarse grids, and look for causes of errors.")
@click.option("--rehearse", is_flag=True, hidden=True)  # the name of --dry-run before
@click.option("--seconds", is_flag=True, help="Also solve on two coarse grids, and predict the seconds of a solve.")
@group.json_option
@group.traceback_option
def explain(scene: Path, spacing: float | None, dry_run: bool, rehearse: bool, seconds: bool, as_json: bool) -> None:
    """Show the discretisation of a scene and its cost without solving: an estimate in a second, or counts by a dry run.

    Nothing is written, and nothing is solved unless --seconds is given.
    """
    from cpmkit import explain as explain_scene
    from cpmkit import load_scene
    from cpmkit.runtime.messages import collected_warnings

    if rehearse:
        click.echo("--rehearse is now called --dry-run; the old name goes with the next release.", err=True)
    with collected_warnings() as issued, group.progress_callback(scene) as progress:
        try:
            loaded = load_scene(scene)
            spacing, options = group.spacing_and_options(loaded, spacing or loaded.spacing)
            options |= {"dry_run": dry_run or rehearse, "seconds": seconds}
            explanation = explain_scene(loaded.scene, spacing=spacing, progress=progress, **options)
        except Exception:
            group.print_warnings(issued, err=True)
            raise
    click.echo(json.dumps(explanation.as_dict(), indent=2) if as_json else str(explanation))
    group.print_warnings(issued, err=as_json)


@main.command()
@click.argument("kind", required=False)
@group.json_option
@group.traceback_option
def plugins(kind: str | None, as_json: bool) -> None:
    """List the kinds that scenes can name, or the keys of one KIND or family of kinds.

    Names are read from the metadata of installed distributions without importing plugins. For a KIND, such as
    `analytic.torus`, `analytic` or `heat`, its keys, their types, defaults and meaning are listed.
    """
    if kind is not None:
        from cpmkit.scenefile.kinds import kinds as documented

        target = documented(kind)
        text = json.dumps([asdict(documented_kind) for documented_kind in target], indent=2, default=str)
        click.echo(text if as_json else "\n\n".join(map(str, target)))
        return

    from cpmkit.plugins import installed_kinds
    from cpmkit.runtime.messages import install_command

    kinds = installed_kinds()
    if as_json:
        click.echo(json.dumps([asdict(installed) for installed in kinds], indent=2))
        return
    if not kinds:
        click.echo(f"No plugin is installed; {install_command('all')} adds them.")
    width = max((len(installed.kind) for installed in kinds), default=0) + 2
    for installed in kinds:
        click.echo(f"{installed.kind:<{width}}{installed.distribution} {installed.version}")


@main.command()
@click.argument("scene", required=False, type=click.Path(path_type=Path), metavar="[SCENE.toml]")
@group.json_option
@group.traceback_option
@click.pass_context
def doctor(ctx: click.Context, scene: Path | None, as_json: bool) -> None:
    """Report what is installed, whether pictures can be drawn, and whether a scene loads.

    The first thing to send along with a question. Exits with 1 if the scene does not load.
    """
    from cpmkit.commands.doctor import diagnose

    diagnosis = diagnose(scene)
    click.echo(json.dumps(asdict(diagnosis), indent=2) if as_json else str(diagnosis))
    if diagnosis.scene:
        ctx.exit(1)


for command in (study, distance, vectors, map_to_target, paint, new, examples, schema):
    main.add_command(command)
