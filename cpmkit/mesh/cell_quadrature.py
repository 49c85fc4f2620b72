"""Quadrature on the cells of a mesh: points, weights and normals, on whole cells or on pieces between knot planes.

A piece is a part of a triangle inside one lattice cell. There splines are polynomials, which are integrated to the
degree of the rule. On whole triangles the error of a rule depends on their size relative to a lattice cell.

Where flat triangles approximate a curved surface, the gradient of u has kinks at their edges, proportional to the angle
between them, which splines do not have between knot planes. The rule on a piece need not be more accurate than this
error.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from itertools import chain
from typing import Any

import numpy as np

from cpmkit.manifold.vector_algebra import norms, unit
from cpmkit.mesh.mesh import CellGeometry, Mesh
from cpmkit.types import Bools, Floats, Ints

#: Values of the option ``samples``: clip where it pays, never, or always.
SAMPLINGS = ("auto", "plain", "clipped")
#: Longest edge of whole triangles, in spacings: three points a triangle then resolve every spline.
PLAIN_EDGE_SPACINGS = 0.5
#: Longest edge of clipped curved triangles, in spacings: 19 samples an unknown; on a sphere the error differs by 3 %
#: from that of edges half as long.
CLIPPED_EDGE_SPACINGS = 0.7
#: Longest edge of clipped flat triangles, in spacings: the error is that of whole triangles with edges half as long,
#: with a tenth to a quarter fewer samples (measured on a square, a cube and Spot).
CLIPPED_FLAT_EDGE_SPACINGS = 1.0
#: Pieces of flat triangles get one point if their area times their squared length, in spacings, is below this times
#: the sine of the least angle to a neighbouring triangle,
SINGLE_MOMENT_OF_ANGLE = 0.5
#: and below this. On Spot the errors are then those of all samples to 1 percent, at three spacings, with five eighths
#: of the samples; on a ball of 1,280 facets, under smooth data, 1 to 4 percent more with three fifths; on Spot and a
#: koala of 100,000 triangles, left whole on coarse lattices, up to 5 percent more with one sample a triangle.
MOST_SINGLE_MOMENT = 5e-3
#: The limit of area times squared length, in spacings, for whole curved triangles, on lattices far coarser than a mesh.
#: A sphere of 82,000 triangles and a torus of 58,000 have the same errors to 1 percent, Nefertiti and a koala of
#: 100,000 up to 7 percent larger errors, with a third to three quarters of the samples; with ten times the limit the
#: error on the sphere is a sixth larger.
CURVED_SINGLE_MOMENT = 1e-4
#: Triangles that are processed together: temporary arrays stay small beside the samples.
TRIANGLES_AT_ONCE = 1 << 11


def is_clipped(sampling: str, manifold_dim: int) -> bool:
    """Return whether ``sampling`` lets triangles be clipped at knot planes; segments end on knot planes in any case."""
    return manifold_dim == 2 and sampling != "plain"


def needs_degree_four(degree: int, geometry: CellGeometry) -> bool:
    """Return whether pieces of triangles need a rule of degree 4: for cubic splines on cells curved by closest points.

    On other meshes the error of the mesh dominates, so that the total error is the same without such a rule (measured).
    """
    return degree == 3 and geometry == "closest_point"


def longest_edge(sampling: str, geometry: CellGeometry, manifold_dim: int) -> float:
    """Return the largest length of cell edges, in spacings, that the quadrature needs for its accuracy."""
    if not is_clipped(sampling, manifold_dim):
        return PLAIN_EDGE_SPACINGS
    return CLIPPED_FLAT_EDGE_SPACINGS if geometry == "flat" else CLIPPED_EDGE_SPACINGS


def triangles_to_clip(mesh: Mesh, sampling: str, geometry: CellGeometry, spacing: float) -> Bools:
    """Return whether each triangle (m,) is clipped at knot planes; with "auto" small flat triangles are not."""
    if not is_clipped(sampling, mesh.manifold_dim):
        return np.zeros(len(mesh.cells), dtype=bool)
    if sampling == "clipped" or geometry != "flat":
        return np.ones(len(mesh.cells), dtype=bool)
    from cpmkit.mesh.subdivision_kernels import with_long_edges

    return with_long_edges(mesh.vertices, np.ascontiguousarray(mesh.cells), PLAIN_EDGE_SPACINGS * float(spacing))


def one_point_limits(mesh: Mesh, spacing: float) -> Floats:
    """Return for each triangle the moment (m,) below which its pieces get a single quadrature point.

    The moment of a piece is its area times its squared length, in spacings. The limit is zero for triangles that touch
    a boundary, because little of a lattice cell may lie on one side of it; for flat triangles in the plane of a
    neighbour, or with an edge that belongs to one triangle or more than two; and for curved triangles that are not
    small as a whole.
    """
    from cpmkit.mesh.whole_triangle_kernels import least_turning_sine, mark_small_triangles

    cells = np.ascontiguousarray(mesh.cells)
    if mesh.midpoints is None:
        sine = least_turning_sine(mesh.vertices, cells, mesh.edges.of_cells)
        limits: Floats = np.minimum(SINGLE_MOMENT_OF_ANGLE * sine, MOST_SINGLE_MOMENT)
    else:
        limits = np.zeros(len(mesh.cells))  # untouched zeros take no memory
        mark_small_triangles(mesh.vertices, cells, spacing, CURVED_SINGLE_MOMENT, limits)
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
    of degree 2, tiny pieces their centroid; with ``fine`` pieces get six points of degree 4 on each triangle of their
    fan. The weights contain the measure of the flat or quadratic cell: the speed of a curve, |x_r x x_s| on a surface.

    Parameters
    ----------
    mesh : Mesh
        Flat or quadratic cells.
    clipped_at : float, optional
        The spacing h of the lattice if triangles are clipped at its knot planes x = (k + 1/2) h, else None.
    further : Samples, optional
        Samples that are appended.
    clipped : (m,) bool, optional
        Which triangles are clipped; by default all.
    fine : bool
        Whether pieces between knot planes get a rule of degree 4.
    """
    parts = [_segment_samples(mesh)] if mesh.manifold_dim == 1 else _triangle_parts(mesh, clipped_at, clipped, fine)
    return _concatenate(chain(parts, [] if further is None else [_fields_of_samples(further)]))


def _segment_samples(mesh: Mesh) -> list[Any]:
    """Return the fields of `Samples` for the segments of a mesh: points, weights, normals and cells."""
    shares, slopes, weights = _segment_rule(mesh)
    tangents = _combine_nodes(mesh, slopes)
    cell = np.repeat(np.arange(len(mesh.cells)), len(weights))
    speed = np.tile(weights, len(mesh.cells)) * norms(tangents)
    return _fields_of_samples(Samples(_combine_nodes(mesh, shares), speed, _normal_frames(tangents), cell))


def _triangle_parts(mesh: Mesh, clipped_at: float | None, clipped: Bools | None, fine: bool) -> Iterator[list[Any]]:
    """Yield the fields of `Samples` for `TRIANGLES_AT_ONCE` triangles at a time; arguments as of :func:`quadrature`."""
    spacing, cells = 1.0 if clipped_at is None else float(clipped_at), np.ascontiguousarray(mesh.cells)
    midpoints = np.empty((len(cells), 0, 3)) if mesh.midpoints is None else np.ascontiguousarray(mesh.midpoints)
    if clipped is None or clipped_at is None:
        clipped = np.full(len(mesh.cells), clipped_at is not None)
    limits = np.zeros(len(mesh.cells)) if clipped_at is None else one_point_limits(mesh, spacing)
    for start in range(0, max(len(cells), 1), TRIANGLES_AT_ONCE):
        rows = slice(start, start + TRIANGLES_AT_ONCE)
        arguments = mesh.vertices, cells[rows], midpoints[rows], spacing, clipped[rows], limits[rows]
        if fine or not limits[rows].any():
            *others, cell = _all_samples(*arguments, fine)
        else:
            *others, cell = _samples_single_first(*arguments)
        yield [*others, cell + np.int32(start)]


def _all_samples(
    vertices: Floats, cells: Ints, midpoints: Floats, spacing: float, clipped: Bools, limits: Floats, fine: bool
) -> list[Any]:
    """Return the points, weights, normals and triangle numbers of samples, in the order of the triangles.

    Arguments from ``spacing`` on are those of `triangle_samples`, with ``limits`` for ``single``.
    """
    from cpmkit.mesh.clipping_kernels import triangle_samples
    from cpmkit.mesh.whole_triangle_kernels import gather_nodes

    return list(triangle_samples(gather_nodes(vertices, cells, midpoints), spacing, clipped, limits, fine))


def _samples_single_first(
    vertices: Floats, cells: Ints, midpoints: Floats, spacing: float, clipped: Bools, limits: Floats
) -> list[Any]:
    """Return what `_all_samples` returns, faster if many triangles get a single point: these are sampled first."""
    from cpmkit.mesh.whole_triangle_kernels import one_point_samples

    count = len(cells)
    single: Any = np.empty((count, 3)), np.empty(count), np.empty((count, 1, 3)), np.empty(count, dtype=np.int32)
    remaining = np.empty(count, dtype=np.int64)
    used, others = one_point_samples(vertices, cells, midpoints, spacing, clipped, limits, single, remaining)
    if not others:
        return list(single)
    rows = remaining[:others]
    *several, triangle = _all_samples(
        vertices, cells[rows], midpoints[rows], spacing, clipped[rows], limits[rows], False
    )
    several.append(rows[triangle].astype(np.int32))
    both: list[Any] = [np.concatenate([first[:used], second]) for first, second in zip(single, several, strict=True)]
    order = np.argsort(both[3], kind="stable")
    return [array[order] for array in both]


def _fields_of_samples(samples: Samples) -> list[Any]:
    """Return the fields of ``samples``: points, weights, normals and cells."""
    return [getattr(samples, field.name) for field in fields(Samples)]


def _concatenate(parts: Iterable[list[Any]]) -> Samples:
    """Return the samples whose fields are in ``parts``, one after the other; arrays grow in place to save memory."""
    whole: list[Any] = []
    for part in parts:
        if not whole:
            whole = [np.array(array) for array in part]
            continue
        for array, more in zip(whole, part, strict=True):
            before = len(array)
            array.resize((before + len(more), *array.shape[1:]), refcheck=False)  # there is no view of it
            array[before:] = more
    return Samples(*whole)


def _combine_nodes(mesh: Mesh, shares: Floats) -> Floats:
    """Return for each of m cells the q linear combinations of its nodes with coefficients ``shares`` (q, nodes).

    The result is (m q, d), in the order of the cells; the nodes of a cell are its corners, then its midpoints.
    """
    nodes = mesh.vertices[mesh.cells.T]
    if mesh.midpoints is not None:
        nodes = np.concatenate([nodes, mesh.midpoints.transpose(1, 0, 2)])
    combined = shares @ nodes.reshape(len(nodes), -1)
    by_cell = combined.reshape(len(shares), -1, mesh.dim).transpose(1, 0, 2)
    return np.ascontiguousarray(by_cell).reshape(-1, mesh.dim)


def _segment_rule(mesh: Mesh) -> tuple[Floats, Floats, Floats]:
    """Return shape functions (3, nodes), their derivatives (3, nodes) and weights (3,) at a segment's Gauss points.

    Derivatives are with respect to the coordinate from 0 at the start to 1 at the end.
    """
    gauss, weights = np.polynomial.legendre.leggauss(3)
    t = 0.5 * (gauss + 1)
    if mesh.midpoints is None:
        return np.stack([1 - t, t], axis=1), np.tile([-1.0, 1.0], (3, 1)), 0.5 * weights
    shares = np.stack([(1 - t) * (1 - 2 * t), t * (2 * t - 1), 4 * t * (1 - t)], axis=1)
    return shares, np.stack([4 * t - 3, 4 * t - 1, 4 - 8 * t], axis=1), 0.5 * weights


def _normal_frames(tangents: Floats) -> Floats:
    """Return orthonormal bases (n, d - 1, d) of the spaces perpendicular to ``tangents`` (n, d)."""
    t = unit(tangents)
    if t.shape[1] == 2:
        return np.stack([t[:, 1], -t[:, 0]], axis=1)[:, None]
    # The axis with the largest angle to the tangent: in the worst case 54 degrees.
    axis = np.eye(3)[np.argmin(np.abs(t), axis=1)]
    first = unit(np.cross(t, axis))
    return np.stack([first, np.cross(t, first)], axis=1)


@dataclass(frozen=True, eq=False)
class Samples:
    """Quadrature points of the manifold, over which every integral is summed.

    Attributes
    ----------
    points : (q, d) float64
        Positions relative to the lattice's origin.
    weights : (q,) float64
        Quadrature weights, whose sum is the measure of the manifold; zero for samples on boundaries, at which u is only
        evaluated.
    normals : (q, c, d) float64
        Orthonormal bases of the normal space, of dimension c = d - manifold_dim.
    cell : (q,) int32
        The cell of the mesh that contains each sample.
    """

    points: Floats
    weights: Floats
    normals: Floats
    cell: Any

    def __post_init__(self) -> None:
        object.__setattr__(self, "cell", np.ascontiguousarray(self.cell, dtype=np.int32))

    def __len__(self) -> int:
        return len(self.points)

    def points_at(self, rows: slice | Ints) -> Floats:
        """Return the points (..., d) of the samples ``rows`` (...)."""
        return np.asarray(self.points[rows])

    def normals_at(self, rows: slice | Ints) -> Floats:
        """Return the normals (..., c, d) of the samples ``rows`` (...)."""
        return np.asarray(self.normals[rows])

    def cell_at(self, rows: Ints) -> Ints:
        """Return the cells (...) of the samples ``rows`` (...)."""
        return np.asarray(self.cell[rows])
