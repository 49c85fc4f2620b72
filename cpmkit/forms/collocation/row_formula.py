"""Formulas of the rows of the extension matrix: ``value = sum of coefficient * u(points) + data``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cpmkit.forms.collocation.side_view import SideView
from cpmkit.manifold.source import ClosestPoints
from cpmkit.scene.data import Data, evaluate_data, takes_time
from cpmkit.scene.laws import Law
from cpmkit.types import Floats, Ints


@dataclass(frozen=True, eq=False)
class BoundaryData:
    """The term ``factor * data(points)`` of boundary data in some rows of a batch."""

    rows: Ints  #: (k,): numbers of the rows in the batch.
    factor: Floats  #: (k,): factors of the data.
    points: Floats  #: (k, d): points at which the data are evaluated, in the scene's coordinates.
    data: Data  #: The data of a condition.
    label: str  #: Name of the boundary or edge, for errors.
    law: Law  #: The law of the condition.
    part: str = "datum"  #: "datum", "jump" or "flux": which of the law's data these are.
    at_corners: bool = False  #: Whether the points are near corners, across which a flux jumps.

    @property
    def name(self) -> str:
        """The name of the data in errors."""
        return self.label if self.part == "datum" else f"the {self.part} of {self.label}"

    @property
    def takes_time(self) -> bool:
        """Whether the data depend on time."""
        return takes_time(self.data)

    def scale(self, coefficient: Floats) -> BoundaryData:
        """Return the data with their factor in each row of the batch multiplied by its ``coefficient`` (n,)."""
        return replace(self, factor=self.factor * coefficient[self.rows])

    def renumber(self, numbers: Ints) -> BoundaryData:
        """Return the data with row k of the batch renumbered to ``numbers[k]``; rows with -1 are dropped."""
        chosen = numbers[self.rows] >= 0
        return replace(self, rows=numbers[self.rows[chosen]], factor=self.factor[chosen], points=self.points[chosen])


def sum_of_data(data: Iterable[BoundaryData], rows: int, channels: int, time: float | None = None) -> Floats:
    """Return the vector (rows, channels) that is added to E u: in each row of E the sum of its boundary ``data``.

    Each is multiplied by its factor; rows without data are 0. ``time`` is None for problems without time. Raises
    InputError as :func:`evaluate_data`.
    """
    total = np.zeros((rows, channels))
    for datum in data:
        values = evaluate_data(datum.data, datum.points, channels, datum.name, time)
        np.add.at(total, datum.rows, datum.factor[:, None] * values)
    return total


@dataclass(frozen=True, eq=False)
class ExtraPoint:
    """A further point of the manifold at which each of some rows reads u."""

    rows: Ints  #: (k,): numbers of the rows in a batch.
    points: Floats  #: (k, d): points of the manifold, relative to the lattice's origin.
    coefficient: Floats  #: (k,): factors of u there.
    #: For each boundary, the distances and sides of the points near it; their rows number the points.
    side_views: Sequence[SideView] = ()
    owner: int = -1  #: The boundary whose ghosts read the points; -1 for nodes.
    feet: ClosestPoints | None = None  #: The surface's records of the points; given where its sheets share the band.

    def renumber(self, numbers: Ints) -> ExtraPoint:
        """Return the points, without side views, with row k renumbered to ``numbers[k]``; rows with -1 are dropped."""
        chosen = numbers[self.rows] >= 0
        feet = None if self.feet is None else self.feet.take(chosen)
        return ExtraPoint(numbers[self.rows[chosen]], self.points[chosen], self.coefficient[chosen], feet=feet)


@dataclass(frozen=True, eq=False)
class RowFormula:
    """The formulas of a batch of n rows."""

    points: Floats  #: (n, d): the point of the manifold that each row reads, relative to the lattice's origin.
    coefficient: Floats  #: (n,): factors of u there.
    data: Sequence[BoundaryData] = ()  #: Terms of boundary data.
    terms: Sequence[ExtraPoint] = ()  #: Further points that some rows read.
    feet: ClosestPoints | None = None  #: The surface's records of the points; given where its sheets share the band.

    def __len__(self) -> int:
        return len(self.points)


def extrapolation_weights(nodes: Floats, at: Floats) -> Floats:
    """Return the Lagrange weights (n, m) that extrapolate values at distances ``nodes`` (n, m) to ``at`` (n,)."""
    count = nodes.shape[1]
    weights = np.ones_like(nodes)
    for k in range(count):
        for j in range(count):
            if j != k:
                weights[:, k] *= (at - nodes[:, j]) / (nodes[:, k] - nodes[:, j])
    return weights
