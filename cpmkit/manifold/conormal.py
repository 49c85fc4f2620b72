"""The normal of a manifold and the conormal to the left, at feet on a boundary.

King et al. (2024), section 4.7 and eq. 18: v = n x t is its binormal b, and the normal of S_perp in its eq. 11.
"""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.orientation import Orientation
from cpmkit.manifold.tangent_space import tangents_and_corners, unit_normals, unit_tangents
from cpmkit.protocols import ClosestPoints, Floats


def axis_and_left(
    source: LocalSource,
    surface: LocalSource,
    signs: tuple[Orientation, Orientation],
    on_surface: ClosestPoints,
    feet: ClosestPoints,
    step: float,
) -> tuple[Floats, Floats]:
    """Return n (n, d) and the conormal v (n, d) that points to the left; where n is not needed, v again.

    Parameters
    ----------
    source, surface : LocalSource
        The boundary, of one dimension less than the manifold there, and the manifold.
    signs : pair of Orientation
        Across: of the manifold's normals, of its tangents where it is a curve. Along: of the boundary's own tangents,
        of its normals where it is a surface.
    on, feet : ClosestPoints
        The manifold's and the boundary's own records of the feet.
    step : float
        Of differences.
    """
    across, along = signs
    dimension = (source.manifold_dim or 0) + 1
    axis = None
    if dimension == 2 and surface.dim == 3:
        axis = across.apply(on_surface.points, unit_normals(surface, on_surface, step))
    left = np.empty_like(on_surface.points)
    for member, rows, member_feet in source.by_member(feet):
        if member.has_left:
            left[rows] = member.leftward(member_feet)
        elif dimension == 1:
            left[rows] = -across.apply(on_surface.points[rows], unit_tangents(surface, on_surface.take(rows), step))
        elif dimension == 3:
            left[rows] = along.apply(member_feet.points, unit_normals(member, member_feet, step))
        elif axis is None:
            tangent = _travel(member, along, member_feet, step)
            left[rows] = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
        else:
            across_it = np.cross(axis[rows], _travel(member, along, member_feet, step))
            left[rows] = across_it / np.linalg.norm(across_it, axis=1, keepdims=True)
    return (left if axis is None else axis), left


def _travel(source: LocalSource, along: Orientation, feet: ClosestPoints, step: float) -> Floats:
    """Return the direction of travel (n, d) at feet on a curve; at a corner about the bisector of both directions."""
    directions, corner = tangents_and_corners(source, feet, step)
    directions = along.apply(feet.points, directions)
    if along.points is not None and corner.any():
        directions[corner] = along.mean(feet.points[corner])
    return directions
