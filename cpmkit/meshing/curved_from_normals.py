"""The smooth surface that a mesh samples: its triangles bent so that normals, known at vertices, stand on them.

A mesh that is read as smooth answers with feet on its flat triangles, and with the normals of the surface that it was
taken from. These tell how far that surface stands above the triangles: by (t_a - t_b) / 8 above the middle of an edge
from a to b, t its tangents there as long as the edge (the middle of Hermite's cubic, as in Vlachos et al. 2001, Curved
PN triangles).

An edge keeps the share of that height that the surface beyond its ends supports
(:mod:`cpmkit.mesh.normals_of_mesh`): a flat face beside a fillet stays flat.

Where such a mesh has creases, triangles with a corner there stay flat: their normals are their own, and their edges
straight. The mean of what stands on both sides of a crease is the normal of neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, norms, unit
from cpmkit.mesh.mesh import Edges, Mesh, edges_of, edges_on_cut
from cpmkit.mesh.normals_of_mesh import Support, edge_support
from cpmkit.mesh.subdivision import halve_edges, inherit_shares
from cpmkit.meshing.curved_from_points import (
    CREASED_EDGE_SHARE,
    ONTO_BOUNDARY_EDGE_SHARE,
    boundary_vertices,
    shortest_edges,
)
from cpmkit.meshing.mesh_cache import edges_with, in_scene_coordinates, mesh_cache_of
from cpmkit.meshing.untangle_midpoints import untangle_midpoints
from cpmkit.protocols import Bools, Floats, HasMembers, HasMesh, Ints

#: How often vertices that were put on flat triangles are lifted to their neighbours.
LIFTING_ROUNDS = 3
#: A vertex that is so many roundings of the largest coordinate from one of the source's own is that.
SAME_PLACE_ROUNDINGS = 8
#: Lengths that are found in two ways differ by less than this share.
ROUNDING_SHARE = 1e-12


@dataclass(frozen=True, eq=False)
class SmoothNormals:
    """The normals at points of a mesh that is read as smooth.

    Attributes
    ----------
    across : (n, d) float64
        Unit vectors.
    flat : (n,) bool
        Whether they are those of triangles that stay flat beside creases.
    """

    across: Floats
    flat: Bools

    def joined(self, others: SmoothNormals) -> SmoothNormals:
        """Return these, and the others behind them."""
        return SmoothNormals(np.concatenate([self.across, others.across]), np.concatenate([self.flat, others.flat]))


def refine_smooth(mesh: Mesh, source: LocalSource, length: float) -> Mesh:
    """Return triangles between points of the smooth surface with no edge longer than ``length``.

    Parameters
    ----------
    mesh : SampleMesh
        The flat triangles of a mesh.
    source : LocalSource
        The same mesh, with normals.
    length : float
        In the unit of the vertices.
    """
    from cpmkit.mesh.subdivision_kernels import with_long_edges

    normals, surely_short = smooth_vertex_normals(source, mesh), length * (1 - ROUNDING_SHARE)
    edges, halves = edges_with(source, mesh), None
    while True:
        if edges is None and not with_long_edges(mesh.vertices, np.ascontiguousarray(mesh.cells), surely_short).any():
            return mesh  # told without numbering the edges
        edges = edges or edges_of(mesh)
        long = edges.lengths(mesh.vertices) > length
        if not long.any():
            return mesh
        share = _shares(source, mesh, edges, normals) if halves is None else inherit_shares(*halves, edges)
        points, between = smooth_midpoints(source, mesh.vertices, edges.ends[long], normals, share[long])
        normals = normals.joined(between)
        middle = np.where(long, len(mesh.vertices) + np.cumsum(long) - 1, -1)
        mesh, halves, edges = halve_edges(mesh, edges, middle, points), (edges, middle, share), None


def curve_from_normals(
    mesh: Mesh,
    source: LocalSource,
    boundaries: Sequence[LocalSource | None] = (),
    edges: Edges | None = None,
) -> Mesh:
    """Return quadratic triangles on the smooth surface, with their edges on boundaries above where those lie.

    Parameters
    ----------
    mesh : SampleMesh
        What :func:`refine_smooth` gave, cut and split.
    source : LocalSource
    boundaries : sequence of LocalSource
        By their number in ``mesh.owner``; None where a boundary stays where the mesh has it.
    edges : Edges, optional
        Of the mesh, found if they are not given.
    """
    from cpmkit.meshing import curved_kernels

    own = edges_with(source, mesh)
    if own is not None and not boundaries:
        arrays = mesh.vertices, own.ends, _kept_heights(source, own), own.of_cells
        return replace(mesh, midpoints=curved_kernels.midpoints_by_heights(*arrays))
    edges = own or edges or edges_of(mesh)
    if not len(mesh.cut):
        found = smooth_vertex_normals(source, mesh)
        share = _shares(source, mesh, edges, found)
        points, _ = smooth_midpoints(source, mesh.vertices, edges.ends, found, share)
        return replace(mesh, midpoints=curved_kernels.gather_by_cell(points, edges.of_cells))
    on_cut, number = np.unique(mesh.cut), edges_on_cut(mesh, edges)
    found = smooth_normals(source, mesh.vertices)
    normals, vertices = found.across, mesh.vertices.copy()
    reach = ONTO_BOUNDARY_EDGE_SHARE * shortest_edges(mesh, edges, on_cut)
    for owner, boundary in enumerate(boundaries):
        rows = boundary_vertices(mesh, owner)
        if boundary is not None and len(rows):
            step = _off(boundary.closest_point(vertices[rows]).points - vertices[rows], normals[rows])
            vertices[rows] += np.where(norms(step) <= reach[rows], 1.0, 0.0)[:, None] * step
    mesh = fit_vertices_to_normals(replace(mesh, vertices=vertices), edges, on_cut, normals)
    share = _shares(source, mesh, edges, found)
    free, _ = smooth_midpoints(source, mesh.vertices, edges.ends, found, share)
    points = free.copy()
    for owner, boundary in enumerate(boundaries):
        rows = np.unique(number[(mesh.owner == owner) & ~mesh.beyond_tip])
        if boundary is not None and len(rows):
            across = unit(normals[edges.ends[rows]].sum(axis=1))
            step = _off(boundary.closest_point(points[rows]).points - points[rows], across)
            near = norms(step) <= CREASED_EDGE_SHARE * edges.lengths(mesh.vertices)[rows]
            points[rows] += np.where(near, 1.0, 0.0)[:, None] * step
    if len(mesh.cut):
        points = untangle_midpoints(mesh, edges, number[~mesh.beyond_tip], points, free, source, lambda x: x)
    return replace(mesh, midpoints=points[edges.of_cells])


def smooth_vertex_normals(source: LocalSource, mesh: Mesh) -> SmoothNormals:
    """Return the source's own normals at the vertices of its cells, or of other ones."""
    own = mesh_cache_of(source)
    if own is None:
        return smooth_normals(source, mesh.vertices)
    if "normals" not in own.found:
        own.found["normals"] = smooth_normals(in_scene_coordinates(source), own.final.vertices)
    found: SmoothNormals = own.found["normals"]
    return found if own.is_final(mesh) else _with_others(source, mesh, found)


def _with_others(source: LocalSource, mesh: Mesh, normals: SmoothNormals) -> SmoothNormals:
    """Return the normals at the vertices of a mesh, ``normals`` being those at the source's own.

    What was added to its own cells stands behind these. Others are asked where the source stands in the scene, as its
    own were: nothing is searched for them in what was moved, and the answer is the same on all lattices.
    """
    own = mesh_cache_of(source)
    assert own is not None
    in_place, count = mesh.vertices + source.scene_origin, len(normals.flat)
    others = np.ones(len(in_place), dtype=bool)
    if len(in_place) >= count:
        rounding = SAME_PLACE_ROUNDINGS * np.finfo(float).eps * np.abs(in_place).max()
        others[:count] = np.abs(in_place[:count] - own.final.vertices).max(axis=1) > rounding
    across, flat = np.empty_like(in_place), np.zeros(len(in_place), dtype=bool)
    across[:count], flat[:count] = normals.across[: len(across)], normals.flat[: len(flat)]
    target = smooth_normals(in_scene_coordinates(source), in_place[others])
    across[others], flat[others] = target.across, target.flat
    return SmoothNormals(across, flat)


def _kept_heights(source: LocalSource, edges: Edges) -> Floats:
    """Return (e, d) how far the smooth surface is above the middles of the edges of a source's own cells."""
    own = mesh_cache_of(source)
    assert own is not None  # their edges are kept
    if "heights" not in own.found:
        mesh = own.final
        middles = 0.5 * (mesh.vertices[edges.ends[:, 0]] + mesh.vertices[edges.ends[:, 1]])
        normals = smooth_vertex_normals(source, mesh)
        share = _shares(source, mesh, edges, normals)
        above, _ = smooth_midpoints(in_scene_coordinates(source), mesh.vertices, edges.ends, normals, share)
        own.found["heights"] = above - middles
    found: Floats = own.found["heights"]
    return found


def smooth_normals(source: LocalSource, points: Floats) -> SmoothNormals:
    """Return the source's own normals at the feet of ``points``, beside creases those of its flat triangles."""
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
    """Return (e, d) the points of the smooth surface above the middles of edges (e, 2), in flat triangles the middles.

    And the normals there: the means of those at the ends, beside creases those that the source has at the middles.
    ``normals`` are those at the ``vertices`` (v, d). Of their heights the edges keep a ``share`` (e,).
    """
    from cpmkit.meshing import curved_kernels

    across, flat = unit(normals.across[ends].sum(axis=1)), np.asarray(normals.flat[ends].any(axis=1))
    if flat.any():
        own = smooth_normals(source, 0.5 * vertices[ends[flat]].sum(axis=1))
        across[flat], flat[flat] = own.across, own.flat
    arrays = np.ascontiguousarray(vertices), np.ascontiguousarray(ends), np.ascontiguousarray(normals.across)
    found: Floats = curved_kernels.hermite_midpoints(*arrays, flat, share, CREASED_EDGE_SHARE)
    return found, SmoothNormals(across, flat)


def support_by_normals(vertices: Floats, edges: Edges, normals: SmoothNormals) -> Support:
    """Return the support of the edges of a mesh with ``normals`` at its ``vertices`` (v, d)."""
    return edge_support(vertices, edges.ends, normals.across[edges.ends], normals.flat)


def _shares(source: LocalSource, mesh: Mesh, edges: Edges, normals: SmoothNormals) -> Floats:
    """Return (e,) what share of their heights edges keep; those of a mesh whose own edges keep all do as well."""
    own = source_support(source)
    if own is not None and edges is edges_with(source, mesh):
        return own.share
    smooth = _all_supported(source) if own is None else bool((own.share == 1.0).all())
    return np.ones(len(edges.ends)) if smooth else support_by_normals(mesh.vertices, edges, normals).share


def _all_supported(source: LocalSource) -> bool:
    """Tell whether a source is a union of meshes whose own edges keep all of their heights."""
    if not isinstance(source.of, HasMembers):
        return False
    for member in source.of.members:
        part = LocalSource(member, np.zeros(source.dim), source.queries, of=member)
        if isinstance(member, HasMesh):
            mesh_cache_of(part, member.mesh(float(np.ptp(member.bounds, axis=0).max()))[1])
        own = source_support(part)
        if own is None or (own.share < 1.0).any():
            return False
    return True


def source_support(source: LocalSource) -> Support | None:
    """Return the support of the edges of a source's own cells; None where it has none."""
    own = mesh_cache_of(source)
    if own is None:
        return None
    if "support" not in own.found:
        mesh = own.final
        edges = edges_with(source, mesh)
        assert edges is not None
        own.found["support"] = support_by_normals(mesh.vertices, edges, smooth_vertex_normals(source, mesh))
    found: Support = own.found["support"]
    return found


def fit_vertices_to_normals(mesh: Mesh, edges: Edges, rows: Ints, normals: Floats) -> Mesh:
    """Return the mesh with those vertices ``rows`` lifted that were put on flat triangles, as boundaries are.

    Each is lifted along its normal until its edges are at right angles with the means of the normals at their ends: on
    a sphere that is where they belong.
    """
    at = np.zeros(len(mesh.vertices), dtype=bool)
    at[rows] = True
    ends = np.concatenate([edges.ends, edges.ends[:, ::-1]])
    ends = ends[at[ends[:, 0]]]
    vertices = mesh.vertices.copy()
    for _ in range(LIFTING_ROUNDS):
        way = vertices[ends[:, 1]] - vertices[ends[:, 0]]
        mean = normals[ends].sum(axis=1)
        weight = 1.0 / np.maximum(dots(way, way), np.finfo(float).tiny)
        height = weight * dots(way, mean) / np.maximum(dots(normals[ends[:, 0]], mean), 0.5)
        total = (
            np.bincount(ends[:, 0], height, len(vertices))[rows] / np.bincount(ends[:, 0], weight, len(vertices))[rows]
        )
        vertices[rows] += total[:, None] * normals[rows]
    return replace(mesh, vertices=vertices)


def _off(vectors: Floats, normals: Floats) -> Floats:
    return vectors - dots(vectors, normals)[:, None] * normals
