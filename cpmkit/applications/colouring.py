"""Diffusion curves: colours prescribed on both sides of curves and harmonic between them.

Each of the three channels solves the Laplace equation between the curves: in the plane Orzan et al. (2008), on
manifolds King et al. (2024), section 7.1. By the maximum principle no colour between them is brighter or darker than
the prescribed ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

import cpmkit as ck
from cpmkit.applications.heat import scene_of
from cpmkit.applications.result import Result, with_colours
from cpmkit.errors import InputError, SceneError, shown
from cpmkit.facade import Solution
from cpmkit.files.array_files import read_array
from cpmkit.files.whole_files import find_file
from cpmkit.plugin import ClosestPointSource, HasMesh, HasTangents, chain_segments, dots, norms
from cpmkit.runtime.arrays import as_colour, as_colours
from cpmkit.runtime.deprecation import DeprecatedMember
from cpmkit.types import Floats

#: The accepted forms of the colours of a side, in words.
ACCEPTED = (
    "a colour (a name, '#rrggbb' or three numbers from 0 to 1), colours along the curve as (k, 3), or (k, 4) with the "
    "share of the length first, the name of a .npy or .csv file of these, a function of points, or None where nothing "
    "passes"
)


@dataclass(frozen=True, eq=False)
class ArcLengthShare:
    """Position of points along the curves of a boundary, as a share of each curve's length."""

    curve: ClosestPointSource  #: A curve whose mesh does not branch.

    def __call__(self, points: Floats) -> Floats:
        """Return the shares (n,), from 0 to 1, of the points of the curve nearest to ``points`` (n, d).

        A closed curve begins where its own mesh does, at a polyline's first point. Raises InputError if the source is
        no curve with a mesh, or branches.
        """
        feet = self.curve.closest_point(np.ascontiguousarray(points, dtype=np.float64)).points
        tree, starts, ends, before, totals = self._short_segments
        row = np.asarray(tree.query(feet)[1])
        step = ends[row] - starts[row]
        length = np.maximum(norms(step), np.finfo(float).tiny)
        ahead = np.clip(dots(feet - starts[row], step) / length, 0, length)
        return np.asarray((before[row] + ahead) / totals[row])

    @cached_property
    def _short_segments(self) -> tuple[Any, Floats, Floats, Floats, Floats]:
        """Short segments of the curves, in the direction of each curve; computed at first use.

        Values are a search tree of the segments' midpoints, their starts (p, d) and ends (p, d), the arc lengths (p,)
        at the starts, and the lengths (p,) of the segments' curves.
        """
        from scipy.spatial import cKDTree

        if not isinstance(self.curve, HasMesh) or self.curve.manifold_dim != 1:
            raise InputError(
                f"colours along a curve need its mesh, and {type(self.curve).__name__} is no curve with one; give a "
                "function of points."
            )
        longest = float(np.ptp(self.curve.bounds, axis=0).max()) / 2000
        vertices, segments = self.curve.mesh(longest)
        if isinstance(self.curve, HasTangents):
            middle = self.curve.closest_point(vertices[segments].mean(axis=1))
            ahead = dots(self.curve.tangents(middle), np.diff(vertices[segments], axis=1)[:, 0])
            segments = np.where(ahead[:, None] < 0, segments[:, ::-1], segments)
        if max(np.bincount(column).max() for column in segments.T) > 1:
            raise InputError("colours along a curve need one that does not branch; give a function of points.")
        parts = []
        for line in chain_segments(vertices, segments):
            points = np.concatenate([line.points, line.points[: int(line.closed)]])
            arc = np.concatenate([[0.0], np.cumsum(norms(np.diff(points, axis=0)))])
            ends = np.cumsum([0, *np.maximum(np.ceil(np.diff(arc) / longest), 1)])  # pieces up to each vertex
            at = np.interp(np.arange(ends[-1] + 1), ends, arc)
            points = np.stack([np.interp(at, arc, axis) for axis in points.T], axis=1)
            parts.append((points[:-1], points[1:], at[:-1], np.full(len(at) - 1, at[-1])))
        starts, ends, before, totals = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        return cKDTree(0.5 * (starts + ends)), starts, ends, before, totals


@dataclass(frozen=True, eq=False)
class Ramp:
    """Colours (k, 3) at ascending ``shares`` (k,) of a curve's length, as a function of its points, linear between."""

    along: ArcLengthShare
    shares: Floats
    colours: Floats

    def __call__(self, points: Floats) -> Floats:
        """Return the colours (n, 3) at ``points`` (n, d)."""
        share = self.along(points)
        return np.stack([np.interp(share, self.shares, channel) for channel in self.colours.T], axis=1)


def colour_data(colours: Any, along: ArcLengthShare, label: str) -> Any:
    """Return the Dirichlet datum for ``colours`` of a side, as in :func:`diffusion_curves`: a list of 3, or a function.

    Rows of colours are placed by ``along``. Raises InputError, which names the colours as ``label``, for other input.
    """
    if callable(colours):

        def checked_colours(points: Floats) -> Floats:
            """Return the colours (n, 3) at points (n, d); raise InputError for another shape, or outside of [0, 1]."""
            values = np.asarray(colours(points), dtype=np.float64)
            if values.shape != (len(points), 3):
                raise InputError(f"{label} must return colours of shape ({len(points)}, 3), got {values.shape}.")
            return as_colours(values, label)

        return checked_colours
    if isinstance(colours, (str, Path)) and Path(colours).suffix.lower() in (".npy", ".csv"):
        colours = _read_curve_colours(Path(colours), label)
    if isinstance(colours, str):
        return as_colour(colours, label).tolist()
    try:
        array = np.asarray(colours, dtype=np.float64)
    except (TypeError, ValueError) as error:  # names
        if not isinstance(colours, (list, tuple)) or not colours:
            raise InputError(f"{label} must be {ACCEPTED}; got {shown(colours)}.") from error
        array = np.array([as_colour(entry, f"entry {number} of {label}") for number, entry in enumerate(colours)])
    if array.shape == (3,):
        return as_colour(array, label).tolist()
    if array.ndim != 2 or array.shape[1] not in (3, 4) or not len(array):
        raise InputError(f"{label} must be {ACCEPTED}; got shape {array.shape}.")
    shares = np.linspace(0, 1, len(array)) if array.shape[1] == 3 else array[:, 0]
    if not (np.isfinite(shares).all() and (np.diff(shares) >= 0).all() and shares[0] >= 0 and shares[-1] <= 1):
        raise InputError(f"{label} must begin its rows with shares of the length from 0 to 1 that do not go back.")
    return Ramp(along, shares, as_colours(array[:, -3:], label))


def _read_curve_colours(name: Path, label: str) -> Floats:
    """Return the rows of the file ``name``, .npy or .csv, unchecked: (k, 3) colours, or (k, 4) with shares of length.

    Raises InputError, which for a .csv names the colours as ``label``, if the file is missing or not readable.
    """
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


def prescribed_range(scene: ck.Scene, spacing: float) -> Floats:
    """Return the least and the largest value of three channels that Dirichlet conditions prescribe, (2, 3), in [0, 1].

    By the maximum principle a harmonic function stays between them if all other conditions are zero fluxes. The result
    is 0 and 1 if another condition is no zero flux, or a function is prescribed on the edge, on a curve without a mesh
    or for one channel of several. Functions are sampled ``spacing`` apart.
    """
    conditions: list[tuple[Any, Any]] = [(condition, None) for condition in scene.edge_conditions]
    for boundary in scene.boundaries:
        conditions += [(boundary.condition(side), boundary.source) for side in ("left", "right")]
    samples = [np.clip(_prescribed_values(condition, curve, spacing), 0.0, 1.0) for condition, curve in conditions]
    values = np.concatenate(samples)
    return np.stack([values.min(axis=0), values.max(axis=0)])


def _prescribed_values(condition: Any, curve: ClosestPointSource | None, spacing: float) -> Floats:
    """Return the values (k, 3) that a condition prescribes: k = 0 for zero flux, rows of 0 and of 1 if unknown.

    A function is sampled ``spacing`` apart on ``curve``, the source of its boundary; None for the edge.
    """
    unknown = np.array([[0.0] * 3, [1.0] * 3])
    if condition.law.is_zero_flux:
        return unknown[:0]
    if condition.kind != "dirichlet":
        return unknown
    datum = condition.value
    if isinstance(datum, Ramp):
        return datum.colours
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


@dataclass(frozen=True, eq=False, repr=False)
class ColouredSurface(Result):
    """Colours everywhere on a manifold: read, saved and drawn as a solution of three channels.

    ``solution`` is red, green and blue as computed: at tips and crossings of curves some hundredths beyond the
    prescribed colours.
    """

    #: (2, 3): the least and the largest prescribed red, green and blue, between which computed colours are clipped.
    ends: Floats

    def evaluate(self, points: Any, side: Any = None) -> Floats:
        """Return red, green and blue at ``points``, each clipped to the range of the prescribed colours.

        ``points`` (n, d) or (d,), ``side``, shapes and errors are as for :meth:`cpmkit.Solution.evaluate`: (n, 3), for
        ``side="both"`` (n, 2, 3), without the first axis for one point.
        """
        return self.clip(self.solution.evaluate(points, side))

    limited = DeprecatedMember("clip")

    def clip(self, colours: Floats) -> Floats:
        """Return ``colours`` (..., 3) with each channel clipped to the range of the prescribed colours."""
        return np.asarray(np.clip(colours, *self.ends))

    def drawable(self) -> Solution:
        """Return the solution with the clipped colours as values of its display mesh."""
        return with_colours(self.solution, self.clip(self.solution.display_mesh().values))


def diffusion_curves(
    surface: ClosestPointSource | ck.Scene,
    curves: Sequence[tuple[ClosestPointSource, Any]] | Mapping[str, tuple[ClosestPointSource, Any]],
    *,
    spacing: float | None = None,
    **options: Any,
) -> ColouredSurface:
    """Return the colours that diffuse from curves with a colour on each side over a curve, surface or solid.

    Parameters
    ----------
    surface : ClosestPointSource or Scene
        The manifold; or a scene, whose conditions on boundaries and edge are kept: each has one channel, or three.
    curves : sequence or mapping of pairs
        Each a curve and its colours, of both sides or ``{"left": ..., "right": ...}``. A side has a colour (a
        name of CSS, ``"#rrggbb"``, three numbers from 0 to 1); colours along the curve, linear in its arc length:
        (k, 3) from its start to its end, or (k, 4) with the share of the length first, or a list of names, or the name
        of a ``.npy`` or ``.csv`` file of such rows; a function of points (n, d) that returns (n, 3); or None, for a
        barrier. In a mapping the keys are the curves' names.
    spacing : float
        Spacing of the lattice, in the scene's unit; or ``tolerance`` or ``seconds`` in its place.
    **options
        Options of :func:`cpmkit.solve`, such as ``degree``; ``help(cpmkit.solve)`` shows them with their defaults.

    Returns
    -------
    ColouredSurface

    Raises
    ------
    InputError, SceneError
        If an argument is not accepted, or a piece of the manifold has no colour on any side of a curve; others as
        :func:`cpmkit.solve` raises them.

    Examples
    --------
    The equator of a sphere is white on its northern side, and green and blue in turn on its southern side.

    >>> import cpmkit as ck
    >>> from cpmkit.applications import diffusion_curves
    >>> equator = ck.source("analytic.circle", normal=[0, 0, 1])
    >>> colours = {"left": "white", "right": ["lime", "blue", "lime"]}
    >>> found = diffusion_curves(ck.source("analytic.sphere"), [(equator, colours)], spacing=0.2)
    >>> (found.evaluate([[0, 0, 1], [0, 0, -1]]) + 1e-6).round(2).tolist()
    [[1.0, 1.0, 1.0], [0.0, 0.5, 0.5]]
    """
    scene = scene_of(surface)
    named = curves if isinstance(curves, Mapping) else {f"curve {number}": pair for number, pair in enumerate(curves)}
    boundaries = [_curve_boundary(name, pair) for name, pair in named.items()]
    if not any(curve.condition(side).kind == "dirichlet" for curve in boundaries for side in ("left", "right")):
        raise InputError("no side of a curve has a colour; give one at least.")
    whole = ck.Scene(scene.surface, ck.Laplace(), [*scene.boundaries, *boundaries], scene.edge)
    solution = ck.solve(whole, spacing, **options)
    free = [imbalance for imbalance in solution.imbalances if imbalance.of == "data"]
    if free:
        where, share = ", ".join(f"{x:.3g}" for x in free[0].near), 100 * free[0].share
        raise SceneError(
            f"a piece of the manifold about ({where}), {share:.0f} percent of it, touches no side of "
            "a curve that has a colour; give it one."
        )
    return ColouredSurface(solution, prescribed_range(whole, 0.25 * solution.spacing))


def _curve_boundary(name: str, pair: Any) -> ck.Boundary:
    """Return the boundary ``name`` of a ``pair`` (curve, colours) with its conditions; raise InputError for others."""
    if not isinstance(pair, (tuple, list)) or len(pair) != 2 or not isinstance(pair[0], ClosestPointSource):
        raise InputError(f"{name} must be a pair (source of a curve, its colours), got {shown(pair)}.")
    curve, colours = pair
    along = ArcLengthShare(curve)
    if not isinstance(colours, Mapping):
        return ck.Boundary(name, curve, both=_side_condition(colours, along, f"the colour of {name}"))
    if set(colours) != {"left", "right"}:
        raise InputError(
            f"colours of {name} are given as left and right, with None for a barrier, got "
            f"{', '.join(map(str, colours)) or 'none'}."
        )
    sides = {side: _side_condition(colours[side], along, f"the {side} colour of {name}") for side in ("left", "right")}
    return ck.Boundary(name, curve, **sides)


def _side_condition(colours: Any, along: ArcLengthShare, label: str) -> Any:
    """Return the condition of one side of a curve: zero flux if ``colours`` is None, else Dirichlet by colour_data."""
    return ck.Neumann(0.0) if colours is None else ck.Dirichlet(colour_data(colours, along, label))
