"""Commands for a first hour: a scene to begin with, the examples, and schemas by which editors complete files."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import click

from cpmkit.commands.group import traceback_option


@click.command()
@click.argument("name", metavar="NAME")
@traceback_option
def new(name: str) -> None:
    """Write a first scene, NAME.toml, to run and to change.

    A file that is there already is left alone.
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
@traceback_option
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
@traceback_option
def schema(sort: str) -> None:
    """Print the JSON schema of files, with the kinds that are installed: SORT is scene, study, vectors, map or paint.

    Editors complete and check TOML by it: write it to a file, and begin a scene with the line `#:schema ./FILE`.
    """
    if sort == "scene":
        from cpmkit.scenefile.kinds import scene_schema as make
    elif sort == "study":
        from cpmkit.studies.studyfile import study_schema as make
    else:
        from cpmkit.scenefile.kinds import application_schema

        make = partial(application_schema, sort)
    click.echo(json.dumps(make(), indent=1))
