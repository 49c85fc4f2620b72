"""A solution in plain values: what was solved, how, what it cost, and where it comes from."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

from cpmkit.conditions import Condition
from cpmkit.special_conditions import Steklov

if TYPE_CHECKING:
    from cpmkit.readable import ReadableSolution
    from cpmkit.scene import Scene


def summarize(solution: ReadableSolution) -> dict[str, Any]:
    """Return the summary that ``summary.json`` holds."""
    return {
        "scene": describe_scene(solution.scene),
        "discretization": {
            "spacing": solution.spacing,
            "channels": solution.channels,
            **solution.discretization(),
        },
        "report": solution.report.as_dict(),
        "work": solution.work.as_dict(),
        "seconds": dict(solution.seconds),
        "warnings": list(solution.warnings),
        "defects": [defect.as_dict() for defect in solution.defects],
        "leaks": [leak.as_dict() for leak in solution.leaks],
        "versions": {
            "python": platform.python_version(),
            **{name: _version(name) for name in solution.libraries},
        },
    }


def describe_scene(scene: Scene) -> dict[str, Any]:
    """Return what a scene holds, as plain values."""
    return {
        "surface": type(scene.surface).__name__,
        "dim": scene.surface.dim,
        "manifold_dim": scene.surface.manifold_dim,
        "problem": {"kind": scene.problem.kind, "equation": str(scene.problem)},
        "boundaries": [
            {side: _condition(boundary.condition(side)) for side in ("left", "right")} | {"name": boundary.name}
            for boundary in scene.boundaries
        ],
    }


def _condition(condition: Condition) -> str:
    data = condition.gamma
    if isinstance(condition, Steklov):
        return condition.kind
    return f"{condition.kind} {'of position' if callable(data) else data}"


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
