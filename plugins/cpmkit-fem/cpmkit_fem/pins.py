"""Dirichlet data: each boundary pins the vertices nearest to it, the edge its own vertices.

This is what mesh methods do in King et al. (2024), section 2.3: of first order in the length of an edge, of
second where the boundary runs along edges of the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import BoundarySet, Floats, Ints, Scene, SceneError, Value, evaluate_data
from cpmkit_fem.gaps import ends_in_gaps
from cpmkit_fem.rim import Rim
from cpmkit_fem.triangulation import Triangulation

#: Points a side of each triangle near a boundary whose feet sample the boundary.
SAMPLES = 3
#: Data on two sides are equal up to this share of their size.
EQUAL = 1e-12
#: A boundary passes through a vertex if it is nearer than this share of an edge.
THROUGH = 1e-6


@dataclass(frozen=True, eq=False)
class Pins:
    """Vertices with given values.

    Attributes
    ----------
    vertices : (p,) int64
    values : (p, channels) float64
    warnings : tuple of str
        How far from their boundary the pinned vertices lie.
    """

    vertices: Ints
    values: Floats
    warnings: tuple[str, ...]


def pin(scene: Scene, mesh: Triangulation, rim: Rim) -> Pins:
    """Return all pinned vertices; one that several conditions claim takes the nearest one's value.

    Raises
    ------
    SceneError
        If a boundary holds anything but one Dirichlet condition for both sides, or lies off the mesh.
    """
    claims = [_nearest_vertices(boundary, scene, mesh) for boundary in scene.boundaries]
    warnings = [
        f"The boundary {boundary.name!r} pins {len(vertices)} vertices up to {distance.max():.3g} away from it "
        f"(a mean edge is {mesh.mean_edge:.3g}): the answer is of first order there."
        for boundary, (vertices, distance, _) in zip(scene.boundaries, claims, strict=True)
        if distance.max() > THROUGH * mesh.mean_edge
    ]
    for condition, edges in rim.conditions(scene):
        law = condition.law
        if isinstance(law, Value):
            on = np.unique(rim.edges[edges])
            values = evaluate_data(law.datum, mesh.vertices[on], scene.channels, "the edge's condition")
            claims.append((on, np.zeros(len(on)), values))
    if not claims:
        return Pins(np.zeros(0, dtype=np.int64), np.zeros((0, scene.channels)), ())
    vertices, distance, values = (np.concatenate(part) for part in zip(*claims, strict=True))
    order = np.lexsort((distance, vertices))
    pinned, first = np.unique(vertices[order], return_index=True)
    return Pins(pinned, values[order[first]], tuple(warnings))


def _nearest_vertices(boundary: BoundarySet, scene: Scene, mesh: Triangulation) -> tuple[Ints, Floats, Floats]:
    """Return the vertices nearest to some point of the boundary, without gaps, their distance and their values."""
    from scipy.spatial import cKDTree

    samples = _samples(boundary, mesh)
    nearest = np.unique(cKDTree(mesh.vertices).query(samples)[1])
    vertices = np.union1d(nearest, ends_in_gaps(boundary.source, mesh, nearest))
    feet = boundary.source.closest_point(mesh.vertices[vertices])
    return vertices, feet.distance, _one_value(boundary, feet.points, scene.channels)


def _samples(boundary: BoundarySet, mesh: Triangulation) -> Floats:
    """Return points of the boundary, closer together than vertices: feet of points all over the triangles near it."""
    corners = mesh.vertices[mesh.faces]
    near = boundary.source.closest_point(corners.mean(axis=1)).distance <= mesh.longest_edges
    if not near.any():
        raise SceneError(
            f"boundary {boundary.name!r} is farther than an edge from every triangle of the mesh; move it onto the "
            "surface."
        )
    i, j = np.divmod(np.arange((SAMPLES + 1) ** 2), SAMPLES + 1)
    inside = i + j <= SAMPLES
    weights = np.stack([i, j, SAMPLES - i - j], axis=1)[inside] / SAMPLES
    spread = np.einsum("wc,mcd->mwd", weights, corners[near]).reshape(-1, mesh.vertices.shape[1])
    points: Floats = boundary.source.closest_point(spread).points
    return points


def _one_value(boundary: BoundarySet, points: Floats, channels: int) -> Floats:
    """Return the data (p, channels) at points of the boundary, the same on both sides."""
    left, right = boundary.condition("left"), boundary.condition("right")
    accepted = (
        "backend='fem' keeps one value a vertex and takes the same Dirichlet data on both sides; use backend='cpm'"
    )
    one, other = left.law, right.law
    if not (isinstance(one, Value) and isinstance(other, Value)):
        raise SceneError(
            f"boundary {boundary.name!r} has {left.kind} on its left and {right.kind} on its right; {accepted}."
        )
    what = f"boundary {boundary.name!r}"
    values = evaluate_data(one.datum, points, channels, what)
    if left is not right:
        others = evaluate_data(other.datum, points, channels, what)
        if np.abs(values - others).max(initial=0.0) > EQUAL * np.abs([values, others]).max(initial=0.0):
            raise SceneError(f"boundary {boundary.name!r} has different data on its two sides; {accepted}.")
    return values
