"""Data with one row per vertex of a source, and their recognition among the arrays given to a scene."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from cpmkit.errors import InputError, SceneError
from cpmkit.manifold.abilities import HasValues
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.scene.boundary import Boundary
from cpmkit.scene.data import DATA_TYPE
from cpmkit.scene.diffusivities import TENSOR_SHAPES
from cpmkit.scene.edge_conditions import map_conditions
from cpmkit.types import Floats


@dataclass(frozen=True, eq=False)
class VertexData:
    """A function of points that interpolates data at vertices: for conditions, right-hand sides, initial values.

    Its value at a point is the interpolation by ``source`` at the closest point, linear on a mesh and along a polyline.

    Parameters
    ----------
    source : ClosestPointSource
        A mesh, a polyline, a point cloud or a set of points: the surface, or the source of a boundary.
    values : (k,) or (k, channels) array
        In the order of the vertices that the source was made from; k is ``source.value_count``.

    Raises
    ------
    InputError
        If the source does not interpolate values, or the number of rows is not that of its vertices, or a value is not
        finite.

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
        """Check that the source interpolates values, and convert the values to an array with one row per vertex."""
        if not isinstance(self.source, HasValues):
            raise InputError(
                f"The source {type(self.source).__name__} carries no values; per-vertex data belong to a mesh, a "
                "polyline, a cloud or a set of points."
            )
        object.__setattr__(self, "values", _as_vertex_values(self.values, self.source.value_count))

    def __repr__(self) -> str:
        return f"VertexData({self.source!r}, {np.shape(self.values)} values)"

    def __call__(self, points: Floats) -> Floats:
        """Return the data (n,) or (n, channels) at ``points`` (n, d)."""
        assert isinstance(self.source, HasValues)
        feet = self.source.closest_point(np.ascontiguousarray(points, dtype=np.float64))
        return self.source.interpolate(self.values, feet)


def _as_vertex_values(values: Any, count: int) -> Floats:
    """Return values as an array (count,) or (count, channels).

    Raises
    ------
    InputError
        If the values are not finite numbers in such a shape.
    """
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


#: Longest array of constants, one for each channel; longer arrays must be vertex data.
MAX_CHANNELS = 16
#: Number of vertices up to which an array may be either the channels of a colour or one value per vertex.
FEW_VERTICES = 4


class VertexArrays:
    """Replaces arrays that have one row for each vertex of a surface by :class:`VertexData`.

    A list or tuple has one entry for each channel. An array of NumPy has one row for each vertex if it has as many rows
    as the surface has vertices; a short array has one entry for each channel.
    """

    def __init__(self, surface: ClosestPointSource) -> None:
        self.surface = surface
        self.count = surface.value_count if isinstance(surface, HasValues) else None
        self._replaced: dict[int, tuple[Any, Any]] = {}

    def in_fields(self, instance: Any, label: str) -> Any:
        """Return an equation or a condition with arrays replaced by vertex data; the same result for the same object.

        Raises
        ------
        SceneError
            If an array has neither one row per vertex nor few channels, or may be both; ``label`` is the name of the
            equation or condition.
        """
        if not is_dataclass(instance) or isinstance(instance, type):
            return instance
        if id(instance) not in self._replaced:  # the argument is stored too, so that its id stays unique
            changed = {}
            for member in fields(instance):
                value = getattr(instance, member.name)
                if member.init and DATA_TYPE in str(member.type) and isinstance(value, np.ndarray) and value.ndim > 0:
                    changed[member.name] = self._datum(value, f"{member.name} of {label}")
            differs = any(new is not getattr(instance, name) for name, new in changed.items())
            self._replaced[id(instance)] = instance, replace(instance, **changed) if differs else instance
        return self._replaced[id(instance)][1]

    def in_boundary(self, boundary: Any) -> Any:
        """Return a boundary with arrays in its conditions replaced by vertex data."""
        if not isinstance(boundary, Boundary):
            return boundary
        old = boundary.given_conditions
        new = {side: self.in_fields(condition, f"boundary {boundary.name!r}") for side, condition in old.items()}
        return boundary if all(new[side] is old[side] for side in old) else replace(boundary, **new)

    def in_edge(self, edge: Any) -> Any:
        """Return the conditions of an edge with arrays replaced by vertex data."""
        return map_conditions(edge, lambda condition: self.in_fields(condition, "the edge"))

    def _datum(self, array: np.ndarray, label: str) -> Any:
        """Return an ``array`` with one row per vertex as :class:`VertexData`; a tensor or channels unchanged.

        Raises
        ------
        SceneError
            If the array has neither one row per vertex nor few channels, or may be both; ``label`` is its name.
        """
        if array.shape in TENSOR_SHAPES:
            return array
        if len(array) == self.count:
            if self.count <= FEW_VERTICES and array.ndim == 1:
                raise SceneError(
                    f"{label} is an array of {len(array)} numbers, which may be one value a vertex of the surface or "
                    "as many channels; give a list of channels, or ck.VertexData(surface, values)."
                )
            return VertexData(self.surface, array)
        if len(array) > MAX_CHANNELS:
            known = "carries no values" if self.count is None else f"has {self.count} vertices"
            raise SceneError(
                f"{label} is an array of shape {array.shape}, and the surface {known}; give one row a vertex, a "
                "function of points, ck.VertexData of another source, or a list of channels."
            )
        return array
