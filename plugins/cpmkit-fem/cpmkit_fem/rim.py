"""The rim of an open triangulation, and the integrals over it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import (
    Condition,
    Data,
    Floats,
    Interface,
    Ints,
    Mixed,
    Nonlinear,
    OneSided,
    Scene,
    edge_condition,
    evaluate_data,
)
from cpmkit_fem.triangulation import Triangulation

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Loops are told apart from this share of an edge outside of it.
OUTSIDE_EDGE_SHARE = 0.25
#: A flux that changes with u by less than this, over the length of an edge, fixes no constant.
STILL = 1e-9
#: Named in errors.
WHAT = "the edge's condition"


@dataclass(frozen=True, eq=False)
class RimPart:
    """The edges of the rim on which one law holds.

    Attributes
    ----------
    law : OneSided
        What holds.
    mesh : Triangulation
        Whose rim it is.
    edges : (e, 2) int64
        Vertices.
    """

    law: OneSided
    mesh: Triangulation
    edges: Ints

    @cached_property
    def on(self) -> Ints:
        """(k,) the vertices."""
        return np.unique(self.edges)

    @property
    def points(self) -> Floats:
        """(k, d) where they are."""
        return self.mesh.vertices[self.on]

    def given(self, data: Data, channels: int, time: float | None) -> Floats:
        """Return data (v, channels) at the part's vertices, zero at all others."""
        values = np.zeros((len(self.mesh.vertices), channels))
        values[self.on] = evaluate_data(data, self.points, channels, WHAT, time)
        return values

    def mass(self, weight: Floats) -> csr_array:
        """Return the integrals of ``weight`` u v over the part (v, v); it is given (v,) and linear on each edge."""
        from scipy.sparse import csr_array

        i, j = self.edges.T
        length = np.linalg.norm(self.mesh.vertices[i] - self.mesh.vertices[j], axis=1)
        first, second = length * weight[i] / 12, length * weight[j] / 12
        entries = np.concatenate([3 * first + second, first + 3 * second, first + second, first + second])
        rows, columns = np.concatenate([i, j, i, j]), np.concatenate([i, j, j, i])
        count = len(self.mesh.vertices)
        return csr_array((entries, (rows, columns)), shape=(count, count))

    # What Newton's method asks where the flux depends on u

    @property
    def guess(self) -> float:
        """Value of u at which Newton's method starts."""
        return self._flux.guess

    def read(self, u: Floats) -> Floats:
        """Return u (k,) at the part's vertices."""
        return np.asarray(u[self.on, 0])

    def grows(self, seen: Floats) -> bool:
        """Tell whether the flux changes with u, beyond rounding, where u is ``seen``."""
        return bool(np.any(np.abs(self._flux.slope_at(seen, self.points)) * self.mesh.mean_edge > STILL))

    def linearized(self, seen: Floats) -> RimPart:
        """Return the part with ``du/db = j(v) + j'(v) (u - v)``, v being ``seen``."""
        slope, flux = self._flux.slope_at(seen, self.points), self._flux.flux_at(seen, self.points)
        return replace(self, law=Mixed(1.0, lambda _: -slope, lambda _: flux - slope * seen))

    @property
    def _flux(self) -> Nonlinear:
        assert isinstance(self.law, Nonlinear)
        return self.law


def rim_of(scene: Scene, mesh: Triangulation) -> Sequence[RimPart]:
    """Return the parts of the rim; none where the triangulation is closed.

    Raises
    ------
    SceneError
        If a loop is not in the scene's table.
    """
    edges, count, opposite = mesh.edges
    edges, opposite = edges[count == 1], opposite[count == 1]
    if not len(edges):
        return []
    if not isinstance(scene.edge, Mapping):
        return [RimPart(_one_sided(scene.edge), mesh, edges)]
    loop = scene.surface.closest_point(_outside(mesh.vertices, edges, opposite)).edge
    laws = {number: _one_sided(edge_condition(scene.edge, int(number))) for number in np.unique(loop)}
    return [RimPart(law, mesh, edges[loop == number]) for number, law in laws.items()]


def _one_sided(condition: Condition) -> OneSided:
    """Return the law of a condition on the edge; scenes refuse those that couple two sides."""
    assert not isinstance(condition.law, Interface)
    return condition.law


def _outside(vertices: Floats, edges: Ints, opposite: Ints) -> Floats:
    """Return points (e, d) a little outside: their feet lie on the rim, which a chord's middle may miss."""
    start, end = (vertices[edges[:, k]] for k in (0, 1))
    middle, along = 0.5 * (start + end), end - start
    inward = vertices[opposite] - middle
    inward -= (np.sum(inward * along, axis=1) / np.sum(along**2, axis=1))[:, None] * along
    scale = OUTSIDE_EDGE_SHARE * np.linalg.norm(along, axis=1) / np.linalg.norm(inward, axis=1)
    return np.ascontiguousarray(middle - scale[:, None] * inward)
