"""Dirichlet data imposed at the vertices nearest to boundaries, as is common on meshes; King et al. (2024), sec. 2.3.

The error is of first order in the length of an edge, of second order where the boundary follows edges of the mesh.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cpmkit.plugin import SIDES, BoundarySet, Floats, Ints, Scene, SceneError, Value
from cpmkit_fem.cell_mesh import CellMesh
from cpmkit_fem.gaps import ends_in_gaps
from cpmkit_fem.rim import RimPart

#: Points along a side of each triangle near a boundary whose closest points sample the boundary.
TRIANGLE_SIDE_SAMPLES = 3
#: A boundary passes through a vertex if it is nearer than this share of an edge.
THROUGH_VERTEX_SHARE = 1e-6


def pinned_parts(scene: Scene, mesh: CellMesh) -> Sequence[RimPart]:
    """Return the vertices nearest to each boundary, with its law, in the order of the scene's boundaries.

    Raise SceneError if a boundary has other conditions than one Dirichlet condition on both sides, or lies off the
    mesh.
    """
    return [_pinned_part(boundary, mesh) for boundary in scene.boundaries]


def pin_warnings(parts: Sequence[RimPart]) -> tuple[str, ...]:
    """Return a warning for each of ``parts`` that pins vertices off its boundary, with the largest distance."""
    return tuple(
        f"The {part.label} pins {len(part.vertex_numbers)} vertices up to {part.distances.max():.3g} away from it "
        f"(a mean edge is {part.mesh.mean_edge:.3g}): the answer is of first order there."
        for part in parts
        if part.place is not None and part.distances.max() > THROUGH_VERTEX_SHARE * part.mesh.mean_edge
    )


def _pinned_part(boundary: BoundarySet, mesh: CellMesh) -> RimPart:
    """Return the vertices of ``mesh`` nearest to ``boundary``, with its law.

    Raise SceneError if its sides have different conditions or no Dirichlet condition, or it lies off the mesh.
    """
    left, right = (boundary.condition(side) for side in SIDES)
    if left is not right or not isinstance(left.law, Value):
        raise SceneError(
            f"boundary {boundary.name!r} has {left.kind} on its left and {right.kind} on its right; "
            "backend='fem-pinned' keeps one value a vertex and takes both = Dirichlet alone; use backend='fem'."
        )
    vertices = _nearest_vertices(boundary, mesh)
    return RimPart(left.law, mesh, vertices[:, None], f"boundary {boundary.name!r}", boundary.source)


def _nearest_vertices(boundary: BoundarySet, mesh: CellMesh) -> Ints:
    """Return (k,) the vertices nearest to points of the boundary, and ends of edges that it crosses between these."""
    from scipy.spatial import cKDTree

    nearest = np.unique(cKDTree(mesh.nodes).query(_boundary_samples(boundary, mesh))[1])
    return np.union1d(nearest, ends_in_gaps(boundary.source, mesh, nearest))


def _boundary_samples(boundary: BoundarySet, mesh: CellMesh) -> Floats:
    """Return points (k, d) of the boundary, denser than vertices: closest points of samples of the triangles near it.

    Raise SceneError if no triangle is near it.
    """
    corners = mesh.nodes[mesh.corners]
    nearby = boundary.source.closest_point(corners.mean(axis=1)).distance <= mesh.longest_edges
    if not nearby.any():
        raise SceneError(
            f"boundary {boundary.name!r} is farther than an edge from every triangle of the mesh; move it onto the "
            "surface."
        )
    i, j = np.divmod(np.arange((TRIANGLE_SIDE_SAMPLES + 1) ** 2), TRIANGLE_SIDE_SAMPLES + 1)
    inside = i + j <= TRIANGLE_SIDE_SAMPLES
    weights = np.stack([i, j, TRIANGLE_SIDE_SAMPLES - i - j], axis=1)[inside] / TRIANGLE_SIDE_SAMPLES
    spread = np.einsum("wc,mcd->mwd", weights, corners[nearby]).reshape(-1, mesh.nodes.shape[1])
    points: Floats = boundary.source.closest_point(spread).points
    return points
