"""A solution in plain values: what was solved, how, what it cost, and where it comes from."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

from cpmkit.conditions import Condition

if TYPE_CHECKING:
    from cpmkit.readable import ReadableSolution
    from cpmkit.scene import Scene


def summarize(solution: ReadableSolution) -> dict[str, Any]:
    """Return the summary that ``summary.json`` holds."""
    return {
        "scene": _scene(solution.scene),
        "discretization": {
            "spacing": solution.spacing,
            "channels": solution.channels,
            **solution.discretization(),
        },
        "report": solution.report.as_dict(),
        "work": solution.work.as_dict(),
        "seconds": dict(solution.seconds),
        "warnings": list(solution.warnings),
        "versions": {
            "python": platform.python_version(),
            **{name: _version(name) for name in solution.libraries},
        },
    }


def _scene(scene: Scene) -> dict[str, Any]:
    return {
        "surface": type(scene.surface).__name__,
        "dim": scene.surface.dim,
        "manifold_dim": scene.surface.manifold_dim,
        "problem": {"kind": scene.problem.kind, "c": scene.problem.c},
        "boundaries": [
            {side: _condition(boundary.condition(side)) for side in ("left", "right")} | {"name": boundary.name}
            for boundary in scene.boundaries
        ],
    }


def _condition(condition: Condition) -> str:
    data = condition.gamma
    return f"{condition.kind} {'of position' if callable(data) else data}"


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
