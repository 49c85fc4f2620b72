"""Which law of a scene holds at which boundary samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.errors import InputError, SceneError, place
from cpmkit.forms.galerkin.conditions.boundary_samples import POINTS_OF_EDGE, BoundarySamples
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import norms
from cpmkit.runtime.arrays import whole
from cpmkit.scene.conditions import Condition, same_condition
from cpmkit.scene.edge_conditions import LoopConditions, check_parts_used, conditions_along
from cpmkit.scene.laws import Flux, Interface, Law, Mixed, Nonlinear, Spectral, Value, beta_at, is_zero_neumann
from cpmkit.scene.point_values import point_value_warnings, short_curve_warnings
from cpmkit.scene.scene import Scene
from cpmkit.types import SIDES, Bools, Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


#: The edge's condition, in sentences.
EDGE_CONDITION = "the edge's condition"
#: A curve of a surface that is smaller than so many spacings is too small for its values to be felt.
SMALL_SPACINGS = 1 / 3
#: Loops of the rim are asked for so many spacings past it: a sample may lie inside by a rounding.
PAST_RIM_SPACINGS = 0.1


@dataclass(frozen=True, eq=False)
class ImposedCondition:
    """A law, and the samples at which it holds.

    Attributes
    ----------
    law : Law
        Of a scene; past the tips of a boundary that of a coupling without jump and flux.
    what : str
        Where it holds, in sentences.
    rows : (k,) int64
        The samples; of a law that couples sides, those on the left.
    across : (k,) int64
        Of a law that couples sides, the samples at the same points on the right; else none.
    seam : bool
        Whether it lies past a tip, where u goes on.
    kind : str
        What the condition is called.
    """

    law: Law
    what: str
    rows: Ints
    across: Ints
    seam: bool = False
    kind: str = ""

    @property
    def ties(self) -> bool:
        """Whether u itself is held there, or coupled to another side, and not its slope alone."""
        return not isinstance(self.law, (Flux, Nonlinear, Spectral))

    @property
    def all_rows(self) -> Ints:
        """The samples on both sides."""
        return np.concatenate([self.rows, self.across])


def needs_rims(scene: Scene) -> bool:
    """Tell whether a scene's edge holds anything but zero flux, which no sample has to say, or names its loops."""
    return (isinstance(scene.edge, Mapping) and bool(scene.edge)) or not all(
        is_zero_neumann(one.law) for one in scene.edge_conditions
    )


def reads_rims(scene: Scene) -> bool:
    """Tell whether anything is read on rims: what holds there, or what a conservative velocity carries out."""
    terms = scene.problem.terms()
    return needs_rims(scene) or (terms.conservative and terms.velocity is not None)


def impose_conditions(
    scene: Scene, samples: BoundarySamples, left: Bools, surface: LocalSource, lattice: Lattice
) -> tuple[ImposedCondition, ...]:
    """Return the laws of a scene with the samples at which each holds.

    Parameters
    ----------
    scene : Scene
        With the boundaries that samples are numbered by.
    samples : BoundarySamples
        With those on rims, where :func:`needs_rims`.
    left : (b,) bool
        Which samples are on the left of their boundary.
    surface : LocalSource
        The manifold, seen from the lattice's origin: it tells loops of the rim apart.
    lattice : Lattice
        That coordinates are relative to.

    Raises
    ------
    SceneError
        If a law couples sides where there is one alone, or three, if a flux is given at a point of a surface, or the
        edge has a condition and the manifold no edge.
    InputError
        If beta is zero all along.
    """
    found = [*_on_boundaries(scene, samples, left, lattice), *_on_rims(scene, samples, surface, lattice)]
    found += _tip_continuations(samples)
    for one in found:
        where = lattice.to_scene(samples.points[one.rows])
        if isinstance(one.law, Mixed) and not np.any(beta_at(one.law, where, one.what)):
            raise InputError(
                f"beta of {one.kind.capitalize()} of {one.what} is zero at all {len(where)} points; use Neumann."
            )
    return tuple(found)


def _on_boundaries(scene: Scene, samples: BoundarySamples, left: Bools, lattice: Lattice) -> Iterator[ImposedCondition]:
    none = np.zeros(0, dtype=np.int64)
    for number, boundary in enumerate(scene.boundaries):
        what = f"boundary {boundary.name!r}"
        on = (samples.owner == number) & ~samples.beyond_tip
        conditions = [boundary.condition(side) for side in SIDES]
        if not np.any(on):
            continue
        if np.any(samples.half[on] < 0):
            _check_point(what, conditions)
        if conditions[0].couples:
            yield ImposedCondition(
                conditions[0].law, what, *_paired_samples(what, samples, left, on, lattice), kind=conditions[0].kind
            )
        elif same_condition(*conditions):
            yield ImposedCondition(conditions[0].law, what, np.flatnonzero(on), none, kind=conditions[0].kind)
        else:
            for condition, side in zip(conditions, (left, ~left), strict=True):
                yield ImposedCondition(condition.law, what, np.flatnonzero(on & side), none, kind=condition.kind)


def _check_point(what: str, conditions: list[Condition]) -> None:
    kinds = {one.kind for one in conditions if not isinstance(one.law, Value)}
    if kinds:
        raise SceneError(
            f"{what}: a {' or '.join(sorted(kinds))} condition at a point of a surface has no effect: what flows "
            "through so little vanishes with the spacing; if a point source is meant, let f be a narrow bump with its "
            "strength as the integral, or use a small circle."
        )


def _paired_samples(what: str, samples: BoundarySamples, left: Bools, on: Bools, lattice: Lattice) -> tuple[Ints, Ints]:
    """Return the samples on the left and those on the right of one boundary, at the same points.

    Raises
    ------
    SceneError
        Where there are not two sides.
    """
    key = POINTS_OF_EDGE * samples.facet + samples.place
    sides = [
        rows[np.argsort(key[rows], kind="stable")] for rows in (np.flatnonzero(on & left), np.flatnonzero(on & ~left))
    ]
    counts = [np.bincount(key[rows], minlength=int(key.max()) + 1) for rows in sides]
    bad = np.flatnonzero((counts[0] != counts[1]) | (counts[0] > 1))
    if len(bad):
        row = np.flatnonzero(on & (key == bad[0]))
        alone = "on the manifold's rim" if len(row) == 1 else f"where {len(row)} sheets meet"
        raise SceneError(
            f"{what} couples two sides and lies {alone}, near {place(lattice.to_scene(samples.points[row])[0])}; "
            "end it there, or give conditions of one side."
        )
    return sides[0], sides[1]


def _on_rims(
    scene: Scene, samples: BoundarySamples, surface: LocalSource, lattice: Lattice
) -> Iterator[ImposedCondition]:
    if not needs_rims(scene):
        return
    rows, none = np.flatnonzero(samples.owner < 0), np.zeros(0, dtype=np.int64)
    if not isinstance(scene.edge, Mapping):
        if not len(rows):
            raise SceneError("`edge` gives a condition, which the manifold has not: it is closed; leave it out.")
        loop_of = none
    else:
        loop_of = _rim_loops_of_table(scene.edge, samples.take(rows), surface, lattice)
    found = conditions_along(scene.edge, loop_of, lattice.to_scene(samples.points[rows]))
    check_parts_used(scene.edge, [condition for condition, _ in found])
    for condition, own in found:
        yield ImposedCondition(condition.law, EDGE_CONDITION, rows[own], none, kind=condition.kind)


def _rim_loops_of_table(
    edge: Mapping[int, LoopConditions], samples: BoundarySamples, surface: LocalSource, lattice: Lattice
) -> Ints:
    """Return the number (k,) of the loop of the rim that each sample lies on.

    Raises
    ------
    SceneError
        If a loop of the table is not among them.
    """
    loop_of = rim_loops(samples, surface, lattice.spacing)
    loops = np.unique(loop_of).tolist()
    missing = sorted({whole(loop, "a key of `edge`, the number of a loop,") for loop in edge} - set(loops))
    if missing:
        named = f"its loops are {', '.join(map(str, loops))}" if loops else "it is closed"
        raise SceneError(
            f"`edge` gives a condition for loop {missing[0]}, which the manifold has not: {named}; leave it out, or "
            "correct the number."
        )
    return loop_of


def rim_loops(samples: BoundarySamples, surface: LocalSource, spacing: float) -> Ints:
    """Return the number (k,) of the loop of the rim that each sample lies on."""
    from scipy.spatial import KDTree

    target: Floats = samples.points + PAST_RIM_SPACINGS * spacing * samples.conormals
    loops = surface.closest_point(target).edge.copy()
    unknown = loops < 0
    if unknown.any() and not unknown.all():  # beside corners, where another part is nearer
        loops[unknown] = loops[~unknown][KDTree(samples.points[~unknown]).query(samples.points[unknown])[1]]
    return np.asarray(loops, dtype=np.int64)


def _tip_continuations(samples: BoundarySamples) -> list[ImposedCondition]:
    """Return where boundaries go on past their tips: all cells beside a facet there are tied, each to the next."""
    rows = np.flatnonzero(samples.beyond_tip)
    key = POINTS_OF_EDGE * samples.facet[rows] + samples.place[rows]
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order[1:]] == key[order[:-1]])
    first, second = rows[order[same]], rows[order[same + 1]]
    return (
        [ImposedCondition(Interface(0.0, 0.0), "the continuation past a tip", first, second, seam=True)]
        if len(first)
        else []
    )


def point_warnings(
    scene: Scene, samples: BoundarySamples, spacing: float, interior: tuple[Floats, Floats] | None = None
) -> tuple[str, ...]:
    """Name values on what is too small: points of a surface, where they have no limit, and curves below the spacing.

    ``interior`` are samples (n, d) of the manifold, in the scene's coordinates, and their weights (n,).
    """
    names = [one.name for one in scene.boundaries]
    at_points = samples.owner[samples.half < 0]
    points = {names[number]: int(np.sum(at_points == number)) for number in np.unique(at_points)}
    sizes = {name: _boundary_size(samples, number) for number, name in enumerate(names)}
    least = SMALL_SPACINGS * spacing
    return (*point_value_warnings(scene, points, interior), *short_curve_warnings(scene, sizes, spacing, least))


def _boundary_size(samples: BoundarySamples, number: int) -> float:
    """Return the diagonal of the bounds of a boundary that is no point, infinite where it has no samples."""
    points = samples.points[(samples.owner == number) & ~samples.beyond_tip & (samples.half >= 0)]
    return float(norms(np.ptp(points, axis=0)[None])[0]) if len(points) else np.inf


#: A flux fixes no constant if u changes it by less than this share of u over a spacing: rounding, or differences.
LEAST_SLOPE = 1e-9


@dataclass(frozen=True, eq=False)
class StateFluxSamples:
    """Samples at which du/db = j(u).

    Attributes
    ----------
    law : Nonlinear
        With j, its slope and the value at which Newton's method starts.
    points : (k, d) float64
        In the scene's coordinates.
    values : csr_array (k, n)
        Rows that read u there.
    spacing : float
        h, of the lattice.
    """

    law: Nonlinear
    points: Floats
    values: csr_array
    spacing: float

    @property
    def guess(self) -> float:
        """Value of u at which Newton's method starts."""
        return self.law.guess

    def read(self, u: Floats) -> Floats:
        """Return u (k,) there, from the unknowns (n, 1)."""
        return np.asarray((self.values @ u)[:, 0])

    def grows(self, seen: Floats) -> bool:
        """Tell whether the flux changes with u, beyond rounding, where u is ``seen``."""
        return _depends_on_solution(self.law, seen, self.points, self.spacing)


@dataclass(frozen=True, eq=False)
class KnownValues:
    """Data whose values (k,) are known at the samples that they belong to, and only there."""

    values: Floats

    def __call__(self, _points: Floats) -> Floats:
        """Return the values."""
        return self.values


def linearised_flux(law: Nonlinear, seen: Floats, points: Floats, spacing: float) -> Mixed | Flux:
    """Return ``du/db = j(v) + j'(v) (u - v)``, v being ``seen`` (k,) at ``points``; a flux where j does not change."""
    slope = law.slope_at(seen, points)
    datum = KnownValues(law.flux_at(seen, points) - slope * seen)
    return Mixed(1.0, KnownValues(-slope), datum) if _depends_on_solution(law, seen, points, spacing) else Flux(datum)


def _depends_on_solution(law: Nonlinear, seen: Floats, points: Floats, spacing: float) -> bool:
    return bool(np.any(np.abs(law.slope_at(seen, points)) * spacing > LEAST_SLOPE))
