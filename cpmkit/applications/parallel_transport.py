"""Parallel transport of vectors from points, and the logarithmic map, by short heat.

After Sharp, Soliman and Crane (2019), The vector heat method. With the connection's Laplacian,

    u / t - Lap u = sum of vectors at points,    t = 2 h^2,

with a lumped mass, and a longer t where nothing arrives, the direction of u at a point is that of the nearest vector
after transport along the shortest path, up to an error of second order. Lengths are the quotient of two such equations
for numbers, averaged over some four spacings where two vectors are about equally near. The logarithm of q is the vector
at p whose length is the distance of q and whose direction is the initial direction of the shortest path to q: the angle
at q between the gradient of the distance and a vector transported from p.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np

import cpmkit as ck
from cpmkit.applications.geodesics import PRESCRIBED_SPACINGS, Distance, geodesic_distance
from cpmkit.applications.heat import prepare_manifold, scene_of, tangential_coupling, vector_heat_directions
from cpmkit.applications.result import with_colours
from cpmkit.applications.vector_fields import TangentField, check_surface, project_vectors
from cpmkit.errors import InputError, place
from cpmkit.facade import Solution
from cpmkit.plugin import ClosestPointSource, HasNormals, dots, norms, unit
from cpmkit.preparing import Prepared
from cpmkit.runtime.arrays import as_points, as_vector
from cpmkit.scenefile.look import LookKeywords
from cpmkit.types import Floats


@dataclass(frozen=True, eq=False, repr=False)
class TransportedField(TangentField):
    """Vectors transported from points, with their lengths."""

    lengths: Solution  #: Two channels: lengths times heat, and heat.

    def evaluate(self, points: Any, side: Any = None, *, normalized: bool = False) -> Floats:
        """Return the tangential vectors (n, 3) at the surface points nearest to ``points`` (n, 3).

        Vectors have length one if ``normalized``; ``side`` is as for :meth:`TangentField.evaluate`.
        """
        directions = super().evaluate(points, side)
        if normalized:
            return directions
        weighted, heat = self.lengths.evaluate(as_points(points, 3), side).T
        return np.asarray((weighted / heat)[:, None] * directions)


@dataclass(frozen=True, eq=False, repr=False)
class LogarithmicMap:
    """Coordinates about a point: length and initial direction of the shortest path, a vector of the tangent plane."""

    point: Floats  #: (3,): a point of the surface.
    axes: Floats  #: (2, 3): orthonormal tangents at the point, the axes of the coordinates.
    distance: Distance  #: The distance from the point.
    #: The axes after transport to any point; the second is None where a normal of the surface gives it.
    transported_axes: tuple[TangentField, TangentField | None]

    def evaluate(self, points: Any) -> Floats:
        """Return coordinates (n, 2), in the scene's unit, of the surface's points nearest to ``points`` (n, 3)."""
        surface, h = self.distance.solution.scene.surface, self.distance.solution.spacing
        at = surface.closest_point(as_points(points, 3)).points
        away, length = unit(self.distance.gradient(at)), self.distance.evaluate(at)
        first_field, second_field = self.transported_axes
        first = first_field.evaluate(at, normalized=True)
        if second_field is None:
            second = np.cross(ck.normals_at(surface, at), first)
        else:
            second = second_field.evaluate(at, normalized=True)
        direction = np.stack([dots(away, axis) for axis in (first, second)], axis=1)
        # near the point, where the spline of the distance is inexact, the direction is that of the chord
        straight = (at - self.point) @ self.axes.T
        close = (norms(at - self.point) < 2 * h) & (length < PRESCRIBED_SPACINGS * h)
        return np.asarray(length[:, None] * unit(np.where(close[:, None], straight, direction)))

    def vectors(self, points: Any) -> Floats:
        """Return the logarithms (n, 3) of ``points`` (n, 3): tangent vectors at the point, as long as the paths."""
        return np.asarray(self.evaluate(points) @ self.axes)

    def __repr__(self) -> str:
        return f"LogarithmicMap about {place(self.point)} by a {self.distance!r}"

    def save(self, path: Any) -> None:
        """Write the distance, not the axes, to the file ``path`` as :meth:`cpmkit.Solution.save` does."""
        self.distance.save(path)

    def picture(self, path: Any, **options: Unpack[LookKeywords]) -> Any:
        """Draw rings and rays of the coordinates into the PNG file ``path``; see :meth:`cpmkit.Solution.picture`."""
        solution = self.distance.solution
        x, y = self.evaluate(solution.display_mesh().points).T
        length = np.hypot(x, y)
        ring, ray = np.floor(16 * length / length.max()), np.floor(24 * np.arctan2(y, x) / (2 * np.pi))
        light = np.where((ring + ray) % 2, 1.0, 0.72)[:, None]
        turn = np.arctan2(y, x)[:, None] + 2 * np.pi / 3 * np.arange(3)
        return with_colours(solution, light * (0.6 + 0.35 * np.cos(turn))).picture(path, **options)


def transport_vector(
    surface: ClosestPointSource | ck.Scene | Prepared,
    points: Any,
    vectors: Any,
    *,
    spacing: float | None = None,
    **options: Any,
) -> TransportedField:
    """Return the parallel transport of vectors at points along shortest paths to everywhere on a surface.

    Parameters
    ----------
    surface : ClosestPointSource, Scene or Prepared
        A surface in space; a scene whose boundaries are barriers; or a scene prepared in the form ``galerkin``.
    points : (k, 3) or (3,) array
        Points at which vectors are given. Elsewhere the vector of the nearest point arrives; half way between two
        points, the mean of their vectors.
    vectors : (k, 3) array, or (3,) for all points
        Neither zero nor normal to the surface; they are projected on it.
    spacing : float
        Spacing of the lattice, in the scene's unit; not for a prepared scene.
    **options
        Options of :func:`cpmkit.prepare`, which its ``help`` shows with defaults; ``form`` is ``galerkin`` by default.

    Returns
    -------
    TransportedField

    Raises
    ------
    InputError, SceneError
        If an argument is not accepted, or a piece of the surface has no point.

    Examples
    --------
    >>> import cpmkit as ck
    >>> from cpmkit.applications import transport_vector
    >>> moved = transport_vector(ck.source("analytic.sphere"), [0, 0, 1], [2, 0, 0], spacing=0.2)
    >>> moved.evaluate([[1, 0, 0], [0, 1, 0]]).round(1) + 0.0
    array([[ 0.,  0., -2.],
           [ 2.,  0.,  0.]])
    """
    check_surface(scene_of(surface).surface)
    prepared = prepare_manifold(surface, spacing, options)
    at, projected = project_vectors(prepared.scene.surface, points, vectors)
    return _transport_vectors(prepared, tangential_coupling(prepared, True), at, projected, norms(projected))


def logarithmic_map(
    surface: ClosestPointSource | ck.Scene | Prepared,
    point: Any,
    *,
    axis: Any = None,
    spacing: float | None = None,
    method: str = "transport",
    **options: Any,
) -> LogarithmicMap:
    """Return the logarithmic map of a surface about a point.

    Parameters
    ----------
    surface : ClosestPointSource, Scene or Prepared
        As for :func:`transport_vector`.
    point : (3,) array
        A point, which is projected on the surface.
    axis : (3,) array, optional
        A vector whose tangential part is the first axis; by default any tangent.
    spacing : float
        As for :func:`transport_vector`.
    method : {"transport", "heat"}
        Method of the distance, as for :func:`geodesic_distance`.
    **options
        Options of :func:`cpmkit.prepare`, which its ``help`` shows with defaults; ``form`` is ``galerkin`` by default.

    Returns
    -------
    LogarithmicMap

    Raises
    ------
    InputError, SceneError
        If an argument is not accepted, or the surface has a piece that no path from the point reaches.

    Examples
    --------
    >>> import cpmkit as ck
    >>> from cpmkit.applications import logarithmic_map
    >>> found = logarithmic_map(ck.source("analytic.sphere"), [0, 0, 1], axis=[1, 0, 0], spacing=0.2, method="heat")
    >>> found.evaluate([[0, 1, 0], [-1, 0, 0]]).round(1) + 0.0
    array([[ 0. ,  1.6],
           [-1.6,  0. ]])
    """
    check_surface(scene_of(surface).surface)
    prepared = prepare_manifold(surface, spacing, options)
    source = prepared.scene.surface
    at = source.closest_point(as_vector(point, 3, "point")[None]).points
    normal = ck.normals_at(source, at)[0]
    direction = np.eye(3)[np.abs(normal).argmin()] if axis is None else as_vector(axis, 3, "axis")
    first = direction - normal * (normal @ direction)
    if np.linalg.norm(first) <= 1e-6 * np.linalg.norm(direction):
        raise InputError("axis must not be zero or normal to the surface.")
    axes = unit(np.stack([first, np.cross(normal, first)]))
    coupling = tangential_coupling(prepared, True)
    first_field = _transport_vectors(prepared, coupling, at, axes[:1], np.ones(1))
    oriented = isinstance(source, HasNormals)  # then the normal and the first axis give the second
    second_field = None if oriented else _transport_vectors(prepared, coupling, at, axes[1:], np.ones(1))
    distance = geodesic_distance(prepared, at, method=method)
    return LogarithmicMap(at[0], axes, distance, (first_field, second_field))


def _transport_vectors(
    prepared: Prepared, coupling: ck.Field, at: Floats, vectors: Floats, lengths: Floats
) -> TransportedField:
    """Return the parallel transport of ``vectors`` (k, 3) with ``lengths`` (k,) from ``at`` (k, 3) to everywhere.

    The time of the heat of vectors is twice the spacing squared: with 16, directions are half as exact on Spot; with 1,
    they are a tenth more exact there, and less exact on a sphere. Lengths are averaged over four spacings, the root of
    the time of their heat.
    """
    directions = vector_heat_directions(prepared, coupling, ck.PointSource(at, vectors), 2.0)[1]
    numbers = ck.PointSource(at, np.stack([lengths, np.ones(len(at))], axis=1))
    c = 1 / (16 * prepared.discretized.spacing**2)
    return TransportedField(directions, "parallel", prepared.solve(problem=ck.ScreenedPoisson(numbers, c=c)))
