"""Data given by one row a vertex of a mesh, a point of a polyline or a sample of a cloud."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.files.array_files import read_array
from cpmkit.files.data_files import find_file
from cpmkit.protocols import ClosestPointSource, Floats, HasValues


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


#: What of a scene file may carry values: its name in messages, and its source.
Carrier = tuple[str, ClosestPointSource]


def with_vertex_data(value: Any, folder: Path, carriers: Sequence[Carrier], where: str) -> Any:
    """Return a value of a scene file with :class:`VertexData` in place of each table ``{ values = "FILE.npy" }``.

    Parameters
    ----------
    value : any
        As TOML gives it; tables and lists are looked through.
    folder : Path
        Where the files are looked for first.
    carriers : sequence of (name, source)
        To whose vertices the rows may belong. A table may say to whose: ``of = NAME``; else they must fit one alone.
    where : str
        Named in errors.

    Raises
    ------
    SceneError
        If an array fits none of the carriers, or several.
    InputError
        If a file is missing or holds no array of finite numbers.
    """
    if isinstance(value, dict) and "values" in value:
        return _vertex_data(value, folder, carriers, where)
    if isinstance(value, dict):
        return {key: with_vertex_data(entry, folder, carriers, f"{key} of {where}") for key, entry in value.items()}
    if isinstance(value, list):
        return [with_vertex_data(entry, folder, carriers, where) for entry in value]
    return value


def _vertex_data(table: dict[str, Any], folder: Path, carriers: Sequence[Carrier], where: str) -> VertexData:
    unknown = sorted(set(table) - {"values", "of"})
    names = [name for name, _ in carriers]
    if unknown or not isinstance(table["values"], str) or table.get("of", names[0]) not in names:
        raise SceneError(
            f"{where} must be {{ values = 'FILE.npy' }}, with of = {' or '.join(map(repr, names))} if need be, got "
            f"{shown(table)}."
        )
    array = read_array(find_file(table["values"], folder), "an array of numbers")
    offered = [carrier for carrier in carriers if table.get("of", carrier[0]) == carrier[0]]
    counts = {name: source.value_count for name, source in offered if isinstance(source, HasValues)}
    fitting = [name for name, count in counts.items() if np.shape(array)[:1] == (count,)]
    if len(fitting) != 1:
        rows = f"{shown(table['values'])} of {where} has the shape {array.shape}"
        if fitting:
            raise SceneError(f"{rows}, which fits {' and '.join(fitting)}; add of = {fitting[0]!r} or another of them.")
        known = " and ".join(f"{name} has {count} vertices" for name, count in counts.items())
        raise SceneError(f"{rows}, where {known or f'{names[0]} carries no values'}; give one row a vertex.")
    return VertexData(dict(offered)[fitting[0]], array)
