"""The kind ``mesh.triangles``: from the keys of a scene to a mesh that is welded and rid of what repeats itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.plugin import InputError, positive, shown
from cpmkit_mesh.engines import ENGINES
from cpmkit_mesh.folds import in_degrees
from cpmkit_mesh.normals import corner_normals
from cpmkit_mesh.oriented import OrientedTriangleMesh
from cpmkit_mesh.reading import as_mesh, read_mesh
from cpmkit_mesh.repair import repaired
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
    """Return a triangle mesh from a file or from arrays.

    Parameters
    ----------
    file : str or Path
        An OBJ, PLY, STL or OFF file.
    vertices : (n, 3) or (n, 2) array
        Those of a mesh in the plane get z = 0. Vertices that lie at exactly the same place count as one, and so do
        those at rims that rounding parted.
    faces : (m, c) array, or a sequence of sequences
        Indices of vertices, three or more a face; polygons are cut into triangles, which then count as the faces that
        were given. Triangles that repeat a vertex are left out, and so are those that repeat an
        earlier triangle, however wound, and those whose corners lie on a line. Faces that are wound against most of
        their piece are turned. What was changed is told in the mesh's warnings.
    closest : "smooth" or "faceted"
        Whether feet follow interpolated vertex normals, as if the mesh sampled a smooth surface,
        or are the nearest points of the triangles as they stand.
    engine : "own", "fcl" or "open3d"
        Which library finds the nearest triangle; what is wrong with the two others is in this plugin's README.
    crease_angle : float
        In degrees: edges at which the mesh turns by more are creases. The form ``galerkin`` leaves the triangles
        beside them flat, whatever ``closest`` says; the form ``collocation`` warns of them.
    weld : float, optional
        Up to which distance, in the unit of the vertices, vertices at rims are the same, and lie on edges of other
        rims, which are divided there; at most .3 of the shortest edge at a vertex. By default as far as rounding parts
        them.

    Raises
    ------
    InputError
        If both or neither of file and arrays are given, the file cannot be read, the arrays are
        empty, of another shape or not finite, a face names a vertex that is not there, no triangle
        has three different corners or an area, or another key holds what is not accepted.
    MissingDependencyError
        If the engine's library is absent or does not load.
    """
    if closest not in ("smooth", "faceted"):
        raise InputError(f"closest must be 'smooth' or 'faceted', got {shown(closest)}.")
    if engine not in ENGINES:
        raise InputError(f"engine must be one of {', '.join(map(repr, ENGINES))}, got {shown(engine)}.")
    if file is not None and (vertices is not None or faces is not None):
        raise InputError("mesh.triangles takes either a file or vertices and faces, got both.")
    if file is None and (vertices is None or faces is None):
        raise InputError("mesh.triangles needs a file, or both vertices and faces.")
    in_degrees(crease_angle, "crease_angle")
    weld = None if weld is None else positive(weld, "weld")
    given_vertices, given_faces = as_mesh(vertices, faces) if file is None else read_mesh(file)
    made = repaired(given_vertices, given_faces, weld)
    oriented = OrientedTriangleMesh if made.adjacency.consistent else TriangleMesh
    mesh = oriented(
        vertices=made.vertices,
        faces=made.faces,
        smooth=closest == "smooth",
        adjacency=made.adjacency,
        normals_at_corners=corner_normals(made.vertices, made.faces, made.adjacency),
        given_faces=made.given_faces,
        given_index=made.given_index,
        turned=made.turned,
        value_count=len(given_vertices),
        engine=engine,
        crease_angle=float(crease_angle),
        notes=made.notes,
        shift=np.zeros(3),
        as_given=(given_vertices, given_faces),
    )
    if engine != "own":
        mesh.closest_point(made.vertices[:0])  # what the library lacks shows now, not at a solve's first query
    return mesh
