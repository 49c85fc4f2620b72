"""A solution: read it at any point of the manifold, from either side of a boundary; save it; draw it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack, overload

import numpy as np

from cpmkit.forms.contract import Discretized
from cpmkit.forms.form_records import MeasuredWork
from cpmkit.forms.free_constants import Imbalance
from cpmkit.linear.solve_report import SolveReport
from cpmkit.protocols import SIDES, Floats, ReadSides, Side, Sides
from cpmkit.runtime.messages import html_table
from cpmkit.scene.scene import Scene

if TYPE_CHECKING:
    from cpmkit.accuracy.error_estimate import ErrorEstimate
    from cpmkit.accuracy.trade import Trade
    from cpmkit.scenefile.look import LookKeywords, SavingKeywords
    from cpmkit.solution.display_mesh import DisplayMesh
    from cpmkit.solution.integrals import Integrand
    from cpmkit.solution.resonance import Resonance
    from cpmkit.view import Picture
    from cpmkit.view.showing import Page


@dataclass(frozen=True, eq=False)
class Solution:
    """The solution of a scene, by whatever form.

    Attributes
    ----------
    discretized : Discretized
        The scene on the form's unknowns.
    values : (unknowns, channels) float64
        Of the unknowns.
    report : SolveReport
        What the solver reached.
    work : MeasuredWork
        What it cost, in units that no machine changes.
    seconds : mapping
        Seconds of each stage; of this machine, on this day.
    warnings : tuple of str
        What a reader of the solution should know.
    imbalances : tuple of Imbalance
        What did not balance, and what was done about it. One of "data" for each piece of the manifold on which the
        solution is fixed by its mean alone, which is zero: what of the data has no solution there. One of "mean" for
        each closed piece on which c times the mean of u was made the mean of f; in place of these one of "fluxes",
        where balancing them was asked for.
    estimated : ErrorEstimate, optional
        Of its error, where it was asked for; False where it is not to be estimated; see :attr:`error`.
    trade : Trade, optional
        What was done to reach an error, or to stay within a time or a memory, where one was asked for.
    resonance : Resonance, optional
        The eigenvalue of the operator that is nearest to zero, of steady problems that may have one near it: where c or
        a condition takes from the energy.
    """

    discretized: Discretized
    values: Floats
    report: SolveReport
    work: MeasuredWork
    seconds: Mapping[str, float]
    warnings: tuple[str, ...] = field(default=(), kw_only=True)
    imbalances: tuple[Imbalance, ...] = field(default=(), kw_only=True)
    estimated: ErrorEstimate | Literal[False] | None = field(default=None, kw_only=True)
    trade: Trade | None = field(default=None, kw_only=True)
    resonance: Resonance | None = field(default=None, kw_only=True)

    @property
    def scene(self) -> Scene:
        """What was solved."""
        return self.discretized.scene

    @property
    def spacing(self) -> float:
        """How fine the discretisation is, in the scene's unit of length."""
        return self.discretized.spacing

    @property
    def channels(self) -> int:
        """Number of right-hand sides that were solved together."""
        return int(self.values.shape[1])

    @property
    def data_time(self) -> float | None:
        """At which data that depend on the time are read; None where nothing does."""
        return None

    @property
    def error(self) -> ErrorEstimate:
        """An estimate of the error: that of :func:`cpmkit.solve`, or one that is made when it is first asked for.

        Made by solving on a lattice of twice the spacing, for about a quarter of what the solution took.

        Raises
        ------
        CpmkitError
            If the scene cannot be solved at twice the spacing, or the solution is not one on a lattice.
        """
        return self.estimated or self._error

    @cached_property
    def _error(self) -> ErrorEstimate:
        from cpmkit.accuracy.estimate import error_of

        return error_of(self)

    def error_at(self, points: Any) -> Any:
        """Return the estimated error (n,) or (n, channels) at points of the manifold, in the solution's own unit."""
        return self._at(points, self.error.at_points)

    @overload
    def evaluate(self, points: Sequence[float], side: ReadSides = None) -> Any: ...
    @overload
    def evaluate(self, points: Any, side: ReadSides = None) -> Floats: ...
    def evaluate(self, points: Any, side: ReadSides = None) -> Any:
        """Return the solution at the points of the manifold nearest to ``points``.

        Parameters
        ----------
        points : (n, d) array, or one point (d,)
            In the scene's coordinates, at most the tube's radius away from the manifold.
        side : "left", "right", "both" or {boundary name: side}, optional
            From which side a point on a boundary is read; left if not said. Points off the boundary are
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
        return self._at(points, lambda rows: self._values_at(rows, side))

    def __call__(self, points: Any, side: ReadSides = None) -> Any:
        """Return the solution at points, as :meth:`evaluate` does: a solution is a function of position."""
        return self.evaluate(points, side)

    def _values_at(self, points: Any, side: ReadSides) -> Floats:
        if isinstance(side, str) and side == "both":
            return np.stack([self._values_at(points, one) for one in SIDES], axis=1)
        values = self.discretized.evaluate(self.values, points, side, self.data_time)
        return values[:, 0] if self.channels == 1 else values

    def _at(self, points: Any, read: Callable[[Any], Floats]) -> Any:
        """Return what is read at points (n, d), or at one point (d,) without the axis of points."""
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

        One row a vertex, in the order of the file or array, whatever was welded or mended since. A vertex in no face
        has the value of the surface beside it, NaN where that is farther than half a spacing. ``side`` is as for
        :meth:`evaluate`.

        Returns
        -------
        (n,) or (n, channels) float64

        Raises
        ------
        InputError
            If the surface was not made from vertices.
        """
        from cpmkit.solution.own_vertices import at_vertices

        return at_vertices(self, side)

    def gradient(self, points: Any, side: Sides = None) -> Any:
        """Return the surface gradient of the solution at the points of the manifold nearest to ``points``.

        Of second order, also on and beside boundaries and edges, where it is that of the point's own side. Where
        two Dirichlet boundaries leave a strip of less than about seven spacings, it is of first order in the strip.

        Parameters
        ----------
        points, side
            As for :meth:`evaluate`.

        Returns
        -------
        (n, d) or (n, channels, d) float64
            Tangential vectors, in the unit of the solution over the unit of length; of one point without the first
            axis.

        Raises
        ------
        InputError
            As :meth:`evaluate` does.

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

        return self._at(points, read)

    def flux(self, boundary: str | int, side: Side | None = None) -> float | Floats:
        """Return what flows out of a side of a boundary: the integral of du/db over it.

        b is the conormal out of that side: across the boundary to the right out of the left side and to the left
        out of the right side, outwards at an edge. By the divergence theorem the fluxes out of a piece of the
        manifold add up to the integral of Lap u over it.

        Parameters
        ----------
        boundary : str or int
            The name of a boundary; ``"edge"`` or the number of a loop for the edge of the manifold.
        side : "left" or "right"
            Of a boundary; an edge has none.

        Returns
        -------
        float, or (channels,) float64 where there are several
            Of a boundary that is a point, du/db there.

        Raises
        ------
        InputError
            If there is no such boundary or edge, the boundary has no sides (a point on a surface), or the surface
            has no mesh whose rim could be followed.

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
        from cpmkit.solution.fluxes import flux

        return flux(self, boundary, side)

    def flux_density(self, boundary: str, side: Side, points: Any) -> Floats:
        """Return du/db, (n,) or (n, channels), at the points of a boundary nearest to ``points`` (n, d).

        b points out of ``side``, as for :meth:`flux`.
        """
        from cpmkit.solution.fluxes import flux_density

        return flux_density(self, boundary, side, points)

    def signed_distance(self, name: str, points: Any) -> Floats:
        """Return the distance (n,) of points of the manifold from boundary ``name``, positive on its left.

        NaN where the point has no side of it: past an open end, far from it, where the boundary has no part on the
        point's sheet, or if the boundary is a point on a surface.
        """
        return self.discretized.signed_distance(name, points)

    def discretization(self) -> dict[str, Any]:
        """Return how the scene was discretised, as plain values."""
        return self.discretized.describe()

    def integrate(self, function: Integrand | None = None, *, dim: int | None = None) -> float | Floats:
        """Return the integral over the manifold of the solution, or of a function of it.

        In the Galerkin form taken over its own samples, which stand for the surface that is solved on, else cell by
        cell over the mesh that the boundaries cut, with curved cells. Jumps stay sharp in both: the error is of the
        order spacing^3 at least on smooth manifolds, less than that of the solution.

        Parameters
        ----------
        function : callable or number, optional
            Integrated in place of the solution: called with points (n, d) of the manifold and the values there, (n,) or
            (n, channels), it returns (n,) or (n, k). ``1`` gives the length or area.
        dim : int, optional
            Over the parts of this dimension, where a union has parts of several: lengths and areas do not add up.

        Returns
        -------
        float, or (channels,) float64 where there are several

        Raises
        ------
        InputError
            If ``dim`` is needed, or, in other forms than the Galerkin form, the surface has no mesh, or one that does
            not fill it (a cloud, a solid in space).

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
        """Return the integral of :meth:`integrate` divided by the length or area."""
        from cpmkit.solution.integrals import mean

        return mean(self, function, dim)

    def save(self, path: str | Path, vertices: str = "display", **options: Unpack[SavingKeywords]) -> None:
        """Write the solution to ``path``; the suffix decides what: see :func:`cpmkit.saving.export.save`.

        A file that is there already is replaced, by a whole one or not at all. ``vertices="own"`` writes a mesh file
        with the vertices and cells that the surface was made from; options are those of films and pages.
        """
        from cpmkit.saving.export import save

        save(self, path, vertices, **options)

    def picture(self, path: str | Path, **options: Unpack[LookKeywords]) -> Picture:
        """Draw the solution into the PNG ``path``; see :func:`cpmkit.view.picture`."""
        from cpmkit.view import picture

        return picture(self, path, **options)

    def plot(self, axes: Any = None, **options: Unpack[LookKeywords]) -> Any:
        """Draw the solution on axes of matplotlib, as :meth:`picture` does, and return them."""
        from cpmkit.view.showing import plot

        return plot(self, axes, **options)

    def show(self, **options: Unpack[LookKeywords]) -> Page:
        """Show the solution to be turned and zoomed, in a window of the browser or in a notebook.

        :func:`cpmkit.pick_line` shows it in a window in which lines are drawn on it.
        """
        from cpmkit.view.showing import show

        return show(self, **options)

    def to_pyvista(self, vertices: str = "display") -> Any:
        """Return a ``pyvista.PolyData`` with point data ``u``; vertices as for :meth:`save`."""
        from cpmkit.saving.converting import to_pyvista

        return to_pyvista(self, vertices)

    def to_trimesh(self, vertices: str = "display") -> Any:
        """Return a ``trimesh.Trimesh`` with the vertex attribute ``u``; vertices as for :meth:`save`."""
        from cpmkit.saving.converting import to_trimesh

        return to_trimesh(self, vertices)

    def to_meshio(self, vertices: str = "display") -> Any:
        """Return a ``meshio.Mesh`` with point data ``u``; vertices as for :meth:`save`."""
        from cpmkit.saving.converting import to_meshio

        return to_meshio(self, vertices)

    def to_polyscope(self, name: str = "solution", vertices: str = "display") -> Any:
        """Register the mesh with polyscope under ``name``; vertices as for :meth:`save`."""
        from cpmkit.saving.converting import to_polyscope

        return to_polyscope(self, name, vertices)

    @property
    def doubled(self) -> Floats:
        """(k, d) the feet of further unknowns at nodes that several sheets of the surface share."""
        doubled = self.discretized.diagnosis().doubled
        return np.zeros((0, self.scene.surface.dim)) if doubled is None else doubled

    def display_mesh(self) -> DisplayMesh:
        """Return a mesh of the manifold with the solution at its vertices, made at the first call."""
        return self._display_mesh

    @cached_property
    def _display_mesh(self) -> DisplayMesh:
        from cpmkit.solution.display_mesh import display_mesh

        own = self.discretized.display_mesh(self.values)
        return display_mesh(self) if own is None else own

    def summary(self) -> dict[str, Any]:
        """Return what was solved, what it cost and what it reached, as plain values."""
        from cpmkit.saving.summary import summarize

        return summarize(self)

    def arrays(self) -> dict[str, Any]:
        """Return the arrays from which the discrete solution is rebuilt; none where the mesh holds it."""
        known = self.discretized.arrays()
        return {**known, "unknowns": self.values} if known else {}

    def __repr__(self) -> str:
        warned = f", {len(self.warnings)} warnings" if self.warnings else ""
        channels = f", {self.channels} channels" if self.channels > 1 else ""
        return (
            f"Solution of {self.scene.problem.kind} with {len(self.scene.boundaries)} boundaries, form "
            f"{self.discretized.form}, spacing {self.spacing:g}{channels}\n"
            f"  {self.work.unknowns:,} unknowns, solver {self.report.solver}{warned}"
        )

    def _figures(self) -> list[tuple[str, str]]:
        """Return what a notebook shows beside the picture."""
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

    def _repr_html_(self) -> str:
        from cpmkit.view.thumbnail import thumbnail

        return html_table(f"Solution of {self.scene.problem.kind}", self._figures(), thumbnail(self))
