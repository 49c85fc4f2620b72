"""Scene files of applications: a surface and barriers and, in place of an equation, what the application is given."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from cpmkit.errors import InputError, SceneError
from cpmkit.files.toml_files import from_toml
from cpmkit.forms.accuracy_target import AccuracyTarget
from cpmkit.plugins import check_accepted
from cpmkit.runtime.declared import declared
from cpmkit.scene.scene import Scene
from cpmkit.scenefile.application_tables import read_colours, read_directions, read_map
from cpmkit.scenefile.condition_tables import as_table
from cpmkit.scenefile.reading import APPLICATION_TABLES, SceneFile, read_options, read_output, read_scene

#: Tables that all of them have.
SHARED_TABLES = ("surface", "boundary", "discretization", "solver", "output")
#: What reads the tables of an application; its arguments are these tables, the scene and the file's folder.
READERS: dict[str, Callable[[Mapping[str, Any], Scene, Path], dict[str, Any]]] = {
    "vectors": read_directions,
    "map": read_map,
    "paint": read_colours,
}


@dataclass(frozen=True, eq=False)
class ApplicationFile(SceneFile):
    """A manifold with barriers, what an application is given there, and how the file wants it made.

    Attributes
    ----------
    given : dict
        Keyword arguments of the application's function.
    """

    given: dict[str, Any] = field(default_factory=dict)


def load_application(path: str | Path, command: str) -> ApplicationFile:
    """Read a scene file of the application that ``cpmkit COMMAND`` makes.

    Raises
    ------
    SceneError
        If the file is missing, does not parse, or holds a key or value that is not accepted.
    PluginError
        If a kind is offered by no installed plugin.
    """
    like = f", such as one that `cpmkit examples` lists as applications/{command}-...toml"
    return from_toml(path, partial(_application_file, command), "scene file", like)


def _application_file(command: str, tables: dict[str, Any], path: Path) -> ApplicationFile:
    if "problem" in tables:
        raise SceneError(f"`cpmkit {command}` has its own equation; leave out [problem].")
    check_accepted("the scene", tables, (*SHARED_TABLES, *APPLICATION_TABLES[command]))
    if "surface" not in tables:
        raise SceneError("a scene needs the table [surface].")
    scene = read_scene({**tables, "problem": {"kind": "laplace"}}, path.parent)
    spacing, options = read_options(tables)
    target = next((name for name in declared(AccuracyTarget) if name in options), None)
    if target is not None and command != "paint":
        raise SceneError(
            f"`cpmkit {command}` takes a spacing and estimates no error; leave out {target} of [discretization]."
        )
    output = read_output(as_table(tables.get("output", {}), "[output]"), path)
    if output.wants_frames:
        raise SceneError(
            f"[output] asks for frames, and `cpmkit {command}` makes none; leave out films and .pvd files."
        )
    if output.wants_error and command != "paint":
        raise SceneError(f"`cpmkit {command}` makes no estimate of the error; leave out field of the picture.")
    if output.picture is not None and output.picture.vectors:
        raise SceneError(f"`cpmkit {command}` draws in its own way; leave out vectors of the picture.")
    try:
        given = READERS[command](tables, scene, path.parent)
    except InputError as error:
        raise error if isinstance(error, SceneError) else SceneError(str(error)) from error
    return ApplicationFile(scene, spacing, options, output, given)
