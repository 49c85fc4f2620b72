"""A tree of parameter cells that finds, for each query, every cell that may hold its closest point.

A cell's image lies within ``deviation`` of a disc: centre, tangent plane, radius. The distance to the
disc less the deviation bounds the distance to the cell from below, to second order in the cell's size, so
that few cells survive next to the one that holds the foot, however the shape bends back on itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cpmkit.plugin import Bools, Floats, InputError, Ints
from cpmkit_parametric.domain import Domain
from cpmkit_parametric.maps import UnitMap

#: Deviations are measured at samples; between them they may be larger.
DEVIATION_SAFETY_FACTOR = 1.5
#: Rounding of the disc's distance, as a share of its radius.
DISC_ROUNDING_SHARE = 1e-6
#: Cells are halved until nineteen in twenty deviate by less than this share of their radius.
FLAT_CELL_SHARE = {1: 0.04, 2: 0.08}
MOST_CELLS = {1: 2**15, 2: 2**17}
#: In a cell that does not wind, no point moves faster than this times the span of the cell.
FASTEST_CELL_SPANS = 3.0
#: Starts of the descent for one query; more are found only where the distance is all but constant.
MOST_QUERY_STARTS = 8
#: Largest number of pairs of a query and a cell in memory.
MOST_QUERY_CELL_PAIRS = 1 << 21
#: For each query there is room for so many at first: two to six are usual.
USUAL_CELLS_OF_QUERY = 32


@dataclass(frozen=True, eq=False)
class Level:
    """The cells of one size.

    Attributes
    ----------
    shape : tuple of int
        Cells along each parameter; all arrays are in C order.
    centres, tangents : (c, d), (c, m, d) float64
        Image of the middle, and an orthonormal basis of the disc's plane (zero where it is degenerate).
    radii, deviations : (c,) float64
        Of the disc, and from it.
    spans : (c, m, d) float64
        Difference of the images of opposite ends.
    """

    shape: tuple[int, ...]
    centres: Floats
    tangents: Floats
    radii: Floats
    deviations: Floats
    spans: Floats

    def distances(self, x: Floats, cell: Ints) -> tuple[Floats, Floats]:
        """Return distances (k,) of queries ``x`` (k, d) to the discs of cells ``cell`` (k,), and to their centres."""
        apart = x - self.centres[cell]
        squared = np.einsum("kd,kd->k", apart, apart)
        along = np.zeros(len(x))
        for axis in range(len(self.shape)):
            along += np.einsum("kd,kd->k", apart, self.tangents[cell, axis]) ** 2
        beyond = np.maximum(np.sqrt(along) - self.radii[cell], 0.0)
        return np.sqrt(np.maximum(squared - along, 0.0) + beyond**2), np.sqrt(squared)


@dataclass(frozen=True, eq=False)
class Starts:
    """Starts of descents: one row for each query and parameter neighbourhood that may contain its foot.

    Attributes
    ----------
    query : (k,) int64
        Sorted; every query occurs.
    parameters : (k, m) float64
        Unit parameters.
    """

    query: Ints
    parameters: Floats


@dataclass(frozen=True, eq=False)
class CellTree:
    """Levels from coarse to fine, each with half the cells' size in every parameter.

    Attributes
    ----------
    levels : tuple of Level
    neighbours : (c, 3^m - 1) int64
        Of the finest cells, the cell itself where there is none.
    ends : (c, m) float64
        Of the finest cells: 0 or 1 where the cell touches that end of a bounded parameter, else NaN.
    inverses : (c, d, m) float64
        Of the finest cells' spans: from a displacement to cells.
    """

    levels: tuple[Level, ...]
    neighbours: Ints
    ends: Floats
    inverses: Floats

    @property
    def finest(self) -> Level:
        """The level on which a search ends."""
        return self.levels[-1]

    @cached_property
    def box(self) -> Floats:
        """(2, d) corners of a box around the image."""
        level = self.finest
        reach = level.radii[:, None] * np.sqrt(np.einsum("cmd,cmd->cd", level.tangents, level.tangents))
        reach += level.deviations[:, None]
        return np.stack([(level.centres - reach).min(axis=0), (level.centres + reach).max(axis=0)])

    @cached_property
    def neighbours_along(self) -> Ints:
        """(c, 3^m - 1) the neighbours that touch all ends that the cell touches; the cell itself in place of others."""
        touches = np.isfinite(self.ends)
        same = (self.ends[self.neighbours] == self.ends[:, None]) | ~touches[:, None]
        return np.where(same.all(axis=2), self.neighbours, np.arange(len(self.ends))[:, None])

    def descent_starts(self, x: Floats) -> Starts:
        """Return the starts for queries ``x`` (n, d): one in each valley of the distance, inside and along the ends.

        A query has at most eight of either, the nearest. A valley inside and another along an end may be a cell apart.
        """
        survivors_of_queries = self._surviving_pairs(x)
        if survivors_of_queries is None:  # too many pairs at a time
            half = len(x) // 2
            first, second = self.descent_starts(x[:half]), self.descent_starts(x[half:])
            return Starts(
                np.concatenate([first.query, second.query + half]),
                np.concatenate([first.parameters, second.parameters]),
            )
        from cpmkit_parametric.start_kernels import find_starts

        finest = self.finest
        along = self.neighbours, self.neighbours_along, self.ends
        of_cells = np.array(finest.shape), finest.centres, self.inverses
        return Starts(*find_starts(np.ascontiguousarray(x), survivors_of_queries, *along, *of_cells, MOST_QUERY_STARTS))

    def _surviving_pairs(self, x: Floats) -> tuple[Ints, Ints, Floats] | None:
        """Return query, finest cell, disc distance (p,) of pairs that may be closest to ``x``; None if too many."""
        from cpmkit_parametric.cell_kernels import fill_survivors

        most, x = min(len(x) * len(self.finest.radii), MOST_QUERY_CELL_PAIRS), np.ascontiguousarray(x)
        for room in (min(most, USUAL_CELLS_OF_QUERY * len(x)), most):
            query, cell, distance = np.empty(room, np.int64), np.empty(room, np.int64), np.empty(room)
            count = fill_survivors(x, *self._level_arrays, query, cell, distance)
            if count >= 0:
                return query[:count].copy(), cell[:count].copy(), distance[:count].copy()
        return None

    @cached_property
    def _level_arrays(self) -> tuple[Ints, Ints, Floats, Floats, Floats, Floats]:
        """The levels' shapes, each level's first cell, and centres, tangents, radii and deviations of all cells."""
        first = np.cumsum([0, *(len(level.radii) for level in self.levels[:-1])])
        centres, tangents, radii, deviations = (
            np.ascontiguousarray(np.concatenate([getattr(level, name) for level in self.levels]))
            for name in ("centres", "tangents", "radii", "deviations")
        )
        return np.array([level.shape for level in self.levels]), first, centres, tangents, radii, deviations


def build_tree(map: UnitMap, domain: Domain) -> CellTree:
    """Return the tree of cells of ``map``, halved until 19 in 20 of the finest are flat.

    At most, the finest are 2^15, of a surface 2^17. Raise InputError if more than half of these are not flat: the map
    winds more often than they resolve.
    """
    shape = _coarsest_shape(map)
    m = map.count
    doublings = 2 if m == 2 else 4
    while True:
        finest = tuple(n << doublings for n in shape)
        points = _grid_points(map, finest)
        level = _build_level(points, finest)
        cells = int(np.prod(finest))
        rough = (level.deviations > FLAT_CELL_SHARE[m] * DEVIATION_SAFETY_FACTOR * level.radii) & (level.radii > 0)
        winding = _winding_cells(map, level)
        if cells << m > MOST_CELLS[m] or (np.mean(rough) < 0.05 and np.mean(winding) < 0.02):
            break
        doublings += 1
    if np.mean(rough | winding) > 0.5:
        raise InputError(
            f"x winds or bends more often than {cells} cells resolve; use a shorter range, or fewer windings in it."
        )
    levels = [_build_level(points, tuple(n << k for n in shape)) for k in range(doublings)]
    inverses = np.linalg.pinv(level.spans.transpose(0, 2, 1), rcond=1e-6).transpose(0, 2, 1)
    neighbours, ends = domain.neighbours(finest), domain.ends(finest)
    return CellTree((*levels, level), neighbours, ends, np.ascontiguousarray(inverses))


def _winding_cells(map: UnitMap, level: Level) -> Bools:
    """Return (c,) in which cells a random point lies off the disc, or moves much faster than the cell's span.

    Samples at equal distances alone miss what winds in step with them, and a helix looks straight from afar.
    """
    numbers = np.arange(len(level.radii))
    inside = np.stack(np.unravel_index(numbers, level.shape), axis=1) + np.random.default_rng(0).uniform(
        size=(len(numbers), len(level.shape))
    )
    points, slopes, _ = map.jet(inside / level.shape)
    winding = level.distances(points, numbers)[0] > level.deviations
    for axis, count in enumerate(level.shape):
        speed = np.linalg.norm(slopes[:, axis], axis=1) / count
        winding |= speed > FASTEST_CELL_SPANS * np.linalg.norm(level.spans[:, axis], axis=1)
    return winding


def _coarsest_shape(map: UnitMap) -> tuple[int, ...]:
    """Return the number of the coarsest cells along each parameter, by which they are about equally long in both.

    On a curve it is 8, on a surface a power of two from 2 to 32: images longer than 16 times their width get long
    cells.
    """
    if map.count == 1:
        return (8,)
    s = np.linspace(0, 1, 33)
    u, v = np.meshgrid(s, s, indexing="ij")
    points = map.value(np.stack([u.ravel(), v.ravel()], axis=1)).reshape(33, 33, -1)
    lengths = [np.linalg.norm(np.diff(points, axis=k), axis=-1).sum(axis=k).mean() for k in (0, 1)]
    shortest = min(lengths) or 1.0
    shares = [np.clip(length / shortest, 1, 16) for length in lengths]
    return tuple(2 * 2 ** int(np.round(np.log2(share))) for share in shares)


def _grid_points(map: UnitMap, shape: tuple[int, ...]) -> Floats:
    """Return the images (2 n_1 + 1, ..., d) of the corners and middles of a grid of ``shape`` (n_1, ...) cells."""
    axes = np.meshgrid(*[np.linspace(0, 1, 2 * n + 1) for n in shape], indexing="ij")
    points = map.value(np.stack([axis.ravel() for axis in axes], axis=1))
    return points.reshape(*axes[0].shape, -1)


def _build_level(points: Floats, shape: tuple[int, ...]) -> Level:
    """Return the level of ``shape`` cells from ``points`` (..., d) on a grid with an even number of steps a cell."""
    steps = [(points.shape[k] - 1) // n for k, n in enumerate(shape)]
    windows = [np.arange(n)[:, None] * step + np.arange(step + 1) for n, step in zip(shape, steps, strict=True)]
    cells = int(np.prod(shape))
    if len(shape) == 1:
        patch = points[windows[0]]
        spans = (patch[:, -1] - patch[:, 0])[:, None]
        centres = patch[:, steps[0] // 2]
    else:
        patch = points[windows[0][:, None, :, None], windows[1][None, :, None, :]]
        patch = patch.reshape(cells, steps[0] + 1, steps[1] + 1, -1)
        i, j = steps[0] // 2, steps[1] // 2
        spans = np.stack([patch[:, -1, j] - patch[:, 0, j], patch[:, i, -1] - patch[:, i, 0]], axis=1)
        centres = patch[:, i, j]
    tangents = _orthonormal_basis(spans)
    apart = patch.reshape(cells, -1, points.shape[-1]) - centres[:, None]
    along = np.einsum("cpd,cmd->cpm", apart, tangents)
    off = np.linalg.norm(apart - np.einsum("cpm,cmd->cpd", along, tangents), axis=2).max(axis=1)
    radii = np.linalg.norm(along, axis=2).max(axis=1)
    return Level(
        shape,
        np.ascontiguousarray(centres),
        tangents,
        radii,
        DEVIATION_SAFETY_FACTOR * off + DISC_ROUNDING_SHARE * radii,
        spans,
    )


def _orthonormal_basis(spans: Floats) -> Floats:
    """Return an orthonormal basis (c, m, d) of ``spans`` (c, m, d), a zero vector where they are parallel or zero."""
    basis = np.zeros_like(spans)
    for k in range(spans.shape[1]):
        rest = spans[:, k]
        for j in range(k):
            rest = rest - np.einsum("cd,cd->c", rest, basis[:, j])[:, None] * basis[:, j]
        length = np.linalg.norm(rest, axis=1)
        independent = length > 1e-6 * np.linalg.norm(spans, axis=(1, 2))
        basis[:, k] = np.where(independent[:, None], rest / np.where(independent, length, 1.0)[:, None], 0.0)
    return basis
