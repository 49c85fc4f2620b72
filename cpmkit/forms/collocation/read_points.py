"""Evaluation of a solution, its gradient and its conormal derivative at points, from either side of a boundary."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import InputError
from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.forms.collocation.extension import extend
from cpmkit.forms.collocation.gradients import surface_gradient
from cpmkit.forms.collocation.selection import Centres
from cpmkit.forms.collocation.side_view import ON_BOUNDARY_SPACINGS, SideView
from cpmkit.forms.contract import Discretized
from cpmkit.grid.stencils import reading_radius
from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.tangent_space import outward_conormals
from cpmkit.runtime.arrays import as_points
from cpmkit.scene.boundary import boundary_number, named_sides
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Side, Sides

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Points nearer to a boundary than this many spacings are read from the side given by the caller.
READ_FROM_SIDE_SPACINGS = 1e-3


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

    def rows(self, points: Any, side: Sides = None) -> csr_array:
        """Return the matrix (k, unknowns) that interpolates at the manifold's points nearest to ``points`` (k, d)."""
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

    def signed_distance(self, name: str, points: Any) -> Floats:
        """Return the distance (k,) of points of the manifold from boundary ``name``, positive on its left.

        It is NaN where the point has no side: past an open end, farther away than twice the tube's radius, where no
        part of the boundary is on the point's sheet, and everywhere if the boundary is a point on a surface.
        """
        boundary = self.tables.layout.boundaries.on_lattice[boundary_number(self.scene.boundaries, name)]
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

    def side_numbers(self, side: Sides) -> dict[int, Side]:
        """Return the side that is read of each boundary, by the boundary's number; see :func:`named_sides`."""
        has_left = [boundary.oriented.has_left for boundary in self.tables.layout.boundaries.on_lattice]
        by_name = named_sides(self.scene.boundaries, side, has_left)
        return {boundary_number(self.scene.boundaries, name): of_boundary for name, of_boundary in by_name.items()}
