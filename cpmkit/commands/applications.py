"""The commands ``cpmkit vectors``, ``map``, ``paint`` and ``distance``; solvers are imported when a command runs."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cpmkit.commands import group

if TYPE_CHECKING:
    from cpmkit.facade import Solution
    from cpmkit.scene.scene import Scene
    from cpmkit.types import Floats

#: The scene as argument and the options that all commands of applications have.
application_options = group.add_options(
    group.scene_argument,
    group.spacing_option,
    group.output_option,
    group.look_option,
    group.json_option,
    click.option("--quiet", is_flag=True, help="Show neither progress nor a summary; warnings are still shown."),
    group.traceback_option,
)


@dataclass(frozen=True, eq=False)
class ApplicationResult:
    """The result of an application, as a command prints and writes it."""

    solution: Solution  #: The solution that is saved.
    picture: Solution | None = None  #: The solution that the picture shows, if it is another.
    values: dict[str, Any] = field(default_factory=dict)  #: Plain values for JSON, beside the summary of the solution.
    lines: list[str] = field(default_factory=list)  #: The same values as printed lines.
    tables: dict[str, Floats] = field(default_factory=dict)  #: Names of further .csv files, and their rows.


def run_application(
    command: str,
    solve: Callable[[dict[str, Any], bool], ApplicationResult],
    *,
    scene: Path,
    spacing: float | None,
    output: Path | None,
    look: tuple[str, ...],
    as_json: bool,
    quiet: bool,
    **accuracy: Any,
) -> None:
    """Read the scene, run the application, write the files of [output], and print a summary.

    ``command``: the name of the command, which determines how the scene file is read.
    ``solve``, callable: takes the keyword arguments of the application's function, with ``surface``, ``spacing`` and
        ``progress``, and whether the picture shows the error.
    ``**accuracy``: accuracy target in place of a spacing. The other arguments are the options of the command.
    """
    import numpy as np

    from cpmkit.files.whole_files import written_whole
    from cpmkit.runtime.messages import collected_warnings
    from cpmkit.saving.results import check_request, write_results
    from cpmkit.scenefile.application_files import load_application
    from cpmkit.scenefile.scene_files import load_scene

    with collected_warnings() as issued, group.progress_callback(scene, quiet) as progress:
        begun = time.perf_counter()
        try:
            loaded: Any = load_scene(scene) if command == "distance" else load_application(scene, command)
            folder, request = output or loaded.output.folder, group.edit_look(loaded.output, None, look, None)
            check_request(request, loaded.scene.surface, folder, 1 if command == "distance" else None)
            decided, options = group.spacing_and_options(loaded, spacing, **accuracy)
            options |= {"surface": loaded.scene, "spacing": decided, "progress": progress}
            result = solve(options | getattr(loaded, "arguments", {}), request.wants_error)
        except Exception:
            group.print_warnings(issued, err=True)
            raise
        solution = replace(result.solution, seconds={"make": time.perf_counter() - begun})  # of all its solves
        warnings = list(dict.fromkeys([*issued, *solution.warnings]))
        written = write_results(solution, request, folder, progress, warnings, result.picture)
    lines = list(result.lines)
    for name, rows in result.tables.items():
        with written_whole(folder / name) as unfinished:
            np.savetxt(unfinished, rows, delimiter=",")
        lines.append(f"written    {folder / name}")
    head = [f"unknowns   {solution.discretized.size:,} at spacing {solution.spacing:.4g}"]
    group.print_outcome(solution, written.summary | result.values, warnings, head, lines, as_json, quiet)
    written.check()


@click.command("map")
@application_options
def map_to_target(**keys: Any) -> None:
    """Relax a map from a scene's surface to its [target] to least stretch, and write the files of [output].

    Each [[landmark]] fixes the image of a point or of a curve; [map] holds the initial map and the criterion of rest.
    Files hold the coordinates of the images; the picture shows the target's colours, or the texture of [map],
    on the surface.
    """
    run_application("map", _solve_map, **keys)


def _solve_map(arguments: dict[str, Any], _wants_error: bool) -> ApplicationResult:
    """Return the harmonic map of ``arguments``, with its energies and degree (None if undefined).

    A ``texture`` among the arguments, which is removed there, is drawn in the picture.
    """
    from cpmkit.applications import harmonic_map
    from cpmkit.errors import CpmkitError

    texture = arguments.pop("texture", None)
    result = harmonic_map(**arguments)
    try:
        degree = result.degree
    except CpmkitError:  # only closed surfaces have a degree
        degree = None
    lines = [
        f"energy     {result.energy[0]:.6g} at first, {result.energy[-1]:.6g} after {len(result.energy) - 1} steps, "
        f"{'at' if result.at_rest else 'not at'} rest",
        *([] if degree is None else [f"degree     {degree}"]),
    ]
    values = {"energy": result.energy.tolist(), "at_rest": result.at_rest, "degree": degree}
    return ApplicationResult(result.solution, result.drawable(texture), values, lines)


@click.command()
@application_options
@group.accuracy_options
def paint(estimate: bool | None, **keys: Any) -> None:
    """Diffuse the colours of a scene's curves over its surface, and write the files of [output].

    Each [[curve]] has a colour on each side, or several along it. The conditions of the scene's boundaries and edge are
    kept.
    """

    def solve(arguments: dict[str, Any], _wants_error: bool) -> ApplicationResult:
        from cpmkit.applications import diffusion_curves

        return ApplicationResult(group.add_estimate(diffusion_curves(**arguments).solution, estimate))

    run_application("paint", solve, **keys)


@click.command()
@application_options
def vectors(**keys: Any) -> None:
    """Extend directions over a scene's surface by parallel transport, and write the files of [output].

    Each [[direction]] of the scene gives a direction at a point or along a curve. Its boundaries are barriers. The
    singularities of the field are printed with their indices, on surfaces that have triangles.
    """
    run_application("vectors", _solve_vectors, **keys)


def _solve_vectors(arguments: dict[str, Any], _wants_error: bool) -> ApplicationResult:
    """Return the field ``vector_field(**arguments)``, with its singularities if the surface has triangles."""
    from cpmkit.applications import vector_field
    from cpmkit.errors import CpmkitError

    field = vector_field(**arguments)
    try:
        places = [{"index": point.index, "place": point.place.tolist()} for point in field.singularities]
    except CpmkitError:  # no triangles
        return ApplicationResult(field.solution, field.drawable())
    lines = [
        *(f"index      {point['index']:+d} at ({', '.join(f'{x:.3g}' for x in point['place'])})" for point in places),
        f"indices    {sum(point['index'] for point in places):+d} in all",
    ]
    return ApplicationResult(field.solution, field.drawable(), {"singularities": places}, lines)


@click.command()
@application_options
@click.option(
    "--from",
    "origins",
    multiple=True,
    required=True,
    metavar="X,Y,Z|NAME|NUMBER",
    help="An origin of the distance: a point, a boundary's name, or a mesh's vertex; may be given several times.",
)
@click.option("--signed", is_flag=True, help="Signed distance to curves, positive to the left of their direction.")
@click.option("--method", type=click.Choice(["transport", "heat"]), default="transport", show_default=True)
@click.option(
    "--tolerance",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    metavar="SHARE",
    help="In place of a spacing: the accepted error, as a share of the largest distance.",
)
@click.option(
    "--path-from",
    "starts",
    multiple=True,
    metavar="X,Y,Z",
    help="Also write the shortest path from this point, as path-1.csv; may be given several times.",
)
def distance(origins: tuple[str, ...], signed: bool, method: str, starts: tuple[str, ...], **keys: Any) -> None:
    """Compute geodesic distances on a scene's surface, and write the files of [output].

    Boundaries that are not named with --from are barriers, and must have the condition neumann = 0. The scene's
    equation is not used.
    """
    from cpmkit.errors import InputError

    if signed and starts:
        raise InputError("paths lead to the origins of a distance without a sign; leave out --signed or --path-from.")
    run_application("distance", partial(_solve_distance, origins, signed, method, starts), **keys)


def _solve_distance(
    origins: tuple[str, ...],
    signed: bool,
    method: str,
    starts: tuple[str, ...],
    arguments: dict[str, Any],
    wants_error: bool,
) -> ApplicationResult:
    """Return the distance from ``origins`` (names or "x,y,z"), and shortest paths from ``starts`` ("x,y,z").

    ``signed`` and ``method`` choose the function and its method; ``arguments`` are its other keywords, with the scene
    as ``surface``. ``wants_error`` adds the error estimate. Raises InputError if an unsigned distance is infinite.
    """
    import numpy as np

    from cpmkit.applications import geodesic_distance, signed_distance
    from cpmkit.errors import InputError

    others = {name: value for name, value in arguments.items() if name not in ("surface", "progress", "estimate")}
    barriers, sources = _split_origins(arguments["surface"], origins)
    arguments["progress"]("distance", 0.0)
    measured: Any = (signed_distance if signed else geodesic_distance)(barriers, sources, method=method, **others)
    if not signed and not measured.reached.all():  # files hold no infinite distances
        raise InputError(
            f"{np.count_nonzero(~measured.reached)} of {len(measured.reached)} pieces of the surface have no "
            "origin; give each an origin, or leave the piece out."
        )
    solution = replace(measured.solution, estimated=measured.error) if wants_error else measured.solution
    paths = measured.path(np.array([_parse_point(text, barriers.surface.dim) for text in starts])) if starts else []
    lengths = [np.linalg.norm(np.diff(path, axis=0), axis=1).sum() for path in paths]
    lines = [f"path       {length:.6g} long, from {start}" for start, length in zip(starts, lengths, strict=True)]
    tables = {f"path-{number}.csv": path for number, path in enumerate(paths, start=1)}
    return ApplicationResult(solution, lines=lines, tables=tables)


def _split_origins(scene: Scene, origins: tuple[str, ...]) -> tuple[Scene, list[Any]]:
    """Return the scene with only the boundaries that are no origins, its barriers, and the origins.

    ``origins`` are texts: names of boundaries, numbers of vertices, or coordinates. The result is a list of sources of
    boundaries, numbers, and an array (k, d) of points. The equation is replaced by -Lap u = 0.
    """
    import numpy as np

    from cpmkit.scene.equations import Poisson
    from cpmkit.scene.scene import Scene

    boundaries = {boundary.name: boundary for boundary in scene.boundaries}
    others = [text for text in origins if text not in boundaries]
    points = [_parse_point(text, scene.surface.dim) for text in others if not text.isdecimal()]
    curves = [boundaries[name].source for name in origins if name in boundaries]
    numbers = [int(text) for text in others if text.isdecimal()]
    barriers = [boundary for name, boundary in boundaries.items() if name not in origins]
    sources = [*curves, *numbers, *([np.array(points)] if points else [])]
    return Scene(scene.surface, Poisson(0.0), barriers, scene.edge), sources


def _parse_point(text: str, dim: int) -> list[float]:
    """Return the ``dim`` coordinates in a text such as ``0,0,1``; raise InputError for other texts."""
    from cpmkit.errors import InputError

    try:
        coordinates = [float(number) for number in text.split(",")]
    except ValueError:
        coordinates = []
    if len(coordinates) != dim:
        raise InputError(
            f"a point is given by {dim} numbers such as {','.join('0' * dim)}, a name or a vertex number, got {text!r}."
        )
    return coordinates
