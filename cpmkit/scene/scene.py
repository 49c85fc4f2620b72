"""A scene: a manifold, boundaries inside it, what holds on its edge, and the equation. No lattice yet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Generic

import numpy as np

from cpmkit.errors import SceneError, shown
from cpmkit.manifold.answers import check_source
from cpmkit.manifold.local_source import LocalSource
from cpmkit.protocols import SIDES, BoundarySet, ClosestPointSource, Floats
from cpmkit.runtime.messages import html_table
from cpmkit.scene.boundary import ONE_SIDED_WORDS, Boundary
from cpmkit.scene.conditions import Condition, Neumann, as_conditions, same_condition
from cpmkit.scene.data import Data, Functional, evaluate_data
from cpmkit.scene.diffusivities import is_tensor
from cpmkit.scene.edge_conditions import (
    EdgeConditions,
    EdgeInput,
    as_edge,
    conditions_of_edge,
    parts_of_edge,
    sample_edge_point,
    shape_of_edge,
)
from cpmkit.scene.equations import Equation, Family
from cpmkit.scene.laws import Interface, Law, Mixed, Nonlinear
from cpmkit.scene.oriented import OrientedBoundary, orient
from cpmkit.scene.surface_input import Surface, as_source
from cpmkit.scene.vertex_data import VertexArrays

#: Where data of the equation and of the edge are asked; numbers from zero are boundaries, those below the edge's parts.
SURFACE_DATA, EDGE_DATA = -1, -2


@dataclass(frozen=True, eq=False)
class Scene(Generic[Family]):
    """A manifold, its boundaries, its edge and an equation.

    Arrays of NumPy and columns of pandas in equations and conditions with one row for each vertex of the surface are
    one value, or one row of channels, a vertex (:class:`VertexData`); lists and tuples are channels.

    Parameters
    ----------
    surface : ClosestPointSource, or a mesh or cloud
        The manifold; of a mesh or cloud of trimesh, pyvista, open3d or meshio, or of a pair of vertices and faces, the
        source is made with its defaults.
    problem : Equation
        Such as ``Laplace()``, ``Poisson(f)`` or ``ScreenedPoisson(f, c)``.
    boundaries : sequence of BoundarySet
        Points and curves inside the manifold, with conditions.
    edge : Condition, list or table, or number, text, sequence or function
        What holds on the rim of an open surface or the ends of an open curve: one condition; or a list of
        pairs of a condition and where it holds, a formula such as ``"x < 0"`` or a function of points,
        of which the first that holds counts and a last condition alone holds on the rest; or a table of
        either by the number of the loop. Data, such as a function of position, are short for Dirichlet of
        them. By default nothing flows through it.

    Raises
    ------
    SceneError
        If names repeat, data disagree about the number of channels, or a part is not what it should be.

    Examples
    --------
    A colour is one solve with three channels.

    >>> import cpmkit as ck
    >>> equator = ck.source("analytic.circle", normal=[0, 0, 1])
    >>> colours = ck.Boundary("equator", equator, left=ck.Dirichlet([1, 0, 0]), right=ck.Dirichlet([0, 0, 1]))
    >>> ck.Scene(ck.source("analytic.sphere"), ck.Laplace(), [colours]).channels
    3
    """

    surface: ClosestPointSource
    problem: Equation[Family]
    boundaries: Sequence[BoundarySet] = ()
    edge: EdgeConditions = field(default_factory=Neumann)

    if TYPE_CHECKING:  # more may be given than is kept

        def __init__(
            self,
            surface: Surface,
            problem: Equation[Family],
            boundaries: Sequence[BoundarySet] = (),
            edge: EdgeInput | Mapping[int, EdgeInput] = ...,
        ) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "surface", as_source(self.surface))
        check_source(self.surface, "the surface", "of a mesh its arrays, the pair (vertices, faces)")
        if not isinstance(self.problem, Equation):
            raise SceneError(
                "the problem must be an equation, such as Laplace(), Poisson(f) or Heat(...), got "
                f"{shown(self.problem)}."
            )
        object.__setattr__(self, "edge", as_edge(self.edge))
        for one in self.edge_conditions:
            if not isinstance(one, Condition) or one.couples:
                raise SceneError(
                    f"`edge` must be {ONE_SIDED_WORDS}, or a table with one of them for each loop, or a list of pairs "
                    f"of one and where it holds, got {shown(one)}."
                )
        arrays = VertexArrays(self.surface)
        object.__setattr__(self, "problem", arrays.stated(self.problem, self.problem.kind))
        object.__setattr__(self, "edge", arrays.edge(self.edge))
        placed = (one.on(self.surface) if isinstance(one, Boundary) else one for one in self.boundaries)
        object.__setattr__(self, "boundaries", tuple(map(arrays.boundary, placed)))
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
        assert self.channels

    @cached_property
    def channels(self) -> int:
        """How many right-hand sides are solved together: the entries of the data, where they have more than one."""
        counts = [(label, self._channels_of(label, data, place)) for label, data, place in self._data()]
        most = max((count for _, count in counts), default=1)
        for label, count in counts:
            if count not in (1, most):
                raise SceneError(f"{label} has {count} channels where others have {most}; give one value, or {most}.")
        return most

    def _channels_of(self, label: str, data: Data, place: int) -> int:
        known = getattr(data, "channels", None)
        if isinstance(known, int) and (isinstance(data, Functional) or callable(data)):
            return known  # a field elsewhere than at its own points costs a linear system
        return int(evaluate_data(data, self._place(place), None, label, self.problem.start_time).shape[1])

    @cached_property
    def has_tensor(self) -> bool:
        """Whether the equation's diffusivity is a tensor; a function is asked for its value at one point."""
        diffusivity = self.problem.terms().diffusivity
        return is_tensor(diffusivity, self._place(SURFACE_DATA)) if callable(diffusivity) else np.ndim(diffusivity) > 0

    @property
    def edge_conditions(self) -> list[Condition]:
        """The condition of the edge, or those of all its loops and parts."""
        return conditions_of_edge(self.edge)

    def __repr__(self) -> str:
        edge = ", ".join(one.kind for one in self.edge_conditions)
        names = ", ".join(repr(boundary.name) for boundary in self.boundaries) or "none"
        return f"Scene of {self.problem.kind}, {self.problem}, boundaries {names}, edge {edge}\n  on {self.surface!r}"

    def _repr_html_(self) -> str:
        rows = [("equation", f"{self.problem.kind}: {self.problem}"), ("surface", repr(self.surface))]
        for one in self.boundaries:
            left, right = (one.condition(side).kind for side in SIDES)
            rows.append((f"boundary {one.name!r}", f"{left} on the left, {right} on the right"))
        rows.append(("edge", ", ".join(one.kind for one in self.edge_conditions)))
        return html_table("Scene", rows)

    def oriented(self, boundary: BoundarySet) -> OrientedBoundary:
        """Return one of the boundaries with what tells its left.

        It is found once: all spacings, lattices and levels share it.

        Raises
        ------
        SceneError
            If the boundary is of the wrong dimension, or asks for sides that it has not.
        """
        if id(boundary) not in self._oriented:  # the scene keeps its boundaries alive
            self._oriented[id(boundary)] = orient(boundary, self.surface)
        return self._oriented[id(boundary)]

    @cached_property
    def _oriented(self) -> dict[int, OrientedBoundary]:
        return {}

    def _conditions(self) -> list[tuple[str, Condition]]:
        conditions = [
            (f"boundary {boundary.name!r}", boundary.condition(side)) for boundary in self.boundaries for side in SIDES
        ]
        return conditions + [("the edge's condition", edge) for edge in self.edge_conditions]

    @property
    def conditions(self) -> list[Condition]:
        """All conditions, of both sides of each boundary and of the edge."""
        return [condition for _, condition in self._conditions()]

    def _data(self) -> list[tuple[str, Data, int]]:
        """Return all data, what they are, and the place at which they can be asked, a number for :meth:`_place`."""
        places = [number for number, _ in enumerate(self.boundaries) for _ in SIDES]
        places += [EDGE_DATA - number for number, _ in enumerate(self.edge_conditions)]
        found: list[tuple[str, Data, int]] = []
        for (label, one), place in zip(self._conditions(), places, strict=True):
            data = one.data()
            found += [(label if len(data) == 1 else f"the {name} of {label}", datum, place) for name, datum in data]
        return found + [(label, data, SURFACE_DATA) for label, data in self.problem.data()]

    def _place(self, number: int) -> Floats:
        """Return a point (1, d) of a boundary, by its number, of the manifold's edge or of the manifold.

        Data may be undefined elsewhere. An edge that is not seen from the corners of the bounds is asked for inside.
        """
        if number not in self._places:
            source = self.boundaries[number].source if number >= 0 else self.surface
            if number <= EDGE_DATA:
                found = sample_edge_point(source, *parts_of_edge(self.edge)[EDGE_DATA - number])
            else:
                centre = np.asarray(source.bounds, dtype=np.float64).mean(axis=0)[None]
                found = LocalSource(source, np.zeros(source.dim)).closest_point(centre).points
            self._places[number] = found
        return self._places[number]

    @cached_property
    def _places(self) -> dict[int, Floats]:
        return {}


#: The word under which the data of the edge are given.
EDGE = "edge"


def with_replaced_data(scene: Scene, problem: Equation | None, data: Mapping[str, Any] | None) -> Scene:
    """Return the scene with another ``problem`` and other ``data``; see :meth:`cpmkit.preparing.Prepared.solve`.

    Raises
    ------
    SceneError
        If a name is no boundary's, or a condition differs in more than its data.
    """
    if problem is None and not data:
        return scene
    data = dict(data or {})
    boundaries = [
        _with_data(boundary, data.pop(boundary.name)) if boundary.name in data else boundary
        for boundary in scene.boundaries
    ]
    edge = _edge_with_data(scene.edge, data.pop(EDGE)) if EDGE in data else scene.edge
    if data:
        names = [EDGE, *(repr(boundary.name) for boundary in scene.boundaries)]
        raise SceneError(f"data are given for {next(iter(data))!r}; the scene has {', '.join(names)}.")
    return replace(scene, problem=problem or scene.problem, boundaries=boundaries, edge=edge)


def _with_data(boundary: Any, given: Any) -> Boundary:
    if not isinstance(boundary, Boundary):
        raise SceneError(
            f"boundary {boundary.name!r} is no cpmkit.Boundary, and takes no other data; use cpmkit.solve."
        )
    sides = {side: getattr(boundary, side) for side in ("both", "left", "right", "across")}
    held = {side: one for side, one in sides.items() if one is not None}
    new = given if isinstance(given, Mapping) else dict.fromkeys([*held][:1], given)
    new = as_conditions(new)
    if set(new) != set(held):
        raise SceneError(
            f"boundary {boundary.name!r} holds conditions on {' and '.join(held)}, got {' and '.join(new)}; give data "
            "for the same."
        )
    for side, one in new.items():
        _check_same(held[side], one, f"boundary {boundary.name!r}, {side},")
    if "left" in held and same_condition(*held.values()) != same_condition(*new.values()):
        count = "one condition" if same_condition(*held.values()) else "two conditions"
        raise SceneError(f"boundary {boundary.name!r} has {count} for its sides in the tables; use cpmkit.solve.")
    return replace(boundary, **new)


def _edge_with_data(edge: Any, given: Any) -> Any:
    given = as_edge(given)
    if shape_of_edge(edge) != shape_of_edge(given):
        raise SceneError(
            "data of the edge must be one condition, or one for each of its loops or parts, as the scene has them, "
            "and each part where it is."
        )
    if isinstance(edge, Mapping):
        given = {loop: given[loop] for loop in edge}
    for (old, _), (new, _) in zip(parts_of_edge(edge), parts_of_edge(given), strict=True):
        _check_same(old.condition, new.condition, "the edge")
    return given


def _check_same(old: Condition, new: Any, label: str) -> None:
    """Refuse a condition of another kind than the tables hold, or with other factors.

    Raises
    ------
    SceneError
        In one sentence.
    """
    if not isinstance(new, Condition) or old.order != new.order or not _same_but_data(old.law, new.law):
        raise SceneError(
            f"{label} is {old.kind} in the tables, got {shown(getattr(new, 'kind', new))}: only data may differ, not "
            "the kind, its factors or its order; use cpmkit.solve."
        )


def _same_but_data(old: Law, new: Law) -> bool:
    if type(old) is not type(new):
        return False
    if isinstance(old, Interface) and isinstance(new, Interface):
        return (old.resistance, old.left, old.right) == (new.resistance, new.left, new.right)
    if isinstance(old, Mixed) and isinstance(new, Mixed):
        return (old.alpha, old.beta) == (new.alpha, new.beta)
    return not isinstance(old, Nonlinear)
