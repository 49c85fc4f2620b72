"""Evaluation of a solution, its gradient and its conormal derivative at points, from either side of a boundary."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.forms.collocation.band_layout import Layout
from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.forms.collocation.extension import extend
from cpmkit.forms.collocation.gradients import surface_gradient
from cpmkit.forms.collocation.selection import Centres
from cpmkit.forms.collocation.side_view import ON_BOUNDARY_SPACINGS, SideView
from cpmkit.forms.collocation.unresolved_geometry.meeting_boundaries import STRIP_SPACINGS
from cpmkit.forms.contract import Discretized
from cpmkit.grid.lattice import Lattice
from cpmkit.grid.stencils import reading_radius
from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.tangent_space import outward_conormals
from cpmkit.runtime.arrays import as_points
from cpmkit.scene.boundary import BoundarySet
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.laws import Value
from cpmkit.scene.scene import Scene
from cpmkit.types import SIDES, Bools, Floats, Side, Sides

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Points nearer to a boundary than this many spacings are read from the side given by the caller.
READ_FROM_SIDE_SPACINGS = 1e-3
#: Number of points that are evaluated at a time.
EVALUATION_CHUNK_POINTS = 1 << 18


@dataclass(frozen=True, eq=False)
class Reader(Discretized):
    """A discretised scene that evaluates vectors of unknowns at points.

    Attributes
    ----------
    scene : Scene
        The scene, with its boundaries' names and conditions.
    tables : Discretization
        The band with its extension and differences.
    """

    scene: Scene
    tables: Discretization

    @property
    def spacing(self) -> float:
        """The spacing of the lattice, in the scene's unit."""
        return self.tables.layout.lattice.spacing

    @property
    def radius(self) -> float:
        """The radius of the tube, in the scene's unit; points farther from the manifold cannot be evaluated."""
        band = self.tables.layout.band
        return reading_radius(band.dim, band.degree) * band.spacing

    def evaluate(self, values: Floats, points: Any, side: Sides = None, time: float | None = None) -> Floats:
        """Return ``values`` interpolated at the points of the manifold nearest to ``points``, (k, channels).

        Parameters
        ----------
        values : (unknowns, channels) float64
            A vector of unknowns for each channel.
        points : array_like (k, d)
            Points within :attr:`radius` of the manifold.
        side : "left", "right" or mapping, optional
            The side from which points on boundaries are read, of all boundaries or by name.
        time : float, optional
            Time at which data are read that fill strips between close boundaries.

        Raises
        ------
        InputError
            If a point is too far from the manifold, or ``side`` names no boundary, or a boundary without sides.
        """
        sides, layout = self.side_numbers(side), self.tables.layout
        local = self.to_local_points(points)
        read = np.empty((len(local), values.shape[1]))
        for start in range(0, len(local), EVALUATION_CHUNK_POINTS):
            part = slice(start, start + EVALUATION_CHUNK_POINTS)
            feet = self.checked_closest_points(local[part])
            side_views = self.side_views(feet.points, sides)
            matrix = extend(self.tables.unknowns, feet.points, Centres.of_points(feet, side_views))
            read[part] = matrix @ values
            if layout.strips:
                _fill_strips(read[part], feet.points, layout, side_views, time)
        return read

    def rows(self, points: Any, side: Sides = None) -> csr_array:
        """Return the matrix (k, unknowns) that interpolates at ``points`` (k, d), without the filling of strips."""
        feet = self.checked_closest_points(self.to_local_points(points))
        centres = Centres.of_points(feet, self.side_views(feet.points, self.side_numbers(side)))
        return extend(self.tables.unknowns, feet.points, centres)

    def gradient(self, values: Floats, points: Any = None, side: Sides = None) -> Floats:
        """Return the surface gradient (k, channels, d) of ``values`` at points (k, d), by default :attr:`points`."""
        points = self.points if points is None else points
        return surface_gradient(self, values, self.to_local_points(points), self.side_numbers(side))

    def conormal_derivative(
        self, values: Floats, points: Any, boundary: str | None = None, side: Side | None = None
    ) -> Floats:
        """Return the derivative du/db (k, channels) at points (k, d) near a boundary, or near the edge without one.

        The conormal b points out of ``side``: it is -v on the left and +v on the right, where v points to the left; at
        the edge it points outwards.
        """
        surface, local = self.tables.layout.surface, self.to_local_points(points)
        if boundary is None or side is None:
            # The localized surface is queried again because conormals need its own records of points on the edge.
            outward = outward_conormals(surface, surface.closest_point(local), 0.5 * self.spacing)
            return np.asarray(np.einsum("ncd,nd->nc", surface_gradient(self, values, local, {}), outward))
        ((index, _),) = self.side_numbers({boundary: side}).items()
        on = self.tables.layout.boundaries.on_lattice[index].source.closest_point(local).points
        feet = self.checked_closest_points(on)
        view = self.side_views(feet.points, {index: side})[index]
        gradient = surface_gradient(self, values, feet.points, {index: side})
        to_left = np.einsum("ncd,nd->nc", gradient, view.conormal)
        return np.asarray(-to_left if side == "left" else to_left)

    def flux(self, u: Floats, boundary: str | int, side: Side | None, time: float | None) -> None:
        """Return None: in this form, fluxes are integrated by quadrature of the conormal derivative.

        Raises
        ------
        InputError
            If ``side`` names a boundary that has no sides.
        """
        if isinstance(boundary, str) and side is not None:
            self.side_numbers({boundary: side})

    def signed_distance(self, name: str, points: Any) -> Floats:
        """Return the distance (k,) of points of the manifold from boundary ``name``, positive on its left.

        It is NaN where the point has no side: past an open end, farther away than twice the tube's radius, where no
        part of the boundary is on the point's sheet, and everywhere if the boundary is a point on a surface.
        """
        boundary = self.tables.layout.boundaries.on_lattice[self._index(name)]
        local = self.checked_closest_points(self.to_local_points(points)).points
        view = boundary.side_view(local, 2 * self.radius, self.spacing)
        signed = np.full(len(local), np.nan)
        signed[view.rows] = np.where(view.end, np.nan, view.signed)
        return signed

    def checked_closest_points(self, local: Floats) -> ClosestPoints:
        """Return the closest points of ``local`` (k, d), both relative to the lattice's origin.

        Raises
        ------
        InputError
            If a point is farther from the manifold than the tube's radius.
        """
        feet = self.tables.layout.surface.closest_point(local)
        worst = float(feet.distance.max(initial=0.0))
        if worst > self.radius:
            raise InputError(
                f"points must lie within the tube's radius {self.radius:.3g} of the manifold to be read, "
                f"the farthest is {worst:.3g} away; take their closest points first."
            )
        return feet

    def side_views(self, local: Floats, sides: Mapping[int, Side]) -> list[SideView]:
        """Return for each boundary the distances and sides of points ``local`` (k, d) of the manifold near it.

        Points on boundary k count to the side ``sides[k]``, if given.
        """
        views = []
        for index, boundary in enumerate(self.tables.layout.boundaries.on_lattice):
            view = boundary.side_view(local, 2 * self.radius, self.spacing)
            if index in sides:
                on_boundary = np.abs(view.signed) < READ_FROM_SIDE_SPACINGS * self.spacing
                inside = (1.0 if sides[index] == "left" else -1.0) * ON_BOUNDARY_SPACINGS * self.spacing
                signed = np.where(on_boundary, inside, view.signed)
                view = replace(view, signed=signed, director=view.director * (signed / view.signed)[:, None])
            views.append(view)
        return views

    def to_local_points(self, points: Any) -> Floats:
        """Return ``points`` (k, d), checked, relative to the lattice's origin."""
        return self.tables.layout.lattice.to_local(as_points(points, self.scene.surface.dim))

    def _index(self, name: str) -> int:
        """Return the number of the boundary called ``name``; raise an InputError if there is none."""
        names = [boundary.name for boundary in self.scene.boundaries]
        if name not in names:
            raise InputError(
                f"no boundary has the name {name!r}; the scene has {', '.join(map(repr, names)) or 'none'}."
            )
        return names.index(name)

    def side_numbers(self, side: Sides) -> dict[int, Side]:
        """Return the sides given by ``side`` by the number of their boundary.

        A single side is that of all boundaries that have a left; a mapping gives sides by boundary name.

        Raises
        ------
        InputError
            If ``side`` names no boundary, or a boundary without sides.
        """
        on_lattice = self.tables.layout.boundaries.on_lattice
        if side is None:
            return {}
        if isinstance(side, Mapping):
            sides = {self._index(name): of_boundary for name, of_boundary in side.items()}
        else:
            sides = {index: side for index, boundary in enumerate(on_lattice) if boundary.oriented.has_left}
        for index, of_boundary in sides.items():
            if of_boundary not in SIDES or not on_lattice[index].oriented.has_left:
                name = self.scene.boundaries[index].name
                raise InputError(
                    f"side of {name!r} must be 'left' or 'right' of a boundary that has sides, got "
                    f"{shown(of_boundary)}."
                )
        return sides


# Strips between two boundaries less than about a spacing apart, too narrow for a stencil


def _fill_strips(
    values: Floats, points: Floats, layout: Layout, side_views: Sequence[SideView], time: float | None
) -> None:
    """Overwrite the ``values`` (n, channels) at the ``points`` (n, d) that lie in a strip between two boundaries.

    Between two prescribed values they become the linear interpolant; beside a single prescribed value, this value: in a
    strip narrower than a spacing the solution is that to first order. Between two fluxes nothing is changed.
    """
    boundaries, lattice = layout.boundaries.definitions, layout.lattice
    for strip in layout.strips:
        first, second = side_views[strip.first], side_views[strip.second]
        _, in_first, in_second = np.intersect1d(first.rows, second.rows, return_indices=True)
        a, b = first.take(in_first), second.take(in_second)
        z = points[a.rows]
        between = np.sum((z - a.foot) * (z - b.foot), axis=1) < 0
        inside = np.flatnonzero(between & (a.distance + b.distance < STRIP_SPACINGS * lattice.spacing))
        a, b = a.take(inside), b.take(inside)
        value_a, fixed_a = _prescribed_values(boundaries[strip.first], a, lattice, values.shape[1], time)
        value_b, fixed_b = _prescribed_values(boundaries[strip.second], b, lattice, values.shape[1], time)
        share = (a.distance / (a.distance + b.distance))[:, None]
        share = np.where(fixed_a[:, None], np.where(fixed_b[:, None], share, 0.0), 1.0)
        interpolated = (1 - share) * value_a + share * value_b
        known = fixed_a | fixed_b
        values[a.rows[known]] = interpolated[known]


def _prescribed_values(
    boundary: BoundarySet, view: SideView, lattice: Lattice, channels: int, time: float | None
) -> tuple[Floats, Bools]:
    """Return the values (k, channels) that a boundary prescribes on the points' sides, and where (k,) it does."""
    values, fixed = np.zeros((len(view.rows), channels)), np.zeros(len(view.rows), dtype=bool)
    for side in SIDES:
        law = boundary.condition(side).law
        rows = np.flatnonzero((view.signed > 0) == (side == "left"))
        if isinstance(law, Value) and len(rows):
            where = lattice.to_scene(view.foot[rows])
            values[rows] = evaluate_data(law.datum, where, channels, f"boundary {boundary.name!r}", time)
            fixed[rows] = True
    return values, fixed
