"""Vertices with given values: those on sides of boundaries and on the edge where Dirichlet conditions hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Floats, Ints, Value
from cpmkit_fem.rim import RimPart
from cpmkit_fem.ties import Tie


@dataclass(frozen=True, eq=False)
class Pins:
    """Vertices with given values; one that several conditions hold takes the value of the nearest, then of the first.

    Attributes
    ----------
    vertices : (p,) int64
    parts : sequence of RimPart and Tie
        Those with values, and those that hold a jump.
    picked : (p,) int64
        The row of the joined parts that each vertex takes.
    channels : int
        Of the values.
    """

    vertices: Ints
    parts: Sequence[RimPart | Tie]
    picked: Ints
    channels: int

    def values(self, time: float | None = None) -> Floats:
        """Return the values (p, channels)."""
        none = np.zeros((0, self.channels))
        found = [part.values(self.channels, time) for part in self.parts]
        return np.concatenate([none, *found])[self.picked]


def pins_of(parts: Sequence[RimPart], ties: Sequence[Tie], channels: int) -> Pins:
    """Return all pinned vertices."""
    held: list[RimPart | Tie] = [part for part in parts if isinstance(part.law, Value)]
    held += [tie for tie in ties if tie.holds_jump]
    vertices = np.concatenate([np.zeros(0, dtype=np.int64), *(part.on for part in held)])
    off = np.concatenate([np.zeros(0), *(part.off for part in held)])
    order = np.lexsort((off, vertices))
    pinned, first = np.unique(vertices[order], return_index=True)
    return Pins(pinned, held, order[first], channels)
