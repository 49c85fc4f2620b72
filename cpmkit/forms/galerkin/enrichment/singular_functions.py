"""Singular functions at tips, the ends of boundaries: powers of the distance times a wave of the angle.

    psi = (1 - r^2 / R^2)^3 r^|k| sin(k t + p),   R the radius of the disc around the tip.

With zero flux on both sides k = 1/2 and p = 0, with values on both k = 1/2 and p = pi/2; with a value on one side alone
|k| = 1/4 and 3/4, and psi vanishes on that side. These are the terms of u at a tip that have unbounded gradients.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cpmkit.errors import place
from cpmkit.forms.galerkin.conditions.boundary_samples import BoundarySamples
from cpmkit.forms.galerkin.conditions.imposed_conditions import ImposedCondition, conditions_with_law
from cpmkit.forms.galerkin.solution_warnings import ends_inside
from cpmkit.grid.lattice import Lattice, find_codes
from cpmkit.manifold.vector_algebra import norms, unit
from cpmkit.mesh.mesh import Mesh
from cpmkit.runtime.index_sets import connected_components
from cpmkit.scene.junction import JunctionLaw
from cpmkit.scene.laws import Interface, Value
from cpmkit.types import Bools, Floats, Ints

#: A disc ends where normals differ from that at the tip by more than 37 degrees (a cosine below the first number). Only
#: triangles count that are higher than the second number times their longest edge, and farther from the tip than so
#: many spacings.
LEAST_COSINE, FLAT_TRIANGLE_SHARE, AT_TIP_SPACINGS = 0.8, 0.05, 0.1
#: A disc ends where the boundary deviates from its parabola by more than this share of the distance from the tip. The
#: parabola is fitted to the boundary within so many spacings of the tip.
PARABOLA_SHARE, PARABOLA_SPACINGS = 0.2, 2.0
#: The radius of a disc as a share of the distance at which it ends.
RADIUS_SHARE = 0.9


@dataclass(frozen=True, eq=False)
class TipDisc:
    """A disc around a tip, with tangential coordinates X and Y; the boundary is ``Y = curvature X^2 / 2``, X < 0."""

    origin: Floats  #: (d,): the tip.
    #: heading, leftward (d,): orthonormal, tangent to the surface: the axes of X and Y.
    heading: Floats
    leftward: Floats
    curvature: float  #: The boundary's curvature at the tip.
    radius: float  #: Radius R of the disc; zero before it is known.
    cells: Ints  #: (k,): the cells of the mesh in the disc, ascending.
    #: (k,): the side of each cell: behind the tip 1 left of the boundary and -1 right of it, ahead of the tip 0.
    sides: Ints

    def coordinates(self, points: Floats) -> tuple[Floats, Floats]:
        """Return X, and Y less that of the parabola, of ``points`` (..., d): coordinates with a straight boundary."""
        apart = points - self.origin
        x = apart @ self.heading
        return x, apart @ self.leftward - 0.5 * self.curvature * x**2

    def distance(self, points: Floats) -> Floats:
        """Return the distance r (...) of ``points`` (..., d) from the tip, in the plane of :meth:`coordinates`."""
        return np.hypot(*self.coordinates(points))

    def polar_coordinates(self, points: Floats, sides: Ints) -> tuple[Floats, Floats]:
        """Return r and t (k,) of ``points`` (k, d) in cells on the ``sides`` (k,) of the boundary.

        t runs from -pi on the right of the boundary over 0 beyond the tip to pi on its left. ``sides`` are 1 on the
        left, -1 on the right and 0 ahead of the tip. A point across the boundary keeps the side of its cell, so that
        the size of t may exceed pi.
        """
        x, y = self.coordinates(points)
        t = np.arctan2(y, x)
        t = np.where((sides > 0) & (t < -0.5 * np.pi), t + 2 * np.pi, t)
        return np.hypot(x, y), np.where((sides < 0) & (t > 0.5 * np.pi), t - 2 * np.pi, t)

    def side_of(self, cells: Ints) -> tuple[Bools, Ints]:
        """Return whether each of the ``cells`` (q,) is in the disc, and its side (q,), 0 outside the disc."""
        at = find_codes(self.cells, cells)
        return at >= 0, np.append(self.sides, 0)[at]


@dataclass(frozen=True, eq=False)
class TipDiscFinder:
    """Search for discs around the tips of boundaries in a mesh."""

    mesh: Mesh  #: A mesh of triangles, cut along the boundaries.
    spacing: float  #: Spacing h of the lattice.

    @cached_property
    def _owner(self) -> Ints:
        """(e,) the boundary that each edge lies on; -1 for edges on no boundary and beyond tips."""
        owner, on_cut = np.full(len(self.mesh.edges.ends), -1), self.mesh.cut_edges
        own = ~self.mesh.beyond_tip & (on_cut >= 0)
        owner[on_cut[own]] = self.mesh.owner[own]
        return owner

    def find_disc(self, tip: int, boundary: int) -> TipDisc:
        """Return the disc around the vertex ``tip``, an end of boundary number ``boundary``; it may be very small."""
        frame = self._axes_at_tip(tip, boundary)
        cells = np.flatnonzero(~self._is_tilted(frame))
        piece = self._pieces(cells)
        cells = cells[np.isin(piece, piece[(self.mesh.cells[cells] == tip).any(axis=1)])]
        edges, count = np.unique(self.mesh.edges.of_cells[cells], return_counts=True)
        owner = self._owner[edges]  # edges on the boundary of the tip itself do not end the disc
        ends = self.mesh.edges.ends[edges[(owner != boundary) & ((count == 1) | (owner >= 0))]]
        nearest = float(frame.distance(self.mesh.vertices[ends.ravel()]).min(initial=np.inf))
        radius = RADIUS_SHARE * min(nearest, self._boundary_end_distance(frame, boundary, tip))
        inside = np.sort(cells[frame.distance(self.mesh.vertices[self.mesh.cells[cells]]).min(axis=1) < radius])
        return replace(frame, radius=radius, cells=inside, sides=self._sides(frame, inside))

    def _normal(self, tip: int) -> Floats:
        """Return the normal (d,) of the surface at a tip, of either sign, from a plane fitted to the cells nearby."""
        mesh = self.mesh
        near = (norms(mesh.vertices[mesh.cells] - mesh.vertices[tip]) < AT_TIP_SPACINGS * self.spacing).all(axis=1)
        near |= (mesh.cells == tip).any(axis=1)
        corners = mesh.vertices[mesh.cells[near]]
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return np.asarray(np.linalg.eigh(areas.T @ areas)[1][:, -1])

    def _axes_at_tip(self, tip: int, boundary: int) -> TipDisc:
        """Return a disc of radius 0 without cells, with axes and curvature of a cubic fitted to the boundary nearby."""
        mesh, normal = self.mesh, self._normal(tip)
        own = mesh.owner == boundary
        behind = mesh.vertices[np.unique(mesh.cut[own & ~mesh.beyond_tip])] - mesh.vertices[tip]
        return axes_at_tip(mesh.vertices[tip], behind, self.spacing, lambda heading: np.cross(normal, heading))

    def _is_tilted(self, frame: TipDisc) -> Bools:
        """Return whether (m,) each cell is tilted against a tip's tangent plane; False for slivers and at the tip."""
        corners = self.mesh.vertices[self.mesh.cells]
        doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        longest = norms(corners - corners[:, [1, 2, 0]]).max(axis=1)
        clear = norms(doubled) > FLAT_TRIANGLE_SHARE * longest**2
        clear &= norms(corners - frame.origin).max(axis=1) > AT_TIP_SPACINGS * self.spacing
        cosine = unit(doubled) @ np.cross(frame.heading, frame.leftward)
        return np.asarray(clear & (np.abs(cosine) < LEAST_COSINE))

    def _pieces(self, cells: Ints) -> Ints:
        """Return the connected component (k,) of each of the ``cells`` (k,); edges on boundaries do not connect."""
        edges = self.mesh.edges.of_cells[cells]
        row, column = np.nonzero(self._owner[edges] < 0)
        pairs = np.stack([row, len(cells) + edges[row, column]], axis=1)
        return connected_components(len(cells) + len(self.mesh.edges.ends), pairs)[1][: len(cells)]

    def _boundary_end_distance(self, frame: TipDisc, boundary: int, tip: int) -> float:
        """Return the distance from a tip at which its boundary ends, turns back, or leaves its parabola; else inf."""
        own = self.mesh.cut[(self.mesh.owner == boundary) & ~self.mesh.beyond_tip]
        vertices, count = np.unique(own, return_counts=True)
        x, y = frame.coordinates(self.mesh.vertices[vertices])
        distance = np.hypot(x, y)
        off = (count != 2) | (x > 0) | (np.abs(y) > PARABOLA_SHARE * distance)
        off &= (vertices != tip) & ((count != 2) | (distance > AT_TIP_SPACINGS * self.spacing))
        return float(distance[off].min(initial=np.inf))

    def _sides(self, frame: TipDisc, cells: Ints) -> Ints:
        """Return the side (k,) of each of the ``cells`` (k,): 1 left of the boundary, -1 right, 0 ahead of the tip.

        Each connected component behind the tip has the side on which most of its cells lie, 0 for equally many.
        """
        x, y = frame.coordinates(self.mesh.vertices[self.mesh.cells[cells]].mean(axis=1))
        behind, sides = np.flatnonzero(x < 0), np.zeros(len(cells), dtype=np.int64)
        piece = self._pieces(cells[behind])
        votes = np.bincount(piece, np.sign(y[behind]), minlength=int(piece.max(initial=-1)) + 1)
        sides[behind] = np.sign(votes)[piece]
        return sides


def axes_at_tip(origin: Floats, behind: Floats, spacing: float, turn: Callable[[Floats], Floats]) -> TipDisc:
    """Return a disc of radius 0 without cells around a tip ``origin`` (d,), with the boundary's axes and curvature.

    They are those of a cubic fitted to the points of the boundary at ``behind`` (k, d) from the tip that are near it.
    ``turn`` turns a vector (d,) by 90 degrees to the left in the tangent plane, and drops its part along the normal.
    """
    distance, none = norms(behind), np.zeros(0, dtype=np.int64)
    behind = behind[(distance > 0) & (distance < PARABOLA_SPACINGS * spacing)]
    heading = -unit(turn(turn(-behind.mean(axis=0)))[None])[0]
    for _ in range(2):
        x, y = behind @ heading, behind @ turn(heading)
        powers = np.stack([x, x**2, x**3], axis=1)[:, : max(len(behind), 1)] / spacing ** np.arange(1, 4)
        slope, curvature = np.append(np.linalg.lstsq(powers, y, rcond=None)[0], [0.0, 0.0])[:2]
        heading = unit((heading + slope / spacing * turn(heading))[None])[0]
    return TipDisc(origin, heading, turn(heading), 2 * curvature / spacing**2, 0.0, none, none)


#: Frequency k and phase p of the functions of a tip, by whether a value is given on the left and on the right.
WAVES: dict[tuple[bool, bool], tuple[tuple[float, float], ...]] = {
    (False, False): ((0.5, 0.0),),
    (True, True): ((0.5, 0.5 * np.pi),),
    (True, False): ((-0.25, 0.25 * np.pi), (-0.75, 0.75 * np.pi)),
    (False, True): ((0.25, 0.25 * np.pi), (0.75, 0.75 * np.pi)),
}
#: Nearer to a tip than this share of its disc's radius the gradient at that distance is used.
LEAST_DISTANCE_SHARE = 1e-9
#: Least radius of a disc in spacings: a smaller disc has too few splines to distinguish psi from these.
LEAST_RADIUS_SPACINGS = 1.0
#: Kinds of condition on a side at a tip: the flux is given, the value is given, or u and its flux are continuous.
FLUX, VALUE, THROUGH = range(3)


@dataclass(frozen=True, eq=False)
class SingularFunction:
    """A singular function psi of a tip."""

    disc: TipDisc  #: The support of psi.
    #: frequency, phase: The frequency k and the phase p.
    frequency: float
    phase: float

    def values(self, points: Floats, cells: Ints) -> tuple[Ints, Floats]:
        """Return the numbers (k,) of the ``points`` (q, d) inside the disc, and the values (k,) of psi there.

        The points, relative to the lattice's origin, lie in the mesh ``cells`` (q,).
        """
        rows, r, t = self._polar(points, cells)
        bump = (1 - (r / self.disc.radius) ** 2) ** 3
        return rows, bump * r ** abs(self.frequency) * np.sin(self.frequency * t + self.phase)

    def slopes(self, points: Floats, cells: Ints) -> tuple[Ints, Floats]:
        """Return the numbers (k,) of the ``points`` (q, d) inside the disc, and the gradients (k, d) of psi there.

        The points, relative to the lattice's origin, lie in ``cells`` (q,); psi is constant along normals.
        """
        disc, power = self.disc, abs(self.frequency)
        rows, r, t = self._polar(points, cells)
        r = np.maximum(r, LEAST_DISTANCE_SHARE * disc.radius)
        rest, angle = 1 - (r / disc.radius) ** 2, self.frequency * t + self.phase
        along = (power * rest - 6 * (r / disc.radius) ** 2) * rest**2 * r ** (power - 1) * np.sin(angle)
        around = rest**3 * r ** (power - 1) * self.frequency * np.cos(angle)
        by_x = along * np.cos(t) - around * np.sin(t)
        by_y = along * np.sin(t) + around * np.cos(t)
        x = disc.coordinates(points[rows])[0]
        by_x = by_x - disc.curvature * x * by_y
        return rows, by_x[:, None] * disc.heading + by_y[:, None] * disc.leftward

    def _polar(self, points: Floats, cells: Ints) -> tuple[Ints, Floats, Floats]:
        """Return the numbers (k,) of the ``points`` (q, d) inside the disc, and their coordinates r and t (k,)."""
        inside, sides = self.disc.side_of(cells)
        rows = np.flatnonzero(inside)
        r, t = self.disc.polar_coordinates(points[rows], sides[rows])
        near = r < self.disc.radius
        return rows[near], r[near], t[near]


def singular_functions(
    mesh: Mesh, boundary: BoundarySamples, conditions: Sequence[ImposedCondition], lattice: Lattice
) -> tuple[tuple[SingularFunction, ...], tuple[str, ...]]:
    """Return the singular functions of all tips of a cut mesh, and a warning if no disc fits around some of them.

    ``boundary`` are the samples that ``conditions`` refer to. Tips with a condition of the kind THROUGH have none.
    """
    finder = TipDiscFinder(mesh, lattice.spacing)
    tips = [(number, tip) for number in np.unique(mesh.owner).tolist() for tip in ends_inside(mesh, number).tolist()]
    discs = [(number, finder.find_disc(tip, number)) for number, tip in tips]
    return functions_in_discs(discs, boundary, conditions, lattice)


def functions_in_discs(
    discs: Sequence[tuple[int, TipDisc]],
    boundary: BoundarySamples,
    conditions: Sequence[ImposedCondition],
    lattice: Lattice,
) -> tuple[tuple[SingularFunction, ...], tuple[str, ...]]:
    """Return the singular functions in ``discs``, each with the number of its boundary, as :func:`singular_functions`.

    Discs with a radius below a spacing have none.
    """
    kinds = _kinds(boundary, conditions)
    functions: list[SingularFunction] = []
    narrow = []
    for number, disc in discs:
        if disc.radius < LEAST_RADIUS_SPACINGS * lattice.spacing:
            narrow.append(disc)
            continue
        sides = np.where((boundary.owner == number) & ~boundary.beyond_tip, disc.side_of(boundary.cell)[1], 0)
        left, right = (np.bincount(kinds[sides == side], minlength=1).argmax() for side in (1, -1))  # the most frequent
        if THROUGH not in (left, right):
            functions += [SingularFunction(disc, *wave) for wave in WAVES[left == VALUE, right == VALUE]]
    return tuple(functions), tuple(_narrow_disc_warnings(narrow, lattice))


def _kinds(boundary: BoundarySamples, conditions: Sequence[ImposedCondition]) -> Ints:
    """Return the kind of condition (b,) at samples: FLUX, VALUE, or THROUGH for a coupling without resistance.

    Where a member of lower dimension ends in another one, u behaves as beside a value, but with a resistance as beside
    a flux.
    """
    kinds = np.full(len(boundary), FLUX)
    for condition in conditions_with_law(conditions, Value, JunctionLaw):
        kinds[condition.all_rows] = FLUX if getattr(condition.law, "resistance", 0.0) else VALUE
    for condition in conditions_with_law(conditions, Interface):
        if condition.law.resistance == 0:
            kinds[condition.all_rows] = THROUGH
    return kinds


def _narrow_disc_warnings(narrow: Sequence[TipDisc], lattice: Lattice) -> Iterator[str]:
    """Yield a warning if there are tips whose discs are too small for a singular function."""
    if narrow:
        disc, count = narrow[0], len(narrow)
        where = place(lattice.to_scene(disc.origin[None])[0])
        yield (
            f"{count} end{'s' * (count > 1)} of boundaries, near {where}{' and elsewhere' * (count > 1)}, have no "
            f"singular unknown: within {disc.radius:.2g} of it, less than a spacing, {lattice.spacing:.2g}, the "
            "boundary bends, the surface turns, or another boundary or the rim is met; take a smaller spacing."
        )
