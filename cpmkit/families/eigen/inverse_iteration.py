"""One step of inverse iteration, ``(A - sigma B)^-1 B``, for the eigenvalue problem ``A u = lambda B u``.

B is the identity, or, where conditions of Steklov stand, what their ghosts read: with ``u(ghost) = u(mirror) + s
lambda u(y)``, y the foot on the boundary, E u becomes ``E u + lambda S u``, S reads u at y with the factor s, and
``B = scale W S``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.families.job import Job
from cpmkit.forms.collocation.conservation.components import unpinned
from cpmkit.linear.operators import LinearSystem, Operator
from cpmkit.protocols import Floats, nothing
from cpmkit.scene.compound_equations import Eigen
from cpmkit.scene.special_conditions import eigenfunction

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Where the shift stands, below the number wanted, in eigenvalues of a manifold of this size.
BELOW, BESIDE = 1.0, 0.05


@dataclass(eq=False)
class Shifted:
    """A step of inverse iteration: ``(A - sigma B)^-1 B``.

    Attributes
    ----------
    job : Job
        With the linear solver.
    operator : Operator
        A - sigma B.
    mass : csr_array or None
        B; None where it is the identity.
    shift : float
        sigma.
    unit : float
        An eigenvalue of a manifold of this size.
    products : int
        Products with the operator so far.
    solves : int
        Linear solves so far.
    """

    job: Job
    operator: Operator
    mass: csr_array | None
    shift: float
    unit: float
    products: int = 0
    solves: int = 0

    def step(self, v: Floats) -> Floats:
        """Return the step from v (n,) or (n, k)."""
        image = v if self.mass is None else self.mass @ v
        columns = np.ascontiguousarray(image.reshape(len(v), -1))
        u, report = self.job.solver(LinearSystem(self.operator, columns), self.job.tolerance, nothing)
        self.products, self.solves = self.products + report.operator_applications, self.solves + 1
        self.job.progress("solve", 1.0 - 1.0 / (1.0 + 0.05 * self.solves))
        return np.asarray(u.reshape(v.shape))


def shifted(job: Job, problem: Eigen, operator: Operator) -> Shifted:
    """Return the step of inverse iteration about the number near which eigenvalues are sought."""
    tables = job.tables
    bounds = np.asarray(job.scene.surface.bounds, dtype=np.float64)
    length = float((bounds[1] - bounds[0]).max())
    reads = tables.read_in_place_of(eigenfunction)
    beside = BELOW if problem.near is None else BESIDE
    if reads.nnz:
        shift = (problem.near or 0.0) - beside / length
        mass = (operator.scale * (operator.differences @ reads)).tocsr()
        _check_reached(job, mass)
        return Shifted(
            job, replace(operator, extension=(operator.extension + shift * reads).tocsr()), mass, shift, 1 / length
        )
    unit = float(tables.read_at_rows(problem.diffusivity, "the diffusivity").mean()) / length**2
    near = float(tables.read_at_rows(problem.c, "the factor c").min()) if problem.near is None else problem.near
    shift = near - beside * unit
    return Shifted(job, replace(operator, diagonal=operator.diagonal - shift), None, shift, unit)


def _check_reached(job: Job, mass: csr_array) -> None:
    """Refuse a Steklov problem with a piece that has every lambda as its eigenvalue.

    Raises
    ------
    SceneError
        If nothing holds on a piece of the manifold but Neumann conditions.
    """
    count, piece = unpinned(job.tables, job.scene)
    reached = np.unique(piece[np.flatnonzero(np.diff(mass.indptr))])
    if np.count_nonzero(reached >= 0) < count:
        raise SceneError(
            "The boundaries cut off a piece of the manifold on which nothing holds but Neumann conditions: there every "
            "lambda is an eigenvalue; give it a Steklov, Dirichlet or Robin condition."
        )
