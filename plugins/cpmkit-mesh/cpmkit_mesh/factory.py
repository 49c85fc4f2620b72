"""The kind ``mesh.triangles``: from the keys of a scene to a mesh that is welded and rid of what repeats itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.errors import InputError
from cpmkit_mesh.engines import ENGINES
from cpmkit_mesh.folds import in_degrees
from cpmkit_mesh.normals import corner_normals
from cpmkit_mesh.reading import as_mesh, read_mesh, weld
from cpmkit_mesh.topology import topology
from cpmkit_mesh.triangles import OrientedTriangleMesh, TriangleMesh


def triangles(
    *,
    file: str | Path | None = None,
    vertices: Any = None,
    faces: Any = None,
    closest: str = "smooth",
    engine: str = "own",
    crease_angle: float = 40.0,
) -> TriangleMesh:
    """Return a triangle mesh from a file or from arrays.

    Parameters
    ----------
    file : str or Path
        An OBJ, PLY, STL or OFF file.
    vertices : (n, 3) array
        Vertices that lie at exactly the same place count as one.
    faces : (m, 3) array
        Indices of vertices. Triangles that repeat a vertex are left out, and so are those that repeat an
        earlier triangle, however wound.
    closest : "smooth" or "faceted"
        Whether feet follow interpolated vertex normals, as if the mesh sampled a smooth surface,
        or are the nearest points of the triangles as they stand.
    engine : "own", "fcl" or "open3d"
        Which library finds the nearest triangle; what is wrong with the two others is in this plugin's README.
    crease_angle : float
        In degrees: edges at which the mesh turns by more are creases, of which a solution warns.

    Raises
    ------
    InputError
        If both or neither of file and arrays are given, the file cannot be read, the arrays are
        empty, of another shape or not finite, a face names a vertex that is not there, no triangle
        has three different corners, or another key holds what is not accepted.
    MissingDependencyError
        If the engine's library is absent or does not load.
    """
    if closest not in ("smooth", "faceted"):
        raise InputError(f"closest must be 'smooth' or 'faceted', got {closest!r}.")
    if engine not in ENGINES:
        raise InputError(f"engine must be one of {', '.join(map(repr, ENGINES))}, got {engine!r}.")
    if file is not None and (vertices is not None or faces is not None):
        raise InputError("mesh.triangles takes either a file or vertices and faces, got both.")
    if file is None and (vertices is None or faces is None):
        raise InputError("mesh.triangles needs a file, or both vertices and faces.")
    in_degrees(crease_angle, "crease_angle")
    given_vertices, given_faces = as_mesh(vertices, faces) if file is None else read_mesh(file)
    used, compact = np.unique(given_faces, return_inverse=True)
    first, place = weld(given_vertices[used])
    welded = place[compact.reshape(-1, 3)]
    apart = np.flatnonzero((welded != np.roll(welded, 1, axis=1)).all(axis=1))
    if not len(apart):
        raise InputError(f"No triangle has three different corners, of {len(welded)}; use mesh.polyline for curves.")
    kept = apart[weld(np.sort(welded[apart], axis=1))[0]]
    points, cells = given_vertices[used][first], welded[kept]
    adjacency = topology(points, cells)
    oriented = OrientedTriangleMesh if adjacency.consistent else TriangleMesh
    mesh = oriented(
        vertices=points,
        faces=cells,
        smooth=closest == "smooth",
        adjacency=adjacency,
        normals_at_corners=corner_normals(points, cells, adjacency),
        given_faces=given_faces[kept],
        given_index=kept,
        value_count=len(given_vertices),
        engine=engine,
        crease_angle=float(crease_angle),
    )
    if engine != "own":
        mesh.closest_point(points[:0])  # what the library lacks shows now, not at a solve's first query
    return mesh
