"""Check that in a scene of diffusion curves each side shows its own colour and no colour bleeds across a curve.

`python examples/check_curves.py examples/02-nefertiti.toml [SPACING]` solves the scene and prints a table. The problem
is taken to be the Laplace equation, whose solution has no extremes away from the curves.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cpmkit as ck

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

POINTS = 200  # on each curve
CLEAR = 2.0  # in spacings: from a curve's ends, and from other curves


@dataclass(frozen=True)
class SideCheck:
    """How well one side of a curve shows its datum g.

    `error` is the largest |u - g| at those of `POINTS` points, evenly spaced along the curve and read from this side,
    that are farther than `CLEAR` spacings from its ends and from the other curves; `read` counts them.
    """

    curve: str
    side: str
    error: float
    read: int


@dataclass(frozen=True)
class CurveCheck:
    """What the curves of a scene show.

    `data_range` is the range of all Dirichlet data over all channels, and `sides` has one entry a Dirichlet side.
    `jump` is the largest difference along an edge of the surface's mesh, of the length `jump_length`, whose ends are
    both farther than `CLEAR` spacings from every curve. `steepest` is the largest such difference per length, in units
    of the data's range over the smallest distance between two curves: a smooth solution stays below 1, a seam does not.
    `excess` says how far u leaves the range that the data at the rim of its own region allow, over all vertices of that
    mesh: the maximum principle forbids it, and a colour that bleeds does it.
    """

    spacing: float
    data_range: float
    sides: tuple[SideCheck, ...]
    jump: float
    jump_length: float
    steepest: float
    excess: float
    excess_at: tuple[float, ...]

    @property
    def worst(self) -> float:
        """The largest error of a side, as a share of the range of the data."""
        return max(side.error for side in self.sides) / self.data_range

    def __str__(self) -> str:
        rows = [f"{'curve':16s} {'side':6s} {'max |u - g|':>12s} {'points':>7s}"]
        rows += [f"{one.curve:16s} {one.side:6s} {one.error:12.5f} {one.read:7d}" for one in self.sides]
        at = ", ".join(f"{x:.4g}" for x in self.excess_at)
        return "\n".join(
            [
                *rows,
                f"spacing {self.spacing:g}, data range {self.data_range:.3g}, worst side {self.worst:.3%} of it",
                f"largest jump along an edge away from curves {self.jump:.4f}, edge length {self.jump_length:.4g}",
                f"steepest edge {self.steepest:.3f} of the data range over the smallest distance between curves",
                f"largest excess over the data around a region {self.excess:.4f}, at ({at})",
            ]
        )


def check(solution: ck.Solution) -> CurveCheck:
    """Check every curve of `solution`, and the surface between them."""
    points, cells = solution.scene.surface.mesh(solution.spacing)
    edges = np.unique(np.sort(np.concatenate([cells[:, [0, 1]], cells[:, [1, 2]], cells[:, [2, 0]]]), axis=1), axis=0)
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    values = solution.evaluate(points).reshape(len(points), -1)
    distance = np.array([curve.source.closest_point(points).distance for curve in curves(solution)])
    clear = distance.min(axis=0) > CLEAR * solution.spacing
    jump = np.abs(values[edges[:, 0]] - values[edges[:, 1]]).max(axis=1) * clear[edges].all(axis=1)
    beyond = excess(solution, points, edges, distance, values)
    data_range = float(np.ptp(np.concatenate([g.ravel() for g in all_data(solution)])))
    return CurveCheck(
        spacing=solution.spacing,
        data_range=data_range,
        sides=tuple(check_sides(solution)),
        jump=float(jump.max()),
        jump_length=float(length[jump.argmax()]),
        steepest=float((jump / length).max()) * smallest_distance(solution) / data_range,
        excess=float(beyond.max()),
        excess_at=tuple(map(float, points[beyond.argmax()])),
    )


def curves(solution: ck.Solution) -> list[ck.Boundary]:
    """The boundaries that are curves."""
    return [boundary for boundary in solution.scene.boundaries if boundary.source.manifold_dim == 1]


def sample(curve: Any, spacing: float) -> tuple[Floats, Floats]:
    """`POINTS` points (n, 3) evenly spaced along `curve`, and its ends (0 or 2, 3)."""
    points, segments = curve.mesh(spacing)
    start, step = points[segments[:, 0]], points[segments[:, 1]] - points[segments[:, 0]]
    length = np.linalg.norm(step, axis=1)
    reached = np.cumsum(length)
    place = (np.arange(POINTS) + 0.5) / POINTS * reached[-1]
    segment = np.searchsorted(reached, place)
    share = 1 - (reached[segment] - place) / length[segment]
    ends = points[np.bincount(segments.ravel(), minlength=len(points)) == 1]
    return curve.closest_point(start[segment] + share[:, None] * step[segment]).points, ends


def smallest_distance(solution: ck.Solution) -> float:
    """The smallest distance between two curves; the largest side of the surface where there is only one curve."""
    points = [(curve, sample(curve.source, solution.spacing)[0]) for curve in curves(solution)]
    between = [
        float(other.source.closest_point(along).distance.min())
        for curve, along in points
        for other, _ in points
        if other is not curve
    ]
    return min(between, default=float(np.ptp(solution.scene.surface.bounds, axis=0).max()))


def clear_points(solution: ck.Solution, curve: ck.Boundary) -> Floats:
    """The points of `sample` that are farther than `CLEAR` spacings from the curve's ends and from the other curves."""
    points, ends = sample(curve.source, solution.spacing)
    near = CLEAR * solution.spacing
    clear = np.linalg.norm(points[:, None] - ends, axis=2).min(axis=1, initial=np.inf) > near
    for other in solution.scene.boundaries:
        if other is not curve:
            clear &= other.source.closest_point(points).distance > near
    return points[clear]


def dirichlet(curve: ck.Boundary, side: str, points: Floats) -> Floats | None:
    """The data (n, channels) of one side at `points`; None where it is no Dirichlet side."""
    condition = curve.condition(side)
    if not isinstance(condition, ck.Dirichlet):
        return None
    value = condition.value
    entries = [value] if callable(value) or np.ndim(value) == 0 else list(value)
    read = [entry(points) if callable(entry) else np.full(len(points), entry) for entry in entries]
    return np.stack(read, axis=-1).reshape(len(points), -1)


def all_data(solution: ck.Solution) -> list[Floats]:
    """The data of each Dirichlet side at `POINTS` points."""
    points = [(curve, sample(curve.source, solution.spacing)[0]) for curve in curves(solution)]
    read = [dirichlet(curve, side, along) for curve, along in points for side in ("left", "right")]
    return [g for g in read if g is not None]


def check_sides(solution: ck.Solution) -> list[SideCheck]:
    """The largest |u - g| on each Dirichlet side."""
    checks = []
    for curve in curves(solution):
        points = clear_points(solution, curve)
        for side in ("left", "right"):
            g = dirichlet(curve, side, points)
            if g is not None:
                u = solution.evaluate(points, side={curve.name: side}).reshape(len(points), -1)
                checks.append(SideCheck(curve.name, side, float(np.abs(u - g).max(initial=0.0)), len(points)))
    return checks


def excess(solution: ck.Solution, points: Floats, edges: Ints, distance: Floats, values: Floats) -> Floats:
    """How far the values (v, channels) leave the range of the data at the rim of their region, (v,).

    The curves cut the `edges` whose ends see them from opposite sides and are no farther from them than the edge is
    long; regions are what still hangs together.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    cuts = []
    for curve, away in zip(curves(solution), distance, strict=True):
        signed = solution.signed_distance(curve.name, points)[edges]
        cuts.append((curve, signed, (signed.prod(axis=1) < 0) & (away[edges].max(axis=1) <= length)))
    whole = edges[~np.any([cut for _, _, cut in cuts], axis=0)]
    graph = coo_array((np.ones(len(whole)), whole.T), shape=(len(points), len(points)))
    count, region = connected_components(graph, directed=False)
    low, high = np.full((count, values.shape[1]), np.inf), np.full((count, values.shape[1]), -np.inf)
    for curve, signed, cut in cuts:
        for side, on_side in (("left", signed > 0), ("right", signed < 0)):
            g = dirichlet(curve, side, sample(curve.source, solution.spacing)[0])
            if g is not None:
                touched = np.unique(region[edges[cut[:, None] & on_side]])
                low[touched] = np.minimum(low[touched], g.min(axis=0))
                high[touched] = np.maximum(high[touched], g.max(axis=0))
    beyond = np.maximum(values - high[region], low[region] - values).max(axis=1)
    return np.where(np.isfinite(beyond), np.maximum(beyond, 0.0), 0.0)


def report(solution: ck.Solution) -> CurveCheck:
    """Check `solution`, print the table and return it."""
    checked = check(solution)
    print(checked)
    return checked


def main(scene_file: str | Path, spacing: float | None = None) -> CurveCheck:
    """Solve the scene, by default at its own spacing, and report."""
    wanted = ck.load_scene(scene_file)
    return report(ck.solve(wanted.scene, spacing or wanted.spacing, **{**wanted.options, "solver_tolerance": 1e-8}))


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]) if len(sys.argv) > 2 else None)
