"""The kind ``mesh.triangles``: from the keys of a scene to a repaired mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.plugin import InputError, positive, shown
from cpmkit_mesh.closed import ClosedTriangleMesh
from cpmkit_mesh.corner_normals import corner_normals
from cpmkit_mesh.engines import ENGINES
from cpmkit_mesh.face_geometry import checked_angle
from cpmkit_mesh.mesh_files import as_mesh, read_mesh
from cpmkit_mesh.oriented import OrientedTriangleMesh
from cpmkit_mesh.repair import repair_mesh
from cpmkit_mesh.triangles import TriangleMesh


def triangles(
    *,
    file: str | Path | None = None,
    vertices: Any = None,
    faces: Any = None,
    closest: str = "smooth",
    engine: str = "own",
    crease_angle: float = 40.0,
    weld: float | None = None,
) -> TriangleMesh:
    """Return the source of a triangle mesh from a file or from arrays, repaired where it has defects.

    Raise InputError if both or neither of file and arrays are given, the file cannot be read, the arrays are empty or
    of another shape, a face uses a vertex that is not there, not finite or too large, a polygon crosses itself, no
    triangle has three different corners or an area, or another key has a value that is not accepted. Raise
    MissingDependencyError if the engine's library is absent or does not load.

    Parameters
    ----------
    file : str or Path
        An OBJ, PLY, STL or OFF file.
    vertices : (n, 3) or (n, 2) array
        Those of a mesh in the plane get z = 0. Vertices at exactly the same place are merged, and so are vertices at
        rims that differ by rounding.
    faces : (m, c) array, or a sequence of sequences
        Indices of vertices, three or more for each face. Polygons are cut into triangles, which then count as the faces
        given. Triangles that repeat a vertex or an earlier triangle, in any winding, and those whose corners lie on a
        line, are left out. Faces that are wound against most of their component are flipped, unless the component is
        one-sided. Changes are listed in the mesh's warnings.
    closest : "smooth" or "faceted"
        Whether closest points follow interpolated vertex normals, as those of a smooth surface that the mesh samples,
        or are the nearest points of the triangles.
    engine : "own", "fcl" or "open3d"
        The library that finds the nearest triangle; the README of this plugin lists the faults of the two others.
    crease_angle : float
        Between 0 and 180 degrees: edges at which the mesh turns by more are creases. The form ``galerkin`` leaves the
        triangles at them flat, for any ``closest``; the form ``collocation`` warns of them.
    weld : float, optional
        The distance, in the unit of the vertices, up to which vertices at rims are merged, or lie on edges of other
        rims, which are split there; at most .3 of the shortest edge at a vertex. By default that of rounding.
    """
    if closest not in ("smooth", "faceted"):
        raise InputError(f"closest must be 'smooth' or 'faceted', got {shown(closest)}.")
    if engine not in ENGINES:
        raise InputError(f"engine must be one of {', '.join(map(repr, ENGINES))}, got {shown(engine)}.")
    if file is not None and (vertices is not None or faces is not None):
        raise InputError("mesh.triangles takes either a file or vertices and faces, got both.")
    if file is None and (vertices is None or faces is None):
        raise InputError("mesh.triangles needs a file, or both vertices and faces.")
    checked_angle(crease_angle, "crease_angle")
    weld = None if weld is None else positive(weld, "weld")
    given_vertices, given_faces = as_mesh(vertices, faces) if file is None else read_mesh(file)
    repaired = repair_mesh(given_vertices, given_faces, weld)
    mesh_class: type[TriangleMesh] = OrientedTriangleMesh if repaired.adjacency.consistent else TriangleMesh
    if repaired.adjacency.consistent and (repaired.adjacency.neighbours >= 0).all():
        mesh_class = ClosedTriangleMesh
    mesh = mesh_class(
        repaired=repaired,
        smooth=closest == "smooth",
        normals_at_corners=corner_normals(repaired.mesh.vertices, repaired.mesh.cells, repaired.adjacency),
        value_count=len(given_vertices),
        engine=engine,
        crease_angle=float(crease_angle),
        shift=np.zeros(3),
        given_arrays=(given_vertices, given_faces),
    )
    if engine != "own":
        mesh.closest_point(mesh.vertices[:0])  # a fault of the library is found now, not at a solve's first query
    return mesh
