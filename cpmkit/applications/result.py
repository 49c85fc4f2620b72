"""Results of applications: a solution that is saved and drawn, its error, and the spacing that reaches a target."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar, Unpack, cast
from weakref import WeakKeyDictionary

import numpy as np

import cpmkit as ck
from cpmkit.applications.heat import barrier_scene, prepare_manifold
from cpmkit.errors import InputError, shown
from cpmkit.facade import Solution
from cpmkit.plugin import Discretized
from cpmkit.preparing import Prepared
from cpmkit.runtime.arrays import whole
from cpmkit.runtime.deprecation import DeprecatedMember
from cpmkit.runtime.messages import collected_warnings, warn_each
from cpmkit.scenefile.look import LookKeywords, SavingKeywords
from cpmkit.solution.display_mesh import values_at_vertices
from cpmkit.types import Floats, Ints

if TYPE_CHECKING:
    from cpmkit.accuracy.error_estimate import ErrorEstimate


@dataclass(frozen=True, eq=False)
class ColouredSolution(Solution):
    """A solution that is drawn in colours of an application."""

    mesh: Any = field(kw_only=True)  #: DisplayMesh: the display mesh with the colours as values.

    def display_mesh(self) -> Any:
        """Return the display mesh with the colours as values."""
        return self.mesh


@dataclass(frozen=True, eq=False)
class VertexValuedSolution(Solution):
    """A solution that has an application's values at the vertices of the mesh from which its surface was made."""

    result: Result = field(kw_only=True)  #: The result whose values they are.

    def at_vertices(self, _side: Any = None) -> Floats:
        """Return the values of the result at the vertices."""
        return self.result.at_vertices()


def with_colours(solution: Solution, colours: Floats) -> ColouredSolution:
    """Return ``solution`` with ``colours`` (v,) or (v, channels) at the vertices of its display mesh."""
    values = np.asarray(colours, dtype=np.float64).reshape(len(colours), -1)
    return ColouredSolution(**_members(solution), mesh=replace(solution.display_mesh(), values=values))


def _members(solution: Solution) -> dict[str, Any]:
    """Return the members of ``solution`` by name."""
    return {entry.name: getattr(solution, entry.name) for entry in fields(Solution)}


#: Corners of an arrow of length one about its centre: coordinates along it and across.
OUTLINE = np.array(
    [[-0.5, -0.05], [0.0, -0.05], [0.15, -0.05], [0.15, -0.18], [0.5, 0.0], [0.15, 0.18], [0.15, 0.05], [0.0, 0.05]]
    + [[-0.5, 0.05]]
)
TRIANGLES = np.array([[0, 1, 8], [8, 1, 7], [1, 2, 7], [7, 2, 6], [3, 4, 5]])


def subsample_points(points: Floats, distance: float) -> Ints:
    """Return indices (k,), always the same, of ``points`` (n, d), no two within ``distance`` and none left to add."""
    from scipy.spatial import cKDTree

    neighbours = cKDTree(points).query_ball_point(points, distance)
    free, chosen = np.ones(len(points), dtype=bool), []
    for number in np.random.default_rng(0).permutation(len(points)):
        if free[number]:
            chosen.append(number)
            free[neighbours[number]] = False
    return np.array(chosen, dtype=np.int64)


def with_arrows(
    solution: ColouredSolution, centres: Floats, directions: Floats, length: float, colour: Any
) -> ColouredSolution:
    """Return ``solution`` with arrows of one ``length`` and ``colour`` (3,) in its display mesh, on both sides of it.

    Arrows have ``centres`` (m, 3) and unit ``directions`` (m, 3). Each corner is projected on the surface and then
    moved off it along the normal.
    """
    surface, mesh = solution.scene.surface, solution.mesh
    normals = ck.normals_at(surface, centres)
    across = np.cross(normals, directions)
    corners = centres[:, None] + length * (OUTLINE[:, :1] * directions[:, None] + OUTLINE[:, 1:] * across[:, None])
    on = surface.closest_point(corners.reshape(-1, 3)).points
    corner_normals = ck.normals_at(surface, on).reshape(corners.shape)
    corner_normals *= np.where(np.einsum("mcd,md->mc", corner_normals, normals) < 0, -1.0, 1.0)[:, :, None]
    lift = 0.08 * length * corner_normals.reshape(-1, 3)
    faces = (len(OUTLINE) * np.arange(len(centres))[:, None, None] + TRIANGLES).reshape(-1, 3)
    triangles = len(mesh.points) + np.concatenate([faces, faces[:, ::-1] + len(on)])
    facing = corner_normals.reshape(-1, 3)
    cells = np.full((len(mesh.cells) + len(triangles), max(mesh.cells.shape[1], 3)), -1)
    cells[: len(mesh.cells), : mesh.cells.shape[1]] = mesh.cells
    cells[len(mesh.cells) :, :3] = triangles
    more = replace(
        mesh,
        points=np.concatenate([mesh.points, on + lift, on - lift]),
        cells=cells,
        values=np.concatenate([mesh.values, np.broadcast_to(colour, (2 * len(on), mesh.values.shape[1]))]),
        normals=np.concatenate([mesh.normals, facing, -facing]),
        sides=None,
    )
    return replace(solution, mesh=more)


@dataclass(frozen=True, eq=False, repr=False)
class Result(ABC):
    """The result of an application: read, saved and drawn as a solution."""

    solution: Solution  #: The solution that is read, saved and drawn.

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings of the solution."""
        return self.solution.warnings

    @abstractmethod
    def evaluate(self, points: Any) -> Floats:
        """Return the values (n,) or (n, channels) of the result at the points of the manifold nearest to ``points``."""

    def at_vertices(self) -> Floats:
        """Return the values (n,) or (n, channels) of :meth:`evaluate` at the n vertices that the user gave.

        Order, missing values and errors are as for :meth:`cpmkit.Solution.at_vertices`.
        """
        return values_at_vertices(self.solution, self.evaluate)

    def save(self, path: Any, vertices: str = "display", **options: Unpack[SavingKeywords]) -> None:
        """Write a file ``path`` with the formats, options and errors of :meth:`cpmkit.Solution.save`.

        It holds the solution; with ``vertices="own"``, in formats of meshes, the values of :meth:`at_vertices`.
        """
        own = vertices == "own"
        solution = VertexValuedSolution(**_members(self.solution), result=self) if own else self.solution
        solution.save(path, vertices, **options)

    def picture(self, path: Any, **options: Unpack[LookKeywords]) -> Any:
        """Draw the result into the PNG file ``path``, with the options of :meth:`cpmkit.Solution.picture`."""
        return self.drawable().picture(path, **options)

    def drawable(self) -> Solution:
        """Return the solution that pictures show: its display mesh may have other colours."""
        return self.solution

    drawn = DeprecatedMember("drawable")

    @property
    def _details(self) -> str:
        """Words for ``repr`` beside those of the solution."""
        return ""

    def __repr__(self) -> str:
        figures = repr(self.solution).rpartition("\n")[2].strip()
        return f"{type(self).__name__} on {self.solution.scene.surface!r}{self._details}\n  {figures}"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Measured(Result):
    """A result of several linear solves, whose error is estimated from the same solves at twice the spacing."""

    #: Computes the solution at another spacing and origin of the lattice.
    recompute: Callable[[float, Any], Solution] | None = None

    @cached_property
    def error(self) -> ErrorEstimate:
        """An estimate of the error: that of the solve to a target, or one made at first use from twice the spacing.

        Errors are assumed to be proportional to the spacing, as on ridges and meshes. On smooth surfaces they fall
        faster, and the estimate is up to ten times too large. Raises CpmkitError if the quantity cannot be computed at
        twice the spacing.
        """
        assert self.recompute is not None
        return self.solution.estimated or ck.estimate_error_by(self.recompute, self.solution, order=1.0)

    def gradient(self, points: Any) -> Floats:
        """Return the tangential gradient (n, d) at ``points`` (n, d), or (d,) at one point (d,).

        Its length is about one except on ridges of the distance, at ends and gaps of curves, and within two spacings of
        the origins of unsigned distances. It is zero on these origins, and on pieces of the manifold without an origin.
        Raises the errors of ``Solution.gradient``.
        """
        return np.asarray(self.solution.gradient(points))


MeasuredResult = TypeVar("MeasuredResult", bound=Measured)


def measure_to_target(
    surface: Any, spacing: float | None, options: dict[str, Any], measure: Callable[[Prepared], MeasuredResult]
) -> MeasuredResult:
    """Return the result of ``measure`` at a spacing, or at that which :func:`cpmkit.solve_by` finds for a target.

    Raises CpmkitError if an option is not accepted, or ``measure`` raises it.

    ``surface``, ClosestPointSource, Scene or Prepared: the manifold.
    ``spacing``: spacing of the lattice; None for a prepared scene or a target.
    ``options``: options of :func:`cpmkit.prepare`; or ``tolerance``, ``norm``, ``seconds``, ``memory`` in place
        of a spacing.
    ``measure``: computes the quantity on a prepared scene.
    """
    target = {name: options[name] for name in ("tolerance", "norm", "seconds", "memory") if name in options}
    #: The result of each discretised scene, without its solution, which would keep that scene in memory.
    beside: WeakKeyDictionary[Discretized, MeasuredResult] = WeakKeyDictionary()
    made: MeasuredResult | None = None
    if not target or spacing is not None or isinstance(surface, Prepared):
        try:
            with collected_warnings() as issued:  # several systems are solved, with equal warnings
                prepared = prepare_manifold(surface, spacing, options)
                made = measure(prepared)
        finally:
            warn_each(issued, stacklevel=3)
        scene, every = prepared.scene, prepared.options.as_dict() if prepared.options else {}
        others = {name: value for name, value in every.items() if name not in ("spacing", "origin")}
        others |= {"form": prepared.discretized.form}
    else:
        scene, others = barrier_scene(surface), {name: value for name, value in options.items() if name not in target}

    def recompute(spacing: float, origin: Any) -> Solution:
        each, nothing = measure(prepare_manifold(scene, spacing, {"origin": origin, **others})), cast("Solution", None)
        beside[each.solution.discretized] = replace(each, solution=nothing)
        return each.solution

    if made is not None:  # the solution alone would estimate the error of the last solve only
        return replace(made, recompute=recompute, solution=replace(made.solution, estimated=False))
    solution = ck.solve_by(recompute, scene, order=1.0, **target)  # not the last one computed if the target is missed
    return replace(beside[solution.discretized], recompute=recompute, solution=solution)


def check_choice(value: Any, accepted: tuple[str, str], label: str) -> str:
    """Return ``value`` if it is one of the two ``accepted``; raise InputError, which names it as ``label``, if not."""
    if value not in accepted:
        raise InputError(f"{label} must be {' or '.join(accepted)}, got {shown(value)}.")
    return str(value)


def unpack_pair(pair: Any, words: str) -> tuple[Any, Any]:
    """Return a ``pair`` of a place and its value; raise InputError, which begins with ``words``, for anything else."""
    if not isinstance(pair, tuple) or len(pair) != 2:
        raise InputError(f"{words}, got {shown(pair)}.")
    return pair


def check_rounds(method: Any, rounds: Any) -> int:
    """Return ``rounds``, from 1 to 100, for the ``method`` transport, 0 for heat; raise InputError for others."""
    return 0 if check_choice(method, ("transport", "heat"), "method") == "heat" else whole(rounds, "rounds", 1, 100)


def point_boundaries(name: str, points: Floats, values: Floats) -> list[ck.Boundary]:
    """Return a boundary for each of ``points`` (k, d), with its row of ``values`` (k, channels) as Dirichlet value."""
    return [
        ck.Boundary(f"{name}.{k}", ck.source("analytic.point", at=at), both=ck.Dirichlet(value.tolist()))
        for k, (at, value) in enumerate(zip(points, values, strict=True))
    ]
