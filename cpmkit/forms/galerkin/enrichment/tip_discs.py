"""The disc around a tip, the support of its singular functions: cells, polar coordinates, and sides."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cpmkit.grid.lattice import find_codes
from cpmkit.manifold.vector_algebra import norms, unit
from cpmkit.mesh.mesh import Edges, Mesh
from cpmkit.types import Bools, Floats, Ints

#: The disc ends where the cosine of the angle between the normals there and at the tip is below this: at 37 degrees.
#: Normals are those of triangles with a height above the first share of their longest edge, and so many spacings from
#: the tip.
LEAST_COSINE, FLAT_TRIANGLE_SHARE, AT_TIP_SPACINGS = 0.8, 0.05, 0.1
#: The disc ends where the boundary deviates from its parabola by more than this share of the distance from the tip. The
#: parabola is fitted to the boundary within so many spacings of the tip.
PARABOLA_SHARE, PARABOLA_SPACINGS = 0.2, 2.0
#: The radius of a disc as a share of the distance at which it ends.
RADIUS_SHARE = 0.9


@dataclass(frozen=True, eq=False)
class TipDisc:
    """A disc around a tip; X points beyond the tip, and the boundary is ``Y = curvature X^2 / 2`` where X < 0.

    Attributes
    ----------
    origin : (d,) float64
        The tip.
    heading, leftward : (d,) float64
        Orthonormal, tangent to the surface: the axes of X and Y.
    curvature : float
        The boundary's curvature at the tip.
    radius : float
        Radius R of the disc; zero where no disc fits.
    cells : (k,) int64
        The cells of the mesh in the disc, ascending.
    sides : (k,) int64
        The side of each cell: behind the tip 1 to the left of the boundary and -1 to its right, ahead of the tip 0.
    """

    origin: Floats
    heading: Floats
    leftward: Floats
    geometry: float
    radius: float
    cells: Ints
    sides: Ints

    def plane(self, points: Floats) -> tuple[Floats, Floats]:
        """Return X, and Y less that of the parabola, of ``points`` (..., d): coordinates with a straight boundary."""
        apart = points - self.origin
        x = apart @ self.heading
        return x, apart @ self.leftward - 0.5 * self.geometry * x**2

    def distance(self, points: Floats) -> Floats:
        """Return the distance r (...) of ``points`` (..., d) from the tip, in the coordinates of :meth:`plane`."""
        return np.hypot(*self.plane(points))

    def polar(self, points: Floats, sides: Ints) -> tuple[Floats, Floats]:
        """Return r and t (k,) of ``points`` (k, d) in cells on the ``sides`` (k,) of the boundary.

        t runs from -pi on the right of the boundary over 0 beyond the tip to pi on its left.
        """
        x, y = self.plane(points)
        t = np.arctan2(y, x)
        t = np.where((sides > 0) & (t < -0.5 * np.pi), t + 2 * np.pi, t)
        return np.hypot(x, y), np.where((sides < 0) & (t > 0.5 * np.pi), t - 2 * np.pi, t)

    def side_of(self, cells: Ints) -> tuple[Bools, Ints]:
        """Return whether each of the ``cells`` (q,) is in the disc, and its side (q,), 0 outside the disc."""
        at = find_codes(self.cells, cells)
        return at >= 0, np.append(self.sides, 0)[at]


@dataclass(frozen=True, eq=False)
class TipDiscFinder:
    """Search for discs around the tips of boundaries in a mesh.

    Attributes
    ----------
    mesh : Mesh
        A mesh of triangles, cut along the boundaries.
    spacing : float
        Spacing h of the lattice.
    """

    mesh: Mesh
    spacing: float

    @cached_property
    def _edges(self) -> Edges:
        """The edges of the mesh."""
        return self.mesh.edges

    @cached_property
    def _owner(self) -> Ints:
        """(e,) the boundary that each edge lies on; -1 for edges on no boundary and beyond tips."""
        owner, on_cut = np.full(len(self._edges.ends), -1), self.mesh.cut_edges
        own = ~self.mesh.beyond_tip & (on_cut >= 0)
        owner[on_cut[own]] = self.mesh.owner[own]
        return owner

    def around(self, tip: int, boundary: int) -> TipDisc:
        """Return the disc around the vertex ``tip``, an end of the boundary number ``boundary``."""
        frame = self._frame(tip, boundary)
        cells = self._connected(np.flatnonzero(~self._is_tilted(frame)), tip)
        ends = self._nearest_end(frame, cells, boundary), self._boundary_end(frame, boundary, tip)
        radius = RADIUS_SHARE * min(ends)
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

    def _frame(self, tip: int, boundary: int) -> TipDisc:
        """Return a disc of radius zero, with axes and curvature from a cubic fitted to the boundary near the tip."""
        mesh, none, normal = self.mesh, np.zeros(0, dtype=np.int64), self._normal(tip)
        origin, own = mesh.vertices[tip], mesh.owner == boundary
        behind = self._near(mesh.cut[own & ~mesh.beyond_tip], origin)
        guess = -behind.mean(axis=0)
        heading = unit((guess - (guess @ normal) * normal)[None])[0]
        for _ in range(2):
            x, y = behind @ heading, behind @ np.cross(normal, heading)
            powers = np.stack([x, x**2, x**3], axis=1)[:, : max(len(behind), 1)] / self.spacing ** np.arange(1, 4)
            slope, curvature = np.append(np.linalg.lstsq(powers, y, rcond=None)[0], [0.0, 0.0])[:2]
            heading = unit((heading + slope / self.spacing * np.cross(normal, heading))[None])[0]
        return TipDisc(origin, heading, np.cross(normal, heading), 2 * curvature / self.spacing**2, 0.0, none, none)

    def _is_tilted(self, frame: TipDisc) -> Bools:
        """Return (m,) whether each cell is tilted against the tangent plane of a tip; slivers never are."""
        corners = self.mesh.vertices[self.mesh.cells]
        doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        longest = norms(corners - corners[:, [1, 2, 0]]).max(axis=1)
        clear = norms(doubled) > FLAT_TRIANGLE_SHARE * longest**2
        clear &= norms(corners - frame.origin).max(axis=1) > AT_TIP_SPACINGS * self.spacing
        cosine = unit(doubled) @ np.cross(frame.heading, frame.leftward)
        return np.asarray(clear & (np.abs(cosine) < LEAST_COSINE))

    def _near(self, edges: Ints, origin: Floats) -> Floats:
        """Return the positions (k, d), relative to a tip at ``origin``, of the vertices of ``edges`` (c, 2) near it."""
        apart = self.mesh.vertices[np.unique(edges)] - origin
        distance = norms(apart)
        return np.asarray(apart[(distance > 0) & (distance < PARABOLA_SPACINGS * self.spacing)])

    def _connected(self, cells: Ints, tip: int) -> Ints:
        """Return the ``cells`` that are connected to a tip across edges that lie on no boundary."""
        label = self._pieces(cells)
        at_tip = np.unique(label[(self.mesh.cells[cells] == tip).any(axis=1)])
        return np.asarray(cells[np.isin(label, at_tip)])

    def _pieces(self, cells: Ints) -> Ints:
        """Return the connected component (k,) of each of the ``cells`` (k,); edges on boundaries do not connect."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        edges = self._edges.of_cells[cells]
        row, column = np.nonzero(self._owner[edges] < 0)
        graph = coo_array((np.ones(len(row)), (row, len(cells) + edges[row, column])), shape=2 * (self._size(cells),))
        return np.asarray(connected_components(graph, directed=False)[1][: len(cells)])

    def _size(self, cells: Ints) -> int:
        """Return the number of nodes of the graph of ``cells`` and all edges."""
        return len(cells) + len(self._edges.ends)

    def _nearest_end(self, frame: TipDisc, cells: Ints, boundary: int) -> float:
        """Return the distance from a tip to the nearest edge at which the region of ``cells`` ends.

        Edges on the boundary of the tip itself do not count.
        """
        edges, count = np.unique(self._edges.of_cells[cells], return_counts=True)
        owner = self._owner[edges]
        ends = edges[(owner != boundary) & ((count == 1) | (owner >= 0))]
        return float(frame.distance(self.mesh.vertices[self._edges.ends[ends].ravel()]).min(initial=np.inf))

    def _boundary_end(self, frame: TipDisc, boundary: int, tip: int) -> float:
        """Return the distance from a tip at which its boundary ends, turns back, or leaves its parabola."""
        own = self.mesh.cut[(self.mesh.owner == boundary) & ~self.mesh.beyond_tip]
        vertices, count = np.unique(own, return_counts=True)
        x, y = frame.plane(self.mesh.vertices[vertices])
        distance = np.hypot(x, y)
        off = (count != 2) | (x > 0) | (np.abs(y) > PARABOLA_SHARE * distance)
        off &= (vertices != tip) & ((count != 2) | (distance > AT_TIP_SPACINGS * self.spacing))
        return float(distance[off].min(initial=np.inf))

    def _sides(self, frame: TipDisc, cells: Ints) -> Ints:
        """Return the side (k,) of each of the ``cells``: 1 left of the boundary, -1 right of it, 0 ahead of the tip.

        Each connected component behind the tip has the side on which most of its cells lie.
        """
        x, y = frame.plane(self.mesh.vertices[self.mesh.cells[cells]].mean(axis=1))
        behind, sides = np.flatnonzero(x < 0), np.zeros(len(cells), dtype=np.int64)
        piece = self._pieces(cells[behind])
        votes = np.bincount(piece, np.sign(y[behind]), minlength=int(piece.max(initial=-1)) + 1)
        sides[behind] = np.sign(votes)[piece]
        return sides
