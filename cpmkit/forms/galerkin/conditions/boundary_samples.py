"""Samples on boundaries and rims: points on the facets of cells, with the conormals out of these cells.

A facet is an edge of a triangle or an end of a segment; a conormal is tangent to the manifold and normal to the facet.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.source import Rows
from cpmkit.manifold.vector_algebra import dots, normal_frames, norms, unit
from cpmkit.mesh.adjacency import HalfFacets
from cpmkit.mesh.cell_quadrature import Samples
from cpmkit.mesh.mesh import Mesh
from cpmkit.mesh.subdivision import expand_counts
from cpmkit.types import Bools, Floats, Ints

#: A triangle whose height over an edge is below this share of the edge is a sliver: a curved edge deviates by more than
#: the height, so that the conormal cannot be computed from the triangle.
SLIVER_SHARE = 0.1
#: Bounds of the barycentric coordinates within which the polynomial of a triangle is evaluated beyond its edges.
REACH = (-2.0, 3.0)
#: Number of Gauss points of an edge: splines have a kink wherever the edge leaves a lattice cell, and two points
#: distribute a flux through a rim among the splines with errors of .4 % at any spacing.
POINTS_OF_EDGE = 6
#: Points, weights, conormals out of the cell, normals of the manifold.
FacetPoints = tuple[Floats, Floats, Floats, Floats]


def correct_sliver_conormals(
    mesh: Mesh, corners: Ints, cell: Ints, facet: Ints, tangents: Floats, conormals: Floats
) -> Floats:
    """Return ``conormals`` (n, g, d) at g points of each of n edges, recomputed where the triangle is a sliver.

    A sliver has a height over the edge below `SLIVER_SHARE` of the edge. The new conormal is normal to the unit
    ``tangents`` (n, g, d) of the edge, lies in the mean tangent plane of the triangles of ``mesh`` near the ends of the
    edge on the same side of the boundary, and points away from the mean position of these triangles. The edges are
    opposite to corner ``facet`` (n,) of ``cell`` (n,); ``corners`` (m, 3) are the vertices of all cells after cutting.
    """
    ends = (facet[:, None] + np.array([1, 2])) % 3
    tail, head, apex = (mesh.vertices[mesh.cells[cell, k]] for k in (*ends.T, facet))
    chord, side = head - tail, apex - tail
    length = norms(chord)
    height = norms(side - (dots(side, chord) / length**2)[:, None] * chord)
    slivers = np.flatnonzero(height < SLIVER_SHARE * length)
    if not len(slivers):
        return conormals
    inward, normal = _mean_place_and_normal(
        mesh, corners, corners[cell[slivers, None], ends[slivers]], 0.5 * (tail + head)[slivers]
    )
    along, out = tangents[slivers], -inward[:, None]
    normal = normal[:, None] - dots(normal[:, None], along)[..., None] * along
    for axis in (along, unit(normal)):
        out = out - dots(out, axis)[..., None] * axis
    corrected = conormals.copy()
    corrected[slivers] = unit(out)
    return corrected


def _mean_place_and_normal(mesh: Mesh, corners: Ints, at: Ints, midpoints: Floats) -> tuple[Floats, Floats]:
    """Return the mean position (n, d) and unit normal (n, d) of the triangles near pairs ``at`` (n, 2) of vertices.

    Means are weighted by area, over the triangles at these vertices and their neighbours, since a sliver may have only
    slivers beside it. Positions are relative to ``midpoints`` (n, d). Vertices are numbered as in ``corners`` (m, 3),
    after cutting. Normals have either sign, and are zero in the plane.
    """
    order = np.argsort(corners, axis=None, kind="stable")
    starts = np.searchsorted(corners.ravel()[order], np.arange(corners.max() + 2))
    row, vertex = np.repeat(np.arange(len(at)), at.shape[1]), at.ravel()
    for _ in range(2):
        each, rank = expand_counts(np.diff(starts)[vertex])
        cell = order[starts[vertex[each]] + rank] // 3
        near, cell = np.unique(np.stack([row[each], cell]), axis=1)
        row, vertex = np.repeat(near, 3), corners[cell].ravel()
    row = near
    corner = mesh.vertices[mesh.cells[cell]]
    a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = np.sqrt(np.maximum(dots(a, a) * dots(b, b) - dots(a, b) ** 2, 0.0))
    weighted = area[:, None] * (corner.mean(axis=1) - midpoints[row])
    place: Floats = np.stack([np.bincount(row, x, len(at)) for x in weighted.T], axis=1).astype(np.float64)
    if mesh.dim == 2:
        return place, np.zeros_like(place)
    slopes = (a, b) if mesh.midpoints is None else _quadratic_tangents(corner, mesh.midpoints[cell], midpoints[row])
    across = np.sqrt(area)[:, None] * unit(np.cross(*slopes))
    squares = np.array([[np.bincount(row, x * y, len(at)) for x in across.T] for y in across.T])
    normal: Floats = np.linalg.eigh(squares.transpose(2, 0, 1))[1][:, :, -1]
    return place, normal


def _quadratic_tangents(x: Floats, m: Floats, points: Floats) -> tuple[Floats, Floats]:
    """Return two tangents, (n, d) each and not of unit length, of quadratic triangles near ``points`` (n, d).

    They are derivatives by two barycentric coordinates. ``x`` (n, 3, d) are the corners and ``m`` (n, 3, d) the
    midpoints opposite to these. The polynomials are evaluated beyond the edges, within `REACH`, since the tangent plane
    changes between triangle and point with the curvature.
    """
    a, b, p = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], points - x[:, 0]
    aa, ab, bb = dots(a, a), dots(a, b), dots(b, b)
    size = np.maximum(aa * bb - ab**2, np.finfo(float).tiny)
    r = np.clip((bb * dots(a, p) - ab * dots(b, p)) / size, *REACH)[:, None]
    s = np.clip((aa * dots(b, p) - ab * dots(a, p)) / size, *REACH)[:, None]
    t = 1 - r - s
    last = (4 * t - 1) * x[:, 0]
    first = (4 * r - 1) * x[:, 1] - last + 4 * ((t - r) * m[:, 2] + s * (m[:, 0] - m[:, 1]))
    return first, (4 * s - 1) * x[:, 2] - last + 4 * ((t - s) * m[:, 1] + r * (m[:, 0] - m[:, 2]))


def points_on_edges(mesh: Mesh, corners: Ints, cell: Ints, facet: Ints, reversed_: Bools) -> FacetPoints:
    """Return the points (n, g, d), weights (n, g), conormals (n, g, d) and normals (n, g, d - 2, d) on triangle edges.

    Each edge has g = `POINTS_OF_EDGE` Gauss points, with unit conormals out of the cell and unit normals. The edges are
    opposite to corner ``facet`` (n,) of ``cell`` (n,). An edge is traversed against the cell's orientation where
    ``reversed_`` (n,) is true, so that the cells on both of its sides give the same points. ``corners`` (m, 3) are the
    vertices of the cells of ``mesh`` after cutting. A quadratic triangle with corners x, opposite edge midpoints m and
    barycentric coordinates l is ``y = sum_i l_i (2 l_i - 1) x_i + 4 l_(i+1) l_(i+2) m_i``.
    """
    tail, head = (facet + 1) % 3, (facet + 2) % 3
    tail, head = np.where(reversed_, head, tail), np.where(reversed_, tail, head)
    vertices = mesh.vertices[mesh.cells[cell]]
    if mesh.midpoints is None:
        mid: Floats = 0.5 * (np.roll(vertices, -1, axis=1) + np.roll(vertices, -2, axis=1))
    else:
        mid = mesh.midpoints[cell]
    p, q, opposite = (_select_corner(vertices, which) for which in (tail, head, facet))
    m, beside_tail, beside_head = (_select_corner(mid, which) for which in (facet, head, tail))
    gauss, weights = np.polynomial.legendre.leggauss(POINTS_OF_EDGE)
    s = 0.5 * (1 + gauss[:, None])  # from 0 at the tail to 1 at the head
    y = (1 - s) * (1 - 2 * s) * p + 4 * s * (1 - s) * m + s * (2 * s - 1) * q
    along = (4 * s - 3) * p + (4 - 8 * s) * m + (4 * s - 1) * q
    inward = -opposite + 4 * (1 - s) * beside_tail + 4 * s * beside_head  # derivative by the opposite corner's l
    inward = inward - ((3 - 4 * s) * p + 4 * s * m)  # less the derivative by the tail's l: the sum of both is constant
    speed = norms(along)
    tangent = unit(along)
    conormals = unit(dots(inward, tangent)[..., None] * tangent - inward)
    conormals = correct_sliver_conormals(mesh, corners, cell, facet, tangent, conormals)
    normals = np.cross(tangent, conormals)[:, :, None] if mesh.dim == 3 else np.zeros((len(cell), POINTS_OF_EDGE, 0, 2))
    return y, 0.5 * weights * speed, conormals, normals


def ends_of_segments(mesh: Mesh, _corners: Ints, cell: Ints, facet: Ints, _reversed: Bools) -> FacetPoints:
    """Return the points (n, 1, d), weights 1 (n, 1), conormals (n, 1, d) and normals (n, 1, d - 1, d) at segment ends.

    The end is corner 1 - ``facet`` (n,) of segment ``cell`` (n,) of ``mesh``; the conormal is the unit tangent out of
    the segment. The other arguments, which :func:`points_on_edges` needs, are unused.
    """
    vertices = mesh.vertices[mesh.cells[cell]]
    end, other = _select_corner(vertices, 1 - facet), _select_corner(vertices, facet)
    mid = 0.5 * (end + other) if mesh.midpoints is None else mesh.midpoints[cell]
    tangent = unit(3 * end - 4 * mid + other)
    return end, np.ones(end.shape[:2]), tangent, normal_frames(tangent[:, 0])[:, None]


def _select_corner(values: Floats, which: Ints) -> Floats:
    """Return for each cell the point (n, 1, d) with number ``which`` (n,) among its points ``values`` (n, k, d)."""
    return np.take_along_axis(values, which[:, None, None], axis=1)


@dataclass(frozen=True, eq=False)
class BoundarySamples(Rows):
    """Points at which conditions are imposed: `POINTS_OF_EDGE` on an edge of a triangle, one at an end of a segment.

    A facet between two cells has these samples twice, once per cell, at the same points and in the same order. A
    boundary that is a point of a surface has one sample.
    """

    points: Floats  #: (b, d): positions relative to the lattice's origin.
    weights: Floats  #: (b,): quadrature weights for integrals along the boundary; 1 where the boundary is a point.
    #: (b, d): unit vectors tangent to the manifold and normal to the boundary, out of the cell; zero where the boundary
    #: is a point of a surface.
    conormals: Floats
    normals: Floats  #: (b, c, d): orthonormal bases of the normal space of the manifold.
    cell: Ints  #: (b,): the cell of each sample.
    centres: Floats  #: (b, d): the mean of the corners of that cell; at points of a surface the point.
    half: Ints  #: (b,): the row in `HalfFacets` of the sample's cell and facet; -1 at points of a surface.
    #: (b,): the number of the facet in ``mesh.cut``; -1 on rims where no boundary lies, and at points of a surface.
    facet: Ints
    place: Ints  #: (b,): the number of the sample along the facet, from 0.
    owner: Ints  #: (b,): the number of the boundary; -1 on rims where no boundary lies, and on creases and junctions.
    beyond_tip: Bools  #: (b,): whether the facet lies on the continuation of its boundary past a tip.

    @property
    def on_rim(self) -> Bools:
        """(b,) whether a sample is on the rim, where no boundary lies."""
        return np.asarray((self.owner < 0) & (self.facet < 0))

    @property
    def on_tie(self) -> Bools:
        """(b,) whether u is continuous across the facet: on creases, junctions, and boundaries past their tips."""
        return np.asarray(self.beyond_tip | ((self.owner < 0) & (self.facet >= 0)))

    @property
    def as_samples(self) -> Samples:
        """These b points as quadrature samples of weight zero: u is evaluated there, but nothing is integrated."""
        return Samples(self.points, np.zeros(len(self)), self.normals, self.cell)


def boundary_samples(
    mesh: Mesh, half: HalfFacets, corners: Ints, rims: bool, points: Mapping[int, Ints] | None = None
) -> BoundarySamples:
    """Return the samples on the facets of boundaries, and with ``rims`` also those on all other facets of the rim.

    ``mesh`` has flat or quadratic cells, ``half`` are its facets on boundaries and rims, once for each cell beside
    them, and ``corners`` (m, k) the vertices of the cells after cutting. ``points`` maps the number of each boundary
    that consists of points of a surface to their vertices (k,), whose samples come last; None if there are none.
    """
    chosen = np.flatnonzero((half.cut >= 0) | rims)
    facet_points = points_on_edges if mesh.manifold_dim == 2 else ends_of_segments
    cell, facet, cut = half.cell[chosen], half.facet[chosen], half.cut[chosen]
    x, weights, conormals, normals = facet_points(mesh, corners, cell, facet, half.along[chosen] < 0)
    each = x.shape[1]
    rows, cut_rows = np.repeat(np.arange(len(chosen)), each), np.flatnonzero(cut >= 0)
    owner, beyond_tip = np.full(len(chosen), -1), np.zeros(len(chosen), dtype=bool)
    owner[cut_rows], beyond_tip[cut_rows] = mesh.owner[cut[cut_rows]], mesh.beyond_tip[cut[cut_rows]]
    samples = BoundarySamples(
        x.reshape(-1, mesh.dim),
        weights.ravel(),
        conormals.reshape(-1, mesh.dim),
        normals.reshape(-1, *normals.shape[2:]),
        cell[rows],
        mesh.vertices[mesh.cells[cell]].mean(axis=1)[rows],
        chosen[rows],
        cut[rows],
        np.tile(np.arange(each), len(chosen)),
        owner[rows],
        beyond_tip[rows],
    )
    return BoundarySamples.join([samples, _vertex_samples(mesh, corners, points)]) if points else samples


def _vertex_samples(mesh: Mesh, corners: Ints, points: Mapping[int, Ints]) -> BoundarySamples:
    """Return samples at boundaries that are points of a surface, each in the first triangle at its vertex.

    ``points`` maps the number of a boundary to its vertices (k,); ``corners`` (m, 3) are the vertices of all triangles
    after the mesh was cut along boundaries. Weights are 1, conormals zero, and ``half`` and ``facet`` -1.
    """
    owner = np.repeat(list(points), [len(vertices) for vertices in points.values()])
    vertex = np.concatenate(list(points.values()))
    order = np.argsort(mesh.cells, axis=None, kind="stable")
    cell = order[np.searchsorted(mesh.cells.ravel()[order], vertex)] // mesh.cells.shape[1]
    normals = points_on_edges(mesh, corners, cell, np.zeros_like(cell), np.zeros(len(cell), dtype=bool))[3][:, 0]
    none, x = np.full(len(cell), -1), mesh.vertices[vertex]
    nowhere = np.zeros(len(cell), dtype=bool)
    return BoundarySamples(
        x, np.ones(len(cell)), np.zeros_like(x), normals, cell, x, none, none, np.zeros_like(cell), owner, nowhere
    )
