"""The command ``cpmkit distance``; solvers are imported when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cpmkit.commands.group import progress_callback, traceback_option
from cpmkit.commands.options import how_fine, scene_argument, spacing_option

if TYPE_CHECKING:
    from cpmkit.scene.scene import Scene


@click.command()
@scene_argument
@click.option(
    "--from",
    "origins",
    multiple=True,
    required=True,
    metavar="X,Y,Z|NAME",
    help="An origin of the distance: a point, or the name of a boundary; may be given several times.",
)
@click.option("--signed", is_flag=True, help="Signed distance to curves, positive to the left of their direction.")
@click.option("--method", type=click.Choice(["transport", "heat"]), default="transport", show_default=True)
@spacing_option
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
@click.option(
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="FOLDER",
    help="Where results go; overrides the file's folder.",
)
@traceback_option
def distance(
    scene: Path,
    origins: tuple[str, ...],
    signed: bool,
    method: str,
    spacing: float | None,
    tolerance: float | None,
    starts: tuple[str, ...],
    output: Path | None,
) -> None:
    """Compute geodesic distances on a scene's surface, and write the files of [output].

    Boundaries that are not named with --from are barriers, and have the condition neumann = 0. The scene's equation is
    not used.
    """
    from dataclasses import replace

    import numpy as np

    from cpmkit import load_scene
    from cpmkit.applications import geodesic_distance, signed_distance
    from cpmkit.errors import InputError
    from cpmkit.files.whole_files import written_whole
    from cpmkit.runtime.messages import collected_warnings
    from cpmkit.saving.results import check_request, write_results

    if signed and starts:
        raise InputError("paths lead to the origins of a distance without a sign; leave out --signed or --path-from.")
    with collected_warnings() as issued, progress_callback(scene) as progress:
        loaded = load_scene(scene)
        folder = output or loaded.output.folder
        check_request(loaded.output, loaded.scene.surface, folder, channels=1)
        decided, options = how_fine(loaded, spacing, tolerance=tolerance)
        options.pop("estimate", None)
        barriers, sources = _split_origins(loaded.scene, origins)
        progress("distance", 0.0)
        if signed:
            measured: Any = signed_distance(barriers, sources, spacing=decided, method=method, **options)
        else:
            measured = geodesic_distance(barriers, sources, spacing=decided, method=method, **options)
            if not measured.reached.all():  # files hold no infinite distances
                raise InputError(
                    f"{np.count_nonzero(~measured.reached)} of {len(measured.reached)} pieces of the surface have no "
                    "origin; give each an origin, or leave the piece out."
                )
        solution = measured.solution
        if loaded.output.wants_error:
            solution = replace(solution, estimated=measured.error)
        paths = measured.path(np.array([_point(text, barriers.surface.dim) for text in starts])) if starts else []
        warnings = list(dict.fromkeys([*issued, *solution.warnings]))
        written = write_results(solution, loaded.output, folder, progress, warnings)
    for number, path in enumerate(paths, start=1):
        with written_whole(Path(folder, f"path-{number}.csv")) as unfinished:
            np.savetxt(unfinished, path, delimiter=",")
        length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
        click.echo(f"path       {length:.6g} long, written to {Path(folder, f'path-{number}.csv')}")
    click.echo(f"unknowns   {solution.discretized.size:,} at spacing {solution.spacing:.4g}")
    if solution.solve_history is not None:
        click.echo(f"way        {solution.solve_history.summary}")
    for file in written.summary["files"]:
        click.echo(f"written    {Path(folder, file)}")
    for sentence in warnings:
        click.echo(f"warning    {sentence}")
    written.check()


def _split_origins(scene: Scene, origins: tuple[str, ...]) -> tuple[Scene, Any]:
    """Return the scene with only the boundaries that are no origins, and the origins.

    The origins are an array (k, d) of points, a list of sources of boundaries, or both in a list.
    """
    import numpy as np

    from cpmkit.scene.equations import Poisson
    from cpmkit.scene.scene import Scene

    boundaries = {boundary.name: boundary for boundary in scene.boundaries}
    points = [_point(text, scene.surface.dim) for text in origins if text not in boundaries]
    curves = [boundaries[name].source for name in origins if name in boundaries]
    barriers = [boundary for name, boundary in boundaries.items() if name not in origins]
    sources: Any = [np.array(points), *curves] if points and curves else curves or np.array(points)
    return Scene(scene.surface, Poisson(0.0), barriers, scene.edge), sources


def _point(text: str, dim: int) -> list[float]:
    """Return the ``dim`` coordinates in a text such as ``0,0,1``; raise InputError for other texts."""
    from cpmkit.errors import InputError

    try:
        coordinates = [float(number) for number in text.split(",")]
    except ValueError:
        coordinates = []
    if len(coordinates) != dim:
        raise InputError(f"a point is given by {dim} numbers such as {','.join('0' * dim)}, or a name, got {text!r}.")
    return coordinates
