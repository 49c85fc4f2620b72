"""Colours on the sides of curves, constant or along the arc length, and the conditions that prescribe values."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import cpmkit as ck
from cpmkit.errors import InputError, shown
from cpmkit.files.array_files import read_array
from cpmkit.files.data_files import find_file
from cpmkit.plugin import ClosestPointSource, HasMesh, HasTangents, unit
from cpmkit.runtime.arrays import as_colour, as_colours
from cpmkit.types import Floats, Ints

#: Files of colours along a curve.
COLOUR_SUFFIXES = (".npy", ".csv")
#: Size of a curve's bounding box over the longest piece in the search for places along the curve.
PIECES_OVER_SIZE = 2000
#: The accepted forms of the colours of a side, in words.
ACCEPTED = (
    "a colour (a name, '#rrggbb' or three numbers from 0 to 1), colours along the curve as (k, 3), or (k, 4) with the "
    "share of the length first, the name of a .npy or .csv file of these, a function of points, or None where nothing "
    "passes"
)


@dataclass(frozen=True, eq=False)
class ArcLengthShare:
    """Position of points along the curves of a boundary, as a share of each curve's length.

    Attributes
    ----------
    curve : ClosestPointSource
        A curve whose mesh does not branch.
    """

    curve: ClosestPointSource

    def __call__(self, points: Floats) -> Floats:
        """Return the shares (n,), from 0 to 1, of the points of the curve nearest to ``points`` (n, d).

        A closed curve begins where its own mesh does, at a polyline's first point.
        """
        feet = self.curve.closest_point(np.ascontiguousarray(points, dtype=np.float64)).points
        pieces = self._pieces
        row = np.asarray(self._tree.query(feet)[1])
        ahead = np.einsum("nd,nd->n", feet - pieces.starts[row], pieces.directions[row])
        return np.asarray((pieces.before[row] + np.clip(ahead, 0, pieces.lengths[row])) / pieces.totals[row])

    @cached_property
    def _pieces(self) -> _Pieces:
        """Short pieces of the curves, in the direction of each.

        Raises
        ------
        InputError
            If the source is no curve with a mesh.
        """
        if not isinstance(self.curve, HasMesh) or self.curve.manifold_dim != 1:
            raise InputError(
                f"colours along a curve need its mesh, and {type(self.curve).__name__} is no curve with one; give a "
                "function of points."
            )
        longest = float(np.ptp(self.curve.bounds, axis=0).max()) / PIECES_OVER_SIZE
        vertices, segments = self.curve.mesh(longest)
        if isinstance(self.curve, HasTangents):
            middle = self.curve.closest_point(vertices[segments].mean(axis=1))
            ahead = np.einsum("sd,sd->s", self.curve.tangents(middle), np.diff(vertices[segments], axis=1)[:, 0])
            segments = np.where(ahead[:, None] < 0, segments[:, ::-1], segments)
        return _pieces(vertices, _vertex_chains(segments, len(vertices)), longest)

    @cached_property
    def _tree(self) -> Any:
        """Search tree of the middles of the pieces."""
        from scipy.spatial import cKDTree

        pieces = self._pieces
        return cKDTree(pieces.starts + 0.5 * pieces.lengths[:, None] * pieces.directions)


class _Pieces(NamedTuple):
    """Short pieces of curves: starts and unit directions (p, d), lengths, arc lengths at starts, curve lengths (p,)."""

    starts: Floats
    directions: Floats
    lengths: Floats
    before: Floats
    totals: Floats


def _vertex_chains(segments: Ints, count: int) -> list[Ints]:
    """Return the vertices in order along each curve of directed ``segments`` (m, 2); a closed curve repeats its first.

    Raises
    ------
    InputError
        If two segments begin, or two end, at one vertex.
    """
    after = np.full(count, -1)
    after[segments[:, 0]] = segments[:, 1]
    if np.bincount(segments[:, 0], minlength=1).max() > 1 or np.bincount(segments[:, 1], minlength=1).max() > 1:
        raise InputError("colours along a curve need one that does not branch; give a function of points.")
    unvisited = np.zeros(count, dtype=bool)
    unvisited[segments[:, 0]] = True
    chains = []
    for start in [*np.setdiff1d(segments[:, 0], segments[:, 1]), *np.unique(segments[:, 0])]:
        if not unvisited[start]:
            continue
        chain = [start]
        while after[chain[-1]] >= 0 and unvisited[chain[-1]]:
            unvisited[chain[-1]] = False
            chain.append(after[chain[-1]])
        chains.append(np.array(chain))
    return chains


def _pieces(vertices: Floats, chains: list[Ints], longest: float) -> _Pieces:
    """Return pieces no longer than ``longest`` of curves, each given by its ``chains`` of vertices."""
    parts = []
    for chain in chains:
        start, step = vertices[chain[:-1]], np.diff(vertices[chain], axis=0)
        count = np.maximum(np.ceil(np.linalg.norm(step, axis=1) / longest).astype(int), 1)
        row = np.repeat(np.arange(len(count)), count)
        place = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
        length = (np.linalg.norm(step, axis=1) / count)[row]
        starts = start[row] + (place / count[row])[:, None] * step[row]
        before = np.cumsum(length) - length
        parts.append(_Pieces(starts, unit(step)[row], length, before, np.full(len(row), length.sum())))
    return _Pieces(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def colour_data(colours: Any, along: ArcLengthShare, label: str) -> Any:
    """Return the Dirichlet datum with three channels for the colours of a side; ``label`` names them in errors.

    Raises
    ------
    InputError
        If the colours are not accepted.
    """
    if callable(colours):
        return _check_colours(colours, label)
    if isinstance(colours, (str, Path)) and Path(colours).suffix.lower() in COLOUR_SUFFIXES:
        colours = _read_colours(Path(colours), label)
    if isinstance(colours, str):
        return as_colour(colours, label).tolist()
    try:
        array = np.asarray(colours, dtype=np.float64)
    except (TypeError, ValueError):
        return Ramp(_named_along(colours, label), along)
    if array.shape == (3,):
        return as_colour(array, label).tolist()
    if array.ndim != 2 or array.shape[1] not in (3, 4) or not len(array):
        raise InputError(f"{label} must be {ACCEPTED}; got shape {array.shape}.")
    return Ramp(_stops(array, label), along)


@dataclass(frozen=True, eq=False)
class _Stops:
    """Colours (k, 3) at shares (k,) of a curve's length, ascending."""

    shares: Floats
    colours: Floats


@dataclass(frozen=True, eq=False)
class Ramp:
    """Colours as a function of points of a curve, linear in the arc length between stops."""

    stops: _Stops
    along: ArcLengthShare

    def __call__(self, points: Floats) -> Floats:
        """Return the colours (n, 3) at ``points`` (n, d)."""
        share = self.along(points)
        return np.stack([np.interp(share, self.stops.shares, channel) for channel in self.stops.colours.T], axis=1)


def _stops(array: Floats, label: str) -> _Stops:
    """Return stops from rows (k, 3), at equal arc lengths, or (k, 4), which begin with shares of the length."""
    shares = np.linspace(0, 1, len(array)) if array.shape[1] == 3 else array[:, 0]
    if not (np.isfinite(shares).all() and (np.diff(shares) >= 0).all() and shares[0] >= 0 and shares[-1] <= 1):
        raise InputError(f"{label} must begin its rows with shares of the length from 0 to 1 that do not go back.")
    return _Stops(shares, as_colours(array[:, -3:], label))


def _named_along(colours: Any, label: str) -> _Stops:
    """Return stops from a list of colour names, at equal arc lengths."""
    if not isinstance(colours, (list, tuple)) or not colours:
        raise InputError(f"{label} must be {ACCEPTED}; got {shown(colours)}.")
    array = np.array([as_colour(entry, f"entry {number} of {label}") for number, entry in enumerate(colours)])
    return _Stops(np.linspace(0, 1, len(array)), array)


def _check_colours(function: Callable[..., Any], label: str) -> Callable[[Floats], Floats]:
    """Return a function of points whose values are checked to be colours."""

    def colours(points: Floats) -> Floats:
        values = np.asarray(function(points), dtype=np.float64)
        if values.shape != (len(points), 3):
            raise InputError(f"{label} must return colours of shape ({len(points)}, 3), got {values.shape}.")
        return as_colours(values, label)

    return colours


def _read_colours(name: Path, label: str) -> Floats:
    """Return the rows (k, 3) or (k, 4) of a .npy or .csv file of colours; raise InputError if it holds other data."""
    file = find_file(name)
    if file.suffix.lower() == ".npy":
        return np.asarray(read_array(file, "an array of colours"), dtype=np.float64)
    try:
        return np.loadtxt(file, delimiter=",", ndmin=2)
    except (ValueError, OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"{label}: {shown(file.name)} must hold lines of three numbers, or of four that begin with a share of the "
            f"length, separated by commas: {shown(str(error))}."
        ) from error


def dirichlet_at_points(name: str, points: Floats, values: Floats) -> list[ck.Boundary]:
    """Return a boundary for each of ``points`` (k, d), with its row of ``values`` (k, channels) as Dirichlet value."""
    return [
        ck.Boundary(f"{name}.{k}", ck.source("analytic.point", at=at), both=ck.Dirichlet(value.tolist()))
        for k, (at, value) in enumerate(zip(points, values, strict=True))
    ]


def dirichlet_along_curve(name: str, curve: ClosestPointSource, values: Callable[[Floats], Floats]) -> ck.Boundary:
    """Return a boundary with a function of points as the Dirichlet value on both sides of a curve."""
    return ck.Boundary(name, curve, both=ck.Dirichlet(values))


def prescribed_range(scene: ck.Scene, spacing: float) -> Floats:
    """Return the least and the largest value of three channels that Dirichlet conditions prescribe, (2, 3), in [0, 1].

    By the maximum principle a harmonic function stays between them if all other conditions are zero fluxes. The result
    is 0 and 1 if another condition is no zero flux, or if a function is prescribed on a curve without a mesh. Functions
    are sampled ``spacing`` apart.
    """
    samples = [np.clip(values, 0.0, 1.0) for values in _prescribed_values(scene, spacing)]
    if not samples:
        return np.array([[0.0] * 3, [1.0] * 3])
    values = np.concatenate(samples)
    return np.stack([values.min(axis=0), values.max(axis=0)])


def _prescribed_values(scene: ck.Scene, spacing: float) -> Iterator[Floats]:
    """Yield the values (k, 3) that each condition prescribes, rows of 0 and of 1 where they are not known."""
    for boundary in scene.boundaries:
        for side in ("left", "right"):
            yield _values_of(boundary.condition(side), boundary.source, spacing)
    for condition in scene.edge_conditions:
        yield _values_of(condition, None, spacing)


def _values_of(condition: Any, curve: ClosestPointSource | None, spacing: float) -> Floats:
    """Return the values (k, 3) that a condition prescribes, none for zero flux.

    They are rows of 0 and of 1 where they are not known. A function is evaluated at the vertices of the mesh of
    ``curve``.
    """
    unknown = np.array([[0.0] * 3, [1.0] * 3])
    datum = condition.data()[0][1] if len(condition.data()) == 1 else None
    if condition.kind == "neumann":
        return unknown[:0] if np.isscalar(datum) and datum == 0 else unknown
    if condition.kind != "dirichlet":
        return unknown
    if isinstance(datum, Ramp):
        return datum.stops.colours
    if callable(datum):
        if not isinstance(curve, HasMesh):
            return unknown
        datum = datum(curve.mesh(spacing)[0])
    else:
        datum = [datum]
    try:
        values = np.asarray(datum, dtype=np.float64)
    except (TypeError, ValueError):  # a formula, or a list of them
        return unknown
    return np.broadcast_to(values.reshape(len(values), -1), (len(values), 3))
