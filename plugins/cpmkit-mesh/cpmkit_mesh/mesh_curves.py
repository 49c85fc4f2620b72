"""The kinds ``mesh.edge_loop`` and ``mesh.feature_edges``: boundary loops and creases of a mesh as curves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.plugin import InputError, shown
from cpmkit_mesh.chains import Chains, order_chains
from cpmkit_mesh.face_geometry import checked_angle, nonmanifold_edges
from cpmkit_mesh.factory import triangles
from cpmkit_mesh.polyline import Polyline
from cpmkit_mesh.triangles import TriangleMesh


def edge_loop(
    *,
    file: str | Path | None = None,
    vertices: Any = None,
    faces: Any = None,
    surface: Any = None,
    loop: int | None = None,
) -> Polyline:
    """Return the boundary of an open mesh: one of its loops, or all of them.

    Its direction is such that the mesh lies to its left, seen from the tips of the normals of the faces (by their
    winding; if that is inconsistent, by that of most faces at a loop).

    Parameters
    ----------
    file : str or Path
        An OBJ, PLY, STL or OFF file.
    vertices, faces : (n, 3) and (m, 3) arrays
        Vertices and triangles, instead of a file.
    surface : TriangleMesh
        Instead of both, a source of the kind ``mesh.triangles``. A scene file's boundary takes the scene's
        surface where it names no mesh.
    loop : int, optional
        Number of the loop, 0 the longest: the value of ``edge`` in the answers of ``mesh.triangles``. Loops that share
        a vertex are one. By default all.

    Raises
    ------
    InputError
        If none or several meshes are given, the mesh is refused as by :func:`triangles`, is closed, or has no such
        loop.
    """
    mesh = as_mesh_source("mesh.edge_loop", file, vertices, faces, surface)
    boundary, number = mesh.adjacency.boundary, mesh.adjacency.loop
    if not len(boundary):
        raise InputError("mesh.edge_loop needs an open mesh; this one is closed and has no edge.")
    if loop is not None:
        boundary = boundary[number == _checked_number(loop, "loop", int(number.max()) + 1)]
    return _polyline_of_chains(mesh, order_chains(boundary, mesh.vertices))


def feature_edges(
    *,
    file: str | Path | None = None,
    vertices: Any = None,
    faces: Any = None,
    surface: Any = None,
    angle: float = 40.0,
    chain: int | None = None,
) -> Polyline:
    """Return the creases of a mesh, including edges of three or more triangles, as one chain of edges or all chains.

    Chains end where a number of such edges other than two meet; a closed crease is one chain. Their direction is that
    in which most of their edges lead to the vertex of the higher number.

    Parameters
    ----------
    file : str or Path
        An OBJ, PLY, STL or OFF file.
    vertices, faces : (n, 3) and (m, 3) arrays
        Vertices and triangles, instead of a file.
    surface : TriangleMesh
        Instead of both, a source of the kind ``mesh.triangles``. A scene file's boundary takes the scene's
        surface where it names no mesh.
    angle : float
        In degrees: edges at which the mesh turns by more are creases.
    chain : int, optional
        Number of the chain, 0 the longest. By default all.

    Raises
    ------
    InputError
        If none or several meshes are given, the mesh is refused as by :func:`triangles`, ``angle`` is not between 0 and
        180, no edge turns by more or has three triangles, or there is no such chain.
    """
    mesh = as_mesh_source("mesh.feature_edges", file, vertices, faces, surface)
    sharp = mesh.inner_edges.ends[mesh.inner_edges.angle > np.deg2rad(checked_angle(angle, "angle"))]
    edges = np.concatenate([np.sort(sharp, axis=1), nonmanifold_edges(mesh.faces, mesh.adjacency)])
    if not len(edges):
        largest = np.rad2deg(mesh.inner_edges.angle.max(initial=0.0))
        raise InputError(
            f"mesh.feature_edges finds no edge that turns by more than {angle:g} degrees; the sharpest of this mesh "
            f"turns by {largest:.3g}."
        )
    chains = order_chains(edges, mesh.vertices)
    return _polyline_of_chains(
        mesh, chains if chain is None else chains.take(_checked_number(chain, "chain", len(chains)))
    )


def _polyline_of_chains(mesh: TriangleMesh, chains: Chains) -> Polyline:
    """Return ``chains`` of edges of ``mesh`` as a polyline that interpolates values at the user's vertices."""
    vertices = chains.vertices
    return Polyline(
        vertices=mesh.vertices[vertices],
        segments=chains.segments(),
        ends=chains.ends(),
        given_index=mesh.given_vertices[vertices],
        value_count=mesh.value_count,
        given_points=mesh.given_mesh[0],
    )


def as_mesh_source(kind: str, file: str | Path | None, vertices: Any, faces: Any, surface: Any) -> TriangleMesh:
    """Return the mesh of a curve's keys: ``surface`` itself, or a faceted mesh from ``file`` or from arrays.

    Raise InputError, which names ``kind``, if none or several are given, or ``surface`` is no ``TriangleMesh``; and
    InputError of :func:`triangles`.
    """
    arrays = vertices is not None or faces is not None
    count = (file is not None) + arrays + (surface is not None)
    if count != 1:
        raise InputError(
            f"{kind} takes one mesh, as a file, as vertices and faces or as a surface, got {count or 'none'}."
        )
    if surface is None:
        return triangles(file=file, vertices=vertices, faces=faces, closest="faceted")
    if not isinstance(surface, TriangleMesh):
        raise InputError(
            f"{kind} takes a surface of the kind mesh.triangles, got {type(surface).__name__}; name the file of a mesh."
        )
    return surface


def _checked_number(value: Any, name: str, count: int) -> int:
    """Return ``value`` as an int from 0 to ``count`` - 1; raise InputError that names the key ``name`` if it is not."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 0 <= value < count:
        raise InputError(f"{name} must be a whole number from 0 to {count - 1}, the longest first, got {shown(value)}.")
    return int(value)
