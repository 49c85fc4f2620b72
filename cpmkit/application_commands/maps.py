"""The command ``cpmkit map``. What it needs is imported when it runs."""

from __future__ import annotations

from typing import Any

import click

from cpmkit.application_commands.running import AccuracyTarget, Made, application_options, run


@click.command("map")
@application_options
def map_to_target(**keys: Any) -> None:
    """Let a map from a scene's surface to its [target] relax to one of least stretch, and write what [output] asks for.

    Each [[landmark]] holds a point or a curve where it says; [map] tells where the map begins and when it rests. Files
    hold the coordinates of the image; the picture shows the target's colours, or the texture of [map], on the surface.
    """
    run(AccuracyTarget("map", **keys), _made)


def _made(arguments: dict[str, Any]) -> Made:
    from cpmkit.applications import harmonic_map
    from cpmkit.errors import CpmkitError

    texture = arguments.pop("texture", None)
    found = harmonic_map(**arguments)
    try:
        degree = found.degree
    except CpmkitError:  # of closed surfaces alone
        degree = None
    told = [
        f"energy     {found.energy[0]:.6g} at first, {found.energy[-1]:.6g} after {len(found.energy) - 1} steps, "
        f"{'at' if found.at_rest else 'not at'} rest",
        *([] if degree is None else [f"degree     {degree}"]),
    ]
    values = {"energy": found.energy.tolist(), "at_rest": found.at_rest, "degree": degree}
    return Made(found.solution, found.drawn(texture), values, told)
