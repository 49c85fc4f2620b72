"""A solution in plain values: what was solved, how, what it cost, and where it comes from."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.scene.conditions import Condition
from cpmkit.scene.edge_conditions import ByPosition, LoopConditions
from cpmkit.types import SIDES

if TYPE_CHECKING:
    from cpmkit.scene.scene import Scene
    from cpmkit.solution.record import SolutionRecord


def summarize(solution: SolutionRecord) -> dict[str, Any]:
    """Return the summary that ``summary.json`` holds."""
    versions = {name: version_of(name) or "not installed" for name in solution.discretized.traits.libraries}
    return {
        "scene": describe_scene(solution.scene),
        "discretization": {"spacing": solution.spacing, "channels": solution.channels, **solution.discretization()},
        "report": solution.report.as_dict(),
        "work": solution.work.as_dict(),
        "seconds": dict(solution.seconds),
        "warnings": list(solution.warnings),
        **({"error": solution.estimated.as_dict()} if solution.estimated else {}),
        **({"trade": solution.solve_history.as_dict()} if solution.solve_history else {}),
        "imbalances": [imbalance.as_dict() for imbalance in solution.imbalances],
        "versions": {"python": platform.python_version(), **versions},
    }


def describe_scene(scene: Scene) -> dict[str, Any]:
    """Return what a scene holds, as plain values: of functions only that they are some."""
    edge = scene.edge
    held = {str(loop): _on_loop(one) for loop, one in edge.items()} if isinstance(edge, Mapping) else _on_loop(edge)
    return {
        "surface": type(scene.surface).__name__,
        "dim": scene.surface.dim,
        "manifold_dim": scene.surface.manifold_dim,
        "problem": {
            "kind": scene.problem.kind,
            "equation": str(scene.problem),
            "constants": {name: _plain(value) for name, value in _arguments(scene.problem).items()},
        },
        "boundaries": [
            {side: _condition(boundary.condition(side)) for side in SIDES} | {"name": boundary.name}
            for boundary in scene.boundaries
        ],
        "edge": held,
    }


def _on_loop(held: LoopConditions) -> Any:
    """Return what holds on a loop of the edge: a condition, or where each of its parts holds."""
    if not isinstance(held, ByPosition):
        return _condition(held)
    where = [None if one.where is None else getattr(one.where, "text", "of position") for one in held.parts]
    return [[_condition(part.condition), here] for part, here in zip(held.parts, where, strict=True)]


def _condition(condition: Condition) -> str:
    """Return a condition's kind and its data, one alone without its name."""
    data = {name: _plain(value) for name, value in _arguments(condition).items() if (name, value) != ("order", None)}
    alone = len(data) == 1 and "order" not in data
    return " ".join([condition.kind, *(f"{value}" if alone else f"{name}={value}" for name, value in data.items())])


def _arguments(made: Any) -> dict[str, Any]:
    """Return what an equation or a condition was made with."""
    return {entry.name: getattr(made, entry.name) for entry in fields(made) if entry.init} if is_dataclass(made) else {}


def _plain(value: Any) -> Any:
    """Return a datum as JSON holds it: numbers as floats, lists entry by entry, of one entry as that entry."""
    if value is None or isinstance(value, (bool, str)):
        return value
    if callable(value):
        return "of position"
    if isinstance(value, (list, tuple, np.ndarray)) and np.ndim(np.asarray(value, dtype=object)):
        entries = [_plain(entry) for entry in value]
        return entries[0] if len(entries) == 1 else entries
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return type(value).__name__


def version_of(distribution: str) -> str | None:
    """Return the version of a distribution, None where it is not installed."""
    try:
        return version(distribution)
    except PackageNotFoundError:
        return None
