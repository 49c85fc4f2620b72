"""Where boundaries meet that hold different values: u jumps at a point there, and no spacing resolves that."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, product

import numpy as np

from cpmkit.errors import place
from cpmkit.forms.galerkin.sample_mesh import SampleMesh
from cpmkit.grid.lattice import Lattice
from cpmkit.protocols import SIDES, BoundarySet, Floats, Ints
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.laws import Value
from cpmkit.scene.scene import Scene

#: Values that differ by less than this share of their size are equal: a vertex lies beside the true crossing.
DIFFERENT_SHARE = 0.01


def of_crossings(scene: Scene, mesh: SampleMesh, lattice: Lattice) -> Iterator[str]:
    """Tell of boundaries on a surface that meet with different values.

    On a sphere at h = 0.2 and 0.1, two great circles that hold 1 and 2 left errors of 0.3 within half a spacing of the
    crossing, 0.05 from one to two spacings away, 0.006 at four and 0.001 at eight.
    """
    if mesh.manifold_dim == 1 or not len(mesh.cut):
        return
    jumps = [
        (names, where, jump)
        for names, where in _meetings(scene, mesh, lattice)
        if (jump := _largest_jump(*names, where, scene.channels)) > 0
    ]
    if jumps:
        (first, second), where, jump = jumps[0]
        more = f" and {len(jumps) - 1} more pairs" if len(jumps) > 1 else ""
        yield (
            f"Boundaries {first.name!r} and {second.name!r}{more} cross with different values in the sectors around, "
            f"near {place(where)}: within half a spacing of it the solution is off by up to a third of their "
            f"difference, {jump:.3g}, and by a hundredth four spacings away."
        )


def _meetings(
    scene: Scene, mesh: SampleMesh, lattice: Lattice
) -> Iterator[tuple[tuple[BoundarySet, BoundarySet], Floats]]:
    """Yield the pairs of boundaries that have a vertex in common, with one such vertex, in the scene's coordinates."""
    seen: set[tuple[int, int]] = set()
    for vertex, owners in _shared_vertices(mesh):
        for pair in combinations(owners, 2):
            if pair not in seen:
                seen.add(pair)
                both = scene.boundaries[pair[0]], scene.boundaries[pair[1]]
                yield both, lattice.to_scene(mesh.vertices[None, vertex])[0]


def _shared_vertices(mesh: SampleMesh) -> Iterator[tuple[int, list[int]]]:
    """Yield the vertices at which facets of several boundaries end, and the numbers of these, ascending."""
    own = ~mesh.extends
    ends: Ints = np.unique(
        np.stack([mesh.cut[own].ravel(), np.repeat(mesh.owner[own], mesh.cut.shape[1])], axis=1), axis=0
    )
    vertices, first, count = np.unique(ends[:, 0], return_index=True, return_counts=True)
    for k in np.flatnonzero(count > 1).tolist():
        yield int(vertices[k]), ends[first[k] : first[k] + count[k], 1].tolist()


def _largest_jump(first: BoundarySet, second: BoundarySet, where: Floats, channels: int) -> float:
    """Return the largest difference of the values that two boundaries hold there, zero where they are equal."""
    values = [_values(one, where, channels) for one in (first, second)]
    size = max((float(np.abs(value).max()) for held in values for value in held), default=0.0)
    worst = max((float(np.abs(a - b).max()) for a, b in product(*values)), default=0.0)
    return worst if worst > DIFFERENT_SHARE * size else 0.0


def _values(boundary: BoundarySet, where: Floats, channels: int) -> list[Floats]:
    laws = [boundary.condition(side).law for side in SIDES]
    what = f"boundary {boundary.name!r}"
    return [evaluate_data(law.datum, where[None], channels, what) for law in laws if isinstance(law, Value)]
