"""The mesh in a PLY file."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats, InputError, PlyLists, ply_vertices, read_ply
from cpmkit_mesh.polygons import Polygons

#: What the list of a face's vertices is called.
VERTEX_LIST_NAMES = ("vertex_indices", "vertex_index")


def read_ply_mesh(data: bytes) -> tuple[Floats, Polygons]:
    """Return the vertices (n, 3) and the faces of a PLY file.

    Raises
    ------
    InputError
        If it is none, is damaged, or a face names a vertex that is not there.
    """
    tables = read_ply(data)
    vertices, faces = ply_vertices(tables), tables.get("face", {})
    if "tristrips" in tables:
        raise InputError("it holds strips of triangles, which are not read; save it with faces.")
    lists = next((faces[name] for name in VERTEX_LIST_NAMES if name in faces), None)
    if lists is None:
        return vertices, Polygons(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
    if not isinstance(lists, PlyLists):
        raise InputError("the vertices of its faces are no lists.")
    if len(lists.counts) and lists.counts.min() < 3:
        raise InputError(f"face {int(np.argmin(lists.counts)) + 1} has {lists.counts.min()} corners, three are needed.")
    corners = lists.entries
    good = (corners >= 0) & (corners < len(vertices)) & (corners == np.floor(corners))
    if not good.all():
        face = np.searchsorted(np.cumsum(lists.counts), np.argmin(good), side="right")
        raise InputError(f"face {face + 1} names a vertex that is none of 0 to {len(vertices) - 1}.")
    return vertices, Polygons(lists.counts, corners.astype(np.int64))
