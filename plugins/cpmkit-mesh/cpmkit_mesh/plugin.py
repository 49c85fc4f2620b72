"""What this distribution offers to cpmkit: triangle meshes, polylines, and the curves that a mesh brings with it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from cpmkit.plugin import ClosestPointSource, hookimpl
from cpmkit_mesh.factory import triangles
from cpmkit_mesh.geodesic_path import path
from cpmkit_mesh.mesh_curves import edge_loop, feature_edges
from cpmkit_mesh.mesh_files import read_mesh
from cpmkit_mesh.obj import read_texture_coordinates
from cpmkit_mesh.picking import pick_line
from cpmkit_mesh.ply_files import read_ply_points
from cpmkit_mesh.polyline import polyline

# cpmkit's functions of the same names call the last four
__all__ = [
    "cpmkit_conformance_cases",
    "cpmkit_sources",
    "pick_line",
    "read_mesh",
    "read_ply_points",
    "read_texture_coordinates",
]

if TYPE_CHECKING:
    from cpmkit.plugin import ConformanceCase


@hookimpl
def cpmkit_sources() -> Mapping[str, Callable[..., ClosestPointSource]]:
    """Return the factory function of each of the five kinds of source, by the name of the kind."""
    return {
        "mesh.triangles": triangles,
        "mesh.polyline": polyline,
        "mesh.path": path,
        "mesh.edge_loop": edge_loop,
        "mesh.feature_edges": feature_edges,
    }


@hookimpl
def cpmkit_conformance_cases() -> Sequence[ConformanceCase]:
    """Return the conformance cases of meshes (closed, open, of two pieces), polylines, paths, rims and creases."""
    from cpmkit_mesh.conformance import cases

    return cases()
