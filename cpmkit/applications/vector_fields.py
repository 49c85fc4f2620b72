"""Smooth fields of tangential vectors with prescribed directions at points and along curves, and their singularities.

``parallel`` extends vectors as parallel transport does: P Lap (P u) = 0 with the connection's Laplacian, as in the
vector heat method (Sharp, Soliman and Crane 2019). ``paper`` extends each coordinate by itself and keeps vectors
tangential: P Lap u = 0, the stationary flow of King et al. (2024), section 7.3, whose vectors deviate towards flat
parts of the surface.

With n the normal, S = -grad n and componentwise energies |grad u|^2 = |P grad u|^2 + |S u|^2 of tangential u,

    -Lap u + (s / h^2) n n' u - S^2 u = 0,

the last term only for ``parallel``, is one linear system of three channels. The penalty s / h^2 keeps u tangential up
to an error of third order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Unpack

import numpy as np

import cpmkit as ck
from cpmkit.applications import result
from cpmkit.applications.heat import scene_of, tangential_coupling
from cpmkit.errors import InputError, shown
from cpmkit.facade import Solution
from cpmkit.plugin import ClosestPointSource, Mesh, dots, norms, unit, vertex_normals
from cpmkit.runtime.arrays import as_points, as_vector, positive
from cpmkit.scenefile.look import LookKeywords
from cpmkit.types import Floats, Ints


@dataclass(frozen=True)
class Singularity:
    """A point at which a tangential field has no direction."""

    place: Floats  #: (3,): the centre of the triangle that contains the point.
    #: Number of turns of the field along a small circle around the point, positive in the sense of the circle. On a
    #: surface that is not orientable the sign is that of the triangle's own orientation.
    index: int


def singularities(vertices: Floats, faces: Ints, vectors: Floats, normals: Floats | None = None) -> list[Singularity]:
    """Return the singularities of a field given by tangential ``vectors`` (v, 3) at the vertices of a mesh.

    In each triangle the field is transported from corner to corner by the smallest rotation that takes one corner's
    tangent plane to the next. The index is the sum of the remaining turns and the curvature of the triangle, over 2 pi.
    On a closed surface the indices sum exactly to the Euler characteristic of the mesh, for any field; also where the
    mesh is cut along a curve that the field follows on both sides, in equal or opposite directions, with the same
    ``normals``.

    ``vertices``, ``faces`` (v, 3) float64, (f, 3) int64: the triangles.
    ``vectors`` (v, 3): the field.
    ``normals`` (v, 3): unit normals at the vertices; by default, and where triangles are not consistently oriented,
        from the triangles.
    """
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if (Mesh.of(vertices, faces).winding == 1).all():  # oriented: normals are trusted, also against those of slivers
        normals = vertex_normals(vertices, faces) if normals is None else normals
        signs = np.ones(faces.shape)
    else:
        area = np.linalg.norm(across, axis=1)[:, None, None]
        squares = across[:, :, None] * across[:, None] / (area + (area == 0))
        sums = np.zeros((len(vertices), 3, 3))
        np.add.at(sums, faces.ravel(), np.repeat(squares, 3, axis=0))
        normals = np.asarray(np.linalg.eigh(sums)[1][:, :, -1])  # of either sign
        signs = np.where(np.einsum("fd,fcd->fc", across, normals[faces]) < 0, -1.0, 1.0)
    planes = normals[faces] * signs[:, :, None]  # (f, 3, 3): with the sign of the triangle's own normal
    first = np.cross(planes, np.eye(3)[np.abs(planes).argmin(axis=2)])  # equal up to the sign where the normals are
    first /= np.linalg.norm(first, axis=2, keepdims=True)
    second = np.cross(planes, first)
    at_corners = vectors[faces]
    angle = np.arctan2(np.einsum("fcd,fcd->fc", at_corners, second), np.einsum("fcd,fcd->fc", at_corners, first))
    transport = np.stack([_transport_angle(planes, first, second, k) for k in range(3)], axis=1)
    steps = _wrap_angles(np.roll(angle, -1, axis=1) - angle - transport)
    curvature = _wrap_angles(transport.sum(axis=1))
    index = np.rint((steps.sum(axis=1) + curvature) / (2 * np.pi)).astype(int)
    return [Singularity(corners[face].mean(axis=0), int(index[face])) for face in np.flatnonzero(index)]


def _transport_angle(planes: Floats, first: Floats, second: Floats, corner: int) -> Floats:
    """Return the angle (f,) of the first axis at a ``corner`` of each triangle after its transport to the next corner.

    The angle is measured from the first axis at the next corner. ``planes`` (f, 3, 3) are the normals at the corners,
    ``first`` and ``second`` (f, 3, 3) the axes of their tangent planes.
    """
    after = (corner + 1) % 3
    n, m, axis = planes[:, corner], planes[:, after], first[:, corner]
    cosine = np.einsum("fd,fd->f", n, m)[:, None]
    turn = np.cross(n, m)
    # Rodrigues' rotation that takes n to m
    rotated = axis * cosine + np.cross(turn, axis) + turn * np.einsum("fd,fd->f", turn, axis)[:, None] / (1 + cosine)
    along, across = (np.einsum("fd,fd->f", rotated, axes[:, after]) for axes in (first, second))
    return np.asarray(np.arctan2(across, along))


def _wrap_angles(angles: Floats) -> Floats:
    """Return angles modulo 2 pi, from -pi inclusive up to pi."""
    return np.asarray((angles + np.pi) % (2 * np.pi) - np.pi)


@dataclass(frozen=True, eq=False, repr=False)
class TangentField(result.Result):
    """A field of tangential vectors: read, saved and drawn as a solution of three channels.

    ``solution`` has the vectors on splines of the lattice, tangential to the order of the method, of any length.
    """

    transport: str  #: How directions are extended: ``parallel`` or ``paper``.

    def evaluate(self, points: Any, side: Any = None, *, normalized: bool = True) -> Floats:
        """Return tangent vectors (n, 3), of length one if ``normalized``, at the points nearest to ``points`` (n, 3).

        ``side``, but not "both", and errors are as for :meth:`cpmkit.Solution.evaluate`. Zero vectors remain zero.
        """
        surface = self.solution.scene.surface
        at = as_points(points, surface.dim)
        vectors = tangential_parts(surface, at, self.solution.evaluate(at, side))
        return unit(vectors) if normalized else vectors

    @cached_property
    def singularities(self) -> list[Singularity]:
        """Points at which the field has no direction, with indices; on a closed surface these sum to its Euler number.

        This includes fields that run in opposite directions on both sides of a curve. Where the two sides differ in
        another way, as around a piece that the spacing does not resolve, the singularities of each side are listed, and
        their sum has no meaning. Raises InputError if the surface has no triangles, as a point cloud.
        """
        surface, mesh = self.solution.scene.surface, self.solution.display_mesh()
        if not len(mesh.triangles):
            raise InputError(f"singularities are found on triangles, and {type(surface).__name__} has none.")
        vectors = tangential_parts(surface, mesh.points, mesh.values)
        return singularities(mesh.points, mesh.triangles, vectors, mesh.normals)

    def drawable(self, length: float | None = None) -> Solution:
        """Return the surface with arrows of one ``length``, by default 0.045 of the longest side of its bounds.

        ``length`` is in the scene's unit; InputError is raised if it is not above zero.
        """
        surface, mesh = self.solution.scene.surface, self.solution.display_mesh()
        size = float(np.ptp(surface.bounds, axis=0).max())
        length = 0.045 * size if length is None else positive(length, "length")
        centres = mesh.points[result.subsample_points(mesh.points, 0.95 * length)]
        plain = result.with_colours(self.solution, np.broadcast_to((0.93, 0.92, 0.9), mesh.points.shape))
        return result.with_arrows(plain, centres, self.evaluate(centres, normalized=True), length, (0.10, 0.25, 0.55))

    def picture(self, path: Any, *, length: float | None = None, **options: Unpack[LookKeywords]) -> Any:
        """Draw arrows of one length on the surface, as :meth:`cpmkit.Solution.picture` draws.

        Parameters
        ----------
        path : str or Path
            A PNG file.
        length : float, optional
            Length of an arrow; by default 0.045 of the longest side of the surface's bounds.
        **options
            Options of :meth:`cpmkit.Solution.picture`.
        """
        return self.drawable(length).picture(path, **options)


def vector_field(
    surface: ClosestPointSource | ck.Scene,
    directions: Sequence[tuple[Any, Any]],
    *,
    spacing: float | None = None,
    transport: str = "parallel",
    **options: Any,
) -> TangentField:
    """Return the smoothest field of tangential vectors with prescribed directions.

    Parameters
    ----------
    surface : ClosestPointSource or Scene
        A surface in space; or a scene whose boundaries are barriers, which nothing passes.
    directions : sequence of tuples
        Places and their directions: points (k, 3) with vectors (k, 3) or (3,); a curve with ``"tangent"``,
        ``"backwards"``, ``"left"``, ``"right"``, a vector (3,) or a function of points; or a curve with ``{"left": ...,
        "right": ...}``, one of these for each of its sides. Vectors are projected on the surface.
    spacing : float
        Spacing of the lattice, in the scene's unit.
    transport : {"parallel", "paper"}
        How directions are extended; see this module.
    **options
        Options of :func:`cpmkit.prepare`, which its ``help`` shows with defaults; ``form`` is ``galerkin`` by default.

    Returns
    -------
    TangentField

    Raises
    ------
    InputError, SceneError
        If an argument is not accepted.

    Examples
    --------
    The direction east along a sphere's equator extends to both poles as east; the field turns round the poles.

    >>> import cpmkit as ck
    >>> from cpmkit.applications import vector_field
    >>> equator = ck.source("analytic.circle", normal=[0, 0, 1])
    >>> field = vector_field(ck.source("analytic.sphere"), [(equator, "tangent")], spacing=0.2)
    >>> field.evaluate([[0.8, 0, 0.6]]).round(2) + 0.0
    array([[0., 1., 0.]])
    >>> sum(one.index for one in field.singularities)
    2
    """
    result.check_choice(transport, ("parallel", "paper"), "transport")
    scene = scene_of(surface)
    check_surface(scene.surface)
    if not directions:
        raise InputError("give a direction at one point or along one curve at least.")
    boundaries = [
        boundary
        for number, pair in enumerate(directions)
        for boundary in _direction_boundaries(number, pair, scene.surface)
    ]
    whole = ck.Scene(scene.surface, ck.Laplace(), [*scene.boundaries, *boundaries], scene.edge)
    prepared = ck.prepare(whole, spacing, **{"form": "galerkin", **options})
    coupling = tangential_coupling(prepared, transport == "parallel")
    return TangentField(
        prepared.solve(problem=ck.Coupled(lambda points: coupling(points).reshape(-1, 3, 3))), transport
    )


def check_surface(surface: ClosestPointSource) -> None:
    """Raise InputError if a manifold is no surface in space, on which fields of tangential vectors are made."""
    if surface.dim != 3 or surface.manifold_dim != 2:
        raise InputError("fields of tangential vectors are made on surfaces in space.")


def _direction_boundaries(number: int, pair: Any, surface: ClosestPointSource) -> list[ck.Boundary]:
    """Return the boundaries that prescribe the directions of a ``pair`` (place, directions).

    Raises InputError if it is no such pair, or a direction at a point is zero or normal to the surface.
    """
    where, which = result.unpack_pair(pair, "directions are pairs (where, which)")
    if getattr(where, "manifold_dim", 0):  # a curve
        name = f"direction {number}"
        if isinstance(which, Mapping):
            sides = {side: _curve_directions(where, surface, direction) for side, direction in which.items()}
            if set(sides) != {"left", "right"}:
                raise InputError(f"directions of two sides are given as left and right, got {', '.join(sides)}.")
            return [ck.Boundary(name, where, **{side: ck.Dirichlet(direction) for side, direction in sides.items()})]
        return [ck.Boundary(name, where, both=ck.Dirichlet(_curve_directions(where, surface, which)))]
    points, vectors = project_vectors(surface, where, which)
    return result.point_boundaries(f"direction {number}", points, unit(vectors))


def _curve_directions(curve: ClosestPointSource, surface: ClosestPointSource, which: Any) -> Callable[[Floats], Floats]:
    """Return a function that maps points (k, 3) of a curve in ``surface`` to unit tangents (k, 3), zero if normal.

    Raises InputError if ``which`` is neither the name of a direction, a vector (3,) nor a function of points.
    """
    if isinstance(which, str):
        named = {"tangent": (0, 1.0), "backwards": (0, -1.0), "left": (1, 1.0), "right": (1, -1.0)}
        if which not in named:
            raise InputError(f"a direction along a curve is {', '.join(named)}, got {shown(which)}.")
        (kind, sign), frame = named[which], ck.directions_along(curve, surface)
        return lambda points: sign * frame(points)[kind]
    if callable(which):
        return lambda points: unit(tangential_parts(surface, points, np.asarray(which(points), dtype=np.float64)))
    vector = as_vector(which, 3, "a direction along a curve, if it is no name or function,")
    return lambda points: unit(tangential_parts(surface, points, np.broadcast_to(vector, points.shape)))


def project_vectors(surface: ClosestPointSource, points: Any, vectors: Any) -> tuple[Floats, Floats]:
    """Return ``points`` (k, 3) or (3,) projected on a surface, (k, 3), and there the tangential parts of ``vectors``.

    Vectors are (k, 3), or (3,) for all points. Raises InputError for another shape, or if a tangential part is zero.
    """
    at = surface.closest_point(as_points(np.atleast_2d(points), 3)).points
    given = as_points(np.atleast_2d(vectors), 3, "vectors")
    if len(given) not in (1, len(at)):
        raise InputError(f"{len(at)} points need one vector or {len(at)}, got {len(given)}.")
    parts = tangential_parts(surface, at, np.broadcast_to(given, at.shape))
    if not (norms(parts) > 1e-6 * norms(given)).all():
        raise InputError("a vector at a point must be neither zero nor normal to the surface.")
    return at, parts


def tangential_parts(surface: ClosestPointSource, points: Floats, vectors: Floats) -> Floats:
    """Return the tangential parts (k, 3) of ``vectors`` (k, 3) at the points of a surface nearest to ``points``."""
    normals = ck.normals_at(surface, points)
    return np.asarray(vectors - dots(normals, vectors)[:, None] * normals)
