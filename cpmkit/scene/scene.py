"""Scenes: a manifold, boundaries inside it, conditions on its edge, and an equation; replacement of a scene's data."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import TYPE_CHECKING, Any, Generic

import numpy as np

from cpmkit.errors import SceneError, shown
from cpmkit.manifold.local_source import LocalSource, largest_dim
from cpmkit.manifold.source import ClosestPointSource, check_source
from cpmkit.runtime.messages import html_table
from cpmkit.scene.boundary import ONE_SIDED_WORDS, Boundary, BoundarySet, as_boundary
from cpmkit.scene.conditions import Condition, Neumann, as_condition, same_condition
from cpmkit.scene.data import Data, FieldOfEntries, Functional, evaluate_data, takes_time
from cpmkit.scene.edge_conditions import (
    EdgeConditions,
    EdgeInput,
    as_edge,
    conditions_of_edge,
    edge_structure,
    map_conditions,
    parts_of_edge,
    sample_edge_point,
)
from cpmkit.scene.equations import Equation, Family
from cpmkit.scene.junction import Junction, Junctions, check_junctions
from cpmkit.scene.oriented import OrientedBoundary, orient
from cpmkit.scene.special_data import VertexArrays
from cpmkit.scene.surface_input import Surface, as_source
from cpmkit.types import SIDES, Floats


@dataclass(frozen=True, eq=False)
class Scene(Generic[Family]):
    """A manifold, its boundaries, its edge and an equation.

    In equations and conditions, an array of NumPy or a column of pandas with one row for each vertex of the surface is
    data at vertices (:class:`VertexData`); a list or a tuple has one entry for each channel.

    Parameters
    ----------
    surface : ClosestPointSource, or a mesh or cloud
        The manifold: a source; or a mesh or point cloud of trimesh, pyvista, open3d or meshio, or a pair of arrays of
        vertices and faces.
    problem : Equation
        The equation, such as ``Laplace()``, ``Poisson(f)`` or ``ScreenedPoisson(f, c)``.
    boundaries : sequence of Boundary or BoundarySet
        Points and curves inside the manifold, with conditions.
    edge : Condition, list or table, or number, text, sequence or function
        The condition on the rim of an open surface or at the ends of an open curve; or a list of pairs (condition,
        where), with ``where`` a formula such as ``"x < 0"`` or a function of points: the first pair that holds at a
        point determines the condition there, and a condition alone at the end of the list holds on the rest; or a table
        of either by the number of the edge loop. Data stand for a Dirichlet condition. The default is zero flux.
    junctions : Junction or table
        The law at all places where members of different dimension in a union meet, or the laws of some pairs of members
        by their numbers, ``{(0, 2): Junction(radius=0.1)}``. By default u is continuous.

    Raises
    ------
    InputError
        If the surface is no source, or data have other shapes than (n,) or (n, channels) or are not finite.
    SceneError
        If the surface consists of points, names repeat, data have different numbers of channels, or another argument is
        not accepted.

    Examples
    --------
    A colour has three channels, which are solved for together.

    >>> import cpmkit as ck
    >>> equator = ck.source("analytic.circle", normal=[0, 0, 1])
    >>> colours = ck.Boundary("equator", equator, left=ck.Dirichlet([1, 0, 0]), right=ck.Dirichlet([0, 0, 1]))
    >>> ck.Scene(ck.source("analytic.sphere"), ck.Laplace(), [colours]).channels
    3
    """

    surface: ClosestPointSource
    problem: Equation[Family]
    boundaries: Sequence[Boundary] = ()
    edge: EdgeConditions = field(default_factory=Neumann)
    junctions: Junctions = field(default_factory=Junction)

    if TYPE_CHECKING:  # the constructor accepts more types than the fields have

        def __init__(
            self,
            surface: Surface,
            problem: Equation[Family],
            boundaries: Sequence[Boundary | BoundarySet] = (),
            edge: EdgeInput | Mapping[int, EdgeInput] = ...,
            junctions: Junctions = ...,
        ) -> None: ...

    def __post_init__(self) -> None:
        """Convert the arguments, replace arrays by vertex data; raise SceneError if parts of the scene do not fit."""
        object.__setattr__(self, "surface", as_source(self.surface))
        check_source(self.surface, "the surface", "of a mesh its arrays, the pair (vertices, faces)")
        if largest_dim(self.surface) == 0:
            raise SceneError(
                f"the surface consists of points, on which there is no equation, got {self.surface!r}; for a surface "
                "known by scattered points take the kind 'pointcloud.points', for values at points a boundary."
            )
        if not isinstance(self.problem, Equation):
            raise SceneError(
                "the problem must be an equation, such as Laplace(), Poisson(f) or Heat(...), got "
                f"{shown(self.problem)}."
            )
        object.__setattr__(self, "edge", as_edge(self.edge))
        for condition in self.edge_conditions:
            if not isinstance(condition, Condition) or condition.couples:
                raise SceneError(
                    f"`edge` must be {ONE_SIDED_WORDS}, or a table with one of them for each loop, or a list of pairs "
                    f"of one and where it holds, got {shown(condition)}."
                )
        object.__setattr__(self, "junctions", check_junctions(self.junctions, self.surface))
        arrays = VertexArrays(self.surface)
        object.__setattr__(self, "problem", arrays.replace_arrays(self.problem, self.problem.kind))
        object.__setattr__(self, "edge", map_conditions(self.edge, lambda one: arrays.replace_arrays(one, "the edge")))
        boundaries = []
        given = self.boundaries if isinstance(self.boundaries, Iterable) else [self.boundaries]
        for each in (as_boundary(boundary).on(self.surface) for boundary in given):
            old = each.given_conditions
            new = {side: arrays.replace_arrays(condition, f"boundary {each.name!r}") for side, condition in old.items()}
            boundaries.append(each if all(new[side] is old[side] for side in old) else replace(each, **new))
        object.__setattr__(self, "boundaries", tuple(boundaries))
        names = [boundary.name for boundary in self.boundaries]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise SceneError(f"{len(names)} boundaries share the name {twice[0]!r}; give each its own.")
        for boundary in self.boundaries:
            if boundary.source.dim != self.surface.dim:
                raise SceneError(
                    f"boundary {boundary.name!r} lies in {boundary.source.dim}D, the surface in {self.surface.dim}D; "
                    "both must be the same."
                )
        self.problem.check_conditions(self._conditions())
        shape, dim = np.shape(self.problem.terms().diffusivity), self.surface.dim
        if shape not in ((), (dim, dim)):
            raise SceneError(
                f"the diffusivity is a tensor of shape {shape} where the manifold lies in {dim}D; give ({dim}, {dim})."
            )
        velocity = self.problem.terms().velocity
        if isinstance(velocity, FieldOfEntries) and len(velocity.entries) != dim:
            raise SceneError(
                f"the velocity has {len(velocity.entries)} entries where the manifold lies in {dim}D; give {dim} "
                "entries, one for each coordinate."
            )
        assert self.channels

    @cached_property
    def channels(self) -> int:
        """Number of right-hand sides that are solved together: the largest number of channels of any data.

        Raises SceneError if other data have neither 1 nor this number, and the errors of :func:`evaluate_data`.
        """
        counts = []
        for label, data, place in self._data():
            count = getattr(data, "channels", None)
            # Evaluating a field at other points than its own takes a linear solve. Numbers are evaluated too, so that
            # a source whose answers are wrong is refused when the scene is made.
            if not isinstance(count, int) or not (isinstance(data, Functional) or callable(data)):
                count = evaluate_data(data, place(), None, label, self.problem.start_time).shape[1]
            counts.append((label, count))
        most = max((count for _, count in counts), default=1)
        for label, count in counts:
            if count not in (1, most):
                raise SceneError(f"{label} has {count} channels where others have {most}; give one value, or {most}.")
        return most

    @cached_property
    def has_tensor(self) -> bool:
        """True if the diffusivity is a tensor; False if it depends on u. A function is evaluated at one point."""
        diffusivity = self.problem.terms().diffusivity
        if not callable(diffusivity):
            return np.ndim(diffusivity) > 0
        return not hasattr(diffusivity, "needs_state") and np.ndim(diffusivity(_point_near_centre(self.surface))) > 2

    @property
    def edge_conditions(self) -> list[Condition]:
        """The conditions of the edge, of all its loops and parts."""
        return conditions_of_edge(self.edge)

    def __repr__(self) -> str:
        edge = ", ".join(condition.kind for condition in self.edge_conditions)
        names = ", ".join(repr(boundary.name) for boundary in self.boundaries) or "none"
        return f"Scene of {self.problem.kind}, {self.problem}, boundaries {names}, edge {edge}\n  on {self.surface!r}"

    def _repr_html_(self) -> str:
        """Return an HTML table of the equation, the surface, the boundaries and the edge."""
        rows = [("equation", f"{self.problem.kind}: {self.problem}"), ("surface", repr(self.surface))]
        for boundary in self.boundaries:
            left, right = (boundary.condition(side).kind for side in SIDES)
            rows.append((f"boundary {boundary.name!r}", f"{left} on the left, {right} on the right"))
        rows.append(("edge", ", ".join(condition.kind for condition in self.edge_conditions)))
        return html_table("Scene", rows)

    def oriented(self, boundary: Boundary) -> OrientedBoundary:
        """Return a boundary of the scene with its orientation, which is cached; raise SceneError as :func:`orient`."""
        if id(boundary) not in self._oriented:  # the scene keeps its boundaries alive
            self._oriented[id(boundary)] = orient(boundary, self.surface)
        return self._oriented[id(boundary)]

    @cached_property
    def _oriented(self) -> dict[int, OrientedBoundary]:
        """The boundaries that are already oriented, by the id of the boundary."""
        return {}

    def _conditions(self) -> list[tuple[str, Condition]]:
        """Return pairs (place in messages, condition): left and right of each boundary, then the edge's parts."""
        conditions = [
            (f"boundary {boundary.name!r}", boundary.condition(side)) for boundary in self.boundaries for side in SIDES
        ]
        return conditions + [("the edge's condition", edge) for edge in self.edge_conditions]

    @property
    def conditions(self) -> list[Condition]:
        """All conditions: left and right of each boundary in order, then those of the edge's loops and parts."""
        return [condition for _, condition in self._conditions()]

    def _data(self) -> list[tuple[str, Data, Callable[[], Floats]]]:
        """Return triples (name in messages, data, function) of all data of the scene.

        The function, without arguments, returns the point (1, d) at which channels of the data are counted: on their
        boundary, by :func:`sample_edge_point` for the edge, or for data of the equation on the manifold.
        """
        places: list[Callable[[], Floats]] = []
        for boundary in self.boundaries:
            places += [cache(partial(_point_near_centre, boundary.source))] * len(SIDES)
        places += [partial(sample_edge_point, self.surface, *part) for part in parts_of_edge(self.edge)]
        triples: list[tuple[str, Data, Callable[[], Floats]]] = []
        for (label, condition), place in zip(self._conditions(), places, strict=True):
            data = condition.law.data
            triples += [(label if len(data) == 1 else f"the {name} of {label}", datum, place) for name, datum in data]
        on_surface = cache(partial(_point_near_centre, self.surface))
        return triples + [(label, data, on_surface) for label, data in self.problem.data()]


def _point_near_centre(source: ClosestPointSource) -> Floats:
    """Return the closest point (1, d) of ``source`` to the centre of its bounds."""
    centre = np.asarray(source.bounds, dtype=np.float64).mean(axis=0)[None]
    return LocalSource(source, np.zeros(source.dim)).closest_point(centre).points


def with_replaced_data(scene: Scene, problem: Equation | None, data: Mapping[str, Any] | None) -> Scene:
    """Return the scene with the equation ``problem``, unless it is None, and other data of its conditions.

    ``data`` maps names of boundaries to a condition or a table of them by side, "edge" to an edge as of a scene. A
    missing name keeps the old ones, None all of them. Raises SceneError if the scene has no such boundary, or a new
    condition differs in sides, parts, kind, factors or order.
    """
    if not isinstance(data, Mapping | None):
        raise SceneError(f"data must be a table of conditions by the names of boundaries, got {shown(data)}.")
    if problem is None and not data:
        return scene
    data = dict(data or {})
    boundaries = []
    for boundary in scene.boundaries:
        old = boundary.given_conditions
        given = data.pop(boundary.name, old)
        values = given if isinstance(given, Mapping) else dict.fromkeys([*old][:1], given)
        new = {side: as_condition(value) for side, value in values.items()}
        if set(new) != set(old):
            raise SceneError(
                f"boundary {boundary.name!r} holds conditions on {' and '.join(old)}, got {' and '.join(new)}; give "
                "data for the same."
            )
        if "left" in old and same_condition(*old.values()) != same_condition(*new.values()):
            count = "one condition" if same_condition(*old.values()) else "two conditions"
            raise SceneError(f"boundary {boundary.name!r} has {count} for its sides in the tables; use cpmkit.solve.")
        boundaries.append(boundary if given is old else replace(boundary, **new))
    edge = as_edge(data.pop("edge")) if "edge" in data else scene.edge
    if edge_structure(edge) != edge_structure(scene.edge):
        raise SceneError(
            "data of the edge must be one condition, or one for each of its loops or parts, as the scene has them, "
            "and each part where it is."
        )
    if data:
        names = ["edge", *(repr(boundary.name) for boundary in scene.boundaries)]
        raise SceneError(f"data are given for {next(iter(data))!r}; the scene has {', '.join(names)}.")
    new_scene = replace(scene, problem=problem or scene.problem, boundaries=boundaries, edge=edge)
    labels = [f"boundary {each.name!r}, {side}," for each in scene.boundaries for side in SIDES]
    labels += ["the edge"] * len(scene.edge_conditions)
    for label, before, after in zip(labels, scene.conditions, new_scene.conditions, strict=True):
        same_law = type(before.law) is type(after.law) and before.law.factors == after.law.factors
        if before is not after and not (same_law and before.order == after.order):
            raise SceneError(
                f"{label} is {before.kind} in the tables, got {after.kind!r}: only data may differ, not the kind, its "
                "factors or its order; use cpmkit.solve."
            )
    return new_scene


def conditions_depend_on_time(scene: Scene) -> bool:
    """Return True if a datum of the conditions on boundaries or the edge depends on the time."""
    return any(takes_time(data) for condition in scene.conditions for _, data in condition.data())
