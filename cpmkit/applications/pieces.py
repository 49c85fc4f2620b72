"""The pieces of a prepared manifold that do not hang together, and which of them have an origin."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from cpmkit.plugin import Discretized, Terms
from cpmkit.preparing import Prepared
from cpmkit.protocols import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class Pieces:
    """Pieces of a manifold with barriers, by its unknowns.

    Attributes
    ----------
    count : int
    of_unknown : (n,) int64
        The number of the piece of each unknown.
    of_point : (p,) int64
        That of each point that is in use.
    """

    count: int
    of_unknown: Ints
    of_point: Ints

    def numbers_at(self, form: Discretized, points: Floats) -> Ints:
        """Return the numbers (k,) of the pieces that ``points`` (k, d) are read on."""
        if self.count == 1 or not len(points):
            return np.zeros(len(points), dtype=np.int64)
        numbers: Ints = np.rint(form.rows(points) @ self.of_unknown.astype(np.float64)).astype(np.int64)
        return numbers

    def any_of(self, holds: Bools) -> Bools:
        """Return (count,) whether something holds at any point of each piece, given whether at each point (p,)."""
        return np.bincount(self.of_point, holds, self.count) > 0


_FOUND: WeakKeyDictionary[Discretized, Pieces] = WeakKeyDictionary()


def pieces_of(prepared: Prepared) -> Pieces:
    """Return the pieces of a prepared scene whose boundaries are barriers; found once."""
    form = prepared.discretized
    if form not in _FOUND:
        border = form.free_constants(form.stiffness(Terms()))
        count = 1 if border is None else border.indicator.shape[1]
        of_unknown = np.zeros(form.size, dtype=np.int64)
        of_point = np.zeros(len(form.points), dtype=np.int64)
        if border is not None and count > 1:
            numbers = border.indicator @ np.arange(count, dtype=np.float64)
            of_unknown = np.rint(numbers).astype(np.int64)
            of_point = np.rint(form.at_points(numbers[:, None])[:, 0]).astype(np.int64)
        _FOUND[form] = Pieces(count, of_unknown, of_point)
    return _FOUND[form]
