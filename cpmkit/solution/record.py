"""The record of a solution: the values of its unknowns, read at any point and on either side of a boundary."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar, overload

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.forms.contract import Discretized
from cpmkit.forms.data_checks import Imbalance
from cpmkit.forms.form_records import MeasuredWork
from cpmkit.linear.residuals import SolveReport
from cpmkit.runtime.deprecation import DeprecatedMember
from cpmkit.scene.scene import Scene
from cpmkit.solution.summary import summarize
from cpmkit.types import SIDES, Floats, Ints, ReadSides, Side, Sides

if TYPE_CHECKING:
    from cpmkit.solution.display_mesh import DisplayMesh
    from cpmkit.solution.integrals import Integrand
    from cpmkit.solution.modes import Resonance

UserClass = TypeVar("UserClass", bound="type[SolutionRecord]")
#: For each record class the class that is constructed in its place.
_user_classes: dict[type, type] = {}


def register_user_class(record: type[SolutionRecord]) -> Callable[[UserClass], UserClass]:
    """Return a class decorator: objects of class ``record`` are then constructed as objects of the decorated class.

    The decorated class is derived from ``record`` and adds saving and drawing; families of equations construct records,
    and cannot import it.
    """

    def register(user_class: UserClass) -> UserClass:
        """Register ``user_class`` for ``record``, and return it."""
        _user_classes[record] = user_class
        return user_class

    return register


@dataclass(frozen=True, eq=False)
class SolutionRecord:
    """The solution of a scene, by any form."""

    discretized: Discretized  #: The discretised scene.
    values: Floats  #: (unknowns, channels): values of the unknowns.
    report: SolveReport  #: Solver, iterations and residual.
    work: MeasuredWork  #: Cost in counts that are the same on every machine.
    seconds: Mapping[str, float]  #: Wall-clock seconds of each stage.
    #: Sentences on possible causes of errors in the solution.
    warnings: tuple[str, ...] = field(default=(), kw_only=True)
    #: Data that did not balance, and their correction. There is one "data" for each piece of the manifold on which the
    #: solution is determined up to a constant (and has mean zero): the part of the data for which there is no solution.
    #: There is one "mean" for each closed piece on which c times the mean of u was set to the mean of f.
    imbalances: tuple[Imbalance, ...] = field(default=(), kw_only=True)
    #: The estimate of the error if it was requested; False if no estimate is to be made; see :attr:`error`.
    estimated: Any = field(default=None, kw_only=True)
    #: The solves by which a requested error, time or memory was met.
    solve_history: Any = field(default=None, kw_only=True)
    #: The eigenvalue of the operator nearest to zero, for steady problems that may have one near it: where c or a
    #: condition makes the energy indefinite.
    resonance: Resonance | None = field(default=None, kw_only=True)

    #: Whether the channels are eigenfunctions, an arbitrary basis where eigenvalues are multiple.
    has_modes: ClassVar[bool] = False

    #: The former name of :attr:`solve_history`.
    trade = DeprecatedMember("solve_history")

    def __new__(cls, *_args: Any, **_fields: Any) -> Self:
        """Return an object of the class that is registered for this record class, if there is one."""
        made: Self = object.__new__(_user_classes.get(cls, cls))
        return made

    @property
    def scene(self) -> Scene:
        """The scene that was solved."""
        return self.discretized.scene

    @property
    def spacing(self) -> float:
        """The mesh width of the discretisation, in the scene's unit of length."""
        return self.discretized.spacing

    @property
    def channels(self) -> int:
        """Number of right-hand sides, components or modes that were solved together."""
        return int(self.values.shape[1])

    @property
    def data_time(self) -> float | None:
        """Time at which data that depend on the time are evaluated; None in problems without time."""
        return None

    @property
    def error(self) -> Any:
        """The error estimate that was made with the solution; :class:`cpmkit.Solution` makes one on first use.

        Raises InputError if there is none.
        """
        if not self.estimated:
            raise InputError("the error of this solution was not estimated; cpmkit.Solution.error estimates it.")
        return self.estimated

    def error_at(self, points: Any) -> Any:
        """Return the estimated error, in the unit of u and without that of time steps; shapes: :meth:`evaluate`."""
        return self._read_at_points(points, self.error.at_points)

    @overload
    def evaluate(self, points: Sequence[float], side: ReadSides = None) -> Any: ...
    @overload
    def evaluate(self, points: Any, side: ReadSides = None) -> Floats: ...
    def evaluate(self, points: Any, side: ReadSides = None) -> Any:
        """Return the solution at the points of the manifold nearest to ``points``.

        Parameters
        ----------
        points : (n, d) array, or one point (d,)
            In the scene's coordinates, at most about three spacings away from the manifold.
        side : "left", "right", "both" or {boundary name: side}, optional
            The side from which a point on a boundary is read, by default the left. Points off the boundary are
            not affected.

        Returns
        -------
        (n,) or (n, channels) float64
            With ``side="both"`` (n, 2) or (n, 2, channels), the value of the left first. Of one point without the first
            axis: a float, (channels,), (2,) or (2, channels).

        Raises
        ------
        InputError
            If a point is not finite or too far away, or a side names no boundary that has sides.
        """
        return self._read_at_points(points, lambda rows: self._values_at(rows, side))

    def __call__(self, points: Any, side: ReadSides = None) -> Any:
        """Return the solution at points, as :meth:`evaluate` does: a solution is a function of position."""
        return self.evaluate(points, side)

    def _values_at(self, points: Any, side: ReadSides) -> Floats:
        """Return the solution at points (n, d), (n,) or (n, channels); for "both" (n, 2) or (n, 2, channels)."""
        if side == "both":
            return np.stack([self._values_at(points, one) for one in SIDES], axis=1)
        values = self.discretized.evaluate(self.values, points, side)
        return values[:, 0] if self.channels == 1 else values

    def _read_at_points(self, points: Any, read: Callable[[Any], Floats]) -> Any:
        """Return ``read(points)`` for points (n, d); for one point (d,) its only row, a float if that is a number."""
        try:
            one = np.shape(points) == (self.scene.surface.dim,)
        except ValueError:  # rows of different lengths, which the reader refuses
            one = False
        if not one:
            return read(points)
        found = read(np.asarray(points)[None])[0]
        return float(found) if np.ndim(found) == 0 else found

    def at_vertices(self, side: Sides = None) -> Floats:
        """Return the solution at the vertices of the mesh, polyline or cloud that the surface was made from.

        Those of a solid are the vertices of its boundary. There is one row per vertex, in the order of the file or
        array, also if vertices were welded or moved since. A vertex in no face has the value of the nearest point of
        the surface; it is NaN if that is farther than half a spacing, or the vertex is not finite. ``side`` is as for
        :meth:`evaluate`.

        Returns
        -------
        (n,) or (n, channels) float64, with ``side="both"`` as for :meth:`evaluate`

        Raises
        ------
        InputError
            If the surface was not made from vertices, or a side names no boundary that has sides.
        """
        from cpmkit.solution.display_mesh import values_at_vertices

        return values_at_vertices(self, lambda points: self.evaluate(points, side))

    def of_dimension(self, dim: int) -> Self:
        """Return the solution on the members of dimension ``dim`` of a union; of others the solution itself.

        Where members of different dimension lie on each other, as a surface on the boundary of a solid, each has values
        of its own there. The result is evaluated, integrated, drawn and saved like any solution, without an estimate.
        Raises InputError if there is no such member, or the form has the same unknowns for all members.

        Examples
        --------
        >>> import cpmkit as ck
        >>> sphere = ck.source("analytic.sphere")
        >>> both = ck.source("union", members=[ck.source("solid", of=sphere), sphere])
        >>> f = ck.MemberData(both, [1.0, 3.0])
        >>> scene = ck.Scene(both, ck.ScreenedPoisson(f), junctions=ck.Junction(resistance=1.0))
        >>> solution = ck.solve(scene, spacing=0.4)
        >>> [round(solution.of_dimension(dim).mean(), 2) for dim in (2, 3)]
        [2.61, 2.16]
        """
        parts = self.discretized.traits.parts
        for part in parts:
            if part.dim == dim:
                values = self.values[part.unknowns]
                return replace(self, discretized=part.form, values=values, imbalances=(), estimated=False)
        dimensions: list[int | None] = [part.dim for part in parts] or [self.scene.surface.manifold_dim]
        if not parts and dim in dimensions:
            return self
        known = " and ".join(map(str, dimensions)) if None not in dimensions else "several dimensions, in another form"
        raise InputError(f"dim must be that of a part of the solution, {known}, got {shown(dim)}.")

    def evaluate_by_dimension(self, points: Floats, dims: Ints | None) -> Floats:
        """Return the solution (k, channels) at ``points`` (k, d), each on members of its dimension in ``dims``.

        Without ``dims`` it is evaluated on the nearest member.
        """
        if dims is None:
            return self.discretized.evaluate(self.values, points)
        found = np.empty((len(points), self.channels))
        for dim in np.unique(dims):
            part = self.of_dimension(int(dim))
            found[dims == dim] = part.discretized.evaluate(part.values, points[dims == dim])
        return found

    def gradient(self, points: Any, side: Sides = None) -> Any:
        """Return the surface gradient of the solution at the points of the manifold nearest to ``points``.

        In the Galerkin form its order is the degree of the splines. In the collocation form it is of second order, also
        on and beside boundaries and edges, where it is that of the point's own side; between two Dirichlet boundaries
        that are less than about seven spacings apart it is of first order.

        Parameters
        ----------
        points, side
            As for :meth:`evaluate`, but not "both".

        Returns
        -------
        (n, d) or (n, channels, d) float64
            Tangential vectors, in the unit of the solution over the unit of length; of one point without the first
            axis.

        Raises
        ------
        InputError
            As :meth:`evaluate` does, or if the form evaluates no gradients.

        Examples
        --------
        >>> import cpmkit as ck
        >>> pin = ck.source("analytic.point", at=[1, 0])
        >>> cut = ck.Boundary("cut", pin, left=ck.Dirichlet(6), right=ck.Dirichlet(0))
        >>> scene = ck.Scene(ck.source("analytic.circle"), ck.Laplace(), [cut])
        >>> ck.solve(scene, spacing=0.02).gradient([[0, 1]]).round(2)  # 6 / (2 pi), the way the circle runs
        array([[-0.95,  0.  ]])
        """

        def read(rows: Any) -> Floats:
            gradient = self.discretized.gradient(self.values, rows, side)
            return gradient[:, 0] if self.channels == 1 else gradient

        return self._read_at_points(points, read)

    def flux(
        self, boundary: str | int, side: Side | None = None, where: str | Callable[[Floats], Any] | None = None
    ) -> float | Floats:
        """Return the flux out of a side of a boundary: the integral of du/db over the boundary.

        b is the unit conormal out of that side: it points across the boundary to the right for the left side, to the
        left for the right side, and outwards at an edge. By the divergence theorem the fluxes out of a piece of the
        manifold add up to the integral of Lap u over the piece.

        Parameters
        ----------
        boundary : str or int
            The name of a boundary; ``"edge"`` or the number of a loop for the edge of the manifold.
        side : "left" or "right"
            Of a boundary; an edge has none.
        where : formula, or function of points, optional
            The part of the boundary over which to integrate, such as ``"x < 0"``. Take the `where` of a part of the
            edge to get the flux through that part.

        Returns
        -------
        float, or (channels,) float64 where there are several
            If the boundary consists of points, the integral is the sum of du/db at them.

        Raises
        ------
        InputError
            If there is no such boundary or edge, ``where`` holds nowhere on it, ``side`` is missing or given for an
            edge, or the boundary has no sides (a point on a surface); for an edge of a solid in space in the form
            ``collocation``, or without a mesh; for an edge that lies on another member of a union.

        Examples
        --------
        >>> import cpmkit as ck
        >>> pin = ck.source("analytic.point", at=[1, 0])
        >>> cut = ck.Boundary("cut", pin, left=ck.Dirichlet(6), right=ck.Dirichlet(0))
        >>> scene = ck.Scene(ck.source("analytic.circle"), ck.Laplace(), [cut])
        >>> solution = ck.solve(scene, spacing=0.02)
        >>> round(solution.flux("cut", "left"), 2), round(solution.flux("cut", "right"), 2)
        (0.95, -0.95)
        """
        from cpmkit.solution.integrals import flux

        return flux(self, boundary, side, where)

    def flux_density(self, boundary: str, side: Side, points: Any) -> Floats:
        """Return du/db, (n,) or (n, channels), at the points of a boundary nearest to ``points`` (n, d).

        b points out of ``side``, as for :meth:`flux`. Raises InputError if there is no such boundary with sides, or the
        points are no finite array of this shape.
        """
        from cpmkit.solution.integrals import flux_density

        return flux_density(self, boundary, side, points)

    def signed_distance(self, name: str, points: Any) -> Floats:
        """Return (z - y) . v (n,) at points z (n, d) of the manifold: near boundary ``name`` the distance from it.

        y is the nearest point of the boundary, v the unit conormal to its left: values are positive there. NaN beyond
        an open end of the boundary, or if it is a point on a surface; in the form "galerkin" also if left and right
        swap along it, in "collocation" also far from it and on sheets that it does not touch. Raises InputError if
        there is no such boundary, or a point is too far from the manifold.
        """
        return self.discretized.signed_distance(name, points)

    def discretization(self) -> dict[str, Any]:
        """Return a description of the discretisation as plain values."""
        return self.discretized.describe()

    def integrate(self, function: Integrand | None = None, *, dim: int | None = None) -> float | Floats:
        """Return the integral over the manifold of the solution, or of a function of it.

        The Galerkin form integrates over its own quadrature points, on its discrete surface; other forms over curved
        cells of the mesh that is cut along the boundaries. Both keep jumps sharp. On smooth manifolds the error
        of the quadrature is of third order in the spacing or better, and less than that of the solution.

        Parameters
        ----------
        function : callable or number, optional
            Integrated in place of the solution: called with points (n, d) of the manifold and the values there, (n,) or
            (n, channels), it returns (n,) or (n, k). ``1`` gives the length, area or volume.
        dim : int, optional
            Dimension of the parts that are integrated over, for a union with parts of several dimensions, since lengths
            and areas do not add up.

        Returns
        -------
        float, or (channels,) float64 where there are several; of a function with k values (k,)

        Raises
        ------
        InputError
            If ``dim`` is needed or is not that of a part, the function returns another shape, or, in other forms than
            the Galerkin form, the surface has no mesh, or one that does not fill it (a cloud, a solid in space).

        Examples
        --------
        >>> import cpmkit as ck
        >>> scene = ck.Scene(ck.source("analytic.circle", radius=2.0), ck.ScreenedPoisson(lambda x: x[:, 0] ** 2))
        >>> solution = ck.solve(scene, spacing=0.1)
        >>> round(solution.integrate(), 2), round(solution.integrate(1.0), 4)
        (25.13, 12.5664)
        """
        from cpmkit.solution.integrals import integrate

        return integrate(self, function, dim)

    def mean(self, function: Integrand | None = None, *, dim: int | None = None) -> float | Floats:
        """Return :meth:`integrate` of the same arguments over the length, area or volume: a float or (channels,)."""
        return self.integrate(function, dim=dim) / float(self.integrate(1.0, dim=dim))

    @property
    def doubled(self) -> Floats:
        """Closest points (k, d) of second unknowns at nodes that several sheets share; k is 0 in forms without them."""
        doubled = self.discretized.diagnosis().doubled
        return np.zeros((0, self.scene.surface.dim)) if doubled is None else doubled

    @property
    def ties(self) -> Floats:
        """Edges (t, 2, d), on curves points (t, 1, d), where the Galerkin form ties parts with separate unknowns.

        Ties lie at creases and junctions, and between parts that are near in space but not along the manifold. Without
        ties, as in other forms, the shape is (0, 1, d).
        """
        ties = self.discretized.diagnosis().ties
        return np.zeros((0, 1, self.scene.surface.dim)) if ties is None else ties

    def display_mesh(self) -> DisplayMesh:
        """Return a mesh of the manifold with the solution at its vertices, cached; InputError if it has no mesh."""
        return self._display_mesh

    @cached_property
    def _display_mesh(self) -> DisplayMesh:
        """The display mesh: that of the form if it has one, else the surface's mesh cut along the boundaries."""
        from cpmkit.solution.display_mesh import display_mesh

        own = self.discretized.display_mesh(self.values)
        return display_mesh(self) if own is None else own

    def summary(self) -> dict[str, Any]:
        """Return the scene, the discretisation, the cost and the result as plain values."""
        return summarize(self)

    def arrays(self) -> dict[str, Any]:
        """Return the arrays, by name, from which a saved solution is rebuilt; {} if only its display mesh is saved."""
        known = self.discretized.arrays()
        return {**known, "unknowns": self.values} if known else {}

    def __repr__(self) -> str:
        """Return the equation, the form, the spacing, the unknowns and the solver in two lines."""
        count = len(self.scene.boundaries)
        boundaries = f"{count} boundar{'y' if count == 1 else 'ies'}"
        warned = f", {len(self.warnings)} warnings" if self.warnings else ""
        channels = f", {self.channels} channels" if self.channels > 1 else ""
        return (
            f"Solution of {self.scene.problem.kind} with {boundaries}, form "
            f"{self.discretized.form}, spacing {self.spacing:g}{channels}\n"
            f"  {self.work.unknowns:,} unknowns, solver {self.report.solver}{warned}"
        )

    def _notebook_rows(self) -> list[tuple[str, str]]:
        """Return the rows (name, text) of the table about the solution that a notebook shows beside its picture."""
        low, high = (float(function(self.values)) for function in (np.min, np.max))
        return [
            ("equation", f"{self.scene.problem.kind}: {self.scene.problem}"),
            ("form", f"{self.discretized.form}, spacing {self.spacing:g}"),
            ("unknowns", f"{self.work.unknowns:,} of {self.channels} channel{'s' * (self.channels > 1)}"),
            ("values", f"from {low:.4g} to {high:.4g}"),
            ("solver", f"{self.report.solver}: {self.report.reason}"),
            ("seconds", f"{sum(self.seconds.values()):.2g}"),
            *(("error", line) for line in str(self.estimated or "").splitlines()),
            *(("warning", sentence) for sentence in self.warnings),
        ]
