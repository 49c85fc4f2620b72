"""The command ``cpmkit vectors``. What it needs is imported when it runs."""

from __future__ import annotations

from typing import Any

import click

from cpmkit.application_commands.running import AccuracyTarget, Made, application_options, run


@click.command()
@application_options
def vectors(**keys: Any) -> None:
    """Go on with directions over a scene's surface by parallel transport, and write what its [output] asks for.

    Each [[direction]] of the scene gives one: at a point, or along a curve. Its boundaries are barriers. The places
    where the field has no direction are told with their indices, on surfaces that have triangles.
    """
    run(AccuracyTarget("vectors", **keys), _made)


def _made(arguments: dict[str, Any]) -> Made:
    from cpmkit.applications import vector_field
    from cpmkit.errors import CpmkitError

    field = vector_field(**arguments)
    try:
        places = [{"index": one.index, "place": one.place.tolist()} for one in field.singularities]
    except CpmkitError:  # no triangles
        return Made(field.solution, field.drawn(), {}, [])
    told = [f"index      {one['index']:+d} at ({', '.join(f'{x:.3g}' for x in one['place'])})" for one in places] + [
        f"indices    {sum(one['index'] for one in places):+d} in all"
    ]
    return Made(field.solution, field.drawn(), {"singularities": places}, told)
