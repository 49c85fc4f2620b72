"""The rim of an open surface or the ends of an open curve: where nodes past the edge read.

A node whose foot lies on the edge reads the manifold at a mirror point inside, by the same formula as
a ghost, with z = y the foot, ``t = (x - y) . b`` and ``s = 2 (x - y) . b``. Zero Neumann, the default,
needs no conormal b: at order 2 the mirror ``cp_S(2 y - x)``, at order 1 the foot itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cpmkit.boundary.formulas import coefficient_and_factor, mirror_distance
from cpmkit.boundary.tangent_space import outward_conormals
from cpmkit.conditions import Condition, evaluate_data
from cpmkit.errors import SceneError
from cpmkit.grid.band import Band
from cpmkit.grid.lattice import Lattice
from cpmkit.localized import Localized
from cpmkit.protocols import ClosestPoints, Floats, Ints

#: Nodes nearer to their foot than this share of the spacing do not tell the direction of the conormal.
TOUCHING = 1e-6


@dataclass(frozen=True, eq=False)
class Reading:
    """What extension rows read: ``value = coefficient * u(points) + datum``.

    Attributes
    ----------
    points : (n, d) float64
        Points of the manifold, relative to the lattice's origin.
    coefficient : (n,) float64
        Factor of what is read.
    datum : (n, channels) float64
        What the boundary data add.
    """

    points: Floats
    coefficient: Floats
    datum: Floats

    def take(self, index: Ints) -> Reading:
        """Return the readings at ``index``."""
        return Reading(self.points[index], self.coefficient[index], self.datum[index])


def edge_condition(edge: Condition | Mapping[int, Condition], loop: int) -> Condition:
    """Return the condition of edge ``loop``.

    Raises
    ------
    SceneError
        If the edge is a table and the loop is not in it.
    """
    if not isinstance(edge, Mapping):
        return edge
    if loop not in edge:
        raise SceneError(
            f"the surface has an edge loop {loop} for which `edge` gives no condition; it has {sorted(edge)}."
        )
    return edge[loop]


def read_past_edge(
    surface: Localized,
    band: Band,
    lattice: Lattice,
    edge: Condition | Mapping[int, Condition],
    order: int,
    channels: int,
) -> Reading:
    """Return what each node of the band reads, the edge's conditions applied to those past it."""
    n = len(band.nodes)
    points, coefficient, datum = band.feet.points.copy(), np.ones(n), np.zeros((n, channels))
    for loop in np.unique(band.feet.edge[band.feet.edge >= 0]):
        rows = np.flatnonzero(band.feet.edge == loop)
        condition = edge_condition(edge, int(loop))
        read = _past_loop(surface, band, lattice, condition, order, channels, rows)
        points[rows], coefficient[rows], datum[rows] = read.points, read.coefficient, read.datum
    return Reading(points, coefficient, datum)


def _past_loop(
    surface: Localized, band: Band, lattice: Lattice, condition: Condition, order: int, channels: int, rows: Ints
) -> Reading:
    foot, beyond = band.feet.points[rows], band.positions[rows] - band.feet.points[rows]
    if is_wall(condition):
        points = foot if (condition.order or order) == 1 else surface.closest_point(foot - beyond).points
        return Reading(points, np.ones(len(rows)), np.zeros((len(rows), channels)))
    outward = _outward(surface, band.feet.take(rows), beyond, band.spacing)
    t = np.maximum(np.sum(beyond * outward, axis=1), 0.0)
    first = (condition.order or order) == 1
    mirror = foot - beyond - (mirror_distance(condition, t, band.spacing) - t)[:, None] * outward
    points = foot if first else surface.closest_point(mirror).points
    coefficient, factor = coefficient_and_factor(condition, t, 2 * t, np.full(len(rows), first), band.spacing)
    gamma = evaluate_data(condition.gamma, lattice.to_scene(foot), channels, "the edge's condition")
    return Reading(points, coefficient, factor[:, None] * gamma)


def _outward(surface: Localized, edge: ClosestPoints, beyond: Floats, spacing: float) -> Floats:
    """Return the outward conormals (n, d) at the feet of nodes past the edge, ``beyond`` them.

    A node outside a solid lies straight above its foot: there the conormal is known to rounding.
    """
    outward = outward_conormals(surface, edge, 0.5 * spacing)
    straight = surface.dimensions_at(edge) == surface.dim
    straight &= np.linalg.norm(beyond, axis=1) > TOUCHING * spacing
    outward[straight] = beyond[straight] / np.linalg.norm(beyond[straight], axis=1, keepdims=True)
    return outward


def is_wall(condition: Condition) -> bool:
    """Tell whether the condition is zero Neumann."""
    data = condition.gamma
    return condition.beta == 0.0 and not callable(data) and not np.any(np.asarray(data, dtype=object))
