"""The Galerkin form on a union of members of different dimension: a form for each dimension, and their junctions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import zip_longest
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import InputError, SceneError
from cpmkit.forms.contract import Discretized
from cpmkit.forms.field import Field
from cpmkit.forms.form_records import Diagnosis, FormTraits, StateDependentCoefficient, StateFlux
from cpmkit.forms.galerkin.conditions.imposed_conditions import conditions_with_law
from cpmkit.forms.galerkin.equation_assembly import GalerkinOperator, multigrid_applies
from cpmkit.forms.galerkin.form import Galerkin
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.galerkin.solve_memory import GalerkinWork
from cpmkit.forms.galerkin.space.energy import scalar_coefficient
from cpmkit.forms.galerkin.unions.junctions import (
    Contact,
    PointContact,
    contact_blocks,
    point_contact_blocks,
)
from cpmkit.forms.galerkin.unions.part_scenes import (
    own_loop_of,
    restrict_data,
    restrict_fields,
    scenes_by_dimension,
    without_edge,
)
from cpmkit.forms.options import Options
from cpmkit.linear.multigrid.solver import Level
from cpmkit.linear.operators import Bordered, CsrOperator, Operator, Stiffness
from cpmkit.linear.residuals import SolveReport
from cpmkit.manifold.mixed_dimension import near_miss_warnings
from cpmkit.runtime.arrays import as_points
from cpmkit.scene.data import Data, Functional, is_sequence
from cpmkit.scene.equations import Terms
from cpmkit.scene.junction import crossed_member_warnings
from cpmkit.scene.laws import Spectral
from cpmkit.scene.scene import Scene
from cpmkit.scene.special_data import ReactionAt
from cpmkit.types import Floats, Ints, Side, Sides, SparseMatrix


@dataclass(frozen=True, eq=False)
class UnionOperator(GalerkinOperator):
    """The operator of a union, with those of its parts."""

    parts: tuple[GalerkinOperator, ...] = ()


@dataclass(frozen=True, eq=False)
class UnionPart:
    """The members of one dimension in a union."""

    numbers: tuple[int, ...]  #: The numbers of the members.
    form: Galerkin  #: The form of the scene on them.
    unknowns: slice  #: Their unknowns among those of the union.
    points: slice  #: Their samples among those of the union.
    taken: Ints  #: (k,): the samples on their edge that lie on other members.
    is_closed: bool  #: Whether they have no edge, so that the scene's conditions there are those of other members.

    def with_scene(self, scene: Scene) -> UnionPart:
        """Return the part with another scene on the same members, which differs in its equation and its data only."""
        scene = without_edge(scene) if self.is_closed else scene
        return replace(self, form=self.form.with_scene(scene)).without_taken_edge()

    def without_taken_edge(self) -> UnionPart:
        """Return the part with the conditions on the edge imposed off other members only."""
        kept = []
        for condition in self.form.conditions:
            rows = condition.rows
            if condition.label == "the edge's condition":
                rows = rows[~np.isin(rows, self.taken)]
                if not len(rows) and isinstance(self.form.scene.edge, Mapping) and not condition.law.is_zero_flux:
                    raise SceneError(
                        f"`edge` gives {condition.kind} for a loop that lies on another member of the union, where "
                        "the junction is the law; leave its number out."
                    )
                condition = replace(condition, sides=(rows,))
            kept += [condition] if len(rows) else []
        return replace(self, form=replace(self.form, conditions=tuple(kept)))

    @property
    def dim(self) -> int:
        """The dimension of the members."""
        return int(self.form.scene.surface.manifold_dim or 0)

    def restrict(self, data: Any, union: Discretized) -> Any:
        """Return ``data`` of the scene on a ``union`` for the part's scene."""
        if isinstance(data, Field) and data.form is union:
            values = data.values[self.points]
            return lambda _: values
        if isinstance(data, StateDependentCoefficient):
            return replace(data, u=data.u[self.unknowns])
        if is_sequence(data):
            return type(data)(self.restrict(each, union) for each in data)
        return restrict_data(data, self.numbers, self.form.scene.surface)


@dataclass(frozen=True, eq=False)
class PartFlux:
    """A part of a boundary on which the flux depends on u, with u given by the unknowns of the union."""

    of: StateFlux  #: The same with u given by the unknowns of the part.
    unknowns: slice

    def __getattr__(self, name: str) -> Any:
        return getattr(self.of, name)

    def read(self, u: Floats) -> Floats:
        """Return the values (k,) of the function with the unknowns ``u`` (n, 1)."""
        return self.of.read(u[self.unknowns])


@dataclass(frozen=True, eq=False)
class GalerkinUnion(Discretized):
    """A scene on a union of members of different dimension; the unknowns of its parts follow one another."""

    form: ClassVar[str] = "galerkin"
    cannot: ClassVar[Mapping[str, str]] = {
        **Galerkin.cannot,
        "second Laplacian": "divide the union into scenes of one dimension each",
    }

    scene: Scene
    options: Options[GalerkinOptions]  #: The options of the discretisation.
    parts: tuple[UnionPart, ...]  #: The members of each dimension, ascending.
    #: The samples at which parts touch, by the numbers of the part of higher dimension and that of lower dimension.
    contacts: Mapping[tuple[int, int], Contact] = field(repr=False)
    #: The points at which curves meet surfaces, by the same numbers.
    point_contacts: Mapping[tuple[int, int], PointContact] = field(repr=False)

    @property
    def forms(self) -> list[Galerkin]:
        """The forms of the parts."""
        return [part.form for part in self.parts]

    # Operators

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.parts[-1].unknowns.stop)

    @property
    def spacing(self) -> float:
        """Spacing of the lattice, in the scene's unit."""
        return self.options.spacing

    @property
    def traits(self) -> FormTraits:
        """The iterative solver, the dispersion of the highest dimension, and the record of work."""
        solver = "multigrid" if multigrid_applies(self.scene) else "direct"
        return replace(self.parts[-1].form.traits, iterative_solver=solver, higher_degree=None, parts=self.parts)

    def check(self, solver: str) -> None:
        """Raise ResolutionError as the forms of the parts do."""
        for form in self.forms:
            form.check(solver)

    def with_scene(self, scene: Scene) -> GalerkinUnion:
        """Return the form on the same unknowns for a scene that differs in its equation and its data only."""
        scenes = [own for _, own in scenes_by_dimension(scene)]
        parts = [part.with_scene(own) for part, own in zip(self.parts, scenes, strict=True)]
        return replace(self, scene=scene, parts=tuple(parts))

    @property
    def constant(self) -> Floats:
        """(n, 1) the unknowns of the function 1."""
        return np.concatenate([form.constant for form in self.forms])

    @cached_property
    def mass(self) -> CsrOperator:
        """M, the sum over the parts of the integrals of products of functions."""
        return CsrOperator(_block_diagonal([form.mass.matrix for form in self.forms]), symmetric=True)

    @cached_property
    def mass_in_time(self) -> CsrOperator:
        """M + h^2 S, with S the stabilisation."""
        return CsrOperator(_block_diagonal([form.mass_in_time.matrix for form in self.forms]), symmetric=True)

    def weighted_mass(self, values: Floats) -> SparseMatrix:
        """Return the integrals (n, n) of c u v, with the ``values`` (p,) of c at the samples."""
        return _block_diagonal([part.form.weighted_mass(values[part.points]) for part in self.parts])

    def stiffness(self, terms: Terms) -> UnionOperator:
        """Return A: the operators of the parts and the terms of the junctions; raises the errors of the parts."""
        operators = [part.form.stiffness(self._terms_of(part, terms)) for part in self.parts]
        blocks: list[list[Any]] = [[None] * len(self.parts) for _ in self.parts]
        for k, operator in enumerate(operators):
            blocks[k][k] = operator.matrix
        for (high, low), contact in self.contacts.items():
            conditions = operators[high].conditions
            assert conditions is not None
            _add_blocks(blocks, high, low, contact_blocks(conditions, contact))
        for (high, low), at_points in self.point_contacts.items():
            part = self.parts[high]
            a = part.form.coefficients.diffusivity(self._terms_of(part, terms).diffusivity)
            a = scalar_coefficient(part.form.space.splines, a)
            at = np.broadcast_to(a[:1], len(at_points.nearest)) if len(a) == 1 else a[at_points.nearest]
            of_curves = operators[low].conditions
            assert of_curves is not None
            _add_blocks(blocks, high, low, point_contact_blocks(at_points, at, self.spacing, of_curves))
        return UnionOperator(
            _stack_blocks(blocks),
            all(each.symmetric for each in operators),
            any(each.indefinite for each in operators),
            fixed=all(each.fixed for each in operators),
            waves=max(each.waves for each in operators),
            least=min(each.least for each in operators),
            lowest=min(each.lowest for each in operators),
            parts=tuple(operators),
        )

    def _terms_of(self, part: UnionPart, terms: Terms) -> Terms:
        """Return the ``terms`` of an equation on the union for a part."""
        made: Terms = restrict_fields(terms, lambda data: part.restrict(data, self))
        return made

    def advection(self, field: StateDependentCoefficient) -> CsrOperator:
        """Return the matrix (n, n) of the integrals of u (w . grad v), w the ``field``, on each part."""
        matrices = [part.form.advection(part.restrict(field, self)).matrix for part in self.parts]
        return CsrOperator(_block_diagonal(matrices))

    def boundary_mass(self, stiffness: Stiffness) -> CsrOperator | None:
        """Return the integrals (n, n) of a u v where du/db = lambda u; None if that is nowhere."""
        assert isinstance(stiffness, UnionOperator)
        masses = [form.boundary_mass(own) for form, own in zip(self.forms, stiffness.parts, strict=True)]
        if all(mass is None for mass in masses):
            return None
        from scipy.sparse import csr_array

        sizes = [(form.size, form.size) for form in self.forms]
        blocks = [csr_array(size) if mass is None else mass.matrix for mass, size in zip(masses, sizes, strict=True)]
        return CsrOperator(_block_diagonal(blocks), symmetric=True)

    def levels(self, operator: Operator) -> Sequence[Level]:
        """Return multigrid levels of ``operator``: those of the parts side by side, as long as a part has any."""
        inner = operator.operator if isinstance(operator, Bordered) else operator
        found = []
        sizes = [form.size for form in self.forms]
        touched = [self._touched_unknowns(number) for number in range(len(self.parts))]
        for levels in zip_longest(*(form.space.plain_levels for form in self.forms)):
            blocks, strips, start = [], [], 0
            for k, level in enumerate(levels):
                blocks.append(_identity(sizes[k]) if level is None else level.prolongation)
                own = np.arange(sizes[k]) if level is None else np.union1d(level.strip, touched[k])
                strips.append(start + own)
                start += sizes[k]
                touched[k] = np.unique(blocks[-1][touched[k]].indices)
                sizes[k] = blocks[-1].shape[1]
            found.append(Level(_block_diagonal(blocks), np.concatenate(strips)))
        return inner.usable_levels(found, self.spacing) if isinstance(inner, GalerkinOperator) else found

    def _touched_unknowns(self, number: int) -> Ints:
        """Return the unknowns of part ``number``, if it is a curve, that are coupled to parts of higher dimension."""
        if self.parts[number].dim > 1:
            return np.zeros(0, dtype=np.int64)
        rows = [contact.lower for (_, low), contact in self.contacts.items() if low == number]
        return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(each.indices for each in rows)]))

    def load(self, f: Data, time: float | None = None) -> Floats:
        """Return the integrals (n, channels) of ``f`` at ``time`` times each function."""
        if isinstance(f, Functional):
            return f.loads(self, time)
        return np.concatenate([part.form.load(part.restrict(f, self), time) for part in self.parts])

    def reaction_load(self, function: Callable[[Floats, Floats], Floats], u: Floats) -> Floats:
        """Return the load (n, channels) of ``function(values, points)`` at the values of ``u`` (n, channels)."""
        loads = []
        for part in self.parts:
            own = function
            if isinstance(function, ReactionAt):
                own = replace(function, reaction=part.restrict(function.reaction, self))
            loads.append(part.form.reaction_load(own, u[part.unknowns]))
        return np.concatenate(loads)

    def gradient_load(self, values: Floats) -> Floats:
        """Return the integrals (n,) of vectors (p, d) at the samples times the tangential gradient of each function."""
        return np.concatenate([part.form.gradient_load(values[part.points]) for part in self.parts])

    def condition_load(self, stiffness: Stiffness, time: float | None = None, of: str = "value") -> Floats:
        """Return the load (n, channels) of the conditions' data at ``time``."""
        assert isinstance(stiffness, UnionOperator)
        loads = [form.condition_load(own, time, of) for form, own in zip(self.forms, stiffness.parts, strict=True)]
        return np.concatenate(loads)

    @property
    def state_fluxes(self) -> Sequence[StateFlux]:
        """The samples on boundaries at which the flux of a condition depends on u, for each such condition."""
        return [PartFlux(flux, part.unknowns) for part in self.parts for flux in part.form.state_fluxes]

    def linearise(self, seen: Sequence[Floats]) -> GalerkinUnion:
        """Return the form with each flux of :attr:`state_fluxes` linearised at its values (k,) of u in ``seen``."""
        parts, rest = [], [*seen]
        for part in self.parts:
            count = len(part.form.state_fluxes)
            parts.append(replace(part, form=part.form.linearise(rest[:count])))
            rest = rest[count:]
        return replace(self, parts=tuple(parts))

    # Values

    @cached_property
    def points(self) -> Floats:
        """(p, d) the samples of all parts, in the scene's coordinates, read-only."""
        points = np.concatenate([form.points for form in self.forms])
        points.flags.writeable = False
        return points

    @property
    def point_weights(self) -> Floats:
        """(p,) the quadrature weights of the samples: lengths, areas and volumes."""
        return np.concatenate([form.point_weights for form in self.forms])

    def some_points(self, count: int) -> tuple[Ints, Floats]:
        """Return the numbers (k,) and positions (k, d) of at most about ``count`` samples, evenly spread over all."""
        total = self.parts[-1].points.stop
        shares = [max(1, count * (part.points.stop - part.points.start) // total) for part in self.parts]
        chosen = [part.form.some_points(share) for part, share in zip(self.parts, shares, strict=True)]
        rows = [part.points.start + own for part, (own, _) in zip(self.parts, chosen, strict=True)]
        return np.concatenate(rows), np.concatenate([points for _, points in chosen])

    def at_points(self, u: Floats, rows: Ints | None = None) -> Floats:
        """Return the values (k, channels) of u (n, channels) at the samples, or at the samples ``rows`` (k,)."""
        if rows is None:
            return np.concatenate([part.form.at_points(u[part.unknowns]) for part in self.parts])
        values = np.empty((len(rows), u.shape[1]))
        for part in self.parts:
            own = (rows >= part.points.start) & (rows < part.points.stop)
            values[own] = part.form.at_points(u[part.unknowns], rows[own] - part.points.start)
        return values

    def project(self, values: Floats, start: Floats | None = None, time: float | None = None) -> Floats:
        """Return the unknowns (n, channels) of the parts' projections of ``values`` (p, channels) at the samples."""
        first = [None if start is None else start[part.unknowns] for part in self.parts]
        pairs = zip(self.parts, first, strict=True)
        return np.concatenate([part.form.project(values[part.points], own, time) for part, own in pairs])

    def data_at_points(self, data: Any, label: str, time: float | None = None, channels: int | None = 1) -> Floats:
        """Return ``data`` (p, channels) at ``time`` at samples; ``label`` is for errors."""
        found = [part.form.data_at_points(part.restrict(data, self), label, time, channels) for part in self.parts]
        return np.concatenate(found)

    def interpolate(
        self, data: Data, label: str, time: float = 0.0, in_range: bool = False, step: float = 0.0
    ) -> Floats:
        """Return the unknowns (n, channels) of the L2 projections of ``data``, as the forms of the parts do."""
        given = [(part.form, part.restrict(data, self)) for part in self.parts]
        return np.concatenate([form.interpolate(own, label, time, in_range, step) for form, own in given])

    def inner(self, u: Floats, v: Floats) -> Floats:
        """Return the means (k, m) over all members of the products of u's columns (n, k) with v's (n, m)."""
        return np.asarray(u.T @ self.mass.apply(v) / self.point_weights.sum())

    def evaluation_matrix(self, points: Any, side: Sides = None) -> SparseMatrix:
        """Return the matrix (k, n) that evaluates u at the nearest points of the nearest members to ``points`` (k, d).

        Raises InputError if a point is not finite or over three spacings away, or a side is not one of the scene's.
        """
        from scipy.sparse import csr_array

        at = as_points(points, self.scene.surface.dim)
        matrix = csr_array((len(at), self.size))
        for part, rows in self._nearest_parts(at):
            found = part.form.evaluation_matrix(at[rows], self._own_sides(part, side)).tocoo()
            place = rows[found.coords[0]], part.unknowns.start + found.coords[1]
            matrix += csr_array((found.data, place), shape=matrix.shape)
        return matrix

    def _nearest_parts(self, at: Floats) -> Iterator[tuple[UnionPart, Ints]]:
        """Yield each part on which the closest points to some of ``at`` (k, d) lie, and the rows of these."""
        element = self.scene.surface.closest_point(np.ascontiguousarray(at)).element
        assert element is not None
        for part in self.parts:
            rows = np.flatnonzero(np.isin(element, part.numbers))
            if len(rows):
                yield part, rows

    def _own_sides(self, part: UnionPart, side: Sides) -> Sides:
        """Return the sides of a part's own boundaries; raise InputError for names of no boundary of the scene."""
        if not isinstance(side, Mapping):
            return side if any(each.name in self._names(part) for each in self.scene.boundaries) else None
        known = {name for each in self.parts for name in self._names(each)}
        unknown = [name for name in side if name not in known]
        if unknown:
            raise InputError(f"no boundary has the name {unknown[0]!r}; the scene has {', '.join(sorted(known))}.")
        return {name: value for name, value in side.items() if name in self._names(part)}

    def _names(self, part: UnionPart) -> list[str]:
        """Return the names of the scene's boundaries that lie on a part."""
        own = {each.name for each in part.form.scene.boundaries}
        return [each.name for each in self.scene.boundaries if each.name in own]

    def gradient(self, u: Floats, points: Any = None, side: Sides = None) -> Floats:
        """Return the tangential gradient (k, channels, d) of u at ``points`` (k, d), by default at the samples."""
        if points is None:
            return np.concatenate([part.form.gradient(u[part.unknowns]) for part in self.parts])
        at = as_points(points, self.scene.surface.dim)
        found = np.empty((len(at), u.shape[1], at.shape[1]))
        for part, rows in self._nearest_parts(at):
            found[rows] = part.form.gradient(u[part.unknowns], at[rows], self._own_sides(part, side))
        return found

    def _part_with(self, boundary: str) -> UnionPart:
        """Return the part on which a boundary lies; raise InputError if there is none of this name."""
        for part in self.parts:
            if boundary in self._names(part):
                return part
        names = ", ".join(repr(each.name) for each in self.scene.boundaries) or "none"
        raise InputError(f"no boundary has the name {boundary!r}; the scene has {names}.")

    def conormal_derivative(
        self, u: Floats, points: Any, boundary: str | None = None, side: Side | None = None
    ) -> Floats:
        """Return du/db (k, channels), b out of ``side``, at ``points`` (k, d) of ``boundary``, of the edge if None."""
        if boundary is not None:
            part = self._part_with(boundary)
            return part.form.conormal_derivative(u[part.unknowns], points, boundary, side)
        at = as_points(points, self.scene.surface.dim)
        found = np.empty((len(at), u.shape[1]))
        for part, rows in self._nearest_parts(at):
            found[rows] = part.form.conormal_derivative(u[part.unknowns], at[rows])
        return found

    def flux(self, u: Floats, boundary: str | int, side: Side | None, time: float | None) -> Floats | None:
        """Return the integrals (channels,) of du/db over a side of a boundary, or the edges of all members."""
        if boundary in [each.name for each in self.scene.boundaries]:
            part = self._part_with(str(boundary))
            return part.form.flux(u[part.unknowns], boundary, side, time)
        if isinstance(boundary, int):
            part, loop = self._part_with_loop(boundary)
            return part.form.flux(u[part.unknowns], loop, side, time)
        found = [part.form.flux(u[part.unknowns], boundary, side, time) for part in self.parts]
        if any(conditions_with_law(form.conditions, Spectral) for form in self.forms):
            return None
        # nothing flows out of an edge without a condition
        return sum((each for each in found if each is not None), np.zeros(u.shape[1]))

    def _part_with_loop(self, loop: int) -> tuple[UnionPart, int]:
        """Return the part with an edge loop of the union, and the loop's number there; InputError if there is none."""
        for part in self.parts:
            own = own_loop_of(self.scene.surface, part.numbers, loop)
            if own is not None:
                return part, own
        raise InputError(f"the union has no edge {loop}; see `first_edges` of its source.")

    def signed_distance(self, name: str, points: Any) -> Floats:
        """Return the distances (k,) of ``points`` (k, d) from the boundary ``name``, positive on its left."""
        at, own = as_points(points, self.scene.surface.dim), self._part_with(name)
        found = np.full(len(at), np.nan)  # on other members, where the boundary does not lie
        for part, rows in self._nearest_parts(at):
            if part is own:
                found[rows] = part.form.signed_distance(name, at[rows])
        return found

    # Diagnosis

    def warnings(self) -> tuple[str, ...]:
        """Return the warnings of all parts, and one if members are near each other that do not meet."""
        of_parts = dict.fromkeys(text for form in self.forms for text in form.warnings())
        return (*self._near_miss, *self._crossed_members, *of_parts)

    @cached_property
    def _crossed_members(self) -> tuple[str, ...]:
        """A warning if a boundary of a surface crosses a curve in it, which has no condition there."""
        return crossed_member_warnings(self.scene)

    @cached_property
    def _near_miss(self) -> tuple[str, ...]:
        """A warning if members of different dimension are nearer than the spacing, and nothing flows between them."""
        return near_miss_warnings(self.scene.surface, self.spacing)

    def diagnosis(
        self, coarser: Discretized | None = None, ratio: float = 2.0, difference: float = 0.0, eigenvalues: bool = False
    ) -> Diagnosis:
        """Return the smallest order of the parts, and the first reason why an error may fall slowly."""
        others = coarser.forms if isinstance(coarser, GalerkinUnion) else [None] * len(self.parts)
        found = [
            form.diagnosis(other, ratio, difference, eigenvalues)
            for form, other in zip(self.forms, others, strict=True)
        ]
        return Diagnosis(
            min(each.order for each in found),
            next((each.slow for each in found if each.slow), ""),
            unresolved_share=max(each.unresolved_share for each in found),
        )

    def source_error(self, difference: float | None = None) -> float:
        """Return the largest error of the parts' sources, a share of u's range."""
        return max(form.source_error(difference) for form in self.forms)

    def work(self, operator: Operator, report: SolveReport | None) -> GalerkinWork:
        """Return the measures of the work of a solve; ``report`` is None where none was made."""
        parts = [form.work(operator, report) for form in self.forms]
        sums = {name: sum(getattr(each, name) for each in parts) for name in ("unknowns", "samples", "patches")}
        queries = sum(each.closest_point_queries for each in parts)
        return GalerkinWork(
            **sums,
            closest_point_queries=queries,
            nonzeros=operator.nonzeros,
            operator_applications=parts[0].operator_applications,
        )

    def describe(self) -> dict[str, Any]:
        """Return the options, and the number of unknowns of the members of each dimension, as plain values."""
        own = {"form": self.options.form, "form_reason": self.options.reason, **self.options.own.as_dict()}
        own["origin"] = self.parts[0].form.sampled.lattice.origin.tolist()
        return {**own, "unknowns_by_dimension": {str(part.dim): part.form.size for part in self.parts}}

    def arrays(self) -> dict[str, Any]:
        """Return the options, the origin of the lattice, and the nodes and sides of boundaries of all parts."""
        found = [form.arrays() for form in self.forms]
        joined = {name: np.concatenate([each[name] for each in found]) for name in ("nodes", "sides")}
        return {**found[0], **joined}

    def differs_from(self, saved: Mapping[str, Any]) -> str:
        """Return in words how the form of arrays ``saved`` differs; empty if equal."""
        start_of_nodes = start_of_sides = 0
        for form in self.forms:
            own = form.arrays()
            nodes, sides = len(own["nodes"]), len(own["sides"])
            part = {**saved, "nodes": saved["nodes"][start_of_nodes : start_of_nodes + nodes]}
            part["sides"] = saved["sides"][start_of_sides : start_of_sides + sides]
            if words := form.differs_from(part):
                return words
            start_of_nodes, start_of_sides = start_of_nodes + nodes, start_of_sides + sides
        return "" if start_of_nodes == len(saved["nodes"]) else "its nodes are others"


def _block_diagonal(matrices: Sequence[Any]) -> Any:
    """Return the sparse matrix with the ``matrices`` on its diagonal."""
    from scipy.sparse import block_diag

    return block_diag(matrices, format="csr")


def _identity(count: int) -> Any:
    from scipy.sparse import eye_array

    return eye_array(count, format="csr")


def _add_blocks(blocks: list[list[Any]], high: int, low: int, added: Sequence[Any]) -> None:
    """Add the blocks (n, n), (n, m) and (m, m) of a junction of the parts ``high`` and ``low`` to ``blocks``."""
    upper, across, lower = added
    for row, column, block in ((high, high, upper), (high, low, across), (low, high, across.T), (low, low, lower)):
        before = blocks[row][column]
        blocks[row][column] = block if before is None else before + block


def _stack_blocks(blocks: list[list[Any]]) -> Any:
    from scipy.sparse import block_array

    matrix = block_array(blocks, format="csr")
    matrix.sort_indices()
    return matrix
