"""The samples of a mesh: points, weights and normals of its cells, flat or quadratic, whole or clipped."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields
from itertools import chain
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.quadrature.samples import Samples
from cpmkit.manifold.vector_algebra import norms, unit
from cpmkit.mesh.mesh import CellGeometry, Mesh
from cpmkit.types import Bools, Floats, Ints

#: Pieces with the area times the square of the length, in spacings, below the angle times this have one sample.
SINGLE_MOMENT_OF_ANGLE = 0.5
#: And below this at most. Errors on Spot are then those of all samples to 1 percent, at three spacings, with five
#: eighths of them; on a ball of 1,280 facets, under smooth data, 1 to 4 percent more with three fifths; on Spot and a
#: koala of 100,000 triangles, left whole on coarse lattices, up to 5 percent more with one sample a triangle.
MOST_SINGLE_MOMENT = 5e-3
#: The same for whole curved triangles, which only lattices far coarser than a mesh come to. A sphere of 82,000
#: triangles and a torus of 58,000 then have the same errors to 1 percent, Nefertiti and a koala of 100,000 errors up to
#: 7 percent larger, with a third to three quarters of the samples; ten times the limit is a sixth more on the sphere.
CURVED_SINGLE_MOMENT = 1e-4


def one_point_limits(mesh: Mesh, spacing: float) -> Floats:
    """Return (m,) the area times the square of the length, in spacings, below which pieces of a triangle have a sample.

    None has where a triangle touches a boundary: what one side of that sees of a cell may be little. And where a flat
    one lies in a plane with a neighbour, or has none at an edge or several, or a curved one is not small as a whole.
    """
    found = _of_flat(mesh) if mesh.midpoints is None else _of_curved(mesh, spacing)
    if len(mesh.cut):
        beside = np.zeros(len(mesh.vertices), dtype=bool)
        beside[mesh.cut] = True
        found[beside[mesh.cells].any(axis=1)] = 0.0
    return found


def _of_flat(mesh: Mesh) -> Floats:
    from cpmkit.forms.galerkin.quadrature.whole_kernels import least_turn

    sine = least_turn(mesh.vertices, np.ascontiguousarray(mesh.cells), mesh.edges.of_cells)
    found: Floats = np.minimum(SINGLE_MOMENT_OF_ANGLE * sine, MOST_SINGLE_MOMENT)
    return found


def _of_curved(mesh: Mesh, spacing: float) -> Floats:
    from cpmkit.forms.galerkin.quadrature.whole_kernels import mark_small

    found = np.zeros(len(mesh.cells))  # zeros that nobody writes take no memory
    mark_small(mesh.vertices, np.ascontiguousarray(mesh.cells), spacing, CURVED_SINGLE_MOMENT, found)
    return found


#: How samples may be asked for.
SAMPLINGS = ("auto", "plain", "clipped")
#: Edges of whole triangles are at most this many spacings long: three samples a triangle then see every spline.
PLAIN_EDGE_SPACINGS = 0.5
#: The same where triangles are clipped: 19 samples an unknown, and on a sphere the error of edges half as long to 3 %.
CLIPPED_EDGE_SPACINGS = 0.7
#: The same where they are flat: the error of whole ones half as long, with a tenth to a quarter fewer samples (measured
#: on a square, a cube and Spot).
CLIPPED_FLAT_EDGE_SPACINGS = 1.0


def is_clipped(sampling: str, manifold_dim: int) -> bool:
    """Tell whether triangles are to be clipped where it pays.

    Segments are split where they cross knot planes in any case.
    """
    return manifold_dim == 2 and sampling != "plain"


def needs_degree_four(degree: int, bend: CellGeometry) -> bool:
    """Tell whether pieces of triangles have a rule of degree 4: for cubic splines on what follows the manifold itself.

    On meshes, flat or bent by their normals, the mesh is the error, and it is the same without (measured).
    """
    return degree == 3 and bend == "closest_point"


def longest_edge(sampling: str, bend: CellGeometry, manifold_dim: int) -> float:
    """Return how long edges of cells may be when samples are taken, in spacings."""
    if not is_clipped(sampling, manifold_dim):
        return PLAIN_EDGE_SPACINGS
    return CLIPPED_FLAT_EDGE_SPACINGS if bend == "flat" else CLIPPED_EDGE_SPACINGS


def triangles_to_clip(mesh: Mesh, sampling: str, bend: CellGeometry, spacing: float) -> Bools:
    """Return which triangles (m,) are to be clipped: "auto" leaves flat ones whole that are small beside a cell."""
    if not is_clipped(sampling, mesh.manifold_dim):
        return np.zeros(len(mesh.cells), dtype=bool)
    if sampling == "clipped" or bend != "flat":
        return np.ones(len(mesh.cells), dtype=bool)
    from cpmkit.mesh.subdivision_kernels import with_long_edges

    return with_long_edges(mesh.vertices, np.ascontiguousarray(mesh.cells), PLAIN_EDGE_SPACINGS * float(spacing))


#: Triangles that samples are taken from at a time: what is needed on the way stays small beside the samples.
TRIANGLES_AT_ONCE = 1 << 11


def quadrature(
    mesh: Mesh,
    clipped_at: float | None = None,
    further: Samples | None = None,
    clipped: Bools | None = None,
    fine: bool = False,
) -> Samples:
    """Return the samples of cells, those of one after those of another, three at least, and ``further`` ones.

    Segments have three by Gauss's rule of degree 5. Triangles have three by the rule of degree 2 at barycentric points
    (2/3, 1/6, 1/6), or for each piece between knot planes four of degree 3, of small ones three of degree 2, of smaller
    ones their centroid, or more where they are to be ``fine``. The weights are those of the quadratic
    cells: the speed, or |x_1 x x_2|.

    Parameters
    ----------
    mesh : Mesh
        Flat or quadratic cells.
    clipped_at : float, optional
        The spacing h of the lattice, if triangles are to be clipped at its knot planes, x = (k + 1/2) h.
    further : Samples, optional
        Put behind them.
    clipped : (m,) bool, optional
        Which of them; all if left out.
    fine : bool
        Whether pieces between knot planes have a rule of degree 4.
    """
    own = [_arrays(_of_segments(mesh))] if mesh.manifold_dim == 1 else _of_triangles(mesh, clipped_at, clipped, fine)
    return _joined(chain(own, [] if further is None else [_arrays(further)]))


def _of_segments(mesh: Mesh) -> Samples:
    shares, slopes, weights = _segment_rule(mesh)
    along = _mixed(mesh, slopes)
    cell = np.repeat(np.arange(len(mesh.cells)), len(weights))
    return Samples(_mixed(mesh, shares), np.tile(weights, len(mesh.cells)) * norms(along), _across(along), cell)


def _of_triangles(mesh: Mesh, clipped_at: float | None, clipped: Bools | None, fine: bool) -> Iterator[list[Any]]:
    """Yield the arrays of samples of some triangles after those of others."""
    spacing, cells = 1.0 if clipped_at is None else float(clipped_at), np.ascontiguousarray(mesh.cells)
    midpoints = np.empty((len(cells), 0, 3)) if mesh.midpoints is None else np.ascontiguousarray(mesh.midpoints)
    if clipped is None or clipped_at is None:
        clipped = np.full(len(mesh.cells), clipped_at is not None)
    single = np.zeros(len(mesh.cells)) if clipped_at is None else one_point_limits(mesh, spacing)
    for start in range(0, max(len(cells), 1), TRIANGLES_AT_ONCE):
        some = slice(start, start + TRIANGLES_AT_ONCE)
        of_some = mesh.vertices, cells[some], midpoints[some], spacing, clipped[some], single[some]
        *others, cell = _whole(*of_some, fine) if fine or not single[some].any() else _single_and_others(*of_some)
        yield [*others, cell + np.int32(start)]


def _whole(
    vertices: Floats, cells: Ints, midpoints: Floats, spacing: float, clipped: Bools, single: Floats, fine: bool
) -> list[Any]:
    """Return the points, weights, normals and triangles of samples, those of one triangle after those of another."""
    from cpmkit.forms.galerkin.quadrature.clipping_kernels import triangle_samples
    from cpmkit.forms.galerkin.quadrature.whole_kernels import nodes_of

    return list(triangle_samples(nodes_of(vertices, cells, midpoints), spacing, clipped, single, fine))


def _single_and_others(
    vertices: Floats, cells: Ints, midpoints: Floats, spacing: float, clipped: Bools, single: Floats
) -> list[Any]:
    """Return the same, where triangles that have one sample are many, and need not be cut to be found."""
    from cpmkit.forms.galerkin.quadrature.whole_kernels import single_samples

    count = len(cells)
    found: Any = np.empty((count, 3)), np.empty(count), np.empty((count, 1, 3)), np.empty(count, dtype=np.int32)
    left = np.empty(count, dtype=np.int64)
    used, others = single_samples(vertices, cells, midpoints, spacing, clipped, single, found, left)
    if not others:
        return list(found)
    rest = left[:others]
    *of_rest, triangle = _whole(vertices, cells[rest], midpoints[rest], spacing, clipped[rest], single[rest], False)
    of_rest.append(rest[triangle].astype(np.int32))
    both: list[Any] = [np.concatenate([one[:used], other]) for one, other in zip(found, of_rest, strict=True)]
    order = np.argsort(both[3], kind="stable")
    return [one[order] for one in both]


def _arrays(samples: Samples) -> list[Any]:
    return [getattr(samples, one.name) for one in fields(Samples)]


def _joined(parts: Iterable[list[Any]]) -> Samples:
    """Return the samples of these arrays; the whole grows where it stands, and never is in memory twice."""
    whole: list[Any] = []
    for part in parts:
        if not whole:
            whole = [np.array(own) for own in part]
            continue
        for own, more in zip(whole, part, strict=True):
            before = len(own)
            own.resize((before + len(more), *own.shape[1:]), refcheck=False)  # no view of it is anywhere
            own[before:] = more
    return Samples(*whole)


def _mixed(mesh: Mesh, shares: Floats) -> Floats:
    """Return (m q, d) the combinations of each cell's corners and midpoints with ``shares`` (q, nodes)."""
    nodes = mesh.vertices[mesh.cells.T]
    if mesh.midpoints is not None:
        nodes = np.concatenate([nodes, mesh.midpoints.transpose(1, 0, 2)])
    mixed = shares @ nodes.reshape(len(nodes), -1)
    return np.ascontiguousarray(mixed.reshape(len(shares), -1, mesh.dim).transpose(1, 0, 2)).reshape(-1, mesh.dim)


def _segment_rule(mesh: Mesh) -> tuple[Floats, Floats, Floats]:
    """Return shares (3, nodes), their slopes (3, nodes) from start to end, and weights (3,)."""
    gauss, weights = np.polynomial.legendre.leggauss(3)
    t = 0.5 * (gauss + 1)
    if mesh.midpoints is None:
        return np.stack([1 - t, t], axis=1), np.tile([-1.0, 1.0], (3, 1)), 0.5 * weights
    shares = np.stack([(1 - t) * (1 - 2 * t), t * (2 * t - 1), 4 * t * (1 - t)], axis=1)
    return shares, np.stack([4 * t - 3, 4 * t - 1, 4 - 8 * t], axis=1), 0.5 * weights


def _across(along: Floats) -> Floats:
    """Return (n, d - 1, d) orthonormal vectors across ``along`` (n, d)."""
    t = unit(along)
    if t.shape[1] == 2:
        return np.stack([t[:, 1], -t[:, 0]], axis=1)[:, None]
    # Across the axis from which the direction is farthest: in the worst case by 54 degrees.
    axis = np.eye(3)[np.argmin(np.abs(t), axis=1)]
    first = unit(np.cross(t, axis))
    return np.stack([first, np.cross(t, first)], axis=1)
