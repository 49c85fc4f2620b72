"""The left side of a boundary, determined once per scene from samples of the boundary, without a lattice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from cpmkit.grid.lattice import cell_levels
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.orientation import AS_GIVEN, Orientation, propagate_signs
from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.tangent_space import left_conormals, tangents_and_corners, unit_tangents
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.types import Bools, Floats, Ints

#: Least cosine between the left direction and the chord to a point for that point to determine the left of a piece.
MIN_CHORD_COSINE = 1e-3


@dataclass(frozen=True, eq=False)
class Left:
    """The left side of a boundary."""

    signs: Orientation  #: The conormals to the left at samples of the boundary.
    #: How left is determined: by the sources, by the point ``left_of``, by a rule; or "nothing", if there is no left
    #: side, as on a Moebius strip.
    named_by: Literal["source", "left_of", "rule", "nothing"]
    origin: Floats  #: (d,): origin of the points of the orientation, in the scene's coordinates.
    #: (2, d): where a rule determines the left, a point on the left and one on the right, in the scene's coordinates.
    side_points: Floats | None = None
    queries: tuple[int, int] = (0, 0)  #: Numbers of closest-point queries of the manifold and of the boundary.
    #: True if the point ``left_of`` is on the right according to the directions that the sources provide.
    contradicts_left_of: bool = False

    @property
    def known(self) -> bool:
        """True if the signs are consistent along the whole boundary, so that it has a left side."""
        return self.named_by != "nothing"


@dataclass(frozen=True, eq=False)
class SampledBoundary:
    """A boundary, or a member of a union of sources, sampled with conormals whose signs agree between neighbours."""

    #: source, surface: The closest-point sources of the boundary and of the manifold.
    source: LocalSource
    surface: LocalSource
    #: samples, on_surface: The s samples of the boundary, and their closest points on the manifold.
    samples: ClosestPoints
    on_surface: ClosestPoints
    left: Floats  #: (s, d): unit conormals at the samples.
    piece: Ints  #: (s,): number of the connected piece of each sample.
    is_own: Bools  #: (s,): where the sources provide all directions, and so the left side.
    consistent: bool  #: False if left and right exchange along some closed path, as on a Moebius strip.
    spacing: float  #: Distance between the samples.

    @classmethod
    def sample(cls, source: LocalSource, surface: LocalSource, dimension: int) -> SampledBoundary:
        """Return ``source`` sampled at the first density that determines the signs of its conormals, or at the highest.

        ``dimension`` is that of the manifold ``surface``. Samples at corners of a curve in a surface are left out,
        unless all are corners. Conormals that the sources provide determine the signs; others are differences over half
        the spacing.
        """
        for samples, spacing in samplings(source, surface):
            tangents = None
            if dimension == 2:
                tangents, corner = tangents_and_corners(source, samples, 0.5 * spacing)
                if not corner.all():
                    samples, tangents = samples.take(~corner), tangents[~corner]
            on_surface = surface.closest_point(samples.points)
            left = left_conormals(source, surface, AS_GIVEN, on_surface, samples, 0.5 * spacing)
            is_own = np.full(len(samples), dimension == surface.dim)
            for member, rows, _ in surface.feet_by_member(on_surface):
                is_own[rows] |= member.knows_directions(dimension)
            is_own &= dimension == 1 or source.knows_directions(dimension - 1)
            agreeing, piece, consistent, sure = propagate_signs(on_surface.points, left, tangents, spacing)
            for number in range(piece.max() + 1):
                mask = piece == number
                if np.sum(agreeing[mask & is_own] * left[mask & is_own]) < 0:
                    agreeing[mask] *= -1
            part = cls(source, surface, samples, on_surface, agreeing, piece, is_own, consistent, spacing)
            if sure:
                break
        return part

    @property
    def signs(self) -> Orientation:
        """The unit conormals to the left at the samples, as an ``Orientation``, which gives the signs of others."""
        return Orientation(self.on_surface.points, self.left, self.spacing)

    def with_left_chosen(self, left_of: Floats | None) -> tuple[SampledBoundary, set[str]]:
        """Return the boundary with the left of each connected piece chosen, and a subset of {"left_of", "rule"}.

        If the sources do not provide it, left is the side of the point ``left_of`` (d,), relative to the origin of the
        sources; if that is None or on neither side of a piece, a rule decides. The subset names the choices made.
        """
        sign = np.ones(len(self.samples))
        named: set[str] = set()
        pieces = [self.piece == number for number in range(self.piece.max() + 1)]
        cosines = np.zeros(len(pieces)) if left_of is None else self._chord_cosines(left_of, pieces)
        for mask, cosine in zip(pieces, cosines, strict=True):
            if self.is_own[mask].any():
                continue
            by_point = abs(cosine) > MIN_CHORD_COSINE
            named.add("left_of" if by_point else "rule")
            sign[mask] = np.sign(cosine) if by_point else self._sign_by_rule(mask)
        return replace(self, left=self.left * sign[:, None]), named

    def _sign_by_rule(self, mask: Bools) -> float:
        """Return the factor, 1 or -1, that gives the piece with samples ``mask`` (s,) its conventional left.

        The rule does not depend on the lattice. Curves in space with a direction of travel have the manifold's normals
        point away from its centre; otherwise the left of a curve is inside, that of a surface outside. Where this is
        undecided, the largest component of the mean conormal, or else of the conormal at the first sample in
        lexicographic order, is positive; of a point on a curve it is negative, and left is where the curve comes from.
        """
        left, on_surface, points = self.left[mask], self.on_surface.points[mask], self.samples.points[mask]
        if self.source.manifold_dim == 1 and self.surface.dim == 3 and self.source.knows_directions(1):
            away = on_surface - self.surface.bounds.mean(axis=0)
            outward = np.cross(unit_tangents(self.source, self.samples.take(mask), 0.5 * self.spacing), left)
        else:
            away = points - self.source.bounds.mean(axis=0)
            outward = left if self.source.manifold_dim == 2 else -left
        size = float(norms(away).max()) or 1.0
        positive = left if self.source.manifold_dim else -left
        moments = [np.array([dots(away, outward).mean() / size]), positive.mean(axis=0)]
        decided = next((moment for moment in moments if np.abs(moment).max() > 0.05), positive[np.lexsort(points.T)[0]])
        return -1.0 if decided[np.argmax(np.abs(decided))] < 0 else 1.0

    def _chord_cosines(self, point: Floats, pieces: Sequence[Bools]) -> Floats:
        """Return for each of ``pieces`` (masks of samples) the cosine between left and the chord to ``point`` (d,).

        The result is (pieces,). A chord leads from the sample of the piece that is nearest to the projection of
        ``point`` to the manifold, on the nearest piece from the closest point, to the projection.
        """
        goal = self.surface.closest_point(point[None]).points[0]
        distance = norms(self.on_surface.points - goal)
        nearest = np.array([np.flatnonzero(mask)[distance[mask].argmin()] for mask in pieces])
        foot = self.source.closest_point(goal[None])
        piece = self.piece[norms(self.samples.points - foot.points[0]).argmin()]
        feet = self.samples.take(nearest).replace_rows(np.array([piece]), foot)
        on_surface = self.surface.closest_point(feet.points)
        left = left_conormals(self.source, self.surface, self.signs, on_surface, feet, 0.5 * self.spacing)
        return dots(unit(goal - on_surface.points), left)

    def side_points(self) -> Floats:
        """Return a point of the manifold left and one right, (2, d), of a sample, a tenth of the boundary's size away.

        The points are relative to the origin of the sources. The size of a single point is ``spacing``.
        """
        middle = len(self.samples) // 2
        size = float(np.ptp(self.source.bounds, axis=0).max()) or self.spacing
        steps = 0.1 * size * np.array([[1.0], [-1.0]]) * self.left[middle]
        return self.surface.closest_point(self.on_surface.points[middle] + steps).points


def samplings(source: LocalSource, surface: LocalSource) -> Iterator[tuple[ClosestPoints, float]]:
    """Yield samples of the ``source`` of a boundary and their spacing, from coarse to dense; a single point once.

    Neighbours are at most about a spacing apart; for a single point the spacing is 1/64 of the size of ``surface``.
    """
    size = float(np.ptp(source.bounds, axis=0).max())
    if not size > 0:  # a single point
        yield source.closest_point(source.bounds.mean(axis=0)[None]), float(np.ptp(surface.bounds, axis=0).max()) / 64
        return
    for count in ((32,), (32, 64, 128, 256, 512), (16, 32, 64))[source.manifold_dim or 0]:  # along the largest side
        spacing = size / count
        cells = next(blocks for side, blocks in cell_levels(source, spacing, 0.5) if side == 1)
        points = source.closest_point(np.asarray(cells * spacing, dtype=np.float64)).points
        cells_of_points = np.round(points / (0.25 * spacing))  # one sample in each cell of a quarter of the spacing
        _, rows = np.unique(cells_of_points, axis=0, return_index=True)
        yield source.closest_point(points[np.sort(rows)]), spacing
