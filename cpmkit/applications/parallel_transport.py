"""Parallel transport of vectors from points, and the logarithmic map, by short heat.

After Sharp, Soliman and Crane (2019), The vector heat method. With the connection's Laplacian,

    u / t - Lap u = sum of vectors at points,    t = 2 h^2,

with a lumped mass, and for a longer t where nothing arrives, the direction of u at a point is that of the nearest
vector, transported along the shortest way, to an error of second order; lengths are the quotient of two such equations
of numbers, mixed over some four spacings where two vectors are about as near. The logarithm of q is the vector at p
whose length is the distance of q and whose direction is the one in which the shortest way to q leaves: the angle at q
between the gradient of the distance and a vector that came from p.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

import cpmkit as ck
from cpmkit.applications.coupling import tangential_coupling
from cpmkit.applications.geodesics import Distance, geodesic_distance
from cpmkit.applications.painted import painted
from cpmkit.applications.transport import HELD_SPACINGS
from cpmkit.applications.vector_fields import TangentField, check_surface, tangential
from cpmkit.applications.vector_heat import directions_of_heat
from cpmkit.errors import InputError, place
from cpmkit.facade import Solution
from cpmkit.plugin import unit
from cpmkit.preparing import Prepared
from cpmkit.protocols import ClosestPointSource, Floats, HasNormals
from cpmkit.runtime.arrays import as_points, as_vector

if TYPE_CHECKING:
    from cpmkit.scenefile.look import LookKeywords

#: Time of the vectors' heat over the spacing's square: with 16 directions are half as exact on Spot, with 1 they are a
#: tenth more exact there, and less on a sphere.
HEAT_TIME = 2.0
#: The same of lengths, which are mixed over its root in spacings.
MIXING_TIME = 16.0
#: Within so many spacings of the point its logarithm is the straight difference.
STRAIGHT_SPACINGS = 2.0
#: Rings and rays of a picture of a logarithmic map.
RINGS, RAYS = 16, 24


@dataclass(frozen=True, eq=False, repr=False)
class TransportedField(TangentField):
    """Vectors transported from points, with their lengths.

    Attributes
    ----------
    lengths : Solution
        Two channels, the lengths times heat and heat alone.
    """

    lengths: Solution

    def evaluate(self, points: Any, side: Any = None, *, normalized: bool = False) -> Floats:
        """Return the tangential vectors (n, 3) nearest to ``points``, of length one if ``normalized``."""
        directions = super().evaluate(points, side)
        if normalized:
            return directions
        weighed, heat = self.lengths.evaluate(as_points(points, 3), side).T
        return np.asarray((weighed / heat)[:, None] * directions)


@dataclass(frozen=True, eq=False, repr=False)
class LogarithmicMap:
    """Coordinates about a point: the plane's polar coordinates of length and direction of the shortest way.

    Attributes
    ----------
    point : (3,) float64
        On the surface.
    axes : (2, 3) float64
        Orthonormal tangents there, which coordinates belong to.
    distance : Distance
        From the point.
    transported : sequence of callable
        The axes, transported to any points (n, 3).
    """

    point: Floats
    axes: Floats
    distance: Distance
    transported: tuple[TangentField, TangentField | None]

    def evaluate(self, points: Any) -> Floats:
        """Return the coordinates (n, 2) of the surface's points nearest to ``points``."""
        surface, h = self.distance.solution.scene.surface, self.distance.solution.spacing
        at = surface.closest_point(as_points(points, 3)).points
        away, length = unit(self.distance.gradient(at)), self.distance.evaluate(at)
        one, other = self.transported
        first = one.evaluate(at, normalized=True)
        second = np.cross(ck.normals_at(surface, at), first) if other is None else other.evaluate(at, normalized=True)
        turned = np.stack([np.einsum("nd,nd->n", away, axis) for axis in (first, second)], axis=1)
        straight = (at - self.point) @ self.axes.T
        near = (np.linalg.norm(at - self.point, axis=1) < STRAIGHT_SPACINGS * h) & (length < HELD_SPACINGS * h)
        return np.asarray(length[:, None] * unit(np.where(near[:, None], straight, turned)))

    def vectors(self, points: Any) -> Floats:
        """Return the logarithms (n, 3): tangent vectors at the point, as long as the shortest ways."""
        return np.asarray(self.evaluate(points) @ self.axes)

    def __repr__(self) -> str:
        return f"LogarithmicMap about {place(self.point)} by a {self.distance!r}"

    def save(self, path: Any) -> None:
        """Write the distance as :meth:`cpmkit.Solution.save` does."""
        self.distance.save(path)

    def picture(self, path: Any, **options: Unpack[LookKeywords]) -> Any:
        """Draw rings and rays of the coordinates as :meth:`cpmkit.Solution.picture` draws."""
        solution = self.distance.solution
        x, y = self.evaluate(solution.display_mesh().points).T
        length = np.hypot(x, y)
        ring, ray = np.floor(RINGS * length / length.max()), np.floor(RAYS * np.arctan2(y, x) / (2 * np.pi))
        light = np.where((ring + ray) % 2, 1.0, 0.72)[:, None]
        turn = np.arctan2(y, x)[:, None] + 2 * np.pi / 3 * np.arange(3)
        return painted(solution, light * (0.6 + 0.35 * np.cos(turn))).picture(path, **options)


def transport_vector(
    surface: ClosestPointSource | ck.Scene | Prepared,
    points: Any,
    vectors: Any,
    *,
    spacing: float | None = None,
    **options: Any,
) -> TransportedField:
    """Return the vectors that come from points by parallel transport along shortest ways.

    Parameters
    ----------
    surface : ClosestPointSource, Scene or Prepared
        In space; a scene, whose boundaries are barriers; or a scene that was prepared in the form ``galerkin``.
    points : (k, 3) or (3,) array
        Where vectors are given. Elsewhere the nearest one's arrives; half way between two, their mean.
    vectors : (k, 3) or (3,) array
        Not zero, and not standing on the surface, on which they are projected.
    spacing : float
        Of the lattice, in the scene's unit; not of a prepared scene.
    **options
        Of :func:`cpmkit.prepare`.

    Returns
    -------
    TransportedField

    Raises
    ------
    InputError, SceneError
        If an argument is not what is accepted.

    Examples
    --------
    >>> import cpmkit as ck
    >>> from cpmkit.applications import transport_vector
    >>> moved = transport_vector(ck.source("analytic.sphere"), [0, 0, 1], [2, 0, 0], spacing=0.2)
    >>> moved.evaluate([[1, 0, 0], [0, 1, 0]]).round(1) + 0.0
    array([[ 0.,  0., -2.],
           [ 2.,  0.,  0.]])
    """
    prepared = _prepared(surface, spacing, options)
    at = as_points(np.atleast_2d(points), 3)
    at = prepared.scene.surface.closest_point(at).points
    given = tangential(prepared.scene.surface, at, np.broadcast_to(np.atleast_2d(vectors), at.shape))
    lengths = np.linalg.norm(given, axis=1)
    if not np.isfinite(lengths).all() or not (lengths > 1e-6 * np.linalg.norm(np.atleast_2d(vectors), axis=1)).all():
        raise InputError("vectors that are transported must be finite, not zero, and not stand on the surface.")
    return _transported(prepared, tangential_coupling(prepared, True), at, given, lengths)


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
        On the surface.
    axis : (3,) array, optional
        Whose tangential part is the first axis; any unless given.
    spacing : float
        Of the lattice.
    method : {"transport", "heat"}
        Of the distance, as for :func:`geodesic_distance`.
    **options
        Of :func:`cpmkit.prepare`.

    Returns
    -------
    LogarithmicMap

    Raises
    ------
    InputError, SceneError
        If an argument is not what is accepted.

    Examples
    --------
    >>> import cpmkit as ck
    >>> from cpmkit.applications import logarithmic_map
    >>> found = logarithmic_map(ck.source("analytic.sphere"), [0, 0, 1], axis=[1, 0, 0], spacing=0.2, method="heat")
    >>> found.evaluate([[0, 1, 0], [-1, 0, 0]]).round(1) + 0.0
    array([[ 0. ,  1.6],
           [-1.6,  0. ]])
    """
    prepared = _prepared(surface, spacing, options)
    source = prepared.scene.surface
    at = source.closest_point(as_vector(point, 3, "point")[None]).points
    normal = ck.normals_at(source, at)[0]
    wanted = np.eye(3)[np.abs(normal).argmin()] if axis is None else as_vector(axis, 3, "axis")
    first = wanted - normal * (normal @ wanted)
    if np.linalg.norm(first) <= 1e-6 * np.linalg.norm(wanted):
        raise InputError("axis must not be zero or stand on the surface.")
    axes = unit(np.stack([first, np.cross(normal, first)]))
    coupling = tangential_coupling(prepared, True)
    one = _transported(prepared, coupling, at, axes[:1], np.ones(1))
    own = isinstance(source, HasNormals)  # of one sign everywhere: the second axis is the first one turned
    other = None if own else _transported(prepared, coupling, at, axes[1:], np.ones(1))
    return LogarithmicMap(at[0], axes, geodesic_distance(prepared, at, method=method), (one, other))


def _prepared(surface: Any, spacing: float | None, options: dict[str, Any]) -> Prepared:
    """Return the surface prepared, with its boundaries for barriers."""
    if isinstance(surface, Prepared):
        if spacing is not None or options:
            raise InputError("spacing and options are those of the prepared scene; leave them out.")
        check_surface(surface.scene.surface)
        return surface
    scene = surface if isinstance(surface, ck.Scene) else ck.Scene(surface, ck.Poisson(0.0))
    check_surface(scene.surface)
    scene = ck.Scene(scene.surface, ck.Poisson(0.0), scene.boundaries, scene.edge)
    made: Prepared = ck.prepare(scene, spacing, **{"form": "galerkin", **options})
    return made


def _transported(
    prepared: Prepared, coupling: ck.Field, at: Floats, vectors: Floats, lengths: Floats
) -> TransportedField:
    """Return ``vectors`` (k, 3) of ``lengths`` (k,) from the points ``at`` (k, 3)."""
    moved = directions_of_heat(prepared, coupling, ck.PointSource(at, vectors), HEAT_TIME)[1]
    numbers = ck.PointSource(at, np.stack([lengths, np.ones(len(at))], axis=1))
    c = 1 / (MIXING_TIME * prepared.discretized.spacing**2)
    return TransportedField(moved, "parallel", prepared.solve(problem=ck.ScreenedPoisson(numbers, c=c)))
