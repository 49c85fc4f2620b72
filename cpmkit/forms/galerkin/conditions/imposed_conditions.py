"""The conditions of a scene, each imposed at some of the boundary samples, and fluxes that depend on the solution."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from cpmkit.errors import SceneError, place
from cpmkit.forms.galerkin.conditions.boundary_samples import POINTS_OF_EDGE, BoundarySamples
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import norms
from cpmkit.mesh.part_borders import PartAt
from cpmkit.runtime.arrays import whole
from cpmkit.scene.conditions import same_condition
from cpmkit.scene.edge_conditions import EdgeLoopError, conditions_along, loops_of_edge
from cpmkit.scene.junction import JunctionSide
from cpmkit.scene.laws import Mixed, Value, checked_beta
from cpmkit.scene.point_values import point_value_warnings, short_curve_warnings
from cpmkit.scene.scene import Scene
from cpmkit.types import SIDES, Bools, Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


#: Values on a curve in a surface have no visible effect if the diagonal of its bounding box is shorter, in spacings.
SMALL_SPACINGS = 1 / 3
#: The loop of the rim is looked up at this distance outside a sample, in spacings: rounding may move samples inside.
PAST_RIM_SPACINGS = 0.1
#: A flux j(u) counts as independent of u if |j'(u)| times the spacing is at most this: rounding, or difference errors.
LEAST_SLOPE = 1e-9


@dataclass(frozen=True, eq=False)
class Tie:
    """Continuity of u and balance of fluxes at a tie: facets, as at a crease, where the mesh is cut on no boundary."""

    couples: ClassVar[bool] = True
    involves_value: ClassVar[bool] = False
    data: ClassVar[tuple[()]] = ()

    @property
    def of_laplacian(self) -> Tie:
        """The law for Lap u in biharmonic problems: Lap u is continuous too."""
        return self


@dataclass(frozen=True, eq=False)
class ImposedCondition:
    """A law, and the samples at which it is imposed."""

    law: Any  #: Law or Tie: the law of the scene's condition, or the continuity of u where the mesh is cut.
    label: str  #: Name of the place in messages.
    #: The samples (k,); for a law that couples both sides the samples on the left, then those at the same points on the
    #: right; for a tie the samples of each lip: of each cell that meets the others there.
    sides: tuple[Ints, ...]
    kind: str = ""  #: The name of the condition.

    @property
    def rows(self) -> Ints:
        """The samples (k,) on the first side."""
        return self.sides[0]

    @property
    def all_rows(self) -> Ints:
        """The samples on all sides, one side after the other."""
        return np.concatenate(self.sides)


class ClosedManifoldError(SceneError):
    """A condition is given for the edge of a manifold that has none."""


def conditions_with_law(conditions: Iterable[ImposedCondition], *kinds: type) -> list[ImposedCondition]:
    """Return those ``conditions`` whose law is an instance of one of the classes ``kinds``."""
    return [condition for condition in conditions if isinstance(condition.law, kinds)]


def join_values(conditions: Iterable[ImposedCondition], values: Callable[[ImposedCondition], Any]) -> Floats:
    """Return ``values(each)``, a number or (k_i,), for each of the ``conditions`` at its k_i rows, concatenated."""
    return np.concatenate([np.broadcast_to(np.float64(values(each)), len(each.rows)) for each in conditions])


def needs_rims(scene: Scene) -> bool:
    """Return whether the scene gives the edge of the manifold conditions other than zero flux, or loop by loop."""
    return (isinstance(scene.edge, Mapping) and bool(scene.edge)) or not all(
        one.law.is_zero_flux for one in scene.edge_conditions
    )


def part_function(scene: Scene, lattice: Lattice) -> PartAt | None:
    """Return the function that gives the part of the edge at points relative to the lattice's origin; None if no parts.

    Parts with equal conditions count as one. If loops have different parts, the result is the combination of the parts
    that each loop would have at the point.
    """
    loops = []
    for loop in loops_of_edge(scene.edge).values():
        conditions = [part.condition for part in loop.parts]
        first = [next(k for k, one in enumerate(conditions) if same_condition(one, each)) for each in conditions]
        if any(first):
            loops.append((loop, np.array(first)))

    def part_at(points: Floats) -> Ints:
        number = np.zeros(len(points), dtype=np.int64)
        for loop, first in loops:
            number = number * len(first) + first[loop.part_at(lattice.to_scene(points))]
        return number

    return part_at if loops else None


def imposed_conditions(
    scene: Scene, samples: BoundarySamples, left: Bools, surface: LocalSource, lattice: Lattice
) -> tuple[ImposedCondition, ...]:
    """Return the conditions of a scene, and continuity at ties, each with the samples at which it is imposed.

    Raises SceneError if a law couples two sides where there are not two, if a condition other than a value is given at
    a point of a surface, if a condition is given for an edge, a loop or a part that the manifold does not have, or if a
    loop or a part has none. Raises InputError if beta of a Robin condition is zero at all points, or a loop no number.

    ``scene``: the scene; ``samples.owner`` are the numbers of its boundaries.
    ``samples``: the samples on boundaries, and on rims if :func:`needs_rims`.
    ``left`` (b,): whether each sample is on the left of its boundary.
    ``surface``: the manifold relative to the lattice's origin, with the numbers of the loops of its rim.
    ``lattice``: the coordinates of samples are relative to its origin.
    """
    conditions = [
        *_boundary_conditions(scene, samples, left, lattice),
        *_rim_conditions(scene, samples, surface, lattice),
    ]
    conditions += tie_conditions(samples)
    for condition in conditions_with_law(conditions, Mixed):
        checked_beta(condition.law, condition.kind, lattice.to_scene(samples.points[condition.rows]), condition.label)
    return tuple(conditions)


def _boundary_conditions(
    scene: Scene, samples: BoundarySamples, left: Bools, lattice: Lattice
) -> Iterator[ImposedCondition]:
    """Yield the conditions on boundaries with their samples; equal conditions on both sides are yielded as one.

    ``left`` (b,) is whether each sample is on the left. Boundaries without samples yield nothing. Raises SceneError if
    a condition other than a value is at a point, or if a condition couples sides where there are not two.
    """
    for number, boundary in enumerate(scene.boundaries):
        label = f"boundary {boundary.name!r}"
        on_boundary = (samples.owner == number) & ~samples.beyond_tip
        first, second = (boundary.condition(side) for side in SIDES)
        if not np.any(on_boundary):
            continue
        kinds = {condition.kind for condition in (first, second) if not isinstance(condition.law, Value)}
        if kinds and np.any(samples.half[on_boundary] < 0):
            raise SceneError(
                f"{label}: a {' or '.join(sorted(kinds))} condition at a point of a surface has no effect, since a "
                "point has no length for a flux; for a point source give f = PointSource(at, strength), else use a "
                "small circle."
            )
        if first.couples:
            pairs = _paired_samples(label, samples, left, on_boundary, lattice)
            yield ImposedCondition(first.law, label, pairs, first.kind)
        elif same_condition(first, second):
            yield ImposedCondition(first.law, label, (np.flatnonzero(on_boundary),), first.kind)
        else:
            for condition, side in ((first, left), (second, ~left)):
                yield ImposedCondition(condition.law, label, (np.flatnonzero(on_boundary & side),), condition.kind)


def _paired_samples(
    label: str, samples: BoundarySamples, left: Bools, on: Bools, lattice: Lattice
) -> tuple[Ints, Ints]:
    """Return the samples (k,) on the left and the samples (k,) on the right of a boundary, at the same points.

    ``left`` and ``on`` (b,) are whether each sample is on the left, and on this boundary, which errors call ``label``.
    Raises SceneError if the boundary has one side or more than two somewhere.
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
            f"{label} couples two sides and lies {alone}, near {place(lattice.to_scene(samples.points[row])[0])}; "
            "end it there, or give conditions of one side."
        )
    return sides[0], sides[1]


def _covers_rims(samples: BoundarySamples) -> bool:
    """Return whether a facet where the mesh is cut lies on a rim, with one cell beside it."""
    pairs = np.unique(np.stack([samples.facet, samples.half], axis=1)[samples.facet >= 0], axis=0)
    return bool(np.any(np.bincount(pairs[:, 0]) == 1))


def _rim_conditions(
    scene: Scene, samples: BoundarySamples, surface: LocalSource, lattice: Lattice
) -> Iterator[ImposedCondition]:
    """Yield the conditions on the edge of the manifold with their samples, if :func:`needs_rims`.

    Raises SceneError and InputError for the edge as :func:`imposed_conditions`.
    """
    if not needs_rims(scene):
        return
    rows, loop_of = np.flatnonzero(samples.on_rim), np.zeros(0, dtype=np.int64)
    if isinstance(scene.edge, Mapping):
        loop_of = rim_loops(samples.take(rows), surface, lattice.spacing)
        loops = np.unique(loop_of).tolist()
        # None is all others; a junction's loop may be an end at which members of one dimension join
        given = [loop for loop, one in scene.edge.items() if loop is not None and not isinstance(one, JunctionSide)]
        missing = sorted({whole(loop, "a key of `edge`, the number of a loop,") for loop in given} - set(loops))
        if missing:
            numbers = [loop for loop in loops if loop >= 0]
            unnumbered = "its source gives no edge a number, `edge` is -1 on the rim" if loops else "it is closed"
            named = "its loops are {loops}" if numbers else unnumbered
            raise EdgeLoopError(
                f"`edge` gives a condition for loop {{loop}}, and the manifold has no such loop: {named}; leave it "
                "out, or correct the number.",
                missing[0],
                given,
                numbers,
            )
    elif not len(rows) and not _covers_rims(samples):
        raise ClosedManifoldError("the manifold is closed and has no edge, so `edge` cannot be given; leave it out.")
    conditions = conditions_along(scene.edge, loop_of, lattice.to_scene(samples.points[rows]))
    for condition, chosen in conditions:
        yield ImposedCondition(condition.law, "the edge's condition", (rows[chosen],), condition.kind)


def rim_loops(samples: BoundarySamples, surface: LocalSource, spacing: float) -> Ints:
    """Return the number (k,) of the rim loop at each sample, if unknown that of the nearest sample; -1 if all are."""
    from scipy.spatial import KDTree

    target: Floats = samples.points + PAST_RIM_SPACINGS * spacing * samples.conormals
    loops = surface.closest_point(target).edge.copy()
    unknown = loops < 0
    if unknown.any() and not unknown.all():  # beside corners, where another part of the manifold is nearer
        loops[unknown] = loops[~unknown][KDTree(samples.points[~unknown]).query(samples.points[unknown])[1]]
    return np.asarray(loops, dtype=np.int64)


def tie_conditions(samples: BoundarySamples) -> Iterator[ImposedCondition]:
    """Yield the conditions of continuity at ties, one for each number of lips (cells that meet at a facet)."""
    rows = np.flatnonzero(samples.on_tie)
    key = POINTS_OF_EDGE * samples.facet[rows] + samples.place[rows]
    order = rows[np.argsort(key, kind="stable")]
    lips = np.unique(key, return_counts=True)[1]
    starts = np.cumsum(lips) - lips
    for count in np.unique(lips[lips > 1]).tolist():
        first = starts[lips == count]
        yield ImposedCondition(Tie(), "a crease or junction", tuple(order[first + k] for k in range(count)))


def point_warnings(
    scene: Scene, samples: BoundarySamples, spacing: float, interior: tuple[Floats, Floats] | None = None
) -> tuple[str, ...]:
    """Return warnings about values at points of a surface, where u has no limit, and about very short curves.

    ``interior`` are points (n, d) on the manifold, in the scene's coordinates, and their quadrature weights (n,), for
    the integral of a source; None if they are not known. ``spacing`` is h.
    """
    names = [boundary.name for boundary in scene.boundaries]
    at_points = samples.owner[samples.half < 0]
    points = {names[number]: int(np.sum(at_points == number)) for number in np.unique(at_points)}
    on_facet, sizes = (samples.half >= 0) & ~samples.beyond_tip, {}
    for number, name in enumerate(names):  # the diagonal of the box around a boundary's samples on facets
        places = samples.points[on_facet & (samples.owner == number)]
        sizes[name] = float(norms(np.ptp(places, axis=0))) if len(places) else np.inf
    least = SMALL_SPACINGS * spacing
    return (*point_value_warnings(scene, points, interior), *short_curve_warnings(scene, sizes, spacing, least))


@dataclass(frozen=True, eq=False)
class StateFluxSamples:
    """Boundary samples with the condition du/db = j(u)."""

    #: The condition; its law has j, its derivative and the value at which Newton's method starts.
    condition: ImposedCondition
    points: Floats  #: (k, d): the points of the samples, in the scene's coordinates.
    values: csr_array  #: (k, n): evaluates u at the samples.
    spacing: float  #: The spacing h of the lattice.

    @property
    def guess(self) -> float:
        """The value of u at which Newton's method starts."""
        return float(self.condition.law.guess)

    def read(self, u: Floats) -> Floats:
        """Return the values (k,) of u at the samples, from the unknowns ``u`` (n, 1)."""
        return np.asarray((self.values @ u)[:, 0])

    def grows(self, seen: Floats) -> bool:
        """Return whether |j'(u)| times the spacing exceeds `LEAST_SLOPE` for a value ``seen`` (k,) at the samples."""
        return bool(np.any(np.abs(self.condition.law.slope_at(seen, self.points)) * self.spacing > LEAST_SLOPE))

    def linearise(self, seen: Floats) -> ImposedCondition:
        """Return the condition ``du/db = j(v) + j'(v) (u - v)``, v = ``seen`` (k,); a flux unless :meth:`grows`."""
        return replace(self.condition, law=self.condition.law.tangent(seen, self.points, self.grows(seen)))
