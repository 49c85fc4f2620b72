"""The kind ``mesh.path``: a curve of geodesics through vertices of a mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.plugin import Floats, InputError, Ints, MissingDependencyError, as_points, shown
from cpmkit_mesh.chains import components
from cpmkit_mesh.mesh_curves import as_mesh_source
from cpmkit_mesh.mesh_files import as_numbers, group_equal_rows
from cpmkit_mesh.polyline import Polyline, polyline
from cpmkit_mesh.triangles import TriangleMesh

#: The user's points may be as far from the mesh's vertices as this share of its size: farther ones have another unit.
REACH_SHARE = 0.1


def path(
    *,
    file: str | Path | None = None,
    vertices: Any = None,
    faces: Any = None,
    surface: Any = None,
    through: Any,
    closed: bool = False,
    tight: bool = False,
) -> Polyline:
    """Return the curve of geodesics between vertices of a mesh; its points lie on edges and vertices.

    Each geodesic is the shortest path along edges, straightened by flipping edges (Sharp and Crane, "You can find
    geodesic paths in triangle meshes by just flipping edges", ACM Trans. Graph. 39 (6), 2020). Raise InputError if none
    or several meshes are given, the mesh is refused as by :func:`triangles`, a number is not that of a vertex of a
    triangle, a point is far from the mesh, two vertices lie on different components, there are too few, an edge has
    three triangles, or two that are wound differently, or a tight closed curve shrinks to a point. Raise
    MissingDependencyError if potpourri3d, which traces geodesics, is not installed.

    Parameters
    ----------
    file : str or Path
        An OBJ, PLY, STL or OFF file.
    vertices, faces : (n, 3) and (m, 3) arrays
        Instead of a file.
    surface : TriangleMesh
        Instead of both, a source of the kind ``mesh.triangles``. A scene file's boundary takes the scene's surface
        where it names no mesh.
    through : (k,) whole numbers or (k, 3) array
        Numbers of vertices, from 0 in the order in which they were given (of a file, that of :func:`cpmkit.read_mesh`),
        or points, each of which represents the vertex nearest to it, in the order along the curve. Consecutive
        repetitions of a vertex count once.
    closed : bool
        Whether the last vertex leads back to the first.
    tight : bool
        Whether the whole curve is straightened, so that it passes only the first and the last vertex, and a closed
        curve none. A closed curve needs a waist of the surface; elsewhere it shrinks to a point, and is refused.
    """
    mesh = as_mesh_source("mesh.path", file, vertices, faces, surface)
    waypoints = _remove_repeats(_waypoints(mesh, through), bool(closed))
    if len(waypoints) < (3 if closed else 2):
        raise InputError(
            f"through must name at least {3 if closed else 2} vertices that differ from their neighbours"
            f"{' for a closed curve' if closed else ''}, got {len(waypoints)}."
        )
    _check_connected(mesh, waypoints)
    points = _trace_geodesics(mesh, waypoints, bool(closed), bool(tight))
    if closed and tight:
        _check_not_shrunk(points)
    return polyline(points=points, closed=bool(closed))


def _waypoints(mesh: TriangleMesh, through: Any) -> Ints:
    """Return the numbers (k,) in the mesh of the vertices that ``through`` gives, as numbers (k,) or points (k, 3).

    Numbers are those of the user's vertices. Raise InputError if ``through`` is neither, a number is out of range or
    that of a vertex without a triangle, or a point is far from the mesh.
    """
    numbers = as_numbers(through, "through")
    if numbers.ndim == 1 and not len(numbers):
        return np.zeros(0, dtype=np.int64)
    if numbers.ndim == 2 and len(numbers):
        return _nearest_vertices(mesh, as_points(numbers, 3, "through"))
    if numbers.ndim != 1 or numbers.dtype.kind not in "iu":
        raise InputError(
            f"through must be whole numbers of vertices (k,) or points (k, 3), got {numbers.dtype} of shape "
            f"{numbers.shape}."
        )
    in_mesh = np.full(mesh.value_count, -1, dtype=np.int64)
    in_mesh[mesh.repaired.given_faces] = mesh.faces
    bad = np.flatnonzero((numbers < 0) | (numbers >= mesh.value_count))
    if len(bad):
        raise InputError(
            f"through must name vertices from 0 to {mesh.value_count - 1}, got {shown(int(numbers[bad[0]]))}."
        )
    unused = numbers[in_mesh[numbers] < 0]
    if len(unused):
        raise InputError(f"vertex {unused[0]} of through is a corner of no triangle; name one that is.")
    return in_mesh[numbers]


def _nearest_vertices(mesh: TriangleMesh, points: Floats) -> Ints:
    """Return the number (k,) of the mesh vertex nearest to each of ``points`` (k, 3).

    Raise InputError if a point is farther from it than :data:`REACH_SHARE` of the longest side of the mesh's bounds.
    """
    from scipy.spatial import cKDTree

    distance, nearest = cKDTree(mesh.vertices).query(points)
    far, size = int(np.argmax(distance)), float(np.ptp(mesh.bounds, axis=0).max())
    if distance[far] > REACH_SHARE * size:
        raise InputError(
            f"point {far} of through is {distance[far]:.3g} from the nearest vertex of a mesh {size:.3g} across; give "
            "points near it, in its unit of length."
        )
    return np.asarray(nearest, dtype=np.int64)


def _remove_repeats(waypoints: Ints, closed: bool) -> Ints:
    """Return ``waypoints`` (k,) without those equal to the one before; if ``closed``, the last precedes the first."""
    before = np.roll(waypoints, 1)
    if not closed and len(waypoints):
        before[0] = -1
    return waypoints[waypoints != before] if len(waypoints) > 1 else waypoints


def _check_connected(mesh: TriangleMesh, waypoints: Ints) -> None:
    """Raise InputError if edges of the mesh do not connect all of the vertices ``waypoints`` (k,), k > 0."""
    edges = np.concatenate([mesh.faces[:, :2], mesh.faces[:, 1:]])
    component = components(edges, len(mesh.vertices))[waypoints]
    other = np.flatnonzero(component != component[0])
    if len(other):
        raise InputError(
            f"entries 0 and {other[0]} of through lie on pieces of the mesh that are not connected; draw a curve on "
            "each."
        )


def _check_not_shrunk(points: Floats) -> None:
    """Raise InputError if the closed curve ``points`` (p, 3), which repeats its first, passes each segment again."""
    numbers = group_equal_rows(points)[1]
    segments = np.sort(np.stack([numbers[:-1], numbers[1:]], axis=1), axis=1)
    if np.unique(segments, axis=0, return_counts=True)[1].min(initial=2) > 1:
        raise InputError(
            "the tight closed curve shrinks to a point, or to a path that it passes there and back; name vertices "
            "around a waist of the surface, or leave tight out."
        )


def _trace_geodesics(mesh: TriangleMesh, waypoints: Ints, closed: bool, tight: bool) -> Floats:
    """Return points (p, 3) of the geodesics through the vertices ``waypoints`` (k,); closed curves repeat the first.

    If ``tight``, the whole curve is straightened, at the vertices between its ends too. Raise MissingDependencyError if
    potpourri3d is absent, InputError if it traces no geodesic on this mesh.
    """
    try:
        import potpourri3d
    except ImportError as error:
        raise MissingDependencyError(
            "mesh.path needs potpourri3d, which traces geodesics; `pip install 'cpmkit-mesh[geodesics]'` adds it."
        ) from error
    try:
        solver = potpourri3d.EdgeFlipGeodesicSolver(mesh.vertices, mesh.faces)
        if tight:
            straighten = solver.find_geodesic_loop if closed else solver.find_geodesic_path_poly
            runs = [np.asarray(straighten(waypoints.tolist()), dtype=np.float64)]
        else:
            ends = np.roll(waypoints, -1) if closed else waypoints[1:]
            runs = [
                np.asarray(solver.find_geodesic_path(int(a), int(b))) for a, b in zip(waypoints, ends, strict=False)
            ]
    except RuntimeError as error:
        raise InputError(
            f"no geodesic is traced on this mesh: {shown(str(error))}. Each edge must have one or two triangles, wound "
            "alike."
        ) from error
    points = np.concatenate([runs[0][:1], *(run[1:] for run in runs)])
    if closed:
        points[-1] = points[0]
    return points
