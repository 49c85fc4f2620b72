"""A solution in plain values: its scene, its discretisation, its cost, and the versions of libraries."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.scene.conditions import Condition
from cpmkit.scene.edge_conditions import ByPosition, LoopConditions
from cpmkit.scene.junction import junctions_in_words
from cpmkit.types import SIDES

if TYPE_CHECKING:
    from cpmkit.scene.scene import Scene
    from cpmkit.solution.record import SolutionRecord


def summarize(solution: SolutionRecord) -> dict[str, Any]:
    """Return the summary of a solution as plain values: numbers, texts, lists and dicts, as in ``summary.json``."""
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
    """Return a scene as plain values, by which saved solutions are compared; functions are ``of position``."""
    edge = scene.edge
    if isinstance(edge, Mapping):
        of_edge: Any = {str(loop): _describe_loop(conditions) for loop, conditions in edge.items()}
    else:
        of_edge = _describe_loop(edge)
    return {
        "surface": type(scene.surface).__name__,
        "dim": scene.surface.dim,
        "manifold_dim": scene.surface.manifold_dim,
        "problem": {
            "kind": scene.problem.kind,
            "equation": str(scene.problem),
            "constants": {name: _as_plain(value) for name, value in _arguments(scene.problem).items()},
        },
        "boundaries": [
            {side: _describe_condition(boundary.condition(side)) for side in SIDES} | {"name": boundary.name}
            for boundary in scene.boundaries
        ],
        "edge": of_edge,
        "junctions": [list(words) for words in junctions_in_words(scene.surface, scene.junctions)],
    }


def _describe_loop(conditions: LoopConditions) -> Any:
    """Return a loop's condition in words, or [condition, formula or "of position"] of its parts, None for the rest."""
    if not isinstance(conditions, ByPosition):
        return _describe_condition(conditions)
    places = [None if part.where is None else getattr(part.where, "text", "of position") for part in conditions.parts]
    return [[_describe_condition(part.condition), place] for part, place in zip(conditions.parts, places, strict=True)]


def _describe_condition(condition: Condition) -> str:
    """Return the kind of a condition and its data in words; a datum has its name if it is not alone."""
    data = {name: _as_plain(value) for name, value in _arguments(condition).items() if (name, value) != ("order", None)}
    alone = len(data) == 1 and "order" not in data
    return " ".join([condition.kind, *(f"{value}" if alone else f"{name}={value}" for name, value in data.items())])


def _arguments(term: Any) -> dict[str, Any]:
    """Return the constructor arguments of an equation or a condition, by name."""
    return {entry.name: getattr(term, entry.name) for entry in fields(term) if entry.init} if is_dataclass(term) else {}


def _as_plain(value: Any) -> Any:
    """Return a datum for JSON: numbers as floats, lists by entries, a list of one entry as that entry.

    None, truth values and texts are unchanged; others become ``of position`` (functions) or the name of their type.
    """
    if value is None or isinstance(value, (bool, str)):
        return value
    if callable(value):
        return "of position"
    if isinstance(value, (list, tuple, np.ndarray)) and np.ndim(np.asarray(value, dtype=object)):
        entries = [_as_plain(entry) for entry in value]
        return entries[0] if len(entries) == 1 else entries
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return type(value).__name__


def version_of(distribution: str) -> str | None:
    """Return the version of a Python distribution such as ``numpy``, None if it is not installed."""
    try:
        return version(distribution)
    except PackageNotFoundError:
        return None
