"""The hooks that a plugin implements; all of them, in one file.

A plugin is a module (or any object) with functions marked ``@hookimpl``. It is found through the
entry point group ``cpmkit.kinds``, one entry point a kind, and imported when a scene names the kind.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import pluggy

if TYPE_CHECKING:
    from cpmkit.protocols import ClosestPointSource
    from cpmkit.scene.conditions import Condition
    from cpmkit.testing import ConformanceCase

hookspec = pluggy.HookspecMarker("cpmkit")
hookimpl = pluggy.HookimplMarker("cpmkit")


@hookspec
def cpmkit_sources() -> Mapping[str, Callable[..., ClosestPointSource]]:  # type: ignore[empty-body]
    """Return a factory for each kind of surface, curve or point; its keyword arguments are the scene's keys."""


@hookspec
def cpmkit_conditions() -> Mapping[str, Callable[..., Condition]]:  # type: ignore[empty-body]
    """Return a factory for each kind of condition; its keyword arguments are the keys beside ``kind``."""


@hookspec
def cpmkit_solvers() -> Mapping[str, Callable[..., Any]]:  # type: ignore[empty-body]
    """Return a factory for each kind of linear solver."""


@hookspec
def cpmkit_backends() -> Mapping[str, Callable[..., Any]]:  # type: ignore[empty-body]
    """Return a factory for each form, also called a back end: a way of discretising scenes."""


@hookspec
def cpmkit_conformance_cases() -> Sequence[ConformanceCase]:  # type: ignore[empty-body]
    """Return at least one case a kind, on which ``cpmkit.testing`` checks the laws."""
