"""Parts of the rim of a mesh and sides of boundaries with their conditions, and integrals over them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import (
    ClosestPointSource,
    Condition,
    Data,
    Floats,
    Interface,
    Ints,
    Mixed,
    Nonlinear,
    OneSided,
    Scene,
    conditions_along,
    evaluate_data,
)
from cpmkit_fem.assembly import gathered, weighted_mass
from cpmkit_fem.cell_mesh import CellMesh
from cpmkit_fem.surface_mapping import measure_and_pseudoinverse

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Distance outside of the rim, as a share of an edge, from which the loop of an edge is determined.
OUTSIDE_EDGE_SHARE = 0.25
#: The same of a solid, where that point is outside.
NEAR_EDGE_SHARE = 0.01
#: A flux that changes with u by less than this, over the length of an edge, fixes no constant.
STILL = 1e-9
#: Distance along the rim, as a share of half an edge, of data from a boundary that ends there.
ALONG_SHARE = 1e-6
#: Data of fluxes are evaluated this share of the way from a facet's nodes to its middle, and extrapolated from there.
INSIDE_SHARE = 1e-4
#: Label of the edge's condition in errors.
EDGE_LABEL = "the edge's condition"


@dataclass(frozen=True, eq=False)
class RimPart:
    """Facets of the rim, or on one side of a boundary, on which the same one-sided condition holds.

    Attributes
    ----------
    law : OneSided
        The law of the condition.
    mesh : CellMesh
        The mesh of the facets.
    edges : (e, c) int64
        Nodes of each facet: one for a point, two for an edge, three for a triangle; of degree 2 then midpoints.
    label : str
        Name of the condition's boundary or edge in errors.
    place : ClosestPointSource, optional
        The boundary, at whose closest points data are evaluated; None on the rim, where they are evaluated at nodes.
    target : (n, d) float64, optional
        On the rim, the points at which data are evaluated in place of the mesh's n nodes: moved off a boundary's end,
        where data may jump. None: the nodes.
    """

    law: OneSided
    mesh: CellMesh
    edges: Ints
    label: str = EDGE_LABEL
    place: ClosestPointSource | None = None
    target: Floats | None = None

    @cached_property
    def vertex_numbers(self) -> Ints:
        """(k,) the vertices of the facets, ascending."""
        return np.unique(self.edges)

    @cached_property
    def points(self) -> Floats:
        """(k, d) points at which the data of the vertices are evaluated."""
        if self.place is None:
            return (self.mesh.nodes if self.target is None else self.target)[self.vertex_numbers]
        return self.place.closest_point(self.mesh.nodes[self.vertex_numbers]).points

    @property
    def distances(self) -> Floats:
        """(k,) distances of :attr:`points` from the vertices; zero on the rim, wherever data are evaluated."""
        if self.place is None:
            return np.zeros(len(self.vertex_numbers))
        return np.asarray(np.linalg.norm(self.points - self.mesh.nodes[self.vertex_numbers], axis=1))

    def values(self, channels: int, time: float | None) -> Floats:
        """Return the law's datum (k, channels) at :attr:`points`; ``time`` is None for steady problems."""
        return evaluate_data(self.law.datum, self.points, channels, self.label, time)

    @cached_property
    def facet_points(self) -> Floats:
        """(e c, d) points at which data of fluxes are evaluated: the nodes of each facet, a little inside of it.

        At a corner of the rim, where normals jump, each facet has data of its own.
        """
        points = inside_facets(self.mesh.nodes[self.edges]).reshape(-1, self.mesh.nodes.shape[1])
        return points if self.place is None else self.place.closest_point(points).points

    def facet_data(self, data: Data, channels: int, time: float | None) -> Floats:
        """Return ``data`` (e c, channels) at the nodes of each facet, extrapolated linearly from inside of it."""
        values = evaluate_data(data, self.facet_points, channels, self.label, time)
        of_facets = values.reshape(*self.edges.shape, channels)
        share = INSIDE_SHARE * (self.edges.shape[1] > 1)
        found = (of_facets - share * of_facets.mean(axis=1, keepdims=True)) / (1 - share)
        return np.asarray(found.reshape(-1, channels))

    def facet_mass(self, weight: Floats) -> csr_array:
        """Return integrals (n, e c) of w u v over the part, v a function of one facet alone; ``weight`` w is (e, c)."""
        return weighted_mass(self.mesh.nodes, self.edges, weight, self.mesh.manifold_dim - 1, self.mesh.degree)

    def mass(self, weight: Floats) -> csr_array:
        """Return integrals (n, n) of w u v over the part, ``weight`` (e, c) as in :meth:`facet_mass`."""
        return gathered(self.facet_mass(weight), self.edges, len(self.mesh.nodes))

    # For Newton's method where the flux depends on u

    @property
    def guess(self) -> float:
        """Value of u at which Newton's method starts."""
        return self._flux.guess

    def read(self, u: Floats) -> Floats:
        """Return the first channel (k,) of ``u`` (n, channels) at :attr:`vertex_numbers`."""
        return np.asarray(u[self.vertex_numbers, 0])

    def grows(self, seen: Floats) -> bool:
        """Return whether |dj/du| times the mean edge exceeds :data:`STILL` anywhere, j the flux, u = ``seen`` (k,)."""
        return bool(np.any(np.abs(self._flux.slope_at(seen, self.points)) * self.mesh.mean_edge > STILL))

    def linearise(self, seen: Floats) -> RimPart:
        """Return the part with the linear law ``du/db = j(v) + j'(v) (u - v)``, v = ``seen`` (k,) at its vertices."""
        places = np.searchsorted(self.vertex_numbers, self.edges)
        near = inside_facets(seen[places][..., None]).ravel()
        slope, flux = self._flux.slope_at(near, self.facet_points), self._flux.flux_at(near, self.facet_points)
        return replace(self, law=Mixed(1.0, lambda _: -slope, lambda _: flux - slope * near))

    @property
    def _flux(self) -> Nonlinear:
        assert isinstance(self.law, Nonlinear)
        return self.law


def inside_facets(values: Floats) -> Floats:
    """Return ``values`` (e, c, k) at the nodes of facets, moved by :data:`INSIDE_SHARE` of the way to their mean."""
    return np.asarray(values + INSIDE_SHARE * (values.mean(axis=1, keepdims=True) - values))


def rim_of(scene: Scene, mesh: CellMesh, excluded: Ints) -> Sequence[RimPart]:
    """Return the parts of the rim, one for each condition of the scene's edge that holds somewhere on it.

    The facets ``excluded`` (b, corners), those on boundaries, are no rim. The list is empty if the mesh is closed.
    Raise SceneError if a loop is not in the scene's table, or no part of the edge covers a place of it.
    """
    facets, opposite = rim_facets(mesh, excluded)
    if not len(facets):
        return []
    feet = scene.surface.closest_point(points_outside_rim(mesh, facets, opposite))
    edge, points = feet.edge, feet.points
    if scene.surface.manifold_dim == scene.surface.dim:  # in narrow gaps only a near point is not across the gap
        near = scene.surface.closest_point(points_outside_rim(mesh, facets, opposite, NEAR_EDGE_SHARE))
        edge = np.where(near.edge >= 0, near.edge, edge)
        points = np.where((near.edge >= 0)[:, None], near.points, points)
    parts = conditions_along(scene.edge, edge, points)
    target = _move_ends_along_rim(mesh, facets, excluded)
    return [RimPart(_one_sided(condition), mesh, facets[rows], target=target) for condition, rows in parts]


def rim_facets(mesh: CellMesh, excluded: Ints) -> tuple[Ints, Ints]:
    """Return the facets (e, c) that only one cell has, without ``excluded`` (b, corners), and the corner opposite each.

    Facets have c nodes: their corners, of degree 2 then the midpoints. The opposite corners are (e,).
    """
    facets, count, opposite = mesh.facets
    k, size = mesh.manifold_dim, len(mesh.nodes)
    powers = size ** np.arange(k)
    rim = (count == 1) & ~np.isin(np.sort(facets[:, :k], axis=1) @ powers, np.sort(excluded, axis=1) @ powers)
    return facets[rim], opposite[rim]


def _move_ends_along_rim(mesh: CellMesh, facets: Ints, excluded: Ints) -> Floats:
    """Return the mesh's nodes (n, d), with those in both rim ``facets`` (e, c) and ``excluded`` moved along the rim.

    Corners are moved a little towards the middle of their rim facet; on a curve, whose facets are points, none moves.
    """
    target, ends = mesh.nodes.copy(), facets[:, : mesh.manifold_dim]
    facet, place = np.nonzero(np.isin(ends, excluded))
    at = ends[facet, place]
    target[at] += ALONG_SHARE * (mesh.nodes[ends[facet]].mean(axis=1) - mesh.nodes[at])
    return target


def _one_sided(condition: Condition) -> OneSided:
    """Return the law of a condition on the edge; scenes refuse those that couple two sides."""
    assert not isinstance(condition.law, Interface)
    return condition.law


def points_outside_rim(mesh: CellMesh, facets: Ints, opposite: Ints, share: float = OUTSIDE_EDGE_SHARE) -> Floats:
    """Return points (e, d) a little outside of the rim ``facets`` (e, c), so that their closest points lie on the rim.

    ``opposite`` (e,) is the corner opposite each facet, ``share`` that of an edge by which they lie outside.
    Closest points of the chords themselves may lie inside.
    """
    middle = mesh.nodes[facets[:, : mesh.manifold_dim]].mean(axis=1)
    return np.ascontiguousarray(middle + share / OUTSIDE_EDGE_SHARE * steps_outward(mesh, facets, opposite))


def steps_outward(mesh: CellMesh, facets: Ints, opposite: Ints) -> Floats:
    """Return vectors (e, d) out of the mesh, perpendicular to ``facets`` (e, c), of a share of an edge.

    ``opposite`` (e,) is the corner opposite each facet.
    """
    corners = mesh.nodes[facets[:, : mesh.manifold_dim]]
    outward = corners.mean(axis=1) - mesh.nodes[opposite]
    if mesh.manifold_dim == 1:
        return np.asarray(OUTSIDE_EDGE_SHARE * outward)
    edges = np.transpose(corners[:, 1:] - corners[:, :1], (1, 2, 0))
    measure, inverse = measure_and_pseudoinverse(edges[..., None])
    outward -= np.einsum("kde,kce,ec->ed", edges, inverse[..., 0], outward)
    length = measure[:, 0] ** (1 / len(edges))
    return np.asarray(OUTSIDE_EDGE_SHARE * (length / np.linalg.norm(outward, axis=1))[:, None] * outward)


def outward_facets(mesh: CellMesh) -> Ints:
    """Return the facets (e, c) of the boundary of a solid in space, as triangles with normals out of the solid."""
    facets, opposite = rim_facets(mesh, np.zeros((0, 3), dtype=np.int64))
    others = mesh.nodes[np.column_stack([facets[:, 1:3], opposite])] - mesh.nodes[facets[:, :1]]
    turned = np.array([0, 2, 1, 5, 4, 3])[: facets.shape[1]]
    return np.where(np.linalg.det(others)[:, None] > 0, facets[:, turned], facets)
