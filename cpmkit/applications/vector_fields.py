"""Fields of tangential vectors that go on smoothly from directions given at points and along curves.

``parallel``: vectors go on as by parallel transport, P Lap (P u) = 0 with the connection's Laplacian, as in the vector
heat method (Sharp, Soliman and Crane 2019). ``paper``: each coordinate goes on by itself, vectors are kept tangential,
P Lap u = 0, the rest of the flow of King et al. (2024), section 7.3; it bends towards where the surface is flat.

With n the normal, S = -grad n and componentwise energies |grad u|^2 = |P grad u|^2 + |S u|^2 of tangential u,

    -Lap u + (s / h^2) n n' u - S^2 u = 0,

the last term for ``parallel`` alone, is one linear system of three channels; s / h^2 holds u tangential, to an error of
third order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

import cpmkit as ck
from cpmkit.applications.arrows import APART_LENGTHS, arrows, spread
from cpmkit.applications.coupling import tangential_coupling
from cpmkit.applications.held import hold_along, hold_at
from cpmkit.applications.painted import painted, with_triangles
from cpmkit.applications.result import Result
from cpmkit.applications.tangent_fields import Singularity, singularities
from cpmkit.errors import InputError, shown
from cpmkit.facade import Solution
from cpmkit.plugin import unit
from cpmkit.protocols import ClosestPointSource, Floats
from cpmkit.runtime.arrays import as_points, positive

if TYPE_CHECKING:
    from cpmkit.scenefile.look import LookKeywords

TRANSPORTS = ("parallel", "paper")
#: Vectors whose tangential part is a smaller share of them stand on the surface.
LEAST_TANGENTIAL_SHARE = 1e-6
#: Length of an arrow over the surface's size, and colours of a picture.
ARROW_SHARE, IVORY, INDIGO = 0.045, (0.93, 0.92, 0.9), (0.10, 0.25, 0.55)
#: Directions along a curve, by name: along it, and across it.
NAMED = {"tangent": (0, 1.0), "backwards": (0, -1.0), "left": (1, 1.0), "right": (1, -1.0)}


@dataclass(frozen=True, eq=False, repr=False)
class TangentField(Result):
    """A field of tangential vectors: read, saved and drawn as a solution of three channels.

    Attributes
    ----------
    solution : Solution
        The vectors on splines of the lattice, tangential to the order of the method, of any length.
    transport : str
        How they go on.
    """

    transport: str

    def evaluate(self, points: Any, side: Any = None, *, normalized: bool = True) -> Floats:
        """Return the tangential vectors (n, 3) nearest to ``points``, of length one unless ``normalized`` is False."""
        surface = self.solution.scene.surface
        at = as_points(points, surface.dim)
        found = self.solution.evaluate(at, side)
        found = tangential(surface, at, found)
        return unit(found) if normalized else found

    @cached_property
    def singularities(self) -> list[Singularity]:
        """Where the field has no direction, by index; on a closed surface they sum to its Euler characteristic.

        So they do where it runs along a curve opposite ways on the two sides. Where the two sides differ otherwise, as
        around a piece that the spacing does not resolve, each side's are listed, and the sum means nothing.

        Raises
        ------
        InputError
            If the surface has no triangles, as a cloud.
        """
        surface, mesh = self.solution.scene.surface, self.solution.display_mesh()
        if not len(mesh.triangles):
            raise InputError(f"singularities are looked for on triangles, and {type(surface).__name__} has none.")
        vectors = tangential(surface, mesh.points, mesh.values)
        return singularities(mesh.points, mesh.triangles, vectors, mesh.normals)

    def drawn(self, length: float | None = None) -> Solution:
        """Return the surface with arrows of one ``length`` that lie on it; a share of its size unless given."""
        surface, mesh = self.solution.scene.surface, self.solution.display_mesh()
        size = float(np.ptp(surface.bounds, axis=0).max())
        length = ARROW_SHARE * size if length is None else positive(length, "length")
        middles = mesh.points[spread(mesh.points, APART_LENGTHS * length)]
        made = arrows(surface, middles, self.evaluate(middles, normalized=True), length)
        plain = painted(self.solution, np.broadcast_to(IVORY, mesh.points.shape))
        return with_triangles(plain, *made, INDIGO)

    def picture(self, path: Any, *, length: float | None = None, **options: Unpack[LookKeywords]) -> Any:
        """Draw arrows of one length that lie on the surface, as :meth:`cpmkit.Solution.picture` draws.

        Parameters
        ----------
        path : str or Path
            Of a PNG file.
        length : float, optional
            Of an arrow; a share of the surface's size unless given.
        **options
            As of :func:`cpmkit.view.picture`.
        """
        return self.drawn(length).picture(path, **options)


def vector_field(
    surface: ClosestPointSource | ck.Scene,
    directions: Sequence[tuple[Any, Any]],
    *,
    spacing: float | None = None,
    transport: str = "parallel",
    **options: Any,
) -> TangentField:
    """Return the smoothest field of tangential vectors with given directions.

    Parameters
    ----------
    surface : ClosestPointSource or Scene
        A surface in space; a scene, whose boundaries are barriers that nothing passes.
    directions : sequence of pairs
        Where and which: points (k, 3) with vectors (k, 3) or (3,); a curve with ``"tangent"``, ``"backwards"``,
        ``"left"``, ``"right"``, a vector (3,) or a function of points, or with ``{"left": ..., "right": ...}`` one of
        these for each of its sides. Vectors are projected on the surface.
    spacing : float
        Of the lattice, in the scene's unit.
    transport : {"parallel", "paper"}
        How vectors go on; see this module.
    **options
        Of :func:`cpmkit.prepare`.

    Returns
    -------
    TangentField

    Raises
    ------
    InputError, SceneError
        If an argument is not what is accepted.

    Examples
    --------
    East along a sphere's equator goes on as east to both poles, round which the field turns.

    >>> import cpmkit as ck
    >>> from cpmkit.applications import vector_field
    >>> equator = ck.source("analytic.circle", normal=[0, 0, 1])
    >>> field = vector_field(ck.source("analytic.sphere"), [(equator, "tangent")], spacing=0.2)
    >>> field.evaluate([[0.8, 0, 0.6]]).round(2) + 0.0
    array([[0., 1., 0.]])
    >>> sum(one.index for one in field.singularities)
    2
    """
    if transport not in TRANSPORTS:
        raise InputError(f"transport must be {' or '.join(TRANSPORTS)}, got {shown(transport)}.")
    scene = surface if isinstance(surface, ck.Scene) else ck.Scene(surface, ck.Laplace())
    check_surface(scene.surface)
    if not directions:
        raise InputError("give directions at a point or along a curve at least.")
    boundaries = [one for number, pair in enumerate(directions) for one in _boundaries(number, pair, scene.surface)]
    whole = ck.Scene(scene.surface, ck.Laplace(), [*scene.boundaries, *boundaries], scene.edge)
    prepared = ck.prepare(whole, spacing, **{"form": "galerkin", **options})
    coupling = tangential_coupling(prepared, transport == "parallel")
    return TangentField(
        prepared.solve(problem=ck.Coupled(lambda points: coupling(points).reshape(-1, 3, 3))), transport
    )


def check_surface(surface: ClosestPointSource) -> None:
    """Refuse what is no surface in space.

    Raises
    ------
    InputError
        If it is another manifold.
    """
    if surface.dim != 3 or surface.manifold_dim != 2:
        raise InputError("fields of tangential vectors are made on surfaces in space.")


def _boundaries(number: int, pair: Any, surface: ClosestPointSource) -> list[ck.Boundary]:
    """Return the boundaries that hold the directions of one pair."""
    if not isinstance(pair, tuple) or len(pair) != 2:
        raise InputError(f"directions are pairs (where, which), got {shown(pair)}.")
    where, which = pair
    if isinstance(where, ClosestPointSource) and where.manifold_dim:
        name = f"direction {number}"
        if isinstance(which, Mapping):
            sides = {side: _along(where, surface, one) for side, one in which.items()}
            if set(sides) != {"left", "right"}:
                raise InputError(f"directions of two sides are given as left and right, got {', '.join(sides)}.")
            return [ck.Boundary(name, where, **{side: ck.Dirichlet(one) for side, one in sides.items()})]
        return [hold_along(name, where, _along(where, surface, which))]
    points = surface.closest_point(np.atleast_2d(np.asarray(where, dtype=np.float64))).points
    given = np.broadcast_to(np.asarray(which, dtype=np.float64), points.shape)
    vectors = tangential(surface, points, given)
    if not (np.linalg.norm(vectors, axis=1) > LEAST_TANGENTIAL_SHARE * np.linalg.norm(given, axis=1)).all():
        raise InputError("a direction at a point must not be zero or stand on the surface.")
    return hold_at(f"direction {number}", points, unit(vectors))


def _along(curve: ClosestPointSource, surface: ClosestPointSource, which: Any) -> Callable[[Floats], Floats]:
    """Return the unit directions along a curve as a function of points on it."""
    if isinstance(which, str):
        if which not in NAMED:
            raise InputError(f"a direction along a curve is {', '.join(NAMED)}, got {shown(which)}.")
        (kind, sign), found = NAMED[which], ck.directions_along(curve, surface)
        return lambda points: sign * found(points)[kind]
    if callable(which):
        return lambda points: unit(tangential(surface, points, np.asarray(which(points), dtype=np.float64)))
    vector = np.asarray(which, dtype=np.float64)
    if vector.shape != (3,):
        raise InputError(f"a direction along a curve is a name, a vector (3,) or a function, got {shown(which)}.")
    return lambda points: unit(tangential(surface, points, np.broadcast_to(vector, points.shape)))


def tangential(surface: ClosestPointSource, points: Floats, vectors: Floats) -> Floats:
    """Return the tangential parts (k, 3) of ``vectors`` (k, 3) at the points of a surface nearest to ``points``."""
    normals = ck.normals_at(surface, points)
    return np.asarray(vectors - np.einsum("kd,kd->k", normals, vectors)[:, None] * normals)
