"""Vertices with prescribed values: those with Dirichlet conditions, on sides of boundaries and on the edge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Floats, Ints, Value
from cpmkit_fem.rim import RimPart
from cpmkit_fem.ties import Tie


@dataclass(frozen=True, eq=False)
class Pins:
    """Vertices with prescribed values; of several conditions at a vertex the nearest holds, then the first.

    Attributes
    ----------
    vertices : (p,) int64
        The pinned vertices, ascending.
    parts : sequence of RimPart and Tie
        Parts with values, and ties with a prescribed jump.
    picked : (p,) int64
        The row of each vertex in the concatenated parts.
    channels : int
        Number of channels of the values.
    """

    vertices: Ints
    parts: Sequence[RimPart | Tie]
    picked: Ints
    channels: int

    def values(self, time: float | None = None) -> Floats:
        """Return the prescribed values (p, channels), of ties their jumps; ``time`` is None for steady problems."""
        none = np.zeros((0, self.channels))
        of_parts = [part.values(self.channels, time) for part in self.parts]
        return np.concatenate([none, *of_parts])[self.picked]


def pins_of(parts: Sequence[RimPart], ties: Sequence[Tie], channels: int) -> Pins:
    """Return the pinned vertices: those of ``parts`` with a Value law, and those of ``ties`` that prescribe a jump."""
    prescribed: list[RimPart | Tie] = [part for part in parts if isinstance(part.law, Value)]
    prescribed += [tie for tie in ties if tie.prescribes_jump]
    vertices = np.concatenate([np.zeros(0, dtype=np.int64), *(part.vertex_numbers for part in prescribed)])
    off = np.concatenate([np.zeros(0), *(part.distances for part in prescribed)])
    order = np.lexsort((off, vertices))
    pinned, first = np.unique(vertices[order], return_index=True)
    return Pins(pinned, prescribed, order[first], channels)
