"""From the vertices and faces that a user gives to a mesh that closest points can be asked of, and what was changed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Bools, Floats, InputError, Ints, place
from cpmkit_mesh.caps import caps_of, without_caps
from cpmkit_mesh.directions import doubled_areas
from cpmkit_mesh.merging import merge_rims
from cpmkit_mesh.reading import at_same_place, distinct_faces
from cpmkit_mesh.t_junctions import divided_at_t_junctions
from cpmkit_mesh.topology import Topology, topology
from cpmkit_mesh.winding import against_the_others

#: A mesh whose triangles all have less than this share of their longest edge's square for an area has none.
LEAST_AREA_SHARE = 1e-12


@dataclass(frozen=True, eq=False)
class Repaired:
    """A mesh that is welded, wound alike, and rid of what repeats itself and of what has no area.

    Attributes
    ----------
    vertices : (k, 3) float64
        Those that faces use, each place once.
    faces : (m, 3) int64
    given_faces : (m, 3) int64
        The same faces by the numbers of the given vertices.
    given_index : (m,) int64
        The number that each face has among those given, ascending; further parts of a face that was divided are
        numbered after all of them.
    turned : (m,) bool
        Which of them are wound otherwise than given.
    adjacency : Topology
    notes : tuple of str
        A sentence for each thing that was changed, or is not as it should be.
    """

    vertices: Floats
    faces: Ints
    given_faces: Ints
    given_index: Ints
    turned: Bools
    adjacency: Topology
    notes: tuple[str, ...]


def repaired(given_vertices: Floats, given_faces: Ints, weld: float | None = None) -> Repaired:
    """Return the mesh of ``given_faces`` (m, 3) between ``given_vertices`` (n, 3), its rims joined up to ``weld``.

    Raises
    ------
    InputError
        If no face has three different corners, or none has an area.
    """
    points, faces = _welded(given_vertices, given_faces)
    rows = distinct_faces(faces)
    if not len(rows):
        raise InputError(f"No triangle has three different corners, of {len(faces)}; use mesh.polyline for curves.")
    same = merge_rims(points, faces[rows], weld)
    if (same != np.arange(len(same))).any():
        rows = rows[distinct_faces(same[faces[rows]])]
    left_out = len(faces) - len(rows)
    cells, named = same[faces[rows]], given_faces[rows]
    caps = cells[caps_of(points, cells)[0]]
    if len(caps):
        kept, corners = without_caps(points, cells)
        rows, cells, named = rows[kept], cells.ravel()[corners], named.ravel()[corners]
    parts, corners, on_edges = divided_at_t_junctions(points, cells, weld)
    if len(on_edges):  # further parts of a triangle are numbered after all that were given
        rows = np.append(rows, len(given_faces) + np.arange(len(parts) - len(rows)))
        cells, named = cells.ravel()[corners], named.ravel()[corners]
    if not _has_area(points, cells):
        raise InputError(f"No triangle of {len(faces)} has an area; use mesh.polyline for curves.")
    against, one_sided = against_the_others(cells, topology(points, cells))
    cells, named = _turned(cells, against), _turned(named, against)
    notes = [
        *_note_unused(given_vertices),
        *_note_left_out(left_out, len(faces)),
        *_note_merged(points, same, weld),
        *_note_on_edges(points, on_edges),
        *_note_caps(points, caps),
        *_note_turned(points, cells, against),
        *_note_one_sided(points, cells, one_sided),
    ]
    used, compact = np.unique(cells, return_inverse=True)
    vertices, cells = points[used], compact.reshape(-1, 3)
    return Repaired(vertices, cells, named, rows, against, topology(vertices, cells), tuple(notes))


def _welded(vertices: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """Return the places (k, 3) of the vertices that faces use, each once, and the faces between them."""
    used, compact = np.unique(faces, return_inverse=True)
    first, place = at_same_place(vertices[used])
    return vertices[used][first], place[compact.reshape(-1, 3)]


def _turned(faces: Ints, turned: Bools) -> Ints:
    return np.where(turned[:, None], faces[:, [0, 2, 1]], faces)


def _has_area(points: Floats, faces: Ints) -> bool:
    lengths = np.linalg.norm(points[faces] - points[faces[:, [1, 2, 0]]], axis=2)
    return bool((doubled_areas(points, faces) > LEAST_AREA_SHARE * lengths.max(axis=1, initial=0.0) ** 2).any())


def _note_unused(vertices: Floats) -> Iterator[str]:
    lost = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(lost):
        yield (
            f"{len(lost)} vertices of the mesh hold NaN or infinity, the first is number {lost[0]}; no face uses them, "
            "and they were left out."
        )


def _note_left_out(count: int, total: int) -> Iterator[str]:
    if count:
        yield (
            f"{count} of {total} triangles of the mesh name a place twice or repeat an earlier triangle, and were left "
            "out."
        )


def _note_merged(points: Floats, same: Ints, weld: float | None) -> Iterator[str]:
    merged = np.flatnonzero(same != np.arange(len(same)))
    if len(merged):
        apart = np.linalg.norm(points[merged] - points[same[merged]], axis=1).max()
        why = "which is rounding beside the edges there" if weld is None else f"and weld is {weld:g}"
        yield (
            f"{len(merged)} vertices at rims of the mesh lie up to {apart:.2g} from another one, the first near "
            f"{place(points[merged[0]])}, {why}: they were taken for the same."
        )


def _note_on_edges(points: Floats, vertices: Ints) -> Iterator[str]:
    if len(vertices):
        yield (
            f"{len(vertices)} vertices of the mesh lie on edges of other triangles, the first near "
            f"{place(points[vertices[0]])}: these T-junctions were joined, the triangles divided there."
        )


def _note_caps(points: Floats, caps: Ints) -> Iterator[str]:
    if len(caps):
        yield (
            f"{len(caps)} triangles of the mesh have their corners on a line, the first near "
            f"{place(points[caps[0]].mean(axis=0))}: they were taken out, and their neighbours parted there."
        )


def _note_turned(points: Floats, faces: Ints, against: Bools) -> Iterator[str]:
    turned = np.flatnonzero(against)
    if len(turned):
        yield (
            f"{len(turned)} of {len(faces)} triangles of the mesh were wound against most of their piece, the first "
            f"near {place(points[faces[turned[0]]].mean(axis=0))}: they were turned, and left and right of curves are "
            "those of the others."
        )


def _note_one_sided(points: Floats, faces: Ints, one_sided: Bools) -> Iterator[str]:
    found = np.flatnonzero(one_sided)
    if len(found):
        yield (
            f"A piece of {len(found)} triangles of the mesh, near {place(points[faces[found[0]]].mean(axis=0))}, has "
            "one side only, as a Moebius strip: it has no normals of its own, and what is left of a curve is carried "
            "along it from where it starts."
        )
