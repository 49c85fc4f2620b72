"""The hooks that a plugin implements; all of them, in one file.

A plugin is a module (or any object) with functions marked ``@hookimpl``. It is found through the
entry point group ``cpmkit.kinds``, one entry point a kind, and imported when a scene names the kind.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pluggy

hookspec = pluggy.HookspecMarker("cpmkit")
hookimpl = pluggy.HookimplMarker("cpmkit")


@hookspec
def cpmkit_sources() -> Mapping[str, Callable[..., Any]]:  # type: ignore[empty-body]
    """Return a factory of a ClosestPointSource for each kind of surface, curve or point.

    Its keyword arguments are the scene's keys.
    """


@hookspec
def cpmkit_conditions() -> Mapping[str, Callable[..., Any]]:  # type: ignore[empty-body]
    """Return a factory of a Condition for each kind of condition; its keyword arguments are its other keys."""


@hookspec
def cpmkit_solvers() -> Mapping[str, Callable[..., Any]]:  # type: ignore[empty-body]
    """Return a factory of a LinearSolver for each kind of linear solver."""


@hookspec
def cpmkit_backends() -> Mapping[str, Callable[..., Any]]:  # type: ignore[empty-body]
    """Return a factory of a Backend for each form, also called a back end: a way of discretising scenes."""


@hookspec
def cpmkit_conformance_cases() -> Sequence[Any]:  # type: ignore[empty-body]
    """Return at least one ConformanceCase a kind, on which ``cpmkit.testing`` checks the laws."""
