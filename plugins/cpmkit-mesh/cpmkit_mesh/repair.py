"""Repair of the mesh that a user gives: welding, joining of rims, consistent winding; a sentence for each change."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Bools, Floats, InputError, Ints, Mesh, place
from cpmkit_mesh.degenerate_triangles import find_caps, remove_caps
from cpmkit_mesh.face_geometry import double_areas
from cpmkit_mesh.mesh_files import distinct_faces, group_equal_rows
from cpmkit_mesh.rim_joining import merge_rim_vertices, split_t_junctions
from cpmkit_mesh.topology import Topology, find_flipped_faces, topology

#: A triangle has an area if twice it is above this share of the square of its longest edge.
LEAST_AREA_SHARE = 1e-12


@dataclass(frozen=True, eq=False)
class RepairedMesh:
    """A welded mesh without repeated triangles and caps, of consistent winding but for one-sided components.

    Attributes
    ----------
    mesh : Mesh
        Triangles in space; each vertex is used, and there is one for each place.
    given_faces : (m, 3) int64
        The same faces by the numbers of the given vertices.
    given_index : (m,) int64
        The number of each face among those given, ascending. Further parts of a face that was split at T-junctions are
        numbered after all of them; a part of a face that was split at a cap has the cap's number.
    flipped : (m,) bool
        Faces whose winding is opposite to that given.
    adjacency : Topology
        The adjacency of the faces.
    notes : tuple of str
        A sentence for each change, and for each defect that was left.
    """

    mesh: Mesh
    given_faces: Ints
    given_index: Ints
    flipped: Bools
    adjacency: Topology
    notes: tuple[str, ...]


def repair_mesh(given_vertices: Floats, given_faces: Ints, weld: float | None = None) -> RepairedMesh:
    """Return the mesh of ``given_faces`` (m, 3) between ``given_vertices`` (n, 3), welded and wound consistently.

    Repeated faces, and caps, whose corners lie on a line, are removed; components that are one-sided keep their
    winding. ``weld`` is the distance up to which vertices at rims are merged, or lie on edges of other rims, which are
    split there; None for that of rounding. Raise InputError if no face has three different corners, or none has area.
    """
    points, faces = _weld(given_vertices, given_faces)
    rows = distinct_faces(faces)
    if not len(rows):
        raise InputError(f"No triangle has three different corners, of {len(faces)}; use mesh.polyline for curves.")
    same = merge_rim_vertices(points, faces[rows], weld)
    if (same != np.arange(len(same))).any():
        rows = rows[distinct_faces(same[faces[rows]])]
    left_out = len(faces) - len(rows)
    cells, named = same[faces[rows]], given_faces[rows]
    caps = cells[find_caps(points, cells)[0]]
    if len(caps):
        remaining, corners = remove_caps(points, cells)
        rows, cells, named = rows[remaining], cells.ravel()[corners], named.ravel()[corners]
    parts, corners, on_edges = split_t_junctions(points, cells, weld)
    if len(on_edges):  # further parts of a triangle are numbered after all that were given
        rows = np.append(rows, len(given_faces) + np.arange(len(parts) - len(rows)))
        cells, named = cells.ravel()[corners], named.ravel()[corners]
    if not _has_area(points, cells):
        raise InputError(f"No triangle of {len(faces)} has an area; use mesh.polyline for curves.")
    flipped, one_sided = find_flipped_faces(cells, topology(points, cells))
    cells, named = _flip_faces(cells, flipped), _flip_faces(named, flipped)
    notes = [
        *_note_nonfinite(given_vertices),
        *_note_left_out(left_out, len(faces)),
        *_note_merged(points, same, weld),
        *_note_on_edges(points, on_edges),
        *_note_caps(points, caps),
        *_note_flipped(points, cells, flipped),
        *_note_one_sided(points, cells, one_sided),
    ]
    used, compact = np.unique(cells, return_inverse=True)
    vertices, cells = points[used], compact.reshape(-1, 3)
    return RepairedMesh(Mesh.of(vertices, cells), named, rows, flipped, topology(vertices, cells), tuple(notes))


def _weld(vertices: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """Return distinct positions (k, 3) of the vertices that ``faces`` (m, 3) use, and (m, 3) the faces between them."""
    used, compact = np.unique(faces, return_inverse=True)
    first, place = group_equal_rows(vertices[used])
    return vertices[used][first], place[compact.reshape(-1, 3)]


def _flip_faces(faces: Ints, flipped: Bools) -> Ints:
    """Return the faces (m, 3) with the winding of those ``flipped`` (m,) reversed."""
    return np.where(flipped[:, None], faces[:, [0, 2, 1]], faces)


def _has_area(points: Floats, faces: Ints) -> bool:
    """Return whether a triangle of ``faces`` (m, 3) has an area above :data:`LEAST_AREA_SHARE`."""
    lengths = np.linalg.norm(points[faces] - points[faces[:, [1, 2, 0]]], axis=2)
    return bool((double_areas(points, faces) > LEAST_AREA_SHARE * lengths.max(axis=1, initial=0.0) ** 2).any())


def _note_nonfinite(vertices: Floats) -> Iterator[str]:
    """Yield a sentence if some of ``vertices`` (n, 3) hold NaN or infinity; no face uses them."""
    lost = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(lost):
        yield (
            f"{len(lost)} vertices of the mesh hold NaN or infinity, the first is number {lost[0]}; no face uses them, "
            "and they were left out."
        )


def _note_left_out(count: int, total: int) -> Iterator[str]:
    """Yield a sentence if ``count`` > 0 of ``total`` triangles were left out as repeated or without three corners."""
    if count:
        yield (
            f"{count} of {total} triangles of the mesh name a place twice or repeat an earlier triangle, and were left "
            "out."
        )


def _note_merged(points: Floats, same: Ints, weld: float | None) -> Iterator[str]:
    """Yield a sentence if vertices of ``points`` were merged: ``same`` (n,) names the vertex that replaces each."""
    merged = np.flatnonzero(same != np.arange(len(same)))
    if len(merged):
        apart = np.linalg.norm(points[merged] - points[same[merged]], axis=1).max()
        why = "which is rounding compared with the edges there" if weld is None else f"and weld is {weld:g}"
        yield (
            f"{len(merged)} vertices at rims of the mesh lie up to {apart:.2g} from another one, the first near "
            f"{place(points[merged[0]])}, {why}: they were merged."
        )


def _note_on_edges(points: Floats, vertices: Ints) -> Iterator[str]:
    """Yield a sentence if there were T-junctions, at ``vertices`` (j,) of ``points`` (n, 3)."""
    if len(vertices):
        yield (
            f"{len(vertices)} vertices of the mesh lie on edges of other triangles, the first near "
            f"{place(points[vertices[0]])}: these T-junctions were joined: the triangles were split there."
        )


def _note_caps(points: Floats, caps: Ints) -> Iterator[str]:
    """Yield a sentence if ``caps`` (c, 3), triangles with their corners on a line, were removed."""
    if len(caps):
        yield (
            f"{len(caps)} triangles of the mesh have their corners on a line, the first near "
            f"{place(points[caps[0]].mean(axis=0))}: they were removed, and their neighbours split there."
        )


def _note_flipped(points: Floats, faces: Ints, is_flipped: Bools) -> Iterator[str]:
    """Yield a sentence if triangles were flipped; ``is_flipped`` (m,) marks them among ``faces``."""
    flipped = np.flatnonzero(is_flipped)
    if len(flipped):
        yield (
            f"{len(flipped)} of {len(faces)} triangles of the mesh were wound against most of their piece, the first "
            f"near {place(points[faces[flipped[0]]].mean(axis=0))}: they were flipped; left and right of curves follow "
            "the others."
        )


def _note_one_sided(points: Floats, faces: Ints, one_sided: Bools) -> Iterator[str]:
    """Yield a sentence if ``one_sided`` (m,) marks ``faces`` (m, 3), of components without consistent winding."""
    rows = np.flatnonzero(one_sided)
    if len(rows):
        yield (
            f"A piece of {len(rows)} triangles of the mesh, near {place(points[faces[rows[0]]].mean(axis=0))}, is "
            "one-sided, as a Moebius strip: it has no global normals, and the left side of a curve is continued along "
            "the curve from its start."
        )
