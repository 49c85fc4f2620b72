"""What this distribution offers to cpmkit: the kind ``pointcloud.points``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from cpmkit.plugin import ClosestPointSource, hookimpl
from cpmkit_pointcloud.factory import points

if TYPE_CHECKING:
    from cpmkit.plugin import ConformanceCase


@hookimpl
def cpmkit_sources() -> Mapping[str, Callable[..., ClosestPointSource]]:
    """Return the factory of the kind."""
    return {"pointcloud.points": points}


@hookimpl
def cpmkit_conformance_cases() -> Sequence[ConformanceCase]:
    """Return the conformance cases: clouds on a sphere, a torus and a plane curve."""
    from cpmkit_pointcloud.conformance import cases

    return cases()
