"""The parts of a union: the members of one dimension with their form, and their data, unknowns and points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.forms.field import Field
from cpmkit.forms.form_records import StateDependentCoefficient, StateFlux
from cpmkit.forms.galerkin.form import Galerkin
from cpmkit.forms.galerkin.unions.part_scenes import restrict_data, without_edge
from cpmkit.scene.data import is_sequence
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Ints


@dataclass(frozen=True, eq=False)
class UnionPart:
    """The members of one dimension in a union."""

    numbers: tuple[int, ...]  #: The numbers of the members.
    form: Galerkin  #: The form of the scene on them.
    unknowns: slice  #: Their unknowns among those of the union.
    points: slice  #: Their samples among those of the union.
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
    def taken(self) -> Ints:
        """(k,) the samples on their edge that lie on other members."""
        return self.form.junction_edge

    @property
    def dim(self) -> int:
        """The dimension of the members."""
        return int(self.form.scene.surface.manifold_dim or 0)

    def restrict(self, data: Any, union: object) -> Any:
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
