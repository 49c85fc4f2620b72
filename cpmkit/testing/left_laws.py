"""The laws of sources that know their left, or number many edges; a source without the ability keeps them all."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Floats, HasLeft, HasManyEdges, HasTangents, NamesLeft
from cpmkit.testing.law import law, require, require_rows, sure
from cpmkit.testing.queries import ROUND_OFF_SHARE, Subject, for_queries


@law(HasLeft)
def check_left(subject: Subject) -> None:
    """Vectors to the left are of length one, at right angles to the curve, and the point on the left is there."""

    def hold(x: Floats) -> None:
        feet = subject.source.closest_point(x)
        feet = feet.take(sure(feet))
        left = subject.source.leftward(feet)
        require(left.shape == feet.points.shape, f"There are {left.shape} vectors for {feet.points.shape} feet.")
        length = np.linalg.norm(left, axis=1)
        require_rows(np.abs(length - 1) <= ROUND_OFF_SHARE, feet.points, "A vector to the left has the length", length)
        if isinstance(subject.source, HasTangents):
            along = np.abs(np.sum(left * subject.source.tangents(feet), axis=1))
            require_rows(along <= ROUND_OFF_SHARE, feet.points, "A vector to the left leans along the curve by", along)

    for_queries(subject, hold, within_radius=True)
    named = subject.source.left_of if isinstance(subject.source, NamesLeft) else None
    if named is not None:
        point = np.asarray(named, dtype=np.float64)[None]
        feet = subject.source.closest_point(point)
        on_left = bool(np.sum((point - feet.points) * subject.source.leftward(feet)) > 0)
        require(on_left, f"left_of, {point[0].tolist()}, is not on the left.")


@law()
def check_edge_limit(subject: Subject) -> None:
    """All numbers of edges are below 1000, or below the limit that the source states, a multiple of that."""
    source = subject.source
    limit = source.edge_limit if isinstance(source, HasManyEdges) else 1000
    require(limit > 0 and limit % 1000 == 0, f"The limit of the edges' numbers is {limit}, no multiple of 1000.")

    def hold(x: Floats) -> None:
        largest = int(subject.feet(x).edge.max(initial=-1))
        require(largest < limit, f"An edge has the number {largest}, the limit is {limit}.")

    for_queries(subject, hold, within_radius=False)
