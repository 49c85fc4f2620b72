"""What this distribution offers to cpmkit: the kinds ``mesh.triangles`` and ``mesh.polyline``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from cpmkit.hookspecs import hookimpl
from cpmkit.protocols import ClosestPointSource
from cpmkit_mesh.polyline import polyline
from cpmkit_mesh.reading import read_mesh
from cpmkit_mesh.triangles import triangles

__all__ = ["cpmkit_conformance_cases", "cpmkit_sources", "read_mesh"]  # cpmkit.read_mesh calls the last

if TYPE_CHECKING:
    from cpmkit.testing import ConformanceCase


@hookimpl
def cpmkit_sources() -> Mapping[str, Callable[..., ClosestPointSource]]:
    """Return the factories of the two kinds."""
    return {"mesh.triangles": triangles, "mesh.polyline": polyline}


@hookimpl
def cpmkit_conformance_cases() -> Sequence[ConformanceCase]:
    """Return closed, open and disconnected meshes, faceted and smooth, and polylines in 2D and 3D."""
    from cpmkit_mesh.conformance import cases

    return cases()
