"""Compiled: the nearest samples of points, looked for in the lattice cells around them."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Bools, Floats, Ints
from cpmkit.runtime.compilation import compiled


@compiled
def nearest_in_cells(
    points: Floats, around: Ints, lower: Ints, strides: Ints, codes: Ints, starts: Ints, samples: Floats, count: int
) -> tuple[Floats, Ints, Bools]:
    """Return the nearest samples of points among those in the lattice cells around each.

    Parameters
    ----------
    points : (k, d) float64
        In spacings.
    around : (3^d, d) int64
        Steps to the cells around one, itself first and the farthest last.
    lower, strides : (d,) int64
        The cell whose code is zero, and what a step along each axis adds: of cells beyond the numbered box, which hold
        no samples, the code may be another's.
    codes, starts : (p,) and (p + 1,) int64
        Of cells that hold samples, ascending, and where those of each begin.
    samples : (q, d) float64
        In spacings, cell after cell.
    count : int
        How many are wanted.

    Returns
    -------
    squares, near : (k, count) float64 and int64
        Squared distances, ascending, and numbers of samples.
    complete : (k,) bool
        Of which points these are the nearest of all: of others some are farther than the cells around reach.
    """
    d = points.shape[1]
    squares, near = np.full((len(points), count), np.inf), np.zeros((len(points), count), dtype=np.int64)
    complete = np.zeros(len(points), dtype=np.bool_)
    for k in range(len(points)):
        for step in around:
            apart, code = 0.0, 0
            for axis in range(d):
                own = np.int64(np.floor(points[k, axis] + 0.5))
                to_plane = 0.5 - step[axis] * (points[k, axis] - own)
                apart += abs(step[axis]) * to_plane * to_plane
                code += (own + step[axis] - lower[axis]) * strides[axis]
            if apart >= squares[k, count - 1]:
                continue
            row = np.searchsorted(codes, code)
            while row < len(codes) and codes[row] == code:
                for q in range(starts[row], starts[row + 1]):
                    square = 0.0
                    for axis in range(d):
                        square += (points[k, axis] - samples[q, axis]) ** 2
                    if square < squares[k, count - 1]:
                        insert(squares[k], near[k], square, q)
                row += 1
        complete[k] = squares[k, count - 1] <= 1.0
    return squares, near, complete


@compiled
def insert(squares: Floats, near: Ints, square: float, q: int) -> None:
    """Put a sample in its place among those found, ascending by distance, the farthest of which is dropped."""
    at = len(near) - 1
    while at > 0 and squares[at - 1] > square:
        squares[at], near[at] = squares[at - 1], near[at - 1]
        at -= 1
    squares[at], near[at] = square, q
