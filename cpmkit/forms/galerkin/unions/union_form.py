"""The Galerkin form on a union of members of different dimension: a form for each dimension, and their junctions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import InputError
from cpmkit.forms.contract import Discretized
from cpmkit.forms.form_records import Diagnosis, FormTraits
from cpmkit.forms.galerkin.conditions.imposed_conditions import conditions_with_law, rim_loops
from cpmkit.forms.galerkin.equation_assembly import multigrid_applies
from cpmkit.forms.galerkin.form import Galerkin
from cpmkit.forms.galerkin.solve_memory import GalerkinWork
from cpmkit.forms.galerkin.unions.disc_contacts import end_flow_warnings, near_boundary_warnings
from cpmkit.forms.galerkin.unions.part_scenes import loop_of_union, own_loop_of, scenes_by_dimension
from cpmkit.forms.galerkin.unions.union_assembly import UnionAssembly
from cpmkit.forms.galerkin.unions.union_parts import UnionPart
from cpmkit.linear.operators import Operator
from cpmkit.linear.residuals import SolveReport
from cpmkit.manifold.meetings import is_near, touching_distance
from cpmkit.manifold.mixed_dimension import near_miss_warnings
from cpmkit.runtime.arrays import as_points
from cpmkit.scene.data import Data
from cpmkit.scene.edge_conditions import EdgeLoopError
from cpmkit.scene.junction import crossed_member_warnings
from cpmkit.scene.laws import Spectral
from cpmkit.scene.scene import Scene
from cpmkit.types import Bools, Floats, Ints, Side, Sides, SparseMatrix


@dataclass(frozen=True, eq=False)
class GalerkinUnion(UnionAssembly, Discretized):
    """A scene on a union of members of different dimension; the unknowns of its parts follow one another."""

    form: ClassVar[str] = "galerkin"
    cannot: ClassVar[Mapping[str, str]] = {
        **Galerkin.cannot,
        "second Laplacian": "divide the union into scenes of one dimension each",
    }

    # Operators

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.parts[-1].unknowns.stop)

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
        for part, rows in self._nearest_parts(at, side):
            found = part.form.evaluation_matrix(at[rows], self._own_sides(part, side)).tocoo()
            place = rows[found.coords[0]], part.unknowns.start + found.coords[1]
            matrix += csr_array((found.data, place), shape=matrix.shape)
        return matrix

    def _nearest_parts(self, at: Floats, side: Sides = None) -> Iterator[tuple[UnionPart, Ints]]:
        """Yield each part on which the closest points to some of ``at`` (k, d) lie, and the rows of these.

        Where members lie on each other it is the part of the lowest dimension. If a ``side`` is given, points on a
        member that cuts another are on the other, which has two sides there.
        """
        touching = touching_distance(self.scene.surface)
        nearest = self.scene.surface.closest_point(np.ascontiguousarray(at))
        assert nearest.element is not None
        owner = np.full(len(at), len(self.parts) - 1)
        for k in range(len(self.parts) - 2, -1, -1):  # to the lowest dimension
            distance = self.parts[k].form.scene.surface.closest_point(np.ascontiguousarray(at)).distance
            owner[np.isin(nearest.element, self.parts[k].numbers) | (distance <= nearest.distance + touching)] = k
        for k, part in enumerate(self.parts):
            for cut in part.form.scene.boundaries if isinstance(side, str) else ():
                owner[is_near(cut.source, at, self.scene.surface)] = k
        for k, part in enumerate(self.parts):
            rows = np.flatnonzero(owner == k)
            if len(rows):
                yield part, rows

    def _own_sides(self, part: UnionPart, side: Sides) -> Sides:
        """Return the sides of a part's own boundaries; raise InputError for names of no boundary of the scene."""
        if not isinstance(side, Mapping):
            return side if part.form.scene.boundaries else None
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
        for part, rows in self._nearest_parts(at, side):
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

    def flux(
        self,
        u: Floats,
        boundary: str | int,
        side: Side | None,
        time: float | None,
        where: Callable[[Floats], Bools] | None = None,
    ) -> Floats | None:
        """Return the integrals (channels,) of du/db over a side of a boundary, or the edges of all members."""
        if boundary in [each.name for each in self.scene.boundaries]:
            part = self._part_with(str(boundary))
            return part.form.flux(u[part.unknowns], boundary, side, time, where)
        if isinstance(boundary, int):
            part, loop = self._part_with_loop(boundary)
            _check_not_junction([part], loop)
            try:
                return part.form.flux(u[part.unknowns], loop, side, time, where)
            except EdgeLoopError as error:
                raise error.renumber((), partial(loop_of_union, self.scene.surface, part.numbers)) from None
        _check_not_junction(self.parts, None)
        open_parts = [part for part in self.parts if not _is_junction(part, None)]
        found = [part.form.flux(u[part.unknowns], boundary, side, time, where) for part in open_parts]
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
        return (*self._warnings_on_members, *of_parts)

    @cached_property
    def _warnings_on_members(self) -> tuple[str, ...]:
        """Warnings on members that nearly meet, and on boundaries that cross a curve or run along one in a solid."""
        near_boundary = near_boundary_warnings(self.scene, self.forms[-1])
        near_miss = near_miss_warnings(self.scene.surface, self.spacing)
        end_flow = end_flow_warnings(self.scene, self.parts, self.disc_contacts)
        return (*near_miss, *near_boundary, *end_flow, *crossed_member_warnings(self.scene))

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
        summed = "unknowns", "samples", "patches", "closest_point_queries"
        return replace(parts[0], **{name: sum(getattr(each, name) for each in parts) for name in summed})

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


def _check_not_junction(parts: Iterable[UnionPart], loop: int | None) -> None:
    """Raise InputError if the edge of ``parts``, or its ``loop``, lies on other members alone: its flux enters them."""
    edges = [part for part in parts if len(_edge_samples(part, loop))]
    if not edges or not all(_is_junction(part, loop) for part in edges):
        return
    part = edges[-1]
    edge = f"the edge of member {part.numbers[0]}" if len(part.numbers) == 1 else "this edge"
    # a curve ends on a surface, others are the edge's own junction with a member of one dimension less
    entered = 2 if part.dim == 1 else part.dim - 1
    raise InputError(
        f"{edge} is a junction, and its flux enters another member. In a steady problem from which nothing flows out "
        "elsewhere, it is the integral of c u - f over that member: "
        f"solution.integrate(lambda x, u: c * u - f, dim={entered})."
    )


def _is_junction(part: UnionPart, loop: int | None) -> bool:
    """Return whether the edge of a ``part``, or its ``loop``, lies on other members alone."""
    rows = _edge_samples(part, loop)
    return len(rows) > 0 and bool(np.isin(rows, part.taken).all())


def _edge_samples(part: UnionPart, loop: int | None) -> Ints:
    """Return the samples (k,) on the edge of a ``part``, or on its ``loop``."""
    sampled = part.form.sampled
    rows = np.flatnonzero(sampled.boundary.on_rim)
    if loop is None or not len(rows):
        return rows
    loops = rim_loops(sampled.boundary.take(rows), sampled.surface, part.form.space.spacing)
    return np.asarray(rows[loops == loop], dtype=np.int64)
