"""Conformance cases: sources that plugins supply as examples of their kinds, on which the laws are checked."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit import plugins
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.types import Floats


@dataclass(frozen=True)
class ConformanceCase:
    """One example of a kind of source, on which the laws are checked.

    Attributes
    ----------
    kind : str
        The kind in scene files, ``family.shape``.
    name : str
        Name that distinguishes the cases of a kind.
    make : callable
        Function without arguments that returns the source.
    samples : callable, optional
        ``samples(rng, n)`` returns points (n, d) that lie on the manifold, found without closest points: with them the
        laws detect every foot that is not the nearest.
    radius : float, optional
        For a source that is not exact: the distance from the manifold up to which feet are meant to be accurate.
        ``None``: anywhere.
    turning_angle : float
        The angle in radians by which feet (of a source that is not exact) and normals (of any source) may be off:
        ``|points - exact foot|`` <= turning angle x distance. For a mesh the largest angle between neighbouring
        normals; for a smooth manifold 0.
    """

    kind: str
    name: str
    make: Callable[[], ClosestPointSource]
    samples: Callable[[np.random.Generator, int], Floats] | None = None
    radius: float | None = None
    turning_angle: float = 0.0

    def __str__(self) -> str:
        return f"{self.kind} ({self.name})"


def installed_cases() -> list[ConformanceCase]:
    """Return the cases of every installed plugin.

    Raises
    ------
    PluginError
        If a plugin does not import.
    """
    return [
        case
        for plugin in _installed_plugins()
        if hasattr(plugin, "cpmkit_conformance_cases")
        for case in plugin.cpmkit_conformance_cases()
    ]


def kinds_without_case() -> list[str]:
    """Return the installed kinds of sources for which no plugin supplies a case; solvers need none.

    Raises
    ------
    PluginError
        If a plugin does not import.
    """
    sources = {
        kind for plugin in _installed_plugins() if hasattr(plugin, "cpmkit_sources") for kind in plugin.cpmkit_sources()
    }
    return sorted(sources - {case.kind for case in installed_cases()})


def _installed_plugins() -> Iterator[Any]:
    """Yield each installed plugin once, also if it offers several kinds."""
    seen: set[int] = set()
    for installed in plugins.installed_kinds():
        plugin = plugins.load(installed.kind)
        if id(plugin) not in seen:
            seen.add(id(plugin))
            yield plugin
