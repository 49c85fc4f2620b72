"""The command ``cpmkit paint``. What it needs is imported when it runs."""

from __future__ import annotations

from functools import partial
from typing import Any

import click

from cpmkit.application_commands.running import AccuracyTarget, Made, application_options, run
from cpmkit.command_options import accuracy_options, with_error


@click.command()
@application_options
@accuracy_options
def paint(
    tolerance: float | None,
    norm: str | None,
    seconds: float | None,
    memory: str | None,
    estimate: bool | None,
    **keys: Any,
) -> None:
    """Spread the colours of a scene's curves over its surface, and write what its [output] asks for.

    Each [[curve]] has a colour on each side, or several along it. The boundaries and the edge of the scene hold
    besides.
    """
    accuracy = {"tolerance": tolerance, "norm": norm, "seconds": seconds, "memory": memory}
    run(AccuracyTarget("paint", **keys, accuracy=accuracy), partial(_made, estimate))


def _made(estimate: bool | None, arguments: dict[str, Any]) -> Made:
    from cpmkit.applications import diffusion_curves

    solution = with_error(diffusion_curves(**arguments).solution, estimate)
    return Made(solution, solution, {}, [])
