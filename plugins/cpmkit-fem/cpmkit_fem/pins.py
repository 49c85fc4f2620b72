"""Dirichlet data: each boundary pins the vertices nearest to it, the edge its own vertices.

This is what mesh methods do in King et al. (2024), section 2.3: of first order in the length of an edge, of
second where the boundary runs along edges of the mesh.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import SIDES, BoundarySet, Data, Floats, Ints, Scene, SceneError, Value, evaluate_data
from cpmkit_fem.gaps import ends_in_gaps
from cpmkit_fem.rim import WHAT, RimPart
from cpmkit_fem.triangulation import Triangulation

#: Points a side of each triangle near a boundary whose feet sample the boundary.
TRIANGLE_SIDE_SAMPLES = 3
#: Data on two sides are equal up to this share of their size.
EQUAL_DATA_SHARE = 1e-12
#: A boundary passes through a vertex if it is nearer than this share of an edge.
THROUGH_VERTEX_SHARE = 1e-6
ACCEPTED = "backend='fem' keeps one value a vertex and takes the same Dirichlet data on both sides; use backend='cpm'"


@dataclass(frozen=True, eq=False)
class Claim:
    """Vertices that one condition pins, and where each reads its value.

    Attributes
    ----------
    vertices : (k,) int64
    distance : (k,) float64
        From the condition's place.
    points : (k, d) float64
        Points of it, of which the data are asked.
    data : tuple of Data
        Those of the one condition, or of both sides, which must agree.
    what : str
        Named in errors.
    """

    vertices: Ints
    distance: Floats
    points: Floats
    data: tuple[Data, ...]
    what: str

    def values(self, channels: int, time: float | None) -> Floats:
        """Return the data (k, channels).

        Raises
        ------
        SceneError
            If they differ on the two sides.
        """
        values = [evaluate_data(data, self.points, channels, self.what, time) for data in self.data]
        size = np.abs(values).max(initial=0.0)
        if any(np.abs(other - values[0]).max(initial=0.0) > EQUAL_DATA_SHARE * size for other in values[1:]):
            raise SceneError(f"{self.what} has different data on its two sides; {ACCEPTED}.")
        return values[0]


@dataclass(frozen=True, eq=False)
class Pins:
    """Vertices with given values.

    Attributes
    ----------
    vertices : (p,) int64
    warnings : tuple of str
        How far from their boundary the pinned vertices lie.
    claims : sequence of Claim
        Of all conditions.
    picked : (p,) int64
        The row of the joined claims that each vertex takes.
    channels : int
        Of the values.
    """

    vertices: Ints
    warnings: tuple[str, ...]
    claims: Sequence[Claim]
    picked: Ints
    channels: int

    def values(self, time: float | None = None) -> Floats:
        """Return the values (p, channels)."""
        none = np.zeros((0, self.channels))
        return np.concatenate([none, *(claim.values(self.channels, time) for claim in self.claims)])[self.picked]


def pin(scene: Scene, mesh: Triangulation, rim: Sequence[RimPart]) -> Pins:
    """Return all pinned vertices; one that several conditions claim takes the nearest one's value.

    Raises
    ------
    SceneError
        If a boundary holds anything but Dirichlet conditions on both sides, or lies off the mesh.
    """
    claims = [_nearest_vertices(boundary, mesh) for boundary in scene.boundaries]
    warnings = tuple(
        f"The {claim.what} pins {len(claim.vertices)} vertices up to {claim.distance.max():.3g} away from it "
        f"(a mean edge is {mesh.mean_edge:.3g}): the answer is of first order there."
        for claim in claims
        if claim.distance.max() > THROUGH_VERTEX_SHARE * mesh.mean_edge
    )
    claims += [
        Claim(part.on, np.zeros(len(part.on)), part.points, (part.law.datum,), WHAT)
        for part in rim
        if isinstance(part.law, Value)
    ]
    none = np.zeros(0, dtype=np.int64)
    vertices = np.concatenate([none, *(claim.vertices for claim in claims)])
    order = np.lexsort((np.concatenate([none, *(claim.distance for claim in claims)]), vertices))
    pinned, first = np.unique(vertices[order], return_index=True)
    return Pins(pinned, warnings, claims, order[first], scene.channels)


def _nearest_vertices(boundary: BoundarySet, mesh: Triangulation) -> Claim:
    """Return the vertices nearest to some point of the boundary, without gaps."""
    from scipy.spatial import cKDTree

    nearest = np.unique(cKDTree(mesh.vertices).query(_samples(boundary, mesh))[1])
    vertices = np.union1d(nearest, ends_in_gaps(boundary.source, mesh, nearest))
    feet = boundary.source.closest_point(mesh.vertices[vertices])
    return Claim(vertices, feet.distance, feet.points, _data_of(boundary), f"boundary {boundary.name!r}")


def _data_of(boundary: BoundarySet) -> tuple[Data, ...]:
    """Return the Dirichlet data of a boundary, once where one condition holds on both sides."""
    sides = [boundary.condition(side) for side in SIDES]
    data = [one.law.datum for one in sides if isinstance(one.law, Value)]
    if len(data) < len(sides):
        left, right = sides
        raise SceneError(
            f"boundary {boundary.name!r} has {left.kind} on its left and {right.kind} on its right; {ACCEPTED}."
        )
    return tuple(data[:1] if sides[0] is sides[1] else data)


def _samples(boundary: BoundarySet, mesh: Triangulation) -> Floats:
    """Return points of the boundary, closer together than vertices: feet of points all over the triangles near it."""
    corners = mesh.vertices[mesh.faces]
    near = boundary.source.closest_point(corners.mean(axis=1)).distance <= mesh.longest_edges
    if not near.any():
        raise SceneError(
            f"boundary {boundary.name!r} is farther than an edge from every triangle of the mesh; move it onto the "
            "surface."
        )
    i, j = np.divmod(np.arange((TRIANGLE_SIDE_SAMPLES + 1) ** 2), TRIANGLE_SIDE_SAMPLES + 1)
    inside = i + j <= TRIANGLE_SIDE_SAMPLES
    weights = np.stack([i, j, TRIANGLE_SIDE_SAMPLES - i - j], axis=1)[inside] / TRIANGLE_SIDE_SAMPLES
    spread = np.einsum("wc,mcd->mwd", weights, corners[near]).reshape(-1, mesh.vertices.shape[1])
    points: Floats = boundary.source.closest_point(spread).points
    return points
