"""A solution: read it at any point of the manifold, from either side of a boundary; save it; draw it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import InputError
from cpmkit.forms.collocation.boundary.crossing import View
from cpmkit.forms.collocation.boundary.frame import ON_BOUNDARY, Frame
from cpmkit.forms.collocation.diagnosis.clusters import feet_of_twins
from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.forms.collocation.extension import extend
from cpmkit.forms.collocation.reading.strips import fill_strips
from cpmkit.grid.stencils import reading_radius
from cpmkit.protocols import SIDES, ClosestPoints, Floats, Side
from cpmkit.runtime.arrays import as_points
from cpmkit.solution.abstract import ReadableSolution
from cpmkit.solution.work import Work

if TYPE_CHECKING:
    from cpmkit.forms.collocation.conservation.flux_balance import Balance
    from cpmkit.meshes.display_mesh import DisplayMesh

#: Points nearer to a boundary than this many spacings can be read from the side that the caller names.
READ_FROM_SIDE = 1e-3
#: Points that are read at a time.
CHUNK = 1 << 18


@dataclass(frozen=True, eq=False)
class Solution(ReadableSolution):
    """The solution of a scene by the closest point method.

    Attributes
    ----------
    scene : Scene
        What was solved.
    values : (unknowns, channels) float64
        Values of the inner nodes and the ghosts.
    report : SolveReport
        What the solver reached.
    work : Work
        What it cost.
    seconds : mapping
        Seconds of each stage; of this machine, on this day.
    warnings : tuple of str
        What a reader of the solution should know.
    defects : tuple of Defect
        One for each piece of the manifold on which the solution is fixed by its mean alone, which is zero: what of
        the data has no solution there.
    tables : Discretization
        The band and its tables.
    balance : Balance or None
        What balancing the fluxes did, where that was asked for.
    """

    work: Work
    tables: Discretization
    balance: Balance | None = field(default=None, kw_only=True)

    @property
    def spacing(self) -> float:
        """Spacing of the lattice, in the scene's unit."""
        return self.tables.layout.lattice.spacing

    @property
    def data_time(self) -> float | None:
        """At which data that depend on the time are read; None where nothing does."""
        return None

    @property
    def radius(self) -> float:
        """Radius of the tube, in the scene's unit: points farther from the manifold cannot be read."""
        band = self.tables.layout.band
        return reading_radius(band.dim, band.degree) * band.spacing

    def evaluate(self, points: Any, side: Side | Mapping[str, Side] | None = None) -> Floats:
        """Return the solution at the points of the manifold nearest to ``points``.

        Parameters
        ----------
        points : (n, d) array
            In the scene's coordinates, at most the tube's radius away from the manifold.
        side : "left", "right" or {boundary name: side}, optional
            From which side a point on a boundary is read; left if not said. Points off the boundary are
            not affected.

        Returns
        -------
        (n,) or (n, channels) float64

        Raises
        ------
        InputError
            If a point is not finite or too far away, or a side names no boundary that has sides.
        """
        wanted = self.sides(side)
        local = self.localized(points)
        values = np.empty((len(local), self.channels))
        for start in range(0, len(local), CHUNK):
            part = slice(start, start + CHUNK)
            values[part] = self._read(self.project(local[part]).points, wanted)
        return values[:, 0] if self.channels == 1 else values

    def gradient(self, points: Any, side: Side | Mapping[str, Side] | None = None) -> Floats:
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
            Tangential vectors, in the unit of the solution over the unit of length.

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
        from cpmkit.forms.collocation.reading.gradients import surface_gradient

        gradient = surface_gradient(self, self.localized(points), self.sides(side))
        return gradient[:, 0] if self.channels == 1 else gradient

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

        NaN where the point has no side of it: past an open end, farther than twice the tube's radius,
        where the boundary has no part on the point's sheet, or if the boundary is a point on a surface.
        """
        index = self._index(name)
        local = self.project(self.localized(points)).points
        seen = self.tables.layout.sight.sighted[index].frame(local, 2 * self.radius, self.spacing)
        signed = np.full(len(local), np.nan)
        signed[seen.rows] = np.where(seen.end, np.nan, seen.signed)
        return signed

    def discretization(self) -> dict[str, Any]:
        """Return how the scene was discretised, as plain values."""
        layout = self.tables.layout
        sighted = zip(self.scene.boundaries, layout.sight.sighted, strict=True)
        return {
            "degree": layout.band.degree,
            "order": layout.order,
            "origin": layout.lattice.origin.tolist(),
            "snapped_by": {boundary.name: one.gap for boundary, one in sighted},
            "balance": None if self.balance is None else self.balance.as_dict(),
        }

    def make_display_mesh(self) -> DisplayMesh:
        """Mesh the manifold, cut it along the boundaries, and evaluate the solution at the vertices."""
        from cpmkit.meshes.display_mesh import display_mesh

        return display_mesh(self)

    def arrays(self) -> dict[str, Any]:
        """Return the lattice, the nodes and the values as plain arrays."""
        return {
            **{name: np.array(value) for name, value in self.tables.layout.options.items()},
            "nodes": self.tables.layout.band.nodes[: self.tables.layout.band.inner],
            "ghosts": self.tables.unknowns.ghost_nodes,
            "left": self.tables.unknowns.ghost_sides,
            "unknowns": self.values,
        }

    @property
    def doubled(self) -> Floats:
        """(k, d) the feet of further unknowns at nodes that several sheets of the surface share."""
        return feet_of_twins(self.tables.layout)

    def __repr__(self) -> str:
        layout, work = self.tables.layout, self.work
        lines = [
            f"Solution of {self.scene.problem.kind} with {len(self.scene.boundaries)} boundaries",
            f"spacing {self.spacing:g}, degree {layout.band.degree}, order {layout.order}, channels {self.channels}",
            f"{work.unknowns} unknowns ({work.ghosts} ghosts), {work.closest_point_queries} closest point queries",
            f"{self.report.solver}: {self.report.reason}",
            f"{len(self.warnings)} warnings",
        ]
        return "\n  ".join(lines)

    def project(self, local: Floats) -> ClosestPoints:
        """Return the feet of points (n, d) near the manifold, both relative to the lattice's origin.

        Raises
        ------
        InputError
            If a point is farther away than the tube's radius.
        """
        feet = self.tables.layout.surface.closest_point(local)
        worst = float(feet.distance.max(initial=0.0))
        if worst > self.radius:
            raise InputError(
                f"points must lie within the tube's radius {self.radius:.3g} of the manifold to be read, "
                f"the farthest is {worst:.3g} away; take their closest points first."
            )
        return feet

    def boundary_frames(self, local: Floats, wanted: Mapping[int, Side]) -> list[Frame]:
        """Return how each boundary sees points of the manifold; those on boundary k from the side ``wanted[k]``."""
        frames = []
        for index, sighted in enumerate(self.tables.layout.sight.sighted):
            seen = sighted.frame(local, 2 * self.radius, self.spacing)
            frames.append(_from_side(seen, wanted[index], self.spacing) if index in wanted else seen)
        return frames

    def localized(self, points: Any) -> Floats:
        """Return points (n, d), checked, relative to the lattice's origin."""
        return self.tables.layout.lattice.to_local(as_points(points, self.scene.surface.dim))

    def _read(self, local: Floats, wanted: Mapping[int, Side]) -> Floats:
        frames, layout = self.boundary_frames(local, wanted), self.tables.layout
        rows = extend(self.tables.unknowns, local, View.of_points(frames, len(local)))
        values = np.asarray(rows @ self.values)
        if layout.strips:
            fill_strips(values, local, layout.strips, self.scene.boundaries, frames, layout.lattice, self.data_time)
        return values

    def _index(self, name: str) -> int:
        names = [boundary.name for boundary in self.scene.boundaries]
        if name not in names:
            raise InputError(
                f"no boundary has the name {name!r}; the scene has {', '.join(map(repr, names)) or 'none'}."
            )
        return names.index(name)

    def sides(self, side: Side | Mapping[str, Side] | None) -> dict[int, Side]:
        """Return the side that ``side`` asks for, by the boundary's number.

        Raises
        ------
        InputError
            If it names no boundary, or one without sides.
        """
        sighted = self.tables.layout.sight.sighted
        if side is None:
            return {}
        if isinstance(side, Mapping):
            wanted = {self._index(name): one for name, one in side.items()}
        else:
            wanted = {index: side for index, one in enumerate(sighted) if one.has_left}
        for index, one in wanted.items():
            if one not in SIDES or not sighted[index].has_left:
                name = self.scene.boundaries[index].name
                raise InputError(
                    f"side of {name!r} must be 'left' or 'right' of a boundary that has sides, got {one!r}."
                )
        return wanted


def _from_side(seen: Frame, side: Side, spacing: float) -> Frame:
    """Return the frame with the points on the boundary moved to ``side``."""
    on = np.abs(seen.signed) < READ_FROM_SIDE * spacing
    signed = np.where(on, (1.0 if side == "left" else -1.0) * ON_BOUNDARY * spacing, seen.signed)
    return replace(seen, signed=signed, director=seen.director * (signed / seen.signed)[:, None])
