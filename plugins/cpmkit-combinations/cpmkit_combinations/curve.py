"""A traced curve: cubics between knots, as a closest point source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cpmkit.plugin import (
    Bools,
    ClosestPoints,
    Floats,
    InputError,
    Ints,
    as_points,
    as_vector,
    dots,
    norms,
    positive,
    source_repr,
    unit,
)
from cpmkit_combinations.cubics import Cubics
from cpmkit_combinations.tracing import Knots

#: Distance of :attr:`TracedCurve.left_of` from the curve, relative to the largest side of its bounds.
LEFT_OF_OFFSET_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class TracedCurve:
    """Smooth pieces of a curve, open or closed, with a left side.

    Attributes
    ----------
    pieces : sequence of Knots
        Relative to ``shift``.
    shift : (d,) float64
        Translation of all knots.
    """

    pieces: Sequence[Knots]
    shift: Floats

    manifold_dim = 1
    exact = True

    __repr__ = source_repr

    @property
    def dim(self) -> int:
        """Dimension of the space, 2 or 3."""
        return len(self.shift)

    @property
    def bounds(self) -> Floats:
        """(2, d) corners of a box around the curve, hardly larger than the smallest."""
        control = self._cubics.control.reshape(-1, self.dim)
        return np.stack([control.min(axis=0), control.max(axis=0)]) + self.shift

    @property
    def deviation(self) -> float:
        """The largest distance, in the unit of length, from the traced cut, measured in the middle between knots."""
        return max(piece.deviation for piece in self.pieces)

    @property
    def left_of(self) -> Floats:
        """(d,) a point to the left of the middle of the first piece, along the conormal to where phi is positive."""
        first = self.pieces[0]
        distance = LEFT_OF_OFFSET_SHARE * float(np.ptp(self.bounds, axis=0).max())
        middle = len(first.points) // 2
        return np.asarray(first.points[middle] + distance * first.conormals[middle] + self.shift)

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d).

        ``element`` is the cubic of the foot, ``local`` (n, 1) its parameter from 0 to 1, and ``edge`` 0 at the start of
        an open piece, 1 at its end, -1 elsewhere. Raise InputError if ``x`` does not have shape (n, d) or is not
        finite.
        """
        x = as_points(x, self.dim) - self.shift
        element, s = self._cubics.nearest(x)
        points = self._cubics.evaluate(element, s)
        starts, ends = self._ends
        edge = np.where(starts[element] & (s <= 0.0), 0, np.where(ends[element] & (s >= 1.0), 1, -1))
        distance = norms(x - points)
        return ClosestPoints(points + self.shift, distance, edge, element, s[:, None])

    def tangents(self, feet: ClosestPoints, /) -> Floats:
        """Return (n, d) unit tangents at closest points ``feet``, in the direction of travel."""
        return unit(self._cubics.slope(*_location(feet)))

    def leftward(self, feet: ClosestPoints, /) -> Floats:
        """Return (n, d) unit conormals at ``feet`` to the left of the curve, tangential to the surface around it."""
        element, s = _location(feet)
        start, end = self._conormals
        between = (1 - s)[:, None] * start[element] + s[:, None] * end[element]
        t = self.tangents(feet)
        return unit(between - dots(between, t)[:, None] * t)

    def piece(self, feet: ClosestPoints, /) -> Ints:
        """Return the number (n,), 0 that of the longest, of the piece that each foot lies on."""
        return self._cubics.piece[_location(feet)[0]]

    def mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return vertices (v, d) on the curve, all knots among them, and segments (m, 2) up to about ``spacing``."""
        parts = np.maximum(np.ceil(self._cubics.lengths / positive(spacing, "spacing")), 1).astype(np.int64)
        count = int(parts.sum())
        element = np.repeat(np.arange(len(parts)), parts)
        first = np.concatenate([[0], np.cumsum(parts)[:-1]])
        s = (np.arange(count) - first[element]) / parts[element]
        _, ends = self._ends
        last = np.flatnonzero(ends)
        points = np.concatenate([self._cubics.evaluate(element, s), self._cubics.evaluate(last, np.ones(len(last)))])
        # the last part of an open piece is followed by its end, that of a closed piece by its first vertex
        following = np.arange(1, count + 1)
        piece = self._cubics.piece
        final = np.flatnonzero(np.diff(piece, append=-1))
        begins = np.flatnonzero(np.diff(piece, prepend=-1))
        number = np.full(len(parts), -1)
        number[last] = count + np.arange(len(last))
        following[first[final] + parts[final] - 1] = np.where(ends[final], number[final], first[begins])
        return points + self.shift, np.stack([np.arange(count), following], axis=1)

    def translate(self, offset: Floats, /) -> TracedCurve:
        """Return the curve translated by ``offset`` (d,)."""
        return replace(self, shift=self.shift + as_vector(offset, self.dim, "offset"))

    @cached_property
    def _cubics(self) -> Cubics:
        parts = [piece.cubics() for piece in self.pieces]
        number = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
        return Cubics(np.concatenate(parts), number)

    @cached_property
    def _ends(self) -> tuple[Bools, Bools]:
        """Masks (m,) of the first and of the last cubics of open pieces."""
        piece = self._cubics.piece
        opened = np.array([not knots.closed for knots in self.pieces])[piece]
        return opened & (np.diff(piece, prepend=-1) != 0), opened & (np.diff(piece, append=-1) != 0)

    @cached_property
    def _conormals(self) -> tuple[Floats, Floats]:
        """The unit conormals (m, d) to the left at the starts and ends of the cubics."""
        ends = [np.roll(knots.conormals, -1, axis=0)[: None if knots.closed else -1] for knots in self.pieces]
        starts = [knots.conormals[: len(end)] for knots, end in zip(self.pieces, ends, strict=True)]
        return np.concatenate(starts), np.concatenate(ends)


def _location(feet: ClosestPoints) -> tuple[Ints, Floats]:
    """Return the cubic (n,) of each of ``feet`` and the parameter (n,) on it; raise InputError if they lack either."""
    if feet.element is None or feet.local is None:
        raise InputError("feet must be answers of this curve: they lack element or local.")
    return feet.element, feet.local[:, 0]
