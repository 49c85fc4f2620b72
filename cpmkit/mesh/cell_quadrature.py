"""Quadrature on the cells of a mesh: points, weights and normals, on whole cells or on pieces between knot planes.

A piece is a part of a triangle inside one lattice cell. On a piece splines are polynomials, for which a rule is exact
up to its degree. On whole triangles the error of a rule depends on their size relative to a lattice cell.

Where flat triangles approximate a curved surface, the gradient of u has kinks at their edges, proportional to the angle
between the triangles, which splines cannot represent. No rule on a piece need be more accurate than this error.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from itertools import chain
from typing import Any

import numpy as np

from cpmkit.manifold.source import ClosestPointSource, Rows
from cpmkit.manifold.vector_algebra import normal_frames, norms, unit
from cpmkit.mesh.adjacency import rim_of_edges
from cpmkit.mesh.mesh import CellGeometry, Mesh
from cpmkit.types import Bools, Floats, Ints

#: Values of the option ``samples``: clip where it pays, never, or always.
SAMPLINGS = ("auto", "plain", "clipped")
#: Longest edge of whole triangles, in spacings: three points a triangle then resolve every spline.
PLAIN_EDGE_SPACINGS = 0.5
#: Longest edge of clipped curved triangles, in spacings: 19 samples an unknown; on a sphere the error differs by 3 %
#: from that with edges half as long.
CLIPPED_EDGE_SPACINGS = 0.7
#: Longest edge of clipped flat triangles, in spacings: the error is that of whole triangles with edges half as long,
#: with a tenth to a quarter fewer samples (measured on a square, a cube and Spot).
CLIPPED_FLAT_EDGE_SPACINGS = 1.0
#: Pieces of flat triangles get one point if their area times their squared length, in spacings, is below this times
#: the sine of the least angle between the triangle and a neighbour,
SINGLE_MOMENT_OF_ANGLE = 0.5
#: and below this. On Spot the errors are then those with all samples to 1 percent, at three spacings, with five eighths
#: of the samples; on a ball of 1,280 facets, with smooth data, 1 to 4 percent larger with three fifths; on Spot and a
#: koala of 100,000 triangles, not clipped on coarse lattices, up to 5 percent larger with one sample a triangle.
MOST_SINGLE_MOMENT = 5e-3
#: The limit of area times squared length, in spacings, for whole curved triangles, on lattices far coarser than a mesh.
#: A sphere of 82,000 triangles and a torus of 58,000 have the same errors to 1 percent, Nefertiti and a koala of
#: 100,000 up to 7 percent larger errors, with a third to three quarters of the samples; with ten times the limit the
#: error on the sphere is a sixth larger.
CURVED_SINGLE_MOMENT = 1e-4
#: Triangles that are processed together: temporary arrays stay small beside the samples.
TRIANGLES_AT_ONCE = 1 << 11


@dataclass(frozen=True, eq=False)
class Samples(Rows):
    """Quadrature points of the manifold, over which every integral is summed."""

    points: Floats  #: (q, d): positions relative to the lattice's origin.
    #: (q,): quadrature weights, whose sum is the measure of the manifold; zero for samples on boundaries, at which u is
    #: only evaluated.
    weights: Floats
    normals: Floats  #: (q, c, d): orthonormal bases of the normal space, of dimension c = d - manifold_dim.
    cell: Any  #: (q,) int32: the cell of the mesh that contains each sample.

    def __post_init__(self) -> None:
        object.__setattr__(self, "cell", np.ascontiguousarray(self.cell, dtype=np.int32))

    def points_at(self, rows: slice | Ints) -> Floats:
        """Return the points (..., d) of the samples ``rows`` (...)."""
        return np.asarray(self.points[rows])

    def normals_at(self, rows: slice | Ints) -> Floats:
        """Return the normals (..., c, d) of the samples ``rows`` (...)."""
        return np.asarray(self.normals[rows])

    def cell_at(self, rows: Ints) -> Ints:
        """Return the cells (...) of the samples ``rows`` (...)."""
        return np.asarray(self.cell[rows])


def is_clipped(sampling: str, manifold_dim: int) -> bool:
    """Return whether ``sampling``, one of :data:`SAMPLINGS`, clips triangles at knot planes; False for segments."""
    return manifold_dim == 2 and sampling != "plain"


def needs_degree_four(degree: int, geometry: CellGeometry) -> bool:
    """Return whether pieces of triangles need a rule of degree 4: for cubic splines on cells curved by closest points.

    ``degree`` is that of the splines. On other meshes the error of the mesh dominates, so that the total error is the
    same without such a rule (measured).
    """
    return degree == 3 and geometry == "closest_point"


def longest_edge(sampling: str, geometry: CellGeometry, manifold_dim: int) -> float:
    """Return the largest length of cell edges, in spacings, with which quadrature by ``sampling`` is accurate."""
    if not is_clipped(sampling, manifold_dim):
        return PLAIN_EDGE_SPACINGS
    return CLIPPED_FLAT_EDGE_SPACINGS if geometry == "flat" else CLIPPED_EDGE_SPACINGS


def triangles_to_clip(mesh: Mesh, sampling: str, geometry: CellGeometry, spacing: float) -> Bools:
    """Return whether (m,) each cell is clipped at knot planes: no segment, and no cell if ``sampling`` is "plain".

    With "clipped" all triangles are clipped, with "auto" curved triangles, and flat triangles with an edge longer than
    ``PLAIN_EDGE_SPACINGS``.
    """
    if not is_clipped(sampling, mesh.manifold_dim):
        return np.zeros(len(mesh.cells), dtype=bool)
    if sampling == "clipped" or geometry != "flat":
        return np.ones(len(mesh.cells), dtype=bool)
    return np.asarray(mesh.lengths_of_cells.max(axis=1) > PLAIN_EDGE_SPACINGS * spacing)


def one_point_limits(mesh: Mesh, spacing: float) -> Floats:
    """Return for each triangle the moment (m,) below which its pieces get a single quadrature point.

    The moment of a piece is its area times its squared length, in spacings. The limit is zero for triangles that touch
    a boundary, because little of a lattice cell may lie on one side of the boundary; for flat triangles that have a
    neighbour in the same plane, or an edge not of exactly two triangles; and for curved triangles that are not small.
    """
    if mesh.midpoints is None:
        a, b, c = (mesh.vertices[mesh.cells[:, k]] for k in range(3))
        normals, edge = unit(np.cross(b - a, c - a)), mesh.edges.of_cells.ravel()
        count = np.bincount(edge, minlength=len(mesh.edges.ends))
        pairs = np.argsort(edge, kind="stable")[(count == 2)[np.sort(edge)]].reshape(-1, 2) // 3
        sine = np.zeros(len(count))
        sine[count == 2] = norms(np.cross(normals[pairs[:, 0]], normals[pairs[:, 1]]))
        sine = sine[mesh.edges.of_cells].min(axis=1, initial=1.0)
        limits: Floats = np.minimum(SINGLE_MOMENT_OF_ANGLE * sine, MOST_SINGLE_MOMENT)
    else:
        limits = np.zeros(len(mesh.cells))  # untouched zeros take no memory
        for start in range(0, len(limits), TRIANGLES_AT_ONCE):
            rows = slice(start, start + TRIANGLES_AT_ONCE)
            corners = mesh.vertices[mesh.cells[rows]] / spacing
            a, b, c = corners.transpose(1, 0, 2)
            moments = 0.5 * norms(np.cross(b - a, c - a)) * np.sum(np.ptp(corners, axis=1) ** 2, axis=1)
            limits[rows][moments < CURVED_SINGLE_MOMENT] = CURVED_SINGLE_MOMENT
    if len(mesh.cut):
        on_boundary = np.zeros(len(mesh.vertices), dtype=bool)
        on_boundary[mesh.cut] = True
        limits[on_boundary[mesh.cells].any(axis=1)] = 0.0
    return limits


def quadrature(
    mesh: Mesh,
    clipped_at: float | None = None,
    further: Samples | None = None,
    clipped: Bools | None = None,
    fine: bool = False,
) -> Samples:
    """Return the quadrature points of all cells, in the order of the cells, followed by ``further`` samples.

    Segments get the three points of Gauss's rule of degree 5. Whole triangles get the three points of degree 2 with
    barycentric coordinates (2/3, 1/6, 1/6). Pieces between knot planes get four points of degree 3, small pieces three
    of degree 2; with ``fine`` all get six points of degree 4 on each triangle of their fan. With ``clipped_at``, tiny
    whole triangles and, without ``fine``, tiny pieces get their centroid, see :func:`one_point_limits`. The weights
    contain the measure of the flat or quadratic cell: the speed of a curve, |x_r x x_s| on a surface.

    ``mesh``: flat or quadratic segments, or triangles in space.
    ``clipped_at``: the spacing h of the lattice if triangles are clipped at its knot planes x = (k + 1/2) h, else None.
    ``further``: samples that are appended.
    ``clipped`` (m,): which triangles are clipped there; by default all.
    ``fine``: whether pieces between knot planes get a rule of degree 4.
    """
    if mesh.manifold_dim == 1:
        points, tangents, weights, _ = quadratic_rule(mesh)
        cell = np.repeat(np.arange(len(mesh.cells)), weights.shape[1])
        at, along = points.reshape(-1, mesh.dim), tangents.reshape(-1, mesh.dim)
        parts: Iterable[Samples] = [Samples(at, weights.ravel(), normal_frames(along), cell)]
    else:
        parts = _triangle_parts(mesh, clipped_at, clipped, fine)
    return _concatenate(chain(parts, [] if further is None else [further]))


def _triangle_parts(mesh: Mesh, clipped_at: float | None, clipped: Bools | None, fine: bool) -> Iterator[Samples]:
    """Yield the samples of `TRIANGLES_AT_ONCE` triangles at a time; arguments as of :func:`quadrature`."""
    from cpmkit.mesh.clipping_kernels import fill_samples
    from cpmkit.mesh.polygon_rules import MOST_CORNERS

    spacing, cells = 1.0 if clipped_at is None else float(clipped_at), mesh.cells
    midpoints = np.empty((len(cells), 0, 3)) if mesh.midpoints is None else mesh.midpoints
    if clipped is None or clipped_at is None:
        clipped = np.full(len(mesh.cells), clipped_at is not None)
    limits = np.zeros(len(mesh.cells)) if clipped_at is None else one_point_limits(mesh, spacing)
    room, pieces, start = 16 * TRIANGLES_AT_ONCE, 64, 0
    while True:
        rows = slice(start, start + TRIANGLES_AT_ONCE)
        nodes = np.concatenate([mesh.vertices[cells[rows]], midpoints[rows]], axis=1)
        points, weights, normals = np.empty((room, 3)), np.empty(room), np.empty((room, 1, 3))
        cell, stack = np.empty(room, dtype=np.int32), np.empty((pieces, MOST_CORNERS + 2, 5))
        limit, cut = limits[rows], clipped[rows]
        used, done = fill_samples(nodes, spacing, cut, limit, fine, points, weights, normals, cell, stack)
        yield Samples(points[:used], weights[:used], normals[:used], cell[:used] + np.int32(start))
        start += done
        if start == len(cells):
            return
        if done == 0:  # the arrays are too small for one triangle
            room, pieces = 2 * room, 2 * pieces


def _concatenate(parts: Iterable[Samples]) -> Samples:
    """Return the samples ``parts``, at least one, one after the other; arrays grow in place to save memory."""
    whole: list[Any] = []
    for part in parts:
        arrays = [getattr(part, field.name) for field in fields(Samples)]
        if not whole:
            whole = [np.array(array) for array in arrays]
            continue
        for array, more in zip(whole, arrays, strict=True):
            before = len(array)
            array.resize((before + len(more), *array.shape[1:]), refcheck=False)  # no view of the array exists
            array[before:] = more
    return Samples(*whole)


#: The rule of degree 4 on a triangle with six points (Strang and Fix 1973): for two groups of three points with the
#: barycentric coordinates (a, a, 1 - 2 a) in any order, the number a and the weight of each point.
TRIANGLE_RULE = ((0.091576213509770743, 0.109951743655321868), (0.445948490915964886, 0.223381589678011466))
#: The rim is searched for beyond the midpoint of a rim edge, outwards by this share of the edge's length.
OUTWARD_EDGE_SHARE = 0.5
#: A midpoint whose closest point is farther away than this share of its edge's length stays on the chord.
MOVED_MIDDLE_SHARE = 0.25


def quadratic_rule(mesh: Mesh) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the points, tangents, weights and shape functions of quadrature on segments, triangles or points.

    Segments get the three points of Gauss's rule of degree 5, triangles six points of degree 4. Flat cells are treated
    as quadratic cells with midpoints halfway along the edges.

    Returned ``points`` (m, q, d).
    Returned ``tangents`` (m, q, a, d): derivatives of the position along the a = manifold_dim coordinates of a cell: t
        from 0 to 1 along a segment, the first two barycentric coordinates of a triangle.
    Returned ``weights`` (m, q): contain the length or area element.
    Returned ``shares`` (q, k): the shape functions of the k nodes of a cell: its corners, then its midpoints.
    """
    shares, slopes, weights = (_point_functions, _segment_functions, _triangle_functions)[mesh.manifold_dim]()
    nodes = mesh.vertices[mesh.cells]
    if mesh.manifold_dim:
        straight = mesh.vertices[mesh.edges.ends].mean(axis=1)[mesh.edges.of_cells]
        nodes = np.concatenate([nodes, straight if mesh.midpoints is None else mesh.midpoints], axis=1)
    tangents = np.einsum("qka,mkd->mqad", slopes, nodes)
    gram = np.einsum("mqad,mqbd->mqab", tangents, tangents)
    determinant = np.linalg.det(gram) if mesh.manifold_dim else np.ones(gram.shape[:2])
    return np.einsum("qk,mkd->mqd", shares, nodes), tangents, weights * np.sqrt(np.maximum(determinant, 0.0)), shares


def _point_functions() -> tuple[Floats, Floats, Floats]:
    """Return the shape function (1, 1) of a point, an empty array (1, 1, 0) of derivatives, and the weight (1,)."""
    return np.ones((1, 1)), np.zeros((1, 1, 0)), np.ones(1)


def _segment_functions() -> tuple[Floats, Floats, Floats]:
    """Return the shape functions (3, 3), derivatives (3, 3, 1) and weights (3,) of quadratic segments.

    Rows are the three Gauss points of [0, 1], columns the nodes 0, 1, 1/2.
    """
    gauss, weights = np.polynomial.legendre.leggauss(3)
    t = 0.5 * (gauss + 1)
    shares = np.stack([(1 - t) * (1 - 2 * t), t * (2 * t - 1), 4 * t * (1 - t)], axis=1)
    slopes = np.stack([4 * t - 3, 4 * t - 1, 4 - 8 * t], axis=1)[:, :, None]
    return shares, slopes, 0.5 * weights


def _triangle_functions() -> tuple[Floats, Floats, Floats]:
    """Return the shape functions (6, 6), their derivatives (6, 6, 2) and the weights (6,) of the triangle rule.

    Rows are quadrature points; derivatives are with respect to the first two barycentric coordinates.
    """
    points = [np.roll([1 - 2 * a, a, a], k) for a, _ in TRIANGLE_RULE for k in range(3)]
    weights = np.repeat([0.5 * weight for _, weight in TRIANGLE_RULE], 3)
    bary = np.array(points)
    second, third = np.roll(bary, -1, axis=1), np.roll(bary, -2, axis=1)  # at the edge opposite to each corner
    shares = np.hstack([bary * (2 * bary - 1), 4 * second * third])
    # Derivatives along (l0, l1), with l2 = 1 - l0 - l1.
    along = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]])
    corner = (4 * bary - 1)[:, :, None] * along
    middle = 4 * (third[:, :, None] * np.roll(along, -1, axis=0) + second[:, :, None] * np.roll(along, -2, axis=0))
    return shares, np.concatenate([corner, middle], axis=1), weights


def project_edge_midpoints(surface: ClosestPointSource, mesh: Mesh) -> Floats:
    """Return the closest points (e, d) on ``surface`` of the midpoints of a mesh's edges; for rim edges on the rim.

    A rim edge gets the closest point of a point beyond its midpoint, if it is on the surface's rim. A midpoint stays on
    the chord if the closest point is farther away than ``MOVED_MIDDLE_SHARE`` of the edge's length.
    """
    straight, rim = mesh.vertices[mesh.edges.ends].mean(axis=1), rim_of_edges(mesh)
    moved = surface.closest_point(straight).points.copy()
    beyond = surface.closest_point(straight[rim.rows] + OUTWARD_EDGE_SHARE * rim.outward)
    moved[rim.rows[beyond.edge >= 0]] = beyond.points[beyond.edge >= 0]
    return limit_midpoint_shift(straight, moved, mesh.edge_lengths)


def limit_midpoint_shift(straight: Floats, moved: Floats, length: Floats) -> Floats:
    """Return ``moved`` (e, d), except ``straight`` (e, d) where the shift is too large for the edge's ``length`` (e,).

    A shift above ``MOVED_MIDDLE_SHARE`` of the length leads to another part of the surface.
    """
    far = np.linalg.norm(moved - straight, axis=1) > MOVED_MIDDLE_SHARE * length
    return np.where(far[:, None], straight, moved)
