"""The hooks that a plugin implements.

A plugin is a module (or any object) with functions marked ``@hookimpl``. It is found through the
entry point group ``cpmkit.kinds``, with one entry point for each kind, and imported when a scene names the kind.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pluggy

hookspec = pluggy.HookspecMarker("cpmkit")
hookimpl = pluggy.HookimplMarker("cpmkit")


@hookspec
def cpmkit_sources() -> Mapping[str, Callable[..., Any]]:  # type: ignore[empty-body]
    """Return a factory of a ClosestPointSource for each kind of surface, curve or point, by the kind's name.

    The keyword arguments of the factory are the keys of the kind in scene files.
    """


@hookspec
def cpmkit_conditions() -> Mapping[str, Callable[..., Any]]:  # type: ignore[empty-body]
    """Return a factory of a Condition for each kind of condition, by the kind's name.

    The keyword arguments of the factory are the keys of the kind in scene files.
    """


@hookspec
def cpmkit_solvers() -> Mapping[str, Callable[..., Any]]:  # type: ignore[empty-body]
    """Return a factory of a LinearSolver for each kind of linear solver, by the name of the kind."""


@hookspec
def cpmkit_backends() -> Mapping[str, Callable[..., Any]]:  # type: ignore[empty-body]
    """Return a factory of a Backend for each form (back end), a way of discretising scenes, by its name."""


@hookspec
def cpmkit_conformance_cases() -> Sequence[Any]:  # type: ignore[empty-body]
    """Return at least one ConformanceCase for each kind, for which ``cpmkit.testing`` checks the laws of sources."""
