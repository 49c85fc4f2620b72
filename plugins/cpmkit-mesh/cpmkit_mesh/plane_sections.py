"""The section of a triangle mesh by a plane: a polyline with vertices on edges of the mesh, for any plane."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import Bools, ClosestPoints, Floats, InputError, Ints, dots, unit
from cpmkit_mesh.chains import Chains, order_chains
from cpmkit_mesh.polyline import AT_VERTEX_SHARE, Polyline
from cpmkit_mesh.rim_joining import joining_distance

if TYPE_CHECKING:
    from cpmkit_mesh.triangles import TriangleMesh

#: The distance of :attr:`PlaneSection.left_of` from the section, relative to the largest side of its bounds.
LEFT_OF_OFFSET_SHARE = 1e-3


@dataclass(frozen=True, eq=False, repr=False)
class PlaneSection(Polyline):
    """The curve in which a plane cuts a mesh: segments in its triangles; the plane's normal points to its left.

    Attributes
    ----------
    conormals : (m, 3) float64
        The unit vector across each segment to its left, in the plane of its triangle.
    """

    conormals: Floats

    def leftward(self, feet: ClosestPoints, /) -> Floats:
        """Return (n, 3) unit conormals to the left of the curve at ``feet``; at vertices the mean.

        Raise InputError if ``feet`` lack ``element`` or ``local``.
        """
        segment, t = self._locate(feet)
        left = self.conormals[segment]
        start, end = t <= AT_VERTEX_SHARE, t >= 1.0 - AT_VERTEX_SHARE
        left[start] = self._vertex_sums[self.segments[segment[start], 0]]
        left[end] = self._vertex_sums[self.segments[segment[end], 1]]
        tangents = self.tangents(feet)
        across = left - dots(left, tangents)[:, None] * tangents
        return unit(across)

    @property
    def left_of(self) -> Floats:
        """(3,) a point beside the first segment's middle, a little to the left of the curve."""
        offset = LEFT_OF_OFFSET_SHARE * float(np.ptp(self.bounds, axis=0).max())
        return np.asarray(self.vertices[self.segments[0]].mean(axis=0) + offset * self.conormals[0])

    @cached_property
    def _vertex_sums(self) -> Floats:
        """(k, 3) the sum of the conormals of the segments that start or end at each vertex."""
        sums = np.zeros_like(self.vertices)
        np.add.at(sums, self.segments, self.conormals[:, None])
        return sums


def plane_section(mesh: TriangleMesh, point: Floats, normal: Floats) -> PlaneSection:
    """Return the curve in which ``mesh`` meets the plane through ``point`` (3,) with normal vector ``normal`` (3,).

    Vertices lie in the plane if they are as near to it as rounding. They count as left of it, or, where this gives no
    section, as right: the section of faces in the plane is their outline. Raise InputError if the plane misses the
    mesh, or touches it only.
    """
    used = np.arange(len(mesh.vertices))
    height = (mesh.vertices - point) @ unit(normal[None])[0]
    height[np.abs(height) <= joining_distance(mesh.vertices, mesh.faces, used, None)] = 0.0
    for left in (height >= 0.0, height > 0.0):
        section = _section_between(mesh, height, left)
        if section is not None:
            return section
    raise InputError(
        "the distance from the plane does not change its sign on the mesh: it is from "
        f"{height.min():.3g} to {height.max():.3g} at the vertices; move the plane into the mesh."
    )


def _section_between(mesh: TriangleMesh, height: Floats, left: Bools) -> PlaneSection | None:
    """Return the section that separates the vertices of ``mesh`` marked ``left`` (k,) from the others; None if empty.

    ``height`` (k,) are the vertices' signed distances from the plane. In each triangle the segment starts on the edge
    that leads from left to right in the triangle's orientation: left is then to its left, seen from the tip of the
    normal.
    """
    start, end = left[mesh.faces[:, [1, 2, 0]]], left[mesh.faces[:, [2, 0, 1]]]  # edge e is opposite corner e
    cell = np.flatnonzero((start != end).any(axis=1))
    if not len(cell):
        return None
    edge = np.stack([(start & ~end)[cell].argmax(axis=1), (end & ~start)[cell].argmax(axis=1)], axis=1)
    faces, rows = mesh.faces[cell], np.arange(len(cell))[:, None]
    ends = np.sort(np.stack([faces[rows, (edge + 1) % 3], faces[rows, (edge + 2) % 3]], axis=2), axis=2)
    pairs, node = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    node, (first, second) = node.reshape(-1, 2), pairs.T
    share = height[first] / (height[first] - height[second])
    places = mesh.vertices[first] + share[:, None] * (mesh.vertices[second] - mesh.vertices[first])
    at = np.where(height[first] == 0.0, first, np.where(height[second] == 0.0, second, -1))
    places[at >= 0] = mesh.vertices[at[at >= 0]]
    name = np.where(at >= 0, at, len(mesh.vertices) + np.arange(len(pairs)))
    chains = _remove_touching(_remove_spurs(order_chains(node, places), name), name, places)
    if not len(chains):
        return None
    vertices, segments = chains.vertices, chains.segments()
    of_segment = cell[_find_pairs(name[node], name[vertices][segments])]
    points = places[vertices]
    conormals = _conormals(mesh, of_segment, name[vertices][segments], points[segments], left)
    return PlaneSection(points, segments, chains.ends(), np.arange(len(points)), len(points), points, conormals)


def _remove_spurs(chains: Chains, name: Ints) -> Chains:
    """Return the chains without repeated points and without parts that lead to a point and back the same way.

    The chains keep their order. Closed ones of fewer than three points, and open ones of one, are dropped. ``name``
    (n,) has equal entries for nodes at one point.
    """
    vertices, chain, closed = chains.vertices, chains.chain, chains.closed
    dropped = np.ones(1, dtype=bool)
    while dropped.any() and len(vertices):
        here, opens, ends = name[vertices], chain != np.roll(chain, 1), chain != np.roll(chain, -1)
        first, last = np.flatnonzero(opens), np.flatnonzero(ends)
        if not len(first):  # there is one chain
            first, last = np.array([0]), np.array([len(chain) - 1])
        before, after = np.roll(here, 1), np.roll(here, -1)
        before[first], after[last] = here[last], here[first]
        opened = ~closed[chain[first]]
        before[first[opened]], after[last[opened]] = -1, -2
        dropped = (here == before) | (before == after)
        vertices, chain = vertices[~dropped], chain[~dropped]
    proper = np.bincount(chain, minlength=len(closed)) >= np.where(closed, 3, 2)
    rows = proper[chain]
    return Chains(vertices[rows], (np.cumsum(proper) - 1)[chain[rows]], closed[proper])


def _remove_touching(chains: Chains, name: Ints, places: Floats) -> Chains:
    """Return the chains, ordered anew, without segments that occur again: there the plane touches the mesh in an edge.

    ``name`` (n,) has equal entries for nodes at one point of ``places`` (n, 3).
    """
    if not len(chains):
        return chains
    segments = name[chains.vertices][chains.segments()]
    _, once, counts = np.unique(np.sort(segments, axis=1), axis=0, return_inverse=True, return_counts=True)
    alone = counts[once.ravel()] == 1
    if alone.all() or not alone.any():
        return chains if alone.all() else Chains(chains.vertices[:0], chains.chain[:0], chains.closed[:0])
    first = np.full(name.max() + 1, -1)
    first[name[::-1]] = np.arange(len(name))[::-1]
    return order_chains(first[segments[alone]], places)


def _find_pairs(pairs: Ints, wanted: Ints) -> Ints:
    """Return (k,) for each row of ``wanted`` (k, 2) the first of ``pairs`` (m, 2) with its numbers, in any order."""
    count = pairs.max() + 1
    keys, target = (np.sort(numbers, axis=1) @ [count, 1] for numbers in (pairs, wanted))
    order = np.argsort(keys, kind="stable")
    return order[np.searchsorted(keys, target, sorter=order)]


def _conormals(mesh: TriangleMesh, cell: Ints, name: Ints, ends: Floats, left: Bools) -> Floats:
    """Return (m, 3) unit vectors to the left across segments ``ends`` (m, 2, 3), each in triangle ``cell`` (m,).

    ``name`` (m, 2) are the vertices at the ends, or numbers from k on for points inside edges; ``left`` (k,) marks the
    vertices left of the plane. Of a segment along an edge of two triangles, unless they are folded onto each other, the
    mean over both is returned.
    """
    along = unit(ends[:, 1] - ends[:, 0])
    corners = mesh.faces[cell]
    middle = ends.mean(axis=1)
    side = np.where(left[corners], 1.0, -1.0)
    away = mesh.vertices[corners] - middle[:, None]
    away -= np.einsum("mcd,md->mc", away, along)[:, :, None] * along[:, None]
    conormals = unit(np.einsum("mc,mcd->md", side, away))
    on_edge = np.flatnonzero((name < len(mesh.vertices)).all(axis=1))
    apex = (corners[on_edge, :, None] != name[on_edge, None]).all(axis=2).argmax(axis=1)
    other = mesh.adjacency.neighbours[cell[on_edge], apex]
    inner = other >= 0
    on_edge, other = on_edge[inner], other[inner]
    far = mesh.faces[other]
    far = far[np.arange(len(far)), (far[:, :, None] != name[on_edge, None]).all(axis=2).argmax(axis=1)]
    beyond = mesh.vertices[far] - middle[on_edge]
    beyond = unit(beyond - dots(beyond, along[on_edge])[:, None] * along[on_edge])
    both = conormals[on_edge] - np.where(left[corners[on_edge, apex[inner]]], 1.0, -1.0)[:, None] * beyond
    folded = np.linalg.norm(both, axis=1) <= AT_VERTEX_SHARE
    conormals[on_edge] = np.where(folded[:, None], conormals[on_edge], unit(both))
    return conormals
