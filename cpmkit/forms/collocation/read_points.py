"""Evaluation of a solution, its gradient and its conormal derivative at points, from either side of a boundary."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpmkit.errors import InputError
from cpmkit.forms.collocation.band_layout import extension_matrix
from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.forms.collocation.row_formula import extrapolation_weights
from cpmkit.forms.collocation.selection import Centres
from cpmkit.forms.collocation.side_view import ON_BOUNDARY_SPACINGS, SideView
from cpmkit.forms.contract import Discretized
from cpmkit.grid.band import reading_radius, stencil_cells, stencil_nodes, tensor_weights
from cpmkit.manifold.source import ClosestPoints, Rows
from cpmkit.manifold.tangent_space import outward_conormals, project_tangent
from cpmkit.manifold.vector_algebra import dots
from cpmkit.runtime.arrays import as_points
from cpmkit.scene.boundary import boundary_number, named_sides
from cpmkit.scene.edge_conditions import edge_condition
from cpmkit.scene.laws import Value
from cpmkit.scene.scene import Scene
from cpmkit.types import SIDES, Bools, Floats, Ints, Side, Sides, SparseMatrix

#: Points nearer to a boundary than this many spacings are read from the side given by the caller.
READ_FROM_SIDE_SPACINGS = 1e-3


@dataclass(frozen=True, eq=False)
class Reader(Discretized):
    """The part of the collocation form that evaluates vectors of unknowns at points; base of :class:`Collocation`."""

    scene: Scene  #: The scene, with its boundaries' names and conditions.
    tables: Discretization  #: The band with its extension and differences.

    @property
    def spacing(self) -> float:
        """The spacing of the lattice, in the scene's unit."""
        return self.tables.layout.lattice.spacing

    @property
    def radius(self) -> float:
        """The radius of the tube, in the scene's unit; points farther from the manifold cannot be evaluated."""
        band = self.tables.layout.band
        return reading_radius(band.dim, band.degree) * band.spacing

    def evaluation_matrix(self, points: Any, side: Sides = None) -> SparseMatrix:
        """Return the matrix (k, unknowns) that interpolates at the manifold's points nearest to ``points`` (k, d).

        Points on a boundary are read from its ``side``, for all or by name. InputError if one is beyond :attr:`radius`.
        """
        feet = self.checked_closest_points(self.to_local_points(points))
        centres = Centres.of_points(feet, self.side_views(feet.points, self.side_numbers(side)))
        return extension_matrix(self.tables.unknowns, feet.points, centres)

    def gradient(self, values: Floats, points: Any = None, side: Sides = None) -> Floats:
        """Return the gradient (k, channels, d) of ``values`` (unknowns, channels) at points (k, d), None: the form's.

        Points on a boundary are read from its ``side``, for all or by name. InputError if one is beyond :attr:`radius`.
        """
        points = self.points if points is None else points
        return surface_gradient(self, values, self.to_local_points(points), self.side_numbers(side))

    def conormal_derivative(
        self, values: Floats, points: Any, boundary: str | None = None, side: Side | None = None
    ) -> Floats:
        """Return du/db (k, channels) at the points of a boundary nearest to points (k, d), on its ``side``.

        ``values`` (unknowns, channels) are u. The conormal b points out of ``side``: it is -v on the left and +v on the
        right, where v points to the left. If ``boundary`` or ``side`` is None, points must be near the edge, where b
        points outwards. InputError if a point is too far to be read.
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
        """Return (z - y) . v (k,), positive on the left: near a smooth boundary ``name`` the signed distance from it.

        z is the closest point of each of ``points`` on the manifold, y its foot on the boundary, v the conormal to the
        left at y. A point on the boundary counts as left of it. The value is NaN where the point has no side: past an
        open end, farther away than about twice the tube's radius, where no part of the boundary is on the point's
        sheet, and everywhere if the boundary is a point on a surface. Where the boundary has no consistent left the
        sign is only local, and no value is NaN for that. Raises InputError if a point is farther from the manifold than
        the tube's radius.
        """
        boundary = self.tables.layout.boundaries.on_lattice[boundary_number(self.scene.boundaries, name)]
        local = self.checked_closest_points(self.to_local_points(points)).points
        view = boundary.side_view(local, 2 * self.radius, self.spacing)
        signed = np.full(len(local), np.nan)
        signed[view.rows] = np.where(view.end, np.nan, view.signed)
        return signed

    def checked_closest_points(self, local: Floats) -> ClosestPoints:
        """Return the closest points of ``local`` (k, d), both relative to the lattice's origin.

        Raises InputError if a point is farther from the manifold than the tube's radius.
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
        """Return for each boundary the distances and sides of those points ``local`` (k, d) of the manifold near it.

        Points on boundary j count to the side ``sides[j]``, if given, else to the left.
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
        """Return ``points`` (k, d) of the scene relative to the lattice's origin; InputError if they are not finite."""
        return self.tables.layout.lattice.to_local(as_points(points, self.scene.surface.dim))

    def side_numbers(self, side: Sides) -> dict[int, Side]:
        """Return sides by boundary number; ``side`` is one for all, or a side by name, see :func:`named_sides`."""
        has_left = [boundary.oriented.has_left for boundary in self.tables.layout.boundaries.on_lattice]
        by_name = named_sides(self.scene.boundaries, side, has_left)
        return {boundary_number(self.scene.boundaries, name): of_boundary for name, of_boundary in by_name.items()}


#: Number of points at which the gradient is computed at a time, so that their weights need little memory.
GRADIENT_CHUNK_POINTS = 8192
#: Distances from a bend, in spacings, from which the gradient is extrapolated. If the first is 2, bends affect the
#: gradient; if it is 3 or more, the error is larger.
CONTINUATION_DISTANCES_SPACINGS = (2.5, 3.5, 4.5)
#: A sample may be used if its distance from all bends is at least (1 - this share) of the first distance.
INSIDE_SLACK_SHARE = 0.1


# The gradient is that of a function that is constant along normals (Ruuth and Merriman 2008, principle 1), here of the
# interpolant of the band's values; its part along the normal, a discretisation error, is removed by projection.
#
# A ghost of a Dirichlet condition continues the solution linearly, so that second derivatives of the interpolant jump
# at the boundary (a bend), and its gradient is of first order only; where stencils hardly reach a ghost, of second.
# There the gradient is computed at three distances, and a parabola in the distance extrapolates it to the boundary.


def surface_gradient(reader: Reader, values: Floats, local: Floats, sides: Mapping[int, Side]) -> Floats:
    """Return the tangential gradient (n, channels, d) of a solution at the manifold's points nearest to ``local``.

    ``reader``: the discretised scene.
    ``values`` (unknowns, channels): the solution's unknowns.
    ``local`` (n, d): points relative to the lattice's origin.
    ``sides``: the side from which points on a boundary are read, by the boundary's number.

    Raises InputError if a point is farther from the manifold than the tube's radius.
    """
    gradient = np.empty((len(local), values.shape[1], local.shape[1]))
    for start in range(0, len(local), GRADIENT_CHUNK_POINTS):
        part = slice(start, start + GRADIENT_CHUNK_POINTS)
        feet = reader.checked_closest_points(local[part])
        side_views = reader.side_views(feet.points, sides)
        gradient[part] = _interpolant_gradient(reader, values, feet, side_views)
        bends = Bends.join([*_boundary_bends(reader, side_views), _edge_bends(reader, feet)])
        bends = bends.take(bends.distance < CONTINUATION_DISTANCES_SPACINGS[0] * reader.spacing)
        order = np.lexsort((bends.distance, bends.rows))  # the nearest bend of each point comes first
        bends = bends.take(order[np.unique(bends.rows[order], return_index=True)[1]])
        rows, samples, weights = _extrapolation_samples(reader, feet, side_views, bends, sides)
        if len(rows):
            read = _interpolant_gradient(reader, values, samples, reader.side_views(samples.points, sides))
            read = read.reshape(*weights.shape, *read.shape[1:])
            continued = np.einsum("ks,kscd->kcd", weights, read)
            gradient[part][rows] = _tangent_part(reader, feet.take(rows), continued)
    return gradient


def _interpolant_gradient(
    reader: Reader, values: Floats, feet: ClosestPoints, side_views: Sequence[SideView]
) -> Floats:
    """Return the tangential gradient (n, channels, d) at ``feet``, from ``values`` (unknowns, channels) of u."""
    unknowns = reader.tables.unknowns
    cells, fractions = stencil_cells(feet.points, unknowns.band.spacing, unknowns.band.degree)
    columns = unknowns.select(Centres.of_points(feet, side_views), stencil_nodes(unknowns.band, cells))
    axes, degree = range(unknowns.band.dim), unknowns.band.degree
    slopes = np.stack([tensor_weights(fractions, degree, axis) for axis in axes], axis=1) / unknowns.band.spacing
    return _tangent_part(reader, feet, np.asarray(np.einsum("nds,nsc->ncd", slopes, values[columns], optimize=True)))


def _tangent_part(reader: Reader, feet: ClosestPoints, vectors: Floats) -> Floats:
    """Return ``vectors`` (n, channels, d) at ``feet`` projected on the tangent spaces there."""
    n, channels, dim = vectors.shape
    each: Ints = np.repeat(np.arange(n), channels)
    surface = reader.tables.layout.surface
    tangential = project_tangent(surface, feet.take(each), vectors.reshape(-1, dim), 0.5 * reader.spacing)
    return tangential.reshape(n, channels, dim)


@dataclass(frozen=True, eq=False)
class Bends(Rows):
    """Pairs of a point of a batch and a bend near the point.

    A bend is a boundary or edge with a Dirichlet condition, where the second derivatives of the interpolant jump.
    """

    rows: Ints  #: (k,): numbers of the points in the batch.
    distance: Floats  #: (k,): distances of the points from the bends.
    inward: Floats  #: (k, d): unit vectors from the bend to the point's side.


def _boundary_bends(reader: Reader, side_views: Sequence[SideView]) -> list[Bends]:
    """Return for each boundary the pairs of this bend and the points near it on a side with a Dirichlet condition.

    A bend is a jump of second derivatives, see :class:`Bends`; ``side_views`` has the points near each boundary.
    """
    bends = []
    for boundary, view in zip(reader.scene.boundaries, side_views, strict=True):
        on_left = view.signed >= 0
        has_value = [isinstance(boundary.condition(side).law, Value) for side in SIDES]
        rows = np.flatnonzero(~np.isnan(view.signed) & ~view.end & np.where(on_left, *has_value))
        inward = np.where(on_left, 1.0, -1.0)[rows, None] * view.conormal[rows]
        bends.append(Bends(view.rows[rows], np.abs(view.signed[rows]), inward))
    return bends


def _edge_bends(reader: Reader, feet: ClosestPoints) -> Bends:
    """Return the pairs of an edge with a Dirichlet condition and a point whose stencil has a node past that edge.

    The edge is replaced by its tangent at the closest point of a node past it: the one nearest to the point read. The
    distance is that of the point from this tangent, along the conormal.
    """
    layout = reader.tables.layout
    band, nothing = layout.band, Bends(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, feet.points.shape[1])))
    loops = np.unique(band.feet.edge[band.feet.edge >= 0])
    with_value = [loop for loop in loops if isinstance(edge_condition(reader.scene.edge, int(loop)).law, Value)]
    if not with_value:
        return nothing
    nodes = stencil_nodes(band, stencil_cells(feet.points, band.spacing, band.degree)[0])
    past = np.isin(band.feet.edge[nodes], with_value)
    rows = np.flatnonzero(past.any(axis=1))
    if not len(rows):
        return nothing
    away = np.linalg.norm(band.feet.points[nodes[rows]] - feet.points[rows, None], axis=2)
    nearest = np.where(past[rows], away, np.inf).argmin(axis=1)
    edge = band.feet.take(nodes[rows, nearest])
    outward = outward_conormals(layout.surface, edge, 0.5 * band.spacing)
    distance = np.maximum(dots(edge.points - feet.points[rows], outward), 0.0)
    return Bends(rows, distance, -outward)


def _extrapolation_samples(
    reader: Reader, feet: ClosestPoints, side_views: Sequence[SideView], bends: Bends, sides: Mapping[int, Side]
) -> tuple[Ints, ClosestPoints, Floats]:
    """Return the samples from which gradients at ``feet`` near bends (jumps of second derivatives) are extrapolated.

    Returned ``rows`` (k,): points of the batch all of whose samples may be used.
    Returned ``samples``: k s closest points, the s samples of the first point first, the nearest to the bend first.
    Returned ``weights`` (k, s): weights of the samples.
    """
    distances = np.array(CONTINUATION_DISTANCES_SPACINGS) * reader.spacing
    offsets = (distances - bends.distance[:, None])[:, :, None] * bends.inward[:, None]
    targets = (feet.points[bends.rows][:, None] + offsets).reshape(-1, feet.points.shape[1])
    samples = reader.tables.layout.surface.closest_point(targets)
    usable = _usable_samples(reader, samples, side_views, np.repeat(bends.rows, len(distances)), sides)
    has_room = usable.reshape(-1, len(distances)).all(axis=1)
    nodes = np.tile(distances, (int(has_room.sum()), 1))
    weights = extrapolation_weights(nodes, bends.distance[has_room])
    return bends.rows[has_room], samples.take(np.repeat(has_room, len(distances))), weights


def _usable_samples(
    reader: Reader, samples: ClosestPoints, side_views: Sequence[SideView], rows: Ints, sides: Mapping[int, Side]
) -> Bools:
    """Return whether (m,) each sample is off edges, far from bends, and on the sides of its point in ``rows`` (m,)."""
    usable: Bools = samples.edge < 0
    sample_views = reader.side_views(samples.points, sides)
    for at_point, at_sample in zip(side_views, sample_views, strict=True):
        position = np.searchsorted(at_point.rows, rows[at_sample.rows])
        known = position < len(at_point.rows)
        known[known] = at_point.rows[position[known]] == rows[at_sample.rows[known]]
        opposite = dots(at_point.director[position[known]], at_sample.director[known]) < 0
        usable[at_sample.rows[known][opposite]] = False
    nearest = np.full(len(samples), np.inf)
    for bends in (*_boundary_bends(reader, sample_views), _edge_bends(reader, samples)):
        np.minimum.at(nearest, bends.rows, bends.distance)
    return usable & (nearest > (1 - INSIDE_SLACK_SHARE) * CONTINUATION_DISTANCES_SPACINGS[0] * reader.spacing)
