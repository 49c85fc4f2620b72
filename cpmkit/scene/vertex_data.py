"""Data given by one row a vertex of a mesh, a point of a polyline or a sample of a cloud."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from cpmkit.errors import InputError, SceneError
from cpmkit.protocols import ClosestPointSource, Floats, HasValues
from cpmkit.scene.boundary import Boundary
from cpmkit.scene.data import DATA_TYPE
from cpmkit.scene.diffusivities import TENSOR_SHAPES
from cpmkit.scene.edge_conditions import ByPosition


@dataclass(frozen=True, eq=False)
class VertexData:
    """A function of points that interpolates one row a vertex: for conditions, right-hand sides, initial values.

    At a point it is what ``source`` makes of its rows at the closest point, on a mesh and along a polyline linearly.

    Parameters
    ----------
    source : ClosestPointSource
        A mesh, a polyline, a cloud or a set of points: the surface itself, or a boundary's own source.
    values : (k,) or (k, channels) array
        In the order in which the vertices were given, ``k`` being ``source.value_count``.

    Raises
    ------
    InputError
        If the source carries no values, or they are not as many rows of finite numbers as it has vertices.

    Examples
    --------
    >>> import cpmkit as ck
    >>> line = ck.source("mesh.polyline", points=[[0, 0], [1, 0], [3, 0]])
    >>> ck.VertexData(line, [0.0, 1.0, 5.0])([[0.5, 0.1], [2.0, 0.0]])
    array([0.5, 3. ])
    """

    source: ClosestPointSource
    values: Any

    def __post_init__(self) -> None:
        if not isinstance(self.source, HasValues):
            raise InputError(
                f"The source {type(self.source).__name__} carries no values; per-vertex data belong to a mesh, a "
                "polyline, a cloud or a set of points."
            )
        object.__setattr__(self, "values", _checked(self.values, self.source.value_count))

    def __repr__(self) -> str:
        return f"VertexData({self.source!r}, {np.shape(self.values)} values)"

    def __call__(self, points: Floats) -> Floats:
        """Return the data (n,) or (n, channels) at ``points`` (n, d)."""
        assert isinstance(self.source, HasValues)
        feet = self.source.closest_point(np.ascontiguousarray(points, dtype=np.float64))
        return self.source.interpolate(self.values, feet)


def _checked(values: Any, count: int) -> Floats:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"values must be numbers, one row a vertex, got {type(values).__name__}.") from error
    if array.ndim not in (1, 2) or len(array) != count or not array.size:
        raise InputError(
            f"values must have the shape ({count},) or ({count}, channels), one row a vertex of the source, got "
            f"{array.shape}."
        )
    bad = np.flatnonzero(~np.isfinite(array.reshape(count, -1)).all(axis=1))
    if len(bad):
        raise InputError(f"values must be finite: {len(bad)} of {count} rows are not, the first is row {bad[0]}.")
    return array


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

    def stated(self, given: Any, label: str) -> Any:
        """Return an equation or a condition with vertex data; the same object for the same.

        Raises
        ------
        SceneError
            If an array is neither a row a vertex nor a few channels, or may be both; ``label`` names whose it is.
        """
        if not is_dataclass(given) or isinstance(given, type):
            return given
        if id(given) not in self._read:  # what is read is kept beside what it was made of, which keeps its id
            changed = {}
            for one in fields(given):
                value = getattr(given, one.name)
                if one.init and DATA_TYPE in str(one.type) and isinstance(value, np.ndarray) and value.ndim > 0:
                    changed[one.name] = self._datum(value, f"{one.name} of {label}")
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

    def _datum(self, array: np.ndarray, label: str) -> Any:
        if array.shape in TENSOR_SHAPES:
            return array
        if len(array) == self.count:
            if self.count <= FEW_VERTICES and array.ndim == 1:
                raise SceneError(
                    f"{label} is an array of {len(array)} numbers, which may be one value a vertex of the surface or "
                    "as many channels; give a list of channels, or ck.VertexData(surface, values)."
                )
            return VertexData(self.surface, array)
        if len(array) > MOST_CHANNELS:
            known = "carries no values" if self.count is None else f"has {self.count} vertices"
            raise SceneError(
                f"{label} is an array of shape {array.shape}, and the surface {known}; give one row a vertex, a "
                "function of points, ck.VertexData of another source, or a list of channels."
            )
        return array
