"""The rim of an open triangulation, and what flows through it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Condition, Floats, Flux, Ints, Scene, SceneError, Value, edge_condition, evaluate_data
from cpmkit_fem.triangulation import Triangulation

#: Loops are told apart from this share of an edge outside of it.
OUTSIDE = 0.25


@dataclass(frozen=True, eq=False)
class Rim:
    """The edges that belong to one triangle.

    Attributes
    ----------
    vertices : (v, d) float64
        Of the triangulation.
    edges : (e, 2) int64
    opposite : (e,) int64
        The third vertex of the edge's triangle.
    """

    vertices: Floats
    edges: Ints
    opposite: Ints

    @property
    def lengths(self) -> Floats:
        """(e,) lengths of the edges."""
        lengths: Floats = np.linalg.norm(np.diff(self.vertices[self.edges], axis=1)[:, 0], axis=1)
        return lengths

    def conditions(self, scene: Scene) -> list[tuple[Condition, Ints]]:
        """Return the conditions and the edges on which each holds.

        Raises
        ------
        SceneError
            If a loop is not in the scene's table.
        """
        every = np.arange(len(self.edges))
        if not isinstance(scene.edge, Mapping) or not len(every):
            return [] if isinstance(scene.edge, Mapping) else [(scene.edge, every)]
        loop = scene.surface.closest_point(self._outside()).edge
        return [(edge_condition(scene.edge, int(number)), np.flatnonzero(loop == number)) for number in np.unique(loop)]

    def _outside(self) -> Floats:
        """Return points (e, d) a little outside: their feet lie on the rim, which a chord's middle may miss."""
        start, end = (self.vertices[self.edges[:, k]] for k in (0, 1))
        middle, along = 0.5 * (start + end), end - start
        inward = self.vertices[self.opposite] - middle
        inward -= (np.sum(inward * along, axis=1) / np.sum(along**2, axis=1))[:, None] * along
        scale = OUTSIDE * self.lengths / np.linalg.norm(inward, axis=1)
        points: Floats = np.ascontiguousarray(middle - scale[:, None] * inward)
        return points


def rim_of(mesh: Triangulation) -> Rim:
    """Return the rim of a triangulation; no edges where it is closed."""
    edges, count, opposite = mesh.edges
    return Rim(mesh.vertices, edges[count == 1], opposite[count == 1])


def inflow(scene: Scene, rim: Rim) -> Floats:
    """Return the integrals (v, channels) over the rim of the flux du/db times each hat function."""
    total = np.zeros((len(rim.vertices), scene.channels))
    for condition, chosen in rim.conditions(scene):
        law = condition.law
        if isinstance(law, Value):
            continue
        if not isinstance(law, Flux):
            kind = condition.kind.capitalize()
            raise SceneError(f"backend='fem' takes Dirichlet and Neumann conditions, not {kind}; use backend='cpm'.")
        edges, sixth = rim.edges[chosen], rim.lengths[chosen][:, None] / 6
        start, end = (
            evaluate_data(law.datum, rim.vertices[edges[:, k]], scene.channels, "the edge's condition") for k in (0, 1)
        )
        np.add.at(total, edges[:, 0], sixth * (2 * start + end))
        np.add.at(total, edges[:, 1], sixth * (start + 2 * end))
    return total
