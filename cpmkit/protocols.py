"""The contracts between the core and its plugins.

The core knows no shape. It asks a :class:`ClosestPointSource` for closest points and a
:class:`BoundarySet` for what holds on each side of a point or curve inside the surface.
The laws that every source keeps are checked by :mod:`cpmkit.testing`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Literal, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from cpmkit.forms.contract import Discretized
    from cpmkit.linear.solve_report import SolveReport
    from cpmkit.scene.conditions import Condition
    from cpmkit.scene.scene import Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Side = Literal["left", "right"]
#: The side from which points on boundaries are read: of all, or of each by its name.
Sides = Side | Mapping[str, Side] | None
#: The same, or both sides at once.
ReadSides = Sides | Literal["both"]
#: Both sides of a boundary.
SIDES: tuple[Side, Side] = ("left", "right")

#: Called with the name of a stage and the share of it that is done, from 0 to 1.
Progress = Callable[[str, float], None]


def no_progress(stage: str, fraction: float) -> None:
    """Report no progress."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Records in arrays, one row each; what a record may lack is None for all of them."""

    def __len__(self) -> int:
        return len(getattr(self, fields(self)[0].name))

    def take(self, index: NDArray[Any]) -> Self:
        """Return the records at ``index`` (integers or a mask)."""

        def picked(values: Any) -> Any:
            if isinstance(values, list):
                return [picked(one) for one in values]
            return values.take(index) if isinstance(values, Rows) else None if values is None else values[index]

        return type(self)(*[picked(getattr(self, field.name)) for field in fields(self)])

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Return the records of several batches, one after the other."""

        def joined(column: list[Any]) -> Any:
            if any(one is None for one in column):
                return None
            return column[0].join(column) if isinstance(column[0], Rows) else np.concatenate(column)

        return cls(*[joined([getattr(part, field.name) for part in parts]) for field in fields(cls)])

    def replaced(self, rows: Ints, new: Self) -> Self:
        """Return the records with those at ``rows`` (k,) replaced by ``new``."""
        order = np.arange(len(self))
        order[rows] = len(self) + np.arange(len(rows))
        return self.join([self, new]).take(order)


@dataclass(frozen=True, eq=False)
class ClosestPoints(Rows):
    """The answer to a batch of closest point queries.

    Attributes
    ----------
    points : (n, d) float64
        The feet: a closest point of each query, in the scene's unit of length.
    distance : (n,) float64
        Decides membership of the band: the distance from the query to the manifold. It is
        1-Lipschitz and never above ``|x - points|``; for an exact source the two are equal.
    edge : (n,) int64
        -1 where the foot lies inside; ``k >= 0`` where it lies on edge loop ``k`` of an open
        surface, or on end ``k`` (0 the start, 1 the end) of an open curve.
    element : (n,) int64, optional
        The triangle, segment, patch or union member that holds the foot.
    local : (n, m) float64, optional
        Coordinates in that element: barycentric, ``t`` or ``(u, v)``.
    doubtful : (n,) bool, optional
        True where the search could not vouch for the foot. ``None``: all are sure.
    """

    points: Floats
    distance: Floats
    edge: Ints
    element: Ints | None = None
    local: Floats | None = None
    doubtful: Bools | None = None


@runtime_checkable
class ClosestPointSource(Protocol):
    """A manifold that is known by its closest points.

    The data are read-only properties: a plain attribute would make frozen dataclasses
    incompatible with the protocol under mypy.
    """

    @property
    def dim(self) -> int:
        """Dimension of the space, 2 or 3."""

    @property
    def manifold_dim(self) -> int | None:
        """Dimension of the manifold: 0 a point, 1 a curve, 2 a surface; ``None`` for a mixed union."""

    @property
    def bounds(self) -> Floats:
        """(2, d) finite lower and upper corner of a box that holds the manifold."""

    @property
    def exact(self) -> bool:
        """True where the feet are true nearest points; False for a smoothed mesh."""

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return a closest point of each row of ``x``.

        ``x`` is (n, d) float64 and is not written to. A degenerate query (the centre of a
        sphere) gets *a* closest point, never the query itself.

        Raises
        ------
        InputError
            If ``x`` holds NaN or infinity, or its shape is not (n, d).
        """


@runtime_checkable
class HasNormals(Protocol):
    """A hypersurface that knows its own consistently signed unit normal."""

    def normals(self, feet: ClosestPoints, /) -> Floats:
        """Return (n, d) unit normals at ``feet``, records that this source answered."""


@runtime_checkable
class HasCreases(Protocol):
    """A surface made of cells, with normals of the smooth one that it samples: beside creases it stays as it is."""

    def facet_normals(self, feet: ClosestPoints, /) -> Floats:
        """Return (n, d) unit normals of the cells that hold ``feet`` where a corner of these lies at a crease.

        NaN in other cells, and at corners off creases and on edges between such: there the surface is smooth.
        """


@runtime_checkable
class HasTangents(Protocol):
    """A curve that knows its direction of travel."""

    def tangents(self, feet: ClosestPoints, /) -> Floats:
        """Return (n, d) unit tangents at ``feet``; at a corner the bisector of its two tangents."""


@runtime_checkable
class HasLocalMinima(Protocol):
    """A source that finds more than the closest point: a foot on each of several sheets that lie near a query."""

    def local_minima(self, x: Floats, radius: float, /) -> tuple[Ints, ClosestPoints]:
        """Return all feet of each row of ``x`` (n, d) within ``radius``.

        A foot is a point of the manifold that no other in its surroundings is nearer than: a local minimum of the
        distance. The first array (k,), ascending, holds the row of ``x`` of each foot. The feet of one row are
        distinct and stand by their ``distance``; the first is what ``closest_point`` answers. Rows with no foot
        within ``radius`` are left out.

        Raises
        ------
        InputError
            If ``x`` holds NaN or infinity, its shape is not (n, d), or ``radius`` is not a number above zero.
        """


@runtime_checkable
class HasLeft(Protocol):
    """A curve in a surface, or a surface in a solid, that knows its left by itself: the cut by a function does."""

    def leftward(self, feet: ClosestPoints, /) -> Floats:
        """Return (n, d) unit vectors at ``feet`` that point to the left, across the curve and along the surface."""


@runtime_checkable
class NamesLeft(Protocol):
    """A boundary's source that names a point on its left, for surfaces that have no normals of their own."""

    @property
    def left_of(self) -> Floats | None:
        """(d,) the point; None where there is none after all."""


@runtime_checkable
class HasValues(Protocol):
    """A source that carries data of its own: one row a vertex, a sample or a control point."""

    @property
    def value_count(self) -> int:
        """How many rows :meth:`interpolate` expects."""

    def interpolate(self, values: Floats, feet: ClosestPoints, /) -> Floats:
        """Return ``values`` (value_count, ...) interpolated at ``feet``, (n, ...)."""


@runtime_checkable
class HasMesh(Protocol):
    """A source that can be drawn."""

    def mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return vertices (v, d) on the manifold and cells (m, k) of about the size ``spacing``.

        ``k`` is 3 for triangles, 2 for segments, 1 for points. Of a mixed union it is the largest that
        occurs, and rows of smaller cells end in -1.
        """


@runtime_checkable
class CutsItself(Protocol):
    """A surface that finds its sections by planes itself."""

    def plane_section(self, point: Floats, normal: Floats, /) -> ClosestPointSource:
        """Return the section by the plane through ``point`` (d,) across ``normal`` (d,), which points to its left.

        Raises
        ------
        InputError
            If the plane misses the surface, or touches it only.
        """


@runtime_checkable
class HasMeshUse(Protocol):
    """A source with a mesh that tells whether samples may be taken from its cells: else it need not be drawn."""

    @property
    def mesh_for_samples(self) -> bool:
        """False where cells are points, or so many or of so bad a shape that they serve pictures alone."""


@runtime_checkable
class HasGivenMesh(Protocol):
    """A source made from a mesh, polyline or samples of somebody's, which may have been welded or mended since."""

    @property
    def given_mesh(self) -> tuple[Floats, Ints]:
        """Vertices (n, d) and cells (m, k) as they were given: all of them, in their order, also those in no cell."""


@runtime_checkable
class HasTranslation(Protocol):
    """A source that can restate itself in shifted coordinates without rounding its own shape.

    The core queries every source in coordinates relative to the lattice's origin. A source
    with this ability keeps its accuracy far away from zero: at 1e9 a rounded query is off by
    1e-7, which the method would amplify by size / spacing. Others are shifted query by query.
    """

    def translated(self, offset: Floats, /) -> ClosestPointSource:
        """Return the same source moved by ``offset`` (d,), with the same abilities."""


@runtime_checkable
class HasMembers(Protocol):
    """A union: ``element`` in its records is the number of the member that holds the foot."""

    @property
    def members(self) -> Sequence[ClosestPointSource]:
        """The sources that it unites, none of them a union."""


@runtime_checkable
class HasManyEdges(Protocol):
    """A source whose numbers of edges may be 1000 or more."""

    @property
    def edge_limit(self) -> int:
        """A multiple of 1000 that all numbers in ``edge`` are below: a union numbers the next member's on from it."""


@runtime_checkable
class HasFiniteFeet(Protocol):
    """A source whose feet are finitely many points, which stand for a manifold: nothing can be integrated over it."""

    @property
    def foot_count(self) -> int:
        """How many points there are."""


@dataclass(frozen=True)
class Advice:
    """What a reader of a solution should know of the source.

    Attributes
    ----------
    floor : float
        The error that the source alone leaves in a solution by the form ``collocation``, as a share of its range: a
        mesh, a cloud or samples on a grid stand for a smooth manifold only to some accuracy. 0 where the source states
        none.
    warnings : tuple of str
        One sentence for each thing that may spoil a solution: merged or doubtful samples, what was put right.
    integral_floor : float, optional
        The same floor by the form ``galerkin``, whose integrals over the manifold feel its slopes less than closest
        points do from some way off. None where it is about the same.
    closest_point_warnings : tuple of str
        What may spoil a solution by the form ``collocation`` beside: places, as creases, near which closest points
        jump.
    """

    floor: float = 0.0
    warnings: tuple[str, ...] = ()
    integral_floor: float | None = None
    closest_point_warnings: tuple[str, ...] = ()


@runtime_checkable
class HasAdvice(Protocol):
    """A source that knows how accurate it is, or what about itself may spoil a solution."""

    def advice(self, spacing: float, /) -> Advice:
        """Return what a reader of a solution at ``spacing`` should know."""


@runtime_checkable
class HasWarnings(Protocol):
    """A source with advice that tells the warnings in it by themselves, for less than floors take to be found."""

    def own_warnings(self, spacing: float, /) -> tuple[str, ...]:
        """Return the ``warnings`` of the advice at ``spacing``."""


@runtime_checkable
class HasIntegralFloor(Protocol):
    """A source with advice that tells the integral floor in it by itself, for less than the rest takes to be found."""

    def own_integral_floor(self, spacing: float, /) -> float:
        """Return the ``integral_floor`` of the advice at ``spacing``."""


@runtime_checkable
class ReadsAsTriangles(Protocol):
    """A mesh that stands for a smooth surface, and can be read as the triangles that it is."""

    def faceted(self) -> ClosestPointSource:
        """Return the same mesh read as its triangles."""


class Operator(Protocol):
    """A square linear map of the unknowns, kept in whatever form its maker likes; all that a solver asks."""

    @property
    def size(self) -> int:
        """Number of unknowns, n."""

    @property
    def nonzeros(self) -> int:
        """Numbers stored for it."""

    @property
    def symmetric(self) -> bool:
        """Whether it is surely symmetric."""

    @property
    def diagonal(self) -> float | Floats:
        """What Jacobi's preconditioner divides by: a number, or (n, 1)."""

    def apply(self, u: Floats, /) -> Floats:
        """Return the product with u of shape (n,) or (n, channels)."""

    def apply_rows(self, u: Floats, rows: Ints, /) -> Floats:
        """Return the entries ``rows`` of the product."""

    def to_csr(self) -> csr_array:
        """Return it as one sparse matrix (n, n)."""

    def pieces(self) -> tuple[int, Ints]:
        """Return how many sets of unknowns it couples among themselves alone, and the set of each unknown (n,)."""


class Stiffness(Operator, Protocol):
    """The operator A of an equation's terms, as a form makes it; steps in time and eigenvalues shift it."""

    def scaled_plus_mass(self, factor: float, mass: Any = None, /) -> Operator:
        """Return ``M + factor A``; M is the form's mass, None for the identity."""

    def minus_shifted_mass(self, shift: float, mass: Any = None, /) -> Operator:
        """Return ``A - shift M``; M is what stands beside lambda, None for the identity."""


class PreparedSolver(Protocol):
    """A solver that has made what it needs of one operator: factors, coarser levels."""

    def solve(
        self, b: Floats, tolerance: float, guess: Floats | None = None, progress: Progress = no_progress
    ) -> tuple[Floats, SolveReport]:
        """Return u (n, channels) with A u = b for all channels, and a report; ``guess`` is where an iteration starts.

        Raises
        ------
        ConvergenceError
            If the relative residual, recomputed after the solve, is above ``tolerance``.
        """


@runtime_checkable
class Preconditioner(PreparedSolver, Protocol):
    """A prepared solver that also makes one cheap, symmetric, positive step towards a solution."""

    @property
    def step_products(self) -> int:
        """How many products with A a step takes, a channel."""

    def precondition(self, residual: Floats, /) -> Floats:
        """Return about A^-1 times (n, channels)."""


class LinearSolver(Protocol):
    """What solves linear systems, in two phases; a plugin's factory in ``cpmkit_solvers`` returns one.

    What is prepared is kept: over channels, steps in time, Newton's steps and iterations for eigenvalues. One whose
    attribute ``takes_levels`` is false is given none, and none are made.
    """

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> PreparedSolver:
        """Return the solver of systems with ``operator``; ``levels`` are a form's coarser ones, where it has them."""


class Backend(Protocol):
    """A form of a plugin: another way of discretising scenes; a plugin's factory in ``cpmkit_backends`` returns one.

    What it makes is solved by the same families and linear solvers as everything else. ``discretize`` may take further
    keyword arguments: options of the form, which ``solve`` hands on.
    """

    def discretize(self, scene: Scene, spacing: float | None, *, progress: Progress) -> Discretized:
        """Return the scene on the form's unknowns; ``spacing`` is None where the caller gave none.

        Raises
        ------
        CpmkitError
            One sentence: what the form cannot do, and which one can.
        """


@runtime_checkable
class BoundarySet(Protocol):
    """A point or curve inside the manifold, and what holds on each side of it."""

    @property
    def name(self) -> str:
        """The name that reports and ``evaluate(side=...)`` use."""

    @property
    def source(self) -> ClosestPointSource:
        """Where the boundary lies."""

    @property
    def left_of(self) -> Floats | None:
        """(d,) a point that is on the left of each piece, for sources without normals or tangents of their own."""

    def condition(self, side: Side, /) -> Condition:
        """Return what holds on ``side``."""
