"""Arrays of data with one value a vertex of the surface: read as such, and told apart from channels.

A list or tuple states channels, one entry each. An array of NumPy or a column of pandas states one row a vertex where
it has as many rows as the surface has vertices; a short one states channels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.protocols import ClosestPointSource, HasValues
from cpmkit.scene.boundary import Boundary
from cpmkit.scene.by_position import ByPosition
from cpmkit.scene.formula_data import DATA_TYPE
from cpmkit.scene.tensors import TENSOR_SHAPES
from cpmkit.scene.vertex_data import VertexData

#: An array of more entries is refused where it is no vertex data: nobody means so many channels of constants.
MOST_CHANNELS = 16
#: Of a surface with so few vertices an array may be either, the channels of a colour or one value a vertex.
FEW_VERTICES = 4


class VertexArrays:
    """Puts :class:`VertexData` of a surface in the place of arrays with one row for each of its vertices."""

    def __init__(self, surface: ClosestPointSource) -> None:
        self.surface = surface
        self.count = surface.value_count if isinstance(surface, HasValues) else None
        self._read: dict[int, tuple[Any, Any]] = {}

    def stated(self, given: Any, what: str) -> Any:
        """Return an equation or a condition with vertex data; the same object for the same.

        Raises
        ------
        SceneError
            If an array is neither a row a vertex nor a few channels, or may be both; ``what`` names whose it is.
        """
        if not is_dataclass(given) or isinstance(given, type):
            return given
        if id(given) not in self._read:  # what is read is kept beside what it was made of, which keeps its id
            changed = {}
            for one in fields(given):
                value = getattr(given, one.name)
                if one.init and DATA_TYPE in str(one.type) and isinstance(value, np.ndarray) and value.ndim > 0:
                    changed[one.name] = self._datum(value, f"{one.name} of {what}")
            differs = any(new is not getattr(given, name) for name, new in changed.items())
            self._read[id(given)] = given, replace(given, **changed) if differs else given
        return self._read[id(given)][1]

    def boundary(self, given: Any) -> Any:
        """Return a boundary whose conditions have vertex data."""
        if not isinstance(given, Boundary):
            return given
        sides = {side: getattr(given, side) for side in ("both", "left", "right", "across")}
        read = {side: self.stated(one, f"boundary {given.name!r}") for side, one in sides.items() if one is not None}
        return given if all(read[side] is sides[side] for side in read) else replace(given, **read)

    def edge(self, given: Any) -> Any:
        """Return what holds on an edge, its conditions with vertex data."""
        if isinstance(given, Mapping):
            return {loop: self.edge(one) for loop, one in given.items()}
        if isinstance(given, ByPosition):
            parts = [replace(part, condition=self.stated(part.condition, "the edge")) for part in given.parts]
            return replace(given, parts=type(given.parts)(parts))
        return self.stated(given, "the edge")

    def _datum(self, array: np.ndarray, what: str) -> Any:
        if array.shape in TENSOR_SHAPES:
            return array
        if len(array) == self.count:
            if self.count <= FEW_VERTICES and array.ndim == 1:
                raise SceneError(
                    f"{what} is an array of {len(array)} numbers, which may be one value a vertex of the surface or as "
                    "many channels; give a list of channels, or ck.VertexData(surface, values)."
                )
            return VertexData(self.surface, array)
        if len(array) > MOST_CHANNELS:
            known = "carries no values" if self.count is None else f"has {self.count} vertices"
            raise SceneError(
                f"{what} is an array of shape {array.shape}, and the surface {known}; give one row a vertex, a "
                "function of points, ck.VertexData of another source, or a list of channels."
            )
        return array
