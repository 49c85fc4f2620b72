"""The kind ``points``: a finite set of points as one source."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.plugin import (
    ClosestPoints,
    Floats,
    InputError,
    Ints,
    as_points,
    as_positions,
    as_vector,
    existing_file,
    one_row_each,
    read_array,
    shown,
    source_repr,
)


@dataclass(frozen=True, eq=False)
class PointSet:
    """A finite set of points.

    Attributes
    ----------
    positions : (k, d) float64
        At least one.
    shift : (d,) float64
        Translation, added to every position.
    """

    positions: Floats
    shift: Floats

    manifold_dim = 0
    exact = True

    __repr__ = source_repr

    @property
    def dim(self) -> int:
        """Dimension of the space, 2 or 3."""
        return int(self.positions.shape[1])

    @property
    def bounds(self) -> Floats:
        """(2, d) corners of the bounding box."""
        return np.stack([self.positions.min(axis=0), self.positions.max(axis=0)]) + self.shift

    @property
    def value_count(self) -> int:
        """Number of points, and of rows that :meth:`interpolate` expects."""
        return len(self.positions)

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d); ``element`` is the point's number, ``edge`` -1.

        Raise InputError if ``x`` does not have shape (n, d) or is not finite.
        """
        x = as_points(x, self.dim)
        element = self._tree.query(x - self.shift)[1].astype(np.int64)
        points = self.positions[element] + self.shift
        return ClosestPoints(points, np.linalg.norm(x - points, axis=1), np.full(len(x), -1), element)

    def interpolate(self, values: Floats, feet: ClosestPoints, /) -> Floats:
        """Return (n, ...) the rows of ``values`` (value_count, ...) of the points at ``feet``.

        Raise InputError if ``values`` has another number of rows, or ``feet`` lack ``element``.
        """
        if feet.element is None:
            raise InputError("feet must be answers of this set of points: they lack element.")
        return one_row_each(values, self.value_count, "points")[feet.element]

    def mesh(self, _spacing: float, /) -> tuple[Floats, Ints]:
        """Return the points (k, d) and one cell (k, 1) for each, whatever the spacing."""
        return self.positions + self.shift, np.arange(len(self.positions))[:, None]

    def translate(self, offset: Floats, /) -> PointSet:
        """Return the set of points translated by ``offset`` (d,)."""
        return replace(self, shift=self.shift + as_vector(offset, self.dim, "offset"))

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self.positions)


def points(*, at: Any = None, file: str | Path | None = None) -> PointSet:
    """Return a finite set of points: those ``at``, or those in a file.

    Raise InputError if both or neither of ``at`` and ``file`` are given, the file is missing or contains no array, or
    the points are none, of another shape or not finite.

    Parameters
    ----------
    at : (n, 2) or (n, 3) array
        At least one point; a single one may be given as 2 or 3 numbers.
    file : str or Path
        A ``.npy`` file that holds such an array.

    Examples
    --------
    >>> pins = points(at=[[0, 0, 1], [1, 0, 0]])
    >>> pins.closest_point([[0.9, 0.2, 0.1]]).element.tolist()
    [1]
    """
    if (at is None) == (file is None):
        raise InputError("points takes either at or a file, got " + ("neither." if file is None else "both."))
    array = _as_numbers(at) if file is None else read_array(existing_file(file), "an array of points")
    array = array[None] if array.ndim == 1 else array
    if array.ndim != 2 or array.shape[1] not in (2, 3) or not len(array):
        raise InputError(f"at must be points of shape (n, 2) or (n, 3), at least one, got the shape {array.shape}.")
    return PointSet(as_positions(array, array.shape[1], "at").copy(), np.zeros(array.shape[1]))


def _as_numbers(at: Any) -> Floats:
    """Return ``at`` as an array of numbers of any shape; raise InputError if it is none."""
    try:
        return np.asarray(at, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"at must be points, n times 2 or 3 numbers, got {shown(at)}.") from error
