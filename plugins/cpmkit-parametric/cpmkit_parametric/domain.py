"""The unit square of parameters: which ends are glued, which collapse to a point, and which are edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Bools, Floats, InputError, Ints
from cpmkit_parametric.maps import UnitMap

#: Glued ends must meet to this share of the size; a side shorter than it is a point.
GLUED_ENDS_SHARE = 1e-9
#: A parameter this close to a bound, as a share of the range, is at the bound: rounding.
AT_BOUND_SHARE = 1e-13
SIDE_SAMPLES = 65
#: Least distance of a start from a pole, and the largest share of that distance that a step may take.
LEAST_POLE_DISTANCE, MOST_POLE_STEP_SHARE = 1e-4, 0.9


@dataclass(frozen=True, eq=False)
class Domain:
    """[0, 1]^m with some opposite ends glued.

    Attributes
    ----------
    periodic : (m,) bool
        Parameters whose ends are glued.
    flip : bool
        Once around the first parameter, the second comes back as one minus itself.
    poles : (m, 2) bool, optional
        Sides that the map sends to one point. A step never jumps onto one: there the other parameter
        has no derivative, and a descent would rest where another direction leads on.
    """

    periodic: Bools
    flip: bool = False
    poles: Bools | None = None

    def move_off_poles(self, s: Floats) -> Floats:
        """Return unit parameters ``s`` (n, m), wrapped or cut at the bounds, and at least 1e-4 away from poles."""
        s = self.wrap_parameters(s)
        if self.poles is None:
            return s
        return np.clip(s, LEAST_POLE_DISTANCE * self.poles[:, 0], 1 - LEAST_POLE_DISTANCE * self.poles[:, 1])

    def advance_parameters(self, s: Floats, step: Floats) -> Floats:
        """Return unit parameters after ``step`` from ``s``, all (n, m): wrapped, cut at bounds, or short of poles."""
        from cpmkit_parametric import unit_kernels

        poles = np.zeros((len(self.periodic), 2), dtype=np.bool_) if self.poles is None else self.poles
        moved: Floats = unit_kernels.advance_parameters(s, step, self.periodic, self.flip, poles, MOST_POLE_STEP_SHARE)
        return moved

    def wrap_parameters(self, s: Floats) -> Floats:
        """Return ``s`` (n, m), any numbers, as parameters in the domain: wrapped, and flipped, or cut at the bounds."""
        wrapped = np.where(self.periodic, s - np.floor(s), np.clip(s, 0.0, 1.0))
        if self.flip:
            odd = np.floor(s[:, 0]) % 2 == 1
            other = 1 - s[:, 1]
            other = other - np.floor(other) if self.periodic[1] else np.clip(other, 0.0, 1.0)
            wrapped[:, 1] = np.where(odd, other, wrapped[:, 1])
        return wrapped

    def snap_to_bounds(self, s: Floats) -> Floats:
        """Return ``s`` (n, m) with parameters within rounding of a bound of a bounded parameter set to 0 or 1."""
        s = np.where(~self.periodic & (s < AT_BOUND_SHARE), 0.0, s)
        return np.where(~self.periodic & (s > 1 - AT_BOUND_SHARE), 1.0, s)

    def neighbours(self, shape: tuple[int, ...]) -> Ints:
        """Return the neighbours (c, 3^m - 1) of each cell of a grid of ``shape`` cells; itself where there is none."""
        cells = np.stack(np.unravel_index(np.arange(np.prod(shape)), shape), axis=1)
        offsets = np.stack(np.meshgrid(*[[0, 1, -1]] * len(shape), indexing="ij"), axis=-1).reshape(-1, len(shape))[1:]
        around = (cells[:, None] + offsets).reshape(-1, len(shape))
        centres = (around + 0.5) / shape
        indices = np.floor(self.wrap_parameters(centres) * shape).astype(np.int64)
        beyond = ((around < 0) | (around >= shape)) & ~self.periodic
        from_cells = np.repeat(cells, len(offsets), axis=0)
        indices = np.where(beyond.any(axis=1)[:, None], from_cells, np.minimum(indices, np.array(shape) - 1))
        return np.asarray(np.ravel_multi_index(tuple(indices.T), shape).reshape(len(cells), -1), dtype=np.int64)

    def ends(self, shape: tuple[int, ...]) -> Floats:
        """Return (c, m): 0 or 1 where a cell of a grid of ``shape`` touches that end, bounded and no pole; else NaN."""
        cells = np.stack(np.unravel_index(np.arange(np.prod(shape)), shape), axis=1)
        ends = np.where(cells == 0, 0.0, np.where(cells == np.array(shape) - 1, 1.0, np.nan))
        ends = np.where(self.periodic, np.nan, ends)
        if self.poles is None:
            return ends
        pole = ((ends == 0) & self.poles[:, 0]) | ((ends == 1) & self.poles[:, 1])
        return np.where(pole, np.nan, ends)


def side_points(map: UnitMap, axis: int, end: float) -> Floats:
    """Return points (65, 3), of a curve (1, d), where parameter ``axis`` is ``end``, 0 or 1, in order of the other."""
    s = np.full((SIDE_SAMPLES if map.count == 2 else 1, map.count), end)
    if map.count == 2:
        s[:, 1 - axis] = np.linspace(0, 1, SIDE_SAMPLES)
    return map.value(s)


def check_gluing(map: UnitMap, domain: Domain, names: str, size: float) -> None:
    """Raise InputError, with the largest gap, if ends that ``domain`` glues are more than 1e-9 of ``size`` apart.

    ``names`` are the parameters' letters, ``size`` is the diagonal of the image's box.
    """
    for axis in np.flatnonzero(domain.periodic):
        start, end = side_points(map, int(axis), 0.0), side_points(map, int(axis), 1.0)
        if domain.flip and axis == 0:
            end = end[::-1]
        gap = float(np.linalg.norm(start - end, axis=1).max())
        if gap > GLUED_ENDS_SHARE * size:
            how = "with the other parameter flipped" if domain.flip and axis == 0 else "as a periodic one must"
            raise InputError(
                f"The two ends of the range of {names[axis]} do not meet, {how}: they are up to {gap:.6g} apart; "
                "correct the range or the formulas, or declare it bounded."
            )


@dataclass(frozen=True, eq=False)
class Sides:
    """The edges and poles at the ends of the parameters.

    Attributes
    ----------
    loops : (m, 2) int64
        Number of the edge loop (or curve end) at the start and end of each parameter; -1: no edge. Of two loops, 0 is
        the longer.
    collapsed : (m, 2) bool
        Sides that the map sends to one point, like the poles of a sphere.
    """

    loops: Ints
    collapsed: Bools

    def edge(self, s: Floats) -> Ints:
        """Return the number (n,) of the edge at which unit parameters ``s`` (n, m) are exactly 0 or 1; -1 for none."""
        edge = np.full(len(s), -1)
        for axis in range(s.shape[1]):
            for end in (0, 1):
                at = s[:, axis] == end
                edge[at] = np.maximum(edge[at], self.loops[axis, end])
        return edge.astype(np.int64)

    def on_pole(self, s: Floats) -> Bools:
        """Return (n,) whether unit parameters ``s`` (n, m) lie exactly on a collapsed side."""
        pole = np.zeros(len(s), dtype=np.bool_)
        for axis, end in np.argwhere(self.collapsed):
            pole |= s[:, axis] == end
        return pole


def find_sides(map: UnitMap, domain: Domain, size: float) -> Sides:
    """Return the poles and the edge loops at the ends of parameters: of a curve its ends 0, 1.

    A side whose image is no longer than 1e-9 of ``size``, the diagonal of the whole image's box, is a pole. If one
    parameter is bounded, its longer side is loop 0, the other 1. If two are, their sides are one loop, 0, and so are
    those of a flipped ``domain``.
    """
    if map.count == 1:
        ends = np.array([[-1, -1]] if domain.periodic[0] else [[0, 1]], dtype=np.int64)
        return Sides(ends, np.zeros((1, 2), dtype=np.bool_))
    lengths = np.array([[_polyline_length(side_points(map, axis, end)) for end in (0.0, 1.0)] for axis in (0, 1)])
    collapsed = (lengths <= GLUED_ENDS_SHARE * size) & ~domain.periodic[:, None]
    open_sides = ~domain.periodic[:, None] & ~collapsed
    loops = np.where(open_sides, 0, -1)
    bounded = np.flatnonzero(~domain.periodic)
    if len(bounded) == 1 and not domain.flip and open_sides[bounded[0]].all():
        loops[bounded[0]] = [0, 1] if lengths[bounded[0], 0] >= lengths[bounded[0], 1] else [1, 0]
    return Sides(loops.astype(np.int64), collapsed)


def _polyline_length(points: Floats) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
