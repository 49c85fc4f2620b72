"""Reading a solution at points of the manifold, from either side of a boundary."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.forms.collocation.boundary.side_view import ON_BOUNDARY_SPACINGS, SideView
from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.forms.collocation.extension import extend
from cpmkit.forms.collocation.reading.gradients import interpolant_gradient_rows, surface_gradient
from cpmkit.forms.collocation.reading.strips import fill_strips
from cpmkit.forms.collocation.selection import Centres
from cpmkit.forms.contract import Discretized
from cpmkit.grid.stencils import reading_radius
from cpmkit.manifold.tangent_space import outward_conormals
from cpmkit.protocols import SIDES, ClosestPoints, Floats, Side, Sides
from cpmkit.runtime.arrays import as_points
from cpmkit.scene.scene import Scene

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Points nearer to a boundary than this many spacings can be read from the side that the caller names.
READ_FROM_SIDE_SPACINGS = 1e-3
#: Points that are read at a time.
EVALUATION_CHUNK_POINTS = 1 << 18


@dataclass(frozen=True, eq=False)
class Reader(Discretized):
    """The part of the form that reads values at points: the tables, and the scene with its boundaries' names.

    Attributes
    ----------
    scene : Scene
    tables : Discretization
    """

    scene: Scene
    tables: Discretization

    @property
    def spacing(self) -> float:
        """Spacing of the lattice, in the scene's unit."""
        return self.tables.layout.lattice.spacing

    @property
    def radius(self) -> float:
        """Radius of the tube, in the scene's unit: points farther from the manifold cannot be read."""
        band = self.tables.layout.band
        return reading_radius(band.dim, band.degree) * band.spacing

    def evaluate(self, values: Floats, points: Any, side: Sides = None, time: float | None = None) -> Floats:
        """Return ``values`` (unknowns, channels) interpolated at points (k, d), (k, channels); data of ``time``."""
        wanted, layout = self.side_numbers(side), self.tables.layout
        local = self.localized(points)
        read = np.empty((len(local), values.shape[1]))
        for start in range(0, len(local), EVALUATION_CHUNK_POINTS):
            part = slice(start, start + EVALUATION_CHUNK_POINTS)
            feet = self.checked_closest_points(local[part])
            side_views = self.side_views(feet.points, wanted)
            centres = Centres.of_points(feet, side_views)
            found = np.asarray(extend(self.tables.unknowns, feet.points, centres) @ values)
            if layout.strips:
                fill_strips(found, feet.points, layout, side_views, time)
            read[part] = found
        return read

    def rows(self, points: Any, side: Sides = None) -> csr_array:
        """Return the matrix (k, unknowns) that interpolates at points; strips between boundaries are not filled."""
        feet = self.checked_closest_points(self.localized(points))
        centres = Centres.of_points(feet, self.side_views(feet.points, self.side_numbers(side)))
        return extend(self.tables.unknowns, feet.points, centres)

    def gradient_rows(self, points: Any, side: Sides = None) -> tuple[csr_array, ...]:
        """Return the d matrices (k, unknowns) of the interpolant's tangential gradient."""
        feet = self.checked_closest_points(self.localized(points))
        return interpolant_gradient_rows(self, feet, self.side_views(feet.points, self.side_numbers(side)))

    def gradient(self, values: Floats, points: Any = None, side: Sides = None) -> Floats:
        """Return the surface gradient (k, channels, d) of ``values`` at points (k, d)."""
        points = self.points if points is None else points
        return surface_gradient(self, values, self.localized(points), self.side_numbers(side))

    def conormal_derivative(
        self, values: Floats, points: Any, boundary: str | None = None, side: Side | None = None
    ) -> Floats:
        """Return du/db (k, channels) at points near a boundary, b out of the side: -v on the left, +v on the right."""
        if boundary is None or side is None:
            return self._rim_derivative(values, points)
        ((index, _),) = self.side_numbers({boundary: side}).items()
        on = self.tables.layout.boundaries.on_lattice[index].source.closest_point(self.localized(points)).points
        feet = self.checked_closest_points(on)
        seen = self.side_views(feet.points, {index: side})[index]
        gradient = surface_gradient(self, values, feet.points, {index: side})
        along_left = np.einsum("ncd,nd->nc", gradient, seen.conormal)
        return np.asarray(-along_left if side == "left" else along_left)

    def flux(self, u: Floats, boundary: str | int, side: Side | None, time: float | None) -> None:
        """Refuse a boundary without sides; the form has no better rule than a quadrature."""
        if isinstance(boundary, str) and side is not None:
            self.side_numbers({boundary: side})

    def _rim_derivative(self, values: Floats, points: Floats) -> Floats:
        """Return du/db (k, channels) at ``points`` (k, d) of the edge, b outwards."""
        local, surface = self.localized(points), self.tables.layout.surface
        # Conormals are those of feet that the localized surface found on its edge itself.
        outward = outward_conormals(surface, surface.closest_point(local), 0.5 * self.spacing)
        return np.asarray(np.einsum("ncd,nd->nc", surface_gradient(self, values, local, {}), outward))

    def signed_distance(self, name: str, points: Any) -> Floats:
        """Return the distance (k,) of points of the manifold from boundary ``name``, positive on its left.

        NaN where the point has no side of it: past an open end, farther than twice the tube's radius,
        where the boundary has no part on the point's sheet, or if the boundary is a point on a surface.
        """
        index = self._index(name)
        local = self.checked_closest_points(self.localized(points)).points
        seen = self.tables.layout.boundaries.on_lattice[index].side_view(local, 2 * self.radius, self.spacing)
        signed = np.full(len(local), np.nan)
        signed[seen.rows] = np.where(seen.end, np.nan, seen.signed)
        return signed

    def checked_closest_points(self, local: Floats) -> ClosestPoints:
        """Return the feet of points (k, d) near the manifold, both relative to the lattice's origin.

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

    def side_views(self, local: Floats, wanted: Mapping[int, Side]) -> list[SideView]:
        """Return how each boundary sees points of the manifold; those on boundary k from the side ``wanted[k]``."""
        side_views = []
        for index, on_lattice in enumerate(self.tables.layout.boundaries.on_lattice):
            seen = on_lattice.side_view(local, 2 * self.radius, self.spacing)
            side_views.append(_moved_to_side(seen, wanted[index], self.spacing) if index in wanted else seen)
        return side_views

    def localized(self, points: Any) -> Floats:
        """Return points (k, d), checked, relative to the lattice's origin."""
        return self.tables.layout.lattice.to_local(as_points(points, self.scene.surface.dim))

    def _index(self, name: str) -> int:
        names = [boundary.name for boundary in self.scene.boundaries]
        if name not in names:
            raise InputError(
                f"no boundary has the name {name!r}; the scene has {', '.join(map(repr, names)) or 'none'}."
            )
        return names.index(name)

    def side_numbers(self, side: Sides) -> dict[int, Side]:
        """Return the side that ``side`` asks for, by the boundary's number.

        Raises
        ------
        InputError
            If it names no boundary, or one without sides.
        """
        on_lattice = self.tables.layout.boundaries.on_lattice
        if side is None:
            return {}
        if isinstance(side, Mapping):
            wanted = {self._index(name): one for name, one in side.items()}
        else:
            wanted = {index: side for index, one in enumerate(on_lattice) if one.oriented.has_left}
        for index, one in wanted.items():
            if one not in SIDES or not on_lattice[index].oriented.has_left:
                name = self.scene.boundaries[index].name
                raise InputError(
                    f"side of {name!r} must be 'left' or 'right' of a boundary that has sides, got {shown(one)}."
                )
        return wanted


def _moved_to_side(side_view: SideView, side: Side, spacing: float) -> SideView:
    """Return the view with the points on the boundary moved to ``side``."""
    on_boundary = np.abs(side_view.signed) < READ_FROM_SIDE_SPACINGS * spacing
    signed = np.where(on_boundary, (1.0 if side == "left" else -1.0) * ON_BOUNDARY_SPACINGS * spacing, side_view.signed)
    return replace(side_view, signed=signed, director=side_view.director * (signed / side_view.signed)[:, None])
