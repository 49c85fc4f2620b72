"""Quadratic cells from normals: the smooth surface that a mesh samples, above its flat triangles.

A mesh that is read as smooth has closest points on its flat triangles, and normals of the surface that it samples. The
surface is above the midpoint of an edge from a to b by (t_a - t_b) / 8, where t are its tangents at the ends, as long
as the edge (the midpoint of Hermite's cubic, as in Vlachos et al. 2001, Curved PN triangles).

That height is multiplied by the support of the edge (:class:`cpmkit.mesh.mesh.CurvatureSupport`): a flat face beside a
fillet stays flat.

Triangles of such a mesh with a corner on a crease stay flat: they have their own normals and straight edges, since the
mean of the normals on both sides of a crease is the normal of neither side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.abilities import HasMembers, HasMesh
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.source import Rows
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.mesh.mesh import CellGeometry, CurvatureSupport, Mesh, curvature_support
from cpmkit.mesh.subdivision import halve_edges, inherit_shares, split_at_knot_planes
from cpmkit.meshing.curved_from_points import (
    CREASED_EDGE_SHARE,
    ONTO_BOUNDARY_EDGE_SHARE,
    boundary_vertices,
    curve_cells_by_closest_points,
    extreme_edge_lengths,
)
from cpmkit.meshing.mesh_cache import MeshCache, mesh_cache_of, untranslated_source
from cpmkit.meshing.untangling import untangle_midpoints
from cpmkit.types import Bools, Floats, Ints


def curve_cells(
    mesh: Mesh, geometry: CellGeometry, source: LocalSource, boundaries: Sequence[LocalSource | None], spacing: float
) -> Mesh:
    """Return the flat or quadratic cells that get quadrature samples; segments are split at the lattice's knot planes.

    ``mesh``: flat cells, subdivided, with the boundaries inserted. ``source``: the manifold.
    ``geometry``: see :data:`~cpmkit.mesh.mesh.CellGeometry`; "closest_point" for a contoured mesh.
    ``boundaries``: the boundaries in the order of their numbers in ``mesh.owner``; None for a boundary that keeps its
        vertices.
    ``spacing``: spacing h of the lattice.
    """
    if geometry == "closest_point":
        return curve_cells_by_closest_points(mesh, source, boundaries, spacing)
    if geometry == "normals":
        return curve_cells_by_normals(mesh, source, boundaries)
    return split_at_knot_planes(mesh, spacing) if mesh.manifold_dim == 1 else mesh


@dataclass(frozen=True, eq=False)
class SmoothNormals(Rows):
    """The normals at points of a mesh that is read as smooth."""

    across: Floats  #: (n, d): unit normals.
    flat: Bools  #: (n,): whether they are normals of triangles that stay flat beside creases.


def refine_smooth_triangles(mesh: Mesh, source: LocalSource, length: float) -> Mesh:
    """Return flat triangles with edges halved at points of the smooth surface until none is longer than ``length``.

    ``mesh``: the flat triangles of a mesh. ``source``: the same mesh, with normals.
    ``length``: longest edge, in the unit of the vertices.
    """
    normals, halving = smooth_vertex_normals(source, mesh), None
    while (long := mesh.edge_lengths > length).any():
        share = inherit_shares(*halving, mesh.edges) if halving else _height_shares(source, mesh, normals)
        points, between = smooth_midpoints(source, mesh.vertices, mesh.edges.ends[long], normals, share[long])
        normals = SmoothNormals.join([normals, between])
        middle = np.where(long, len(mesh.vertices) + np.cumsum(long) - 1, -1)
        halving = mesh.edges, middle, share
        mesh = halve_edges(mesh, middle, points)
    return mesh


def curve_cells_by_normals(mesh: Mesh, source: LocalSource, boundaries: Sequence[LocalSource | None] = ()) -> Mesh:
    """Return quadratic triangles with nodes on the smooth surface; nodes of facets on boundaries lie on the boundaries.

    Nodes far from their boundary stay off it, as do midpoints of triangles that would turn over.
    ``mesh``: triangles of :func:`refine_smooth_triangles`, subdivided, with the boundaries inserted.
    ``source``: the manifold. ``boundaries``: as in :func:`curve_cells`.
    """
    cache, edges = mesh_cache_of(source), mesh.edges
    if cache is not None and cache.has_cells_of(mesh) and not boundaries:
        midpoints = 0.5 * (mesh.vertices[edges.ends[:, 0]] + mesh.vertices[edges.ends[:, 1]])
        return mesh.with_same_cells(midpoints=(midpoints + _cached_heights(source, cache))[edges.of_cells])
    if not len(mesh.cut):
        normals = smooth_vertex_normals(source, mesh)
        share = _height_shares(source, mesh, normals)
        points, _ = smooth_midpoints(source, mesh.vertices, edges.ends, normals, share)
        return mesh.with_same_cells(midpoints=points[edges.of_cells])
    on_cut = mesh.cut_edges
    normals = smooth_normals(source, mesh.vertices)
    mesh = _move_onto_boundaries(mesh, normals, boundaries)
    free, _ = smooth_midpoints(source, mesh.vertices, edges.ends, normals, _height_shares(source, mesh, normals))
    points = free.copy()
    for owner, boundary in enumerate(boundaries):
        rows = np.unique(on_cut[(mesh.owner == owner) & ~mesh.beyond_tip])
        if boundary is not None and len(rows):
            across = unit(normals.across[edges.ends[rows]].sum(axis=1))
            step = _tangential_components(boundary.closest_point(points[rows]).points - points[rows], across)
            is_close = norms(step) <= CREASED_EDGE_SHARE * mesh.edge_lengths[rows]
            points[rows] += np.where(is_close, 1.0, 0.0)[:, None] * step
    points = untangle_midpoints(mesh, on_cut[~mesh.beyond_tip], points, free, source, lambda x: x)
    return mesh.with_same_cells(midpoints=points[edges.of_cells])


def smooth_vertex_normals(source: LocalSource, mesh: Mesh) -> SmoothNormals:
    """Return the source's normals at the vertices of a mesh; cached values at vertices that the source has itself."""
    cache = mesh_cache_of(source)
    if cache is None:
        return smooth_normals(source, mesh.vertices)
    normals = cache.value("normals", lambda: smooth_normals(untranslated_source(source), cache.mesh.vertices))
    return normals if cache.has_cells_of(mesh) else _extend_normals(source, mesh, cache, normals)


def smooth_normals(source: LocalSource, points: Floats) -> SmoothNormals:
    """Return the normals of ``source`` at the feet of ``points`` (n, d); beside creases those of flat triangles."""
    feet = source.closest_point(np.ascontiguousarray(points))
    across = source.normals(feet)
    if not source.has_creases:
        return SmoothNormals(across, np.zeros(len(feet), dtype=bool))
    facets = source.facet_normals(feet)
    flat = np.isfinite(facets[:, 0])
    return SmoothNormals(np.where(flat[:, None], facets, across), flat)


def smooth_midpoints(
    source: LocalSource, vertices: Floats, ends: Ints, normals: SmoothNormals, share: Floats
) -> tuple[Floats, SmoothNormals]:
    """Return points (e, d) of the smooth surface above the midpoints of edges, and the normals there.

    Edges of flat triangles, and edges below a height of more than ``CREASED_EDGE_SHARE`` lengths, stay straight. The
    normals are the means of those at the ends; beside creases they are the source's normals at the midpoints.

    ``vertices`` (v, d), ``ends`` (e, 2): positions of vertices, and the two vertices of each edge.
    ``normals``: normals at the vertices. ``share`` (e,): factor of the height of the surface above each edge.
    """
    across, flat = unit(normals.across[ends].sum(axis=1)), np.asarray(normals.flat[ends].any(axis=1))
    if flat.any():
        at_midpoints = smooth_normals(source, 0.5 * vertices[ends[flat]].sum(axis=1))
        across[flat], flat[flat] = at_midpoints.across, at_midpoints.flat
    a, b = vertices[ends[:, 0]], vertices[ends[:, 1]]
    start, end = (unit(_tangential_components(b - a, normals.across[side])) for side in ends.T)
    length = norms(b - a)[:, None]
    height = length * (start - end) / 8  # of the middle of Hermite's cubic
    straight = flat | (norms(height) > CREASED_EDGE_SHARE * length[:, 0])
    return 0.5 * (a + b) + np.where(straight, 0.0, share)[:, None] * height, SmoothNormals(across, flat)


def support_by_normals(mesh: Mesh, normals: SmoothNormals) -> CurvatureSupport:
    """Return how well the surface beyond the ends of each edge supports the curvature along it, from vertex normals."""
    return curvature_support(mesh.vertices, mesh.edges.ends, normals.across[mesh.edges.ends], normals.flat)


def own_curvature_support(source: LocalSource) -> CurvatureSupport | None:
    """Return the :func:`support_by_normals` of a source's own mesh, cached.

    None for a source whose mesh depends on the spacing, or was not made yet.
    """
    cache = mesh_cache_of(source)
    if cache is None:
        return None
    return cache.value("support", lambda: support_by_normals(cache.mesh, smooth_vertex_normals(source, cache.mesh)))


def fit_vertices_to_normals(mesh: Mesh, rows: Ints, normals: Floats) -> Mesh:
    """Return the mesh with the vertices ``rows`` (k,) moved from the flat triangles onto the smooth surface.

    Each vertex is moved along its unit normal, in ``normals`` (v, d), so that its edges become perpendicular to the
    means of the normals at their ends, in the least-squares sense. On a sphere the result is exact.
    """
    from scipy.sparse import csr_array, eye_array
    from scipy.sparse.linalg import spsolve

    if not len(rows):
        return mesh
    number = np.full(len(mesh.vertices), -1)
    number[rows] = np.arange(len(rows))
    beside = (number[mesh.edges.ends] >= 0).any(axis=1)
    ends, lengths = mesh.edges.ends[beside], np.maximum(mesh.edge_lengths, 1e-4 * mesh.edge_lengths.max())[beside]
    across = unit(normals[ends].sum(axis=1)) / lengths[:, None]
    slopes = dots(mesh.vertices[ends[:, 1]] - mesh.vertices[ends[:, 0]], across)
    edge, side = np.nonzero(number[ends] >= 0)
    moved = ends[edge, side]
    derivatives = (2 * side - 1) * dots(normals[moved], across[edge])
    matrix = csr_array((derivatives, (edge, number[moved])), shape=(len(ends), len(rows)))
    gram = matrix.T @ matrix
    gram += 1e-12 * gram.diagonal().max() * eye_array(len(rows))  # if no vertex is fixed
    vertices = mesh.vertices.copy()
    vertices[rows] -= spsolve(gram.tocsc(), matrix.T @ slopes)[:, None] * normals[rows]
    return mesh.with_same_cells(vertices=vertices)


def _extend_normals(source: LocalSource, mesh: Mesh, cache: MeshCache, normals: SmoothNormals) -> SmoothNormals:
    """Return the normals at the vertices of a mesh, given the ``normals`` at the source's own vertices.

    The mesh's first vertices are expected to be the source's own. Normals at the others are queried in the scene's
    coordinates, like the cached normals: the source needs no search tree of a translated copy, and the result is the
    same on all lattices.
    """
    in_scene, count = mesh.vertices + source.scene_origin, len(normals.flat)
    is_new = np.ones(len(in_scene), dtype=bool)
    if len(in_scene) >= count:
        rounding = 8 * np.finfo(float).eps * np.abs(in_scene).max()
        is_new[:count] = np.abs(in_scene[:count] - cache.mesh.vertices).max(axis=1) > rounding
    across, flat = np.empty_like(in_scene), np.zeros(len(in_scene), dtype=bool)
    across[:count], flat[:count] = normals.across[: len(across)], normals.flat[: len(flat)]
    further = smooth_normals(untranslated_source(source), in_scene[is_new])
    across[is_new], flat[is_new] = further.across, further.flat
    return SmoothNormals(across, flat)


def _cached_heights(source: LocalSource, cache: MeshCache) -> Floats:
    """Return the vectors (e, d) from midpoints of the edges of a source's own cells to the smooth surface, cached."""

    def heights() -> Floats:
        """Compute the vectors (e, d) in the scene's coordinates."""
        mesh = cache.mesh
        midpoints = 0.5 * (mesh.vertices[mesh.edges.ends[:, 0]] + mesh.vertices[mesh.edges.ends[:, 1]])
        normals = smooth_vertex_normals(source, mesh)
        share = _height_shares(source, mesh, normals)
        points, _ = smooth_midpoints(untranslated_source(source), mesh.vertices, mesh.edges.ends, normals, share)
        return points - midpoints

    return cache.value("heights", heights)


def _height_shares(source: LocalSource, mesh: Mesh, normals: SmoothNormals) -> Floats:
    """Return the factor (e,) by which the height of the smooth surface above each edge is multiplied.

    The factor is 1 if all edges of the source's own cells, or of a union's members, are supported; else it follows from
    ``normals``.
    """
    cache, support = mesh_cache_of(source), own_curvature_support(source)
    if cache is not None and support is not None and cache.has_cells_of(mesh):
        return support.share
    smooth = _is_supported_union(source) if support is None else bool((support.share == 1.0).all())
    return np.ones(len(mesh.edges.ends)) if smooth else support_by_normals(mesh, normals).share


def _is_supported_union(source: LocalSource) -> bool:
    """Return whether a source is a union of meshes with curvature support everywhere; fill the mesh caches."""
    if not isinstance(source.of, HasMembers):
        return False
    for member in source.of.members:
        part = LocalSource(member, np.zeros(source.dim), source.queries, of=member)
        if isinstance(member, HasMesh):
            mesh_cache_of(part, member.mesh(float(np.ptp(member.bounds, axis=0).max()))[1])
        support = own_curvature_support(part)
        if support is None or (support.share < 1.0).any():
            return False
    return True


def _move_onto_boundaries(mesh: Mesh, normals: SmoothNormals, boundaries: Sequence[LocalSource | None]) -> Mesh:
    """Return the mesh with boundary vertices moved along the surface to their boundaries, then back onto the surface.

    Vertices farther from their boundary than ``ONTO_BOUNDARY_EDGE_SHARE`` of their shortest edge stay off it. Vertices
    on creases and their neighbours stay on the flat triangles. ``normals`` are those at the vertices.
    """
    vertices, on_cut = mesh.vertices.copy(), np.unique(mesh.cut)
    reach = ONTO_BOUNDARY_EDGE_SHARE * extreme_edge_lengths(mesh, on_cut, np.minimum, np.inf)
    for owner, boundary in enumerate(boundaries):
        rows = boundary_vertices(mesh, owner)
        if boundary is not None and len(rows):
            step = _tangential_components(
                boundary.closest_point(vertices[rows]).points - vertices[rows], normals.across[rows]
            )
            vertices[rows] += np.where(norms(step) <= reach[rows], 1.0, 0.0)[:, None] * step
    beside_crease = np.zeros(len(vertices), dtype=bool)
    beside_crease[mesh.edges.ends[normals.flat[mesh.edges.ends].any(axis=1)]] = True
    moved = mesh.with_same_cells(vertices=vertices)
    return fit_vertices_to_normals(moved, on_cut[~beside_crease[on_cut]], normals.across)


def _tangential_components(vectors: Floats, normals: Floats) -> Floats:
    """Return the components (n, d) of ``vectors`` perpendicular to unit ``normals`` (n, d)."""
    return vectors - dots(vectors, normals)[:, None] * normals
