"""What a solve cost, in units that no machine changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.linear.solve_report import SolveReport
from cpmkit.protocols import Operator
from cpmkit.runtime.memory import ENTRY_BYTES


@dataclass(frozen=True)
class Work:
    """Machine-independent measures of a solve.

    Attributes
    ----------
    unknowns : int
        Inner nodes and ghosts.
    nodes : int
        Nodes of the band, outer ones included.
    ghosts : int
        Unknowns that are ghosts.
    first_order_ghosts : int
        Ghosts of order 1 because their mirror point lies beyond another boundary, or by request.
    nonzeros : int
        Stored entries of E and N.
    operator_applications : int
        Products with A, all channels together.
    closest_point_queries : int
        Of the surface and of all boundaries.
    queries : mapping
        The same, by name of what was asked.
    table_bytes : int
        Bytes of E, N and the closest point records.
    """

    unknowns: int
    nodes: int
    ghosts: int
    first_order_ghosts: int
    nonzeros: int
    operator_applications: int
    closest_point_queries: int
    table_bytes: int
    queries: Mapping[str, int] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return the measures as plain values."""
        return asdict(self)


def measure_work(tables: Discretization, operator: Operator, report: SolveReport | None) -> Work:
    """Return what the tables hold and what the solve did."""
    fallen = sum(np.count_nonzero(ghosts.orders[: ghosts.unknowns] == 1) for ghosts in tables.layout.ghosts)
    return Work(
        unknowns=operator.size,
        nodes=len(tables.layout.band.nodes),
        ghosts=operator.size - tables.layout.band.inner,
        first_order_ghosts=int(fallen),
        nonzeros=operator.nonzeros,
        operator_applications=report.operator_applications if report else 0,
        closest_point_queries=sum(tables.layout.queries.values()),
        table_bytes=table_bytes(tables),
        queries=dict(tables.layout.queries),
    )


def table_bytes(tables: Discretization) -> int:
    """Return the bytes of E, the neighbours and their weights, the nodes and their closest points."""
    matrix = tables.extension
    stored = sum(part.nbytes for part in (matrix.data, matrix.indices, matrix.indptr))
    stored += tables.neighbours.nbytes + tables.neighbours.size * ENTRY_BYTES
    feet = tables.layout.band.feet
    return int(stored + tables.layout.band.nodes.nbytes + feet.points.nbytes + feet.distance.nbytes + feet.edge.nbytes)
