"""Nodes of a contoured mesh at creases, moved onto the creases of the manifold that closest points define.

Closest points of nodes beside a crease lie on one of its faces, up to a hundredth of a spacing from the crease, which
causes an error of first order. Here each node moves to the common point of tangent planes of the faces nearby.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.manifold.abilities import HasValues
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.mesh.adjacency import rim_of_vertices
from cpmkit.mesh.mesh import Mesh
from cpmkit.mesh.subdivision import halve_edges
from cpmkit.meshing.contour_edges import collapse_edges, double_areas, shortest_at_both_ends
from cpmkit.meshing.creases import CREASE_DEGREES, inward_directions, sharp_facets
from cpmkit.types import Bools, Floats, Ints

#: Tangent planes touch the faces at these shares of an edge's length from the node, one after the other: the error of a
#: plane on a curved face is proportional to the square of its distance.
PLANE_SHARES = (0.5, 0.2, 0.08, 0.03, 0.012, 0.005)
#: Normals are computed at this share of that distance above a face, but not closer than so many times the noise.
HEIGHT_SHARE, NOISE_FACTOR = 0.1, 30.0
#: The least turn, in degrees, of a crease if closest points are exact: the planes that touch both faces are then a
#: hundredth of an edge apart, over which a smooth surface hardly turns.
LEAST_CREASE_DEGREES = 6.0
#: Singular values of unit normals of planes below this share of the largest define no further direction.
LEAST_SINGULAR_SHARE = float(np.tan(np.radians(LEAST_CREASE_DEGREES / 2)))
#: A node moves by at most an edge's length, to a point whose distance from the manifold is below this share of it.
ON_MANIFOLD_SHARE = 1e-4
#: The midpoint of an edge along a slight crease is nearer to the crease than this share of the edge.
MIDDLE_SHARE = 0.1
#: Edges at creases that are shorter than this share of the longest edge of their triangle are collapsed.
SHORT_SHARE = 0.2
#: A triangle is a sliver if its height over its longest edge is a smaller share of this edge.
SLIVER_SHARE = 0.1
#: Rounds of moves, collapses and halvings, since each treats the result of the round before.
SHARPENING_ROUNDS = 6


@dataclass(frozen=True, eq=False)
class Faces:
    """The smooth faces of a manifold beside creases: at each node two faces or more, each with its tangent plane.

    Nodes are vertices, or midpoints of edges.
    """

    node: Ints  #: (f,): the number of the node of each face.
    inward: Floats  #: (f, d): unit vectors from the node into the face.
    normals: Floats  #: (f, d): unit normals of the triangles that touch the faces.
    lengths: Floats  #: (f,): lengths of the edges at the nodes.

    @staticmethod
    def of_sides(nodes: Ints, across: Floats, normals: Floats, lengths: Floats) -> Faces:
        """Return two faces at each of ``nodes`` (n,), in the direction ``across`` (n, 3) and in the opposite one."""
        both = np.concatenate([across, -across])
        return Faces(np.tile(nodes, 2), both, np.tile(normals, (2, 1)), np.tile(lengths, 2))


def creased_edges(mesh: Mesh, source: LocalSource, sliver: float = 0.0, farthest: float = MIDDLE_SHARE) -> Bools:
    """Return whether (e,) each edge of triangles lies on a crease or has three triangles or more; False on boundaries.

    An edge where the triangles turn by 6 degrees or more, but by less than `CREASE_DEGREES`, is on a slight crease if
    planes that touch the manifold on both sides show a crease nearer to the midpoint of the edge than the share
    ``farthest`` of its length. For ``sliver`` see :func:`sharp_facets`.
    """
    creased = sharp_facets(mesh, CREASE_DEGREES, sliver)
    if source.slight_creases:
        slight = sharp_facets(mesh, LEAST_CREASE_DEGREES, sliver) & ~creased
        if slight.any() and shows_slight_creases(source, mesh.edge_lengths[slight]):
            midpoints = mesh.vertices[mesh.edges.ends].mean(axis=1)
            creased |= points_on_creases(source, midpoints, _faces_at(mesh, slight), farthest)[1]
    return np.asarray(creased & ~mesh.edge_is_cut)


def shows_slight_creases(source: LocalSource, lengths: Floats) -> bool:
    """Return whether slight creases can be distinguished from curvature over edges of ``lengths`` (n,).

    The closest points must be exact, and not those of a mesh with vertex values, whose facets have such creases.
    """
    has_facets = any(isinstance(member.source, HasValues) for member in source.members)
    return _is_exact(source, PLANE_SHARES[-1], lengths) and not has_facets


def _is_exact(source: LocalSource, share: float, lengths: Floats) -> bool:
    """Return whether closest points are exact enough for normals at the ``share`` of ``lengths`` (n,) from an edge."""
    return HEIGHT_SHARE * share * float(lengths.min(initial=np.inf)) >= NOISE_FACTOR * source.noise


def sharpen_vertices(mesh: Mesh, source: LocalSource) -> Mesh:
    """Return the mesh with the ends of creased edges moved onto the creases of ``source``.

    Ends on a rim or boundary, or far from the crease, stay. An edge opposite to a moved end is halved where a crease
    crosses the edge, and short edges beside creases are collapsed.
    """
    on_crease = np.zeros(len(mesh.vertices), dtype=bool)
    for _ in range(SHARPENING_ROUNDS):
        creased = creased_edges(mesh, source, farthest=1.0)  # their vertices are not on creases yet
        if not creased.any():
            break
        faces = _faces_at(mesh, creased)
        ends = mesh.edges.ends[faces.node]
        both = (np.concatenate([of, of]) for of in (faces.inward, faces.normals, faces.lengths))
        vertices, found = points_on_creases(source, mesh.vertices, Faces(ends.T.ravel(), *both))
        on_crease |= found
        vertices = np.where(_are_fixed(mesh)[:, None], mesh.vertices, vertices)
        mesh, cells = mesh.with_same_cells(vertices=vertices), mesh.cells
        if not on_crease.any():
            break
        at_crease = on_crease.copy()
        at_crease[ends] = True
        mesh = _halve_crossing_edges(_without_short_edges(mesh, at_crease), source, on_crease)
        on_crease = np.concatenate([on_crease, np.ones(len(mesh.vertices) - len(on_crease), dtype=bool)])
        if mesh.cells is cells:
            break
    return mesh


def _are_fixed(mesh: Mesh) -> Bools:
    """Return whether (v,) each vertex is on a rim or boundary."""
    fixed = np.zeros(len(mesh.vertices), dtype=bool)
    fixed[mesh.cut], fixed[rim_of_vertices(mesh).rows] = True, True
    return fixed


def _without_short_edges(mesh: Mesh, at_crease: Bools) -> Mesh:
    """Return the mesh without edges at creases that are short beside others of their triangle, which are collapsed.

    ``at_crease`` (v,) tells the vertices on creases and of creased edges. An edge is collapsed to such a vertex.
    Vertices on rims and boundaries do not move.
    """
    ends, of_cells, lengths, fixed = mesh.edges.ends, mesh.edges.of_cells, mesh.lengths_of_cells, _are_fixed(mesh)
    longest = lengths.max(axis=1, keepdims=True)
    short = lengths < SHORT_SHARE * longest
    on = np.flatnonzero(at_crease[mesh.cells].all(axis=1))
    thin = on[double_areas(mesh.vertices, mesh.cells[on]) < SLIVER_SHARE * longest[on, 0] ** 2]
    short[thin, lengths[thin].argmin(axis=1)] = True
    rows = np.unique(of_cells[short])
    stays = at_crease.astype(int) + 2 * fixed
    pairs = np.take_along_axis(ends[rows], np.argsort(-stays[ends[rows]], axis=1, kind="stable"), axis=1)
    chosen = np.flatnonzero(at_crease[pairs[:, 0]] & ~fixed[pairs[:, 1]])
    if not len(chosen):
        return mesh
    chosen = chosen[shortest_at_both_ends(pairs[chosen], mesh.edge_lengths[rows[chosen]], len(mesh.vertices))]
    return replace(mesh, cells=collapse_edges(mesh.cells, pairs[chosen], len(mesh.vertices)))


def _halve_crossing_edges(mesh: Mesh, source: LocalSource, on_crease: Bools) -> Mesh:
    """Return the mesh with inner edges opposite to vertices ``on_crease`` (v,) halved where creases cross the edges."""
    edges = mesh.edges
    opposite = np.zeros(len(edges.ends), dtype=bool)
    opposite[edges.of_cells[on_crease[mesh.cells]]] = True
    excluded = mesh.edge_is_cut | mesh.connectivity.on_rim | on_crease[edges.ends].any(axis=1)
    rows = np.flatnonzero(opposite & ~excluded)
    a, b = mesh.vertices[edges.ends[rows]].transpose(1, 0, 2)
    cell = np.zeros(len(edges.ends), dtype=np.int64)
    cell[edges.of_cells] = np.arange(len(mesh.cells))[:, None]
    p, q, r = mesh.vertices[mesh.cells[cell[rows]]].transpose(1, 0, 2)
    faces = Faces.of_sides(np.arange(len(rows)), unit(b - a), unit(np.cross(q - p, r - p)), norms(b - a))
    points, crossed = points_on_creases(source, 0.5 * (a + b), faces)
    if not crossed.any():
        return mesh
    middle = np.full(len(edges.ends), -1)
    middle[rows[crossed]] = len(mesh.vertices) + np.arange(crossed.sum())
    return halve_edges(mesh, middle, points[crossed])


def sharpen_midpoints(mesh: Mesh, source: LocalSource) -> Mesh:
    """Return a mesh of quadratic cells with the midpoints of its creased edges moved onto the creases of ``source``."""
    assert mesh.midpoints is not None
    flat = mesh.with_same_cells(midpoints=None)
    creased = creased_edges(flat, source)
    if not creased.any():
        return mesh
    of_cells = mesh.edges.of_cells
    points = np.empty((len(creased), mesh.dim))
    points[of_cells] = mesh.midpoints
    points, _ = points_on_creases(source, points, _faces_at(flat, creased))
    return mesh.with_same_cells(midpoints=points[of_cells])


def _faces_at(mesh: Mesh, creased: Bools) -> Faces:
    """Return the faces beside the ``creased`` edges (e,) of flat triangles; the nodes are the midpoints of the edges.

    A sliver does not show the plane of its face; it is replaced by the triangle across the edge, continued over it.
    """
    cell, facet = np.nonzero(creased[mesh.edges.of_cells])
    edge = mesh.edges.of_cells[cell, facet]
    order = np.argsort(edge, kind="stable")
    cell, facet, edge = cell[order], facet[order], edge[order]
    a, b, c = mesh.vertices[mesh.cells[cell]].transpose(1, 0, 2)
    normals, inward = np.cross(b - a, c - a), unit(inward_directions(mesh, 3 * cell + facet))
    sliver = norms(normals) < SLIVER_SHARE * mesh.lengths_of_cells[cell].max(axis=1) ** 2
    first, count = np.unique(edge, return_index=True, return_counts=True)[1:]
    pair = first[count == 2, None] + np.arange(2)
    for one, other in (pair.T, pair.T[::-1]):
        alone = sliver[one] & ~sliver[other]
        inward[one[alone]], normals[one[alone]] = -inward[other[alone]], normals[other[alone]]
        sliver[one[alone]] = False
    kept = ~sliver
    return Faces(edge[kept], inward[kept], unit(normals[kept]), mesh.edge_lengths[edge[kept]])


def points_on_creases(source: LocalSource, points: Floats, faces: Faces, farthest: float = 1.0) -> tuple[Floats, Bools]:
    """Return ``points`` (n, d) with the nodes of ``faces`` moved onto creases, and whether (n,) each is on a crease.

    Points that are no nodes stay, as do nodes at smooth places or farther from the crease than the share ``farthest``
    of an edge. A node x moves to the least-squares solution of ``n . (x - p) = 0``, where p are points of the faces
    near x with normals n; the points approach x in several rounds. The manifold is smooth where the turn of the
    normals, extrapolated from the last two distances to zero, is too small.
    """
    nodes, node, times = np.unique(faces.node, return_inverse=True, return_counts=True)
    start, dim = points[nodes], points.shape[1]
    x, length = start.copy(), np.zeros(len(nodes))
    np.maximum.at(length, node, faces.lengths)
    several = (times > 1) & _is_exact(source, PLANE_SHARES[0], faces.lengths)  # whether planes differ in direction
    before: tuple[Floats, float] | None = None
    for share in PLANE_SHARES:
        rows = np.flatnonzero(several[node])
        step, of = share * faces.lengths[rows, None], node[rows]
        if not len(rows) or not _is_exact(source, share, faces.lengths):
            break
        feet = source.closest_point(x[of] + step * faces.inward[rows]).points
        above = feet + HEIGHT_SHARE * step * faces.normals[rows]
        n = unit(above - source.closest_point(above).points)
        distance = dots(n, feet - x[of])
        products = [n[:, i] * value for i in range(dim) for value in (*n.T, distance)]
        sums = np.stack([np.bincount(of, each, len(nodes)) for each in products], axis=1)
        sums = sums.reshape(len(nodes), dim, dim + 1)
        values, vectors = np.linalg.eigh(sums[:, :, :dim])
        large = values > LEAST_SINGULAR_SHARE**2 * values[:, -1:]
        inverse = np.where(large, 1 / np.where(large, values, 1.0), 0.0)
        x += np.einsum("nij,nj,nkj,nk->ni", vectors, inverse, vectors, sums[:, :, dim])
        largest = np.where(values[:, -1] > 0, values[:, -1], 1.0)  # zero without normals
        turn = np.sqrt(np.maximum(values[:, -2], 0.0) / largest)  # tangent of its half
        limit = turn if before is None else (turn * before[1] - before[0] * share) / (before[1] - share)
        several &= limit > LEAST_SINGULAR_SHARE
        before = turn, share
    found = np.flatnonzero(several & (norms(x - start) < farthest * length))
    found = found[source.closest_point(x[found]).distance < ON_MANIFOLD_SHARE * length[found]]
    moved, on_crease = points.copy(), np.zeros(len(points), dtype=bool)
    moved[nodes[found]], on_crease[nodes[found]] = x[found], True
    return moved, on_crease
