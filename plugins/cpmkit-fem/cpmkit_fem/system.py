"""The linear system of the vertices that are free, and its direct solution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import Floats, Ints, Progress, ResolutionError, Scene, SceneError, SolveReport, judge, place
from cpmkit_fem.pins import Pins
from cpmkit_fem.triangulation import Triangulation

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class FreeSystem:
    """A u = b for the free vertices.

    Attributes
    ----------
    matrix : csr_array (n, n)
        Symmetric and positive definite.
    right_side : (n, channels) float64
        Given values are on this side already.
    free : (n,) int64
        The vertices.
    """

    matrix: csr_array
    right_side: Floats
    free: Ints

    def apply(self, u: Floats) -> Floats:
        """Return A u."""
        product: Floats = self.matrix @ u
        return product


def reduce(matrix: csr_array, load: Floats, pins: Pins) -> FreeSystem:
    """Return the system without the pinned vertices.

    Raises
    ------
    ResolutionError
        If no vertex is free.
    """
    free = np.setdiff1d(np.arange(len(load)), pins.vertices)
    if not len(free):
        raise ResolutionError(f"All {len(load)} vertices of the mesh are pinned by Dirichlet data; use a finer mesh.")
    rows = matrix[free]
    return FreeSystem(rows[:, free], load[free] - rows[:, pins.vertices] @ pins.values, free)


def solve_free(system: FreeSystem, tolerance: float, progress: Progress) -> tuple[Floats, SolveReport]:
    """Solve by sparse LU in the order that suits symmetric matrices, with one step of refinement.

    Raises
    ------
    ConvergenceError
        If the residual is above the tolerance.
    """
    from scipy.sparse.linalg import splu

    progress("solve", 0.0)
    factors = splu(
        system.matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    u = factors.solve(system.right_side)
    u += factors.solve(system.right_side - system.apply(u))
    progress("solve", 1.0)
    remedy = "ask for a larger tolerance: rounding limits a direct solve"
    # judge reads right_side and apply alone, which a system of vertices has as well
    return u, judge(system, u, "direct", tolerance, 0, 1, remedy)  # type: ignore[arg-type]


def check_fixed(scene: Scene, mesh: Triangulation, pins: Pins) -> None:
    """Refuse a problem whose solution is fixed only up to a constant on some piece of the mesh.

    Raises
    ------
    SceneError
        Naming a point of the piece.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    if scene.problem.terms().pins:
        return
    edges, n = mesh.edges[0], len(mesh.vertices)
    graph = csr_array((np.ones(len(edges), dtype=np.int8), (edges[:, 0], edges[:, 1])), shape=(n, n))
    count, piece = connected_components(graph, directed=False)
    loose = np.setdiff1d(np.arange(count), piece[pins.vertices])
    if len(loose):
        members = np.flatnonzero(piece == loose[0])
        near = place(mesh.vertices[members[0]])
        raise SceneError(
            f"Nothing fixes the solution on {len(loose)} of the mesh's {count} pieces: the one near {near}, "
            f"{len(members) / n:.0%} of the vertices, has only Neumann conditions, so that any constant may be added; "
            "give a Dirichlet condition there, or solve the screened problem."
        )
