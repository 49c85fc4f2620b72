"""Formulas of the rows of the extension: ``value = sum of coefficient * u(points) + data``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.manifold.source import ClosestPoints
from cpmkit.scene.data import Data, evaluate_data, takes_time
from cpmkit.scene.laws import Law
from cpmkit.types import Floats, Ints

if TYPE_CHECKING:
    from cpmkit.forms.collocation.side_view import SideView


@dataclass(frozen=True, eq=False)
class BoundaryData:
    """The term of boundary data in some rows: ``factor * data(points)``.

    Attributes
    ----------
    rows : (k,) int64
        Which rows of a batch.
    factor : (k,) float64
        Multiplies the data.
    points : (k, d) float64
        Where they are read, in the scene's coordinates.
    data : Data
        As a condition gives them.
    label : str
        Name of the boundary or edge, for errors.
    law : Law
        Of the condition that gives them.
    part : "datum", "jump" or "flux"
        Which of the law's data they are.
    at_corners : bool
        Whether the points lie beside corners, across which a flux jumps.
    """

    rows: Ints
    factor: Floats
    points: Floats
    data: Data
    label: str
    law: Law
    part: str = "datum"
    at_corners: bool = False

    @property
    def name(self) -> str:
        """Name of the data in errors."""
        return self.label if self.part == "datum" else f"the {self.part} of {self.label}"

    @property
    def takes_time(self) -> bool:
        """True where the data change in time."""
        return takes_time(self.data)

    def scale(self, coefficient: Floats) -> BoundaryData:
        """Return the data with each row of the batch multiplied by its ``coefficient`` (n,)."""
        return replace(self, factor=self.factor * coefficient[self.rows])

    def renumber(self, numbers: Ints) -> BoundaryData:
        """Return the data with row k of the batch called ``numbers[k]``; -1 leaves it out."""
        chosen = numbers[self.rows] >= 0
        return replace(self, rows=numbers[self.rows[chosen]], factor=self.factor[chosen], points=self.points[chosen])


def sum_of_data(data: Iterable[BoundaryData], rows: int, channels: int, time: float | None = None) -> Floats:
    """Return the sum (rows, channels) of all ``data`` in each of so many rows."""
    total = np.zeros((rows, channels))
    for datum in data:
        values = evaluate_data(datum.data, datum.points, channels, datum.name, time)
        np.add.at(total, datum.rows, datum.factor[:, None] * values)
    return total


@dataclass(frozen=True, eq=False)
class ExtraPoint:
    """A further point that some rows read.

    Attributes
    ----------
    rows : (k,) int64
        Which rows of a batch.
    points : (k, d) float64
        Points of the manifold, relative to the lattice's origin.
    coefficient : (k,) float64
        Factor of u there.
    side_views : sequence of SideView
        How each boundary sees the points; their rows count the points.
    owner : int
        The boundary whose ghosts read; -1 where nodes do.
    feet : ClosestPoints, optional
        The surface's records of the points: where several of its sheets share the band.
    """

    rows: Ints
    points: Floats
    coefficient: Floats
    side_views: Sequence[SideView] = ()
    owner: int = -1
    feet: ClosestPoints | None = None

    def renumber(self, numbers: Ints) -> ExtraPoint:
        """Return the points with row k of the batch called ``numbers[k]``, -1 leaves it out; without side views."""
        chosen = numbers[self.rows] >= 0
        feet = None if self.feet is None else self.feet.take(chosen)
        return ExtraPoint(numbers[self.rows[chosen]], self.points[chosen], self.coefficient[chosen], feet=feet)


@dataclass(frozen=True, eq=False)
class RowFormula:
    """The formulas of a batch of n rows.

    Attributes
    ----------
    points : (n, d) float64
        Points of the manifold, relative to the lattice's origin.
    coefficient : (n,) float64
        Factor of u there.
    data : sequence of BoundaryData
        Terms of boundary data.
    terms : sequence of ExtraPoint
        Further points that some rows read.
    feet : ClosestPoints, optional
        The surface's records of the points: where several of its sheets share the band.
    """

    points: Floats
    coefficient: Floats
    data: Sequence[BoundaryData] = ()
    terms: Sequence[ExtraPoint] = ()
    feet: ClosestPoints | None = None

    def __len__(self) -> int:
        return len(self.points)


def extrapolation_weights(nodes: Floats, at: Floats) -> Floats:
    """Return the weights (n, m) with which values at ``nodes`` (n, m) give their polynomial's value ``at`` (n,)."""
    count = nodes.shape[1]
    weights = np.ones_like(nodes)
    for k in range(count):
        for j in range(count):
            if j != k:
                weights[:, k] *= (at - nodes[:, j]) / (nodes[:, k] - nodes[:, j])
    return weights
