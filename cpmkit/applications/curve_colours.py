"""Colours of one side of a curve: one for all of it, or several along it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.files.array_files import read_array
from cpmkit.files.data_files import find_file
from cpmkit.plugin import unit
from cpmkit.protocols import ClosestPointSource, Floats, HasMesh, HasTangents, Ints
from cpmkit.runtime.arrays import as_colour, as_colours

#: Files of colours along a curve.
COLOUR_SUFFIXES = (".npy", ".csv")
#: Pieces by which places along a curve are told: that many over the size of its box.
PIECES_OVER_SIZE = 2000
#: What a side's colours may be.
ACCEPTED = (
    "a colour (a name, '#rrggbb' or three numbers from 0 to 1), colours along the curve as (k, 3), or (k, 4) with the "
    "share of the length first, the name of a .npy or .csv file of these, a function of points, or None where nothing "
    "passes"
)


@dataclass(frozen=True, eq=False)
class Along:
    """Where points lie along the curves of a boundary, as shares of each curve's length.

    Attributes
    ----------
    curve : ClosestPointSource
        With a mesh, of which one segment at most begins and ends at a vertex.
    """

    curve: ClosestPointSource

    def __call__(self, points: Floats) -> Floats:
        """Return the shares (n,) of the points of the curve nearest to ``points`` (n, d), from 0 to 1.

        A closed curve begins where its own mesh does, at a polyline's first point.
        """
        feet = self.curve.closest_point(np.ascontiguousarray(points, dtype=np.float64)).points
        pieces = self._pieces
        row = np.asarray(self._tree.query(feet)[1])
        ahead = np.einsum("nd,nd->n", feet - pieces.starts[row], pieces.directions[row])
        return np.asarray((pieces.before[row] + np.clip(ahead, 0, pieces.lengths[row])) / pieces.totals[row])

    @cached_property
    def _pieces(self) -> _Pieces:
        if not isinstance(self.curve, HasMesh) or self.curve.manifold_dim != 1:
            raise InputError(
                f"colours along a curve need its mesh, and {type(self.curve).__name__} is no curve with one; give a "
                "function of points."
            )
        longest = float(np.ptp(self.curve.bounds, axis=0).max()) / PIECES_OVER_SIZE
        vertices, segments = self.curve.mesh(longest)
        if isinstance(self.curve, HasTangents):
            middle = self.curve.closest_point(vertices[segments].mean(axis=1))
            way = np.einsum("sd,sd->s", self.curve.tangents(middle), np.diff(vertices[segments], axis=1)[:, 0])
            segments = np.where(way[:, None] < 0, segments[:, ::-1], segments)
        return _pieces(vertices, _followed(segments, len(vertices)), longest)

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        pieces = self._pieces
        return cKDTree(pieces.starts + 0.5 * pieces.lengths[:, None] * pieces.directions)


class _Pieces(NamedTuple):
    """Short pieces of curves: starts and unit directions (p, d), lengths, lengths before them, those of curves (p,)."""

    starts: Floats
    directions: Floats
    lengths: Floats
    before: Floats
    totals: Floats


def _followed(segments: Ints, count: int) -> list[Ints]:
    """Return the vertices along each curve that directed ``segments`` (m, 2) make; a closed one repeats its first.

    Raises
    ------
    InputError
        If two segments begin at one vertex.
    """
    after = np.full(count, -1)
    after[segments[:, 0]] = segments[:, 1]
    if np.bincount(segments[:, 0], minlength=1).max() > 1 or np.bincount(segments[:, 1], minlength=1).max() > 1:
        raise InputError("colours along a curve need one that does not branch; give a function of points.")
    left = np.zeros(count, dtype=bool)
    left[segments[:, 0]] = True
    found = []
    for start in [*np.setdiff1d(segments[:, 0], segments[:, 1]), *np.unique(segments[:, 0])]:
        if not left[start]:
            continue
        way = [start]
        while after[way[-1]] >= 0 and left[way[-1]]:
            left[way[-1]] = False
            way.append(after[way[-1]])
        found.append(np.array(way))
    return found


def _pieces(vertices: Floats, ways: list[Ints], longest: float) -> _Pieces:
    """Return the pieces of curves along ``vertices``, cut so that none is longer than ``longest``."""
    parts = []
    for way in ways:
        start, step = vertices[way[:-1]], np.diff(vertices[way], axis=0)
        count = np.maximum(np.ceil(np.linalg.norm(step, axis=1) / longest).astype(int), 1)
        row = np.repeat(np.arange(len(count)), count)
        place = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
        length = (np.linalg.norm(step, axis=1) / count)[row]
        starts = start[row] + (place / count[row])[:, None] * step[row]
        before = np.cumsum(length) - length
        parts.append(_Pieces(starts, unit(step)[row], length, before, np.full(len(row), length.sum())))
    return _Pieces(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def colour_data(given: Any, along: Along, what: str) -> Any:
    """Return the datum of three channels that a side's colours are.

    Raises
    ------
    InputError
        If they are not what is accepted.
    """
    if callable(given):
        return _checked(given, what)
    if isinstance(given, (str, Path)) and Path(given).suffix.lower() in COLOUR_SUFFIXES:
        given = _read(Path(given), what)
    if isinstance(given, str):
        return as_colour(given, what).tolist()
    try:
        array = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        return Ramp(_named_along(given, what), along)
    if array.shape == (3,):
        return as_colour(array, what).tolist()
    if array.ndim != 2 or array.shape[1] not in (3, 4) or not len(array):
        raise InputError(f"{what} must be {ACCEPTED}; got shape {array.shape}.")
    return Ramp(_stops(array, what), along)


@dataclass(frozen=True, eq=False)
class _Stops:
    """Colours (k, 3) at shares (k,) of a curve's length, ascending."""

    shares: Floats
    colours: Floats


@dataclass(frozen=True, eq=False)
class Ramp:
    """The function of points of a curve that is linear in the arc length between stops."""

    stops: _Stops
    along: Along

    def __call__(self, points: Floats) -> Floats:
        """Return the colours (n, 3) at ``points`` (n, d)."""
        share = self.along(points)
        return np.stack([np.interp(share, self.stops.shares, channel) for channel in self.stops.colours.T], axis=1)


def _stops(array: Floats, what: str) -> _Stops:
    """Return the stops of rows (k, 3), which divide the curve evenly, or (k, 4), which begin with their shares."""
    shares = np.linspace(0, 1, len(array)) if array.shape[1] == 3 else array[:, 0]
    if not (np.isfinite(shares).all() and (np.diff(shares) >= 0).all() and shares[0] >= 0 and shares[-1] <= 1):
        raise InputError(f"{what} must begin its rows with shares of the length from 0 to 1 that do not go back.")
    return _Stops(shares, as_colours(array[:, -3:], what))


def _named_along(given: Any, what: str) -> _Stops:
    """Return the stops of a list of names, which divide the curve evenly."""
    if not isinstance(given, (list, tuple)) or not given:
        raise InputError(f"{what} must be {ACCEPTED}; got {shown(given)}.")
    colours = np.array([as_colour(one, f"entry {number} of {what}") for number, one in enumerate(given)])
    return _Stops(np.linspace(0, 1, len(colours)), colours)


def _checked(function: Callable[..., Any], what: str) -> Callable[[Floats], Floats]:
    """Return a function of points whose answers are checked for colours."""

    def colours(points: Floats) -> Floats:
        found = np.asarray(function(points), dtype=np.float64)
        if found.shape != (len(points), 3):
            raise InputError(f"{what} must return colours of shape ({len(points)}, 3), got {found.shape}.")
        return as_colours(found, what)

    return colours


def _read(name: Path, what: str) -> Floats:
    file = find_file(name)
    if file.suffix.lower() == ".npy":
        return np.asarray(read_array(file, "an array of colours"), dtype=np.float64)
    try:
        return np.loadtxt(file, delimiter=",", ndmin=2)
    except (ValueError, OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"{what}: {shown(file.name)} must hold lines of three numbers, or of four that begin with a share of the "
            f"length, parted by commas: {shown(str(error))}."
        ) from error
