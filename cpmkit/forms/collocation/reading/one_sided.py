"""Gradients beside a bend of the extension, continued from points farther inside.

A ghost of order 1 or 2 that carries a value continues the solution by a straight line, so that second derivatives
of the interpolant jump there and its gradient is of first order only. The values themselves are of second order
up to the boundary, and so is the gradient where stencils hardly reach a ghost. Read there at three distances, a
parabola in the distance continues it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.collocation.boundary.side_view import SideView
from cpmkit.grid.stencils import stencil_cells, stencil_nodes
from cpmkit.manifold.tangent_space import outward_conormals
from cpmkit.protocols import SIDES, Bools, ClosestPoints, Floats, Ints, Rows, Side
from cpmkit.scene.conditions import Condition
from cpmkit.scene.edge_conditions import edge_condition
from cpmkit.scene.laws import Value

if TYPE_CHECKING:
    from cpmkit.forms.collocation.reading.points import Reader

#: Distances, in spacings, from which the gradient is continued. From 2 on it still feels the bend, on an arc at
#: spacing 0.006 three times as much as from 2.5 on; from 3 on it is three times as far off at spacing 0.05.
CONTINUATION_DISTANCES_SPACINGS = (2.5, 3.5, 4.5)
#: A sample counts as inside if it is as far from all bends as the first step, less this share.
INSIDE_SLACK_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class Bends(Rows):
    """Points of a batch beside a bend of the extension.

    Attributes
    ----------
    rows : (k,) int64
        Their numbers in the batch, each once.
    distance : (k,) float64
        From the boundary or the edge.
    inward : (k, d) float64
        Unit vectors away from it, on the point's side.
    """

    rows: Ints
    distance: Floats
    inward: Floats


@dataclass(frozen=True, eq=False)
class SamplesInside:
    """Where the gradients of some rows are continued from, s samples a row, and the samples' weights (k, s)."""

    rows: Ints
    feet: ClosestPoints
    weights: Floats


def find_bends(reader: Reader, feet: ClosestPoints, side_views: Sequence[SideView]) -> Bends:
    """Return those points of a batch that lie beside a bend, each with the one nearest to it."""
    found = Bends.join([*_at_boundaries(reader, side_views), _at_edge(reader, feet)])
    found = found.take(found.distance < CONTINUATION_DISTANCES_SPACINGS[0] * reader.spacing)
    order = np.lexsort((found.distance, found.rows))
    return found.take(order[np.unique(found.rows[order], return_index=True)[1]])


def samples_inside(
    reader: Reader, feet: ClosestPoints, side_views: Sequence[SideView], bends: Bends, wanted: Mapping[int, Side]
) -> SamplesInside:
    """Return the samples inside of those bends that have room for them."""
    ways = np.array(CONTINUATION_DISTANCES_SPACINGS) * reader.spacing
    offsets = (ways - bends.distance[:, None])[:, :, None] * bends.inward[:, None]
    targets = (feet.points[bends.rows][:, None] + offsets).reshape(-1, feet.points.shape[1])
    samples = reader.tables.layout.surface.closest_point(targets)
    sound = _sound_samples(reader, samples, side_views, np.repeat(bends.rows, len(ways)), wanted)
    kept = sound.reshape(-1, len(ways)).all(axis=1)
    weights = _parabola(ways, bends.distance[kept])
    return SamplesInside(bends.rows[kept], samples.take(np.repeat(kept, len(ways))), weights)


def _parabola(distances: Floats, at: Floats) -> Floats:
    """Return the weights (k, s) that extrapolate values at ``distances`` (s,) to ``at`` (k,) by a polynomial."""
    weights = np.empty((len(at), len(distances)))
    for k, distance in enumerate(distances):
        others = np.delete(distances, k)
        weights[:, k] = np.prod((at[:, None] - others) / (distance - others), axis=1)
    return weights


def _bends_interpolant(condition: Condition, order: int) -> bool:
    """Tell whether ghosts of this condition bend the interpolant: those of order 1 or 2 that carry a value."""
    return (condition.order or order) <= 2 and isinstance(condition.law, Value)


def _at_boundaries(reader: Reader, side_views: Sequence[SideView]) -> list[Bends]:
    bends = []
    order = reader.tables.layout.order
    for boundary, frame in zip(reader.scene.boundaries, side_views, strict=True):
        on_left = frame.signed >= 0
        sides = [_bends_interpolant(boundary.condition(side), order) for side in SIDES]
        rows = np.flatnonzero(~np.isnan(frame.signed) & ~frame.end & np.where(on_left, *sides))
        inward = np.where(on_left, 1.0, -1.0)[rows, None] * frame.conormal[rows]
        bends.append(Bends(frame.rows[rows], np.abs(frame.signed[rows]), inward))
    return bends


def _at_edge(reader: Reader, feet: ClosestPoints) -> Bends:
    """Return the points whose stencils read nodes past a bent edge, with the nearest place of it that they read."""
    layout = reader.tables.layout
    band, none = layout.band, Bends(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, feet.points.shape[1])))
    loops = np.unique(band.feet.edge[band.feet.edge >= 0])
    bent = [loop for loop in loops if _bends_interpolant(edge_condition(reader.scene.edge, int(loop)), layout.order)]
    if not bent:
        return none
    nodes = stencil_nodes(band, stencil_cells(feet.points, band.spacing, band.degree)[0])
    past = np.isin(band.feet.edge[nodes], bent)
    rows = np.flatnonzero(past.any(axis=1))
    if not len(rows):
        return none
    away = np.linalg.norm(band.feet.points[nodes[rows]] - feet.points[rows, None], axis=2)
    nearest = np.where(past[rows], away, np.inf).argmin(axis=1)
    edge = band.feet.take(nodes[rows, nearest])
    outward = outward_conormals(layout.surface, edge, 0.5 * band.spacing)
    distance = np.maximum(np.sum((edge.points - feet.points[rows]) * outward, axis=1), 0.0)
    return Bends(rows, distance, -outward)


def _sound_samples(
    reader: Reader, samples: ClosestPoints, side_views: Sequence[SideView], rows: Ints, wanted: Mapping[int, Side]
) -> Bools:
    """Tell which samples, of the points ``rows``, lie on their points' sides and away from every bend."""
    sound: Bools = samples.edge < 0
    sample_frames = reader.side_views(samples.points, wanted)
    for at_point, at_sample in zip(side_views, sample_frames, strict=True):
        place = np.searchsorted(at_point.rows, rows[at_sample.rows])
        known = place < len(at_point.rows)
        known[known] = at_point.rows[place[known]] == rows[at_sample.rows[known]]
        opposite = np.sum(at_point.director[place[known]] * at_sample.director[known], axis=1) < 0
        sound[at_sample.rows[known][opposite]] = False
    nearest = np.full(len(samples), np.inf)
    for bends in (*_at_boundaries(reader, sample_frames), _at_edge(reader, samples)):
        np.minimum.at(nearest, bends.rows, bends.distance)
    return sound & (nearest > (1 - INSIDE_SLACK_SHARE) * CONTINUATION_DISTANCES_SPACINGS[0] * reader.spacing)
