"""One step of inverse iteration, ``(A - sigma B)^-1 B``, for the eigenvalue problem ``A u = lambda B u``.

B is the form's mass, or, where conditions of Steklov stand, what they bring.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.families.context import SolveContext, left_side
from cpmkit.protocols import Floats, Operator, PreparedSolver, Stiffness
from cpmkit.scene.compound_equations import Eigen

#: Distance of the shift from the wanted number, in typical eigenvalues of a manifold of this size: below the spectrum,
#: or beside a number inside it.
SHIFT_BELOW_EIGENVALUES, SHIFT_BESIDE_EIGENVALUES = 1.0, 0.05


@dataclass(eq=False)
class InverseIteration:
    """A step of inverse iteration: ``(A - sigma B)^-1 B``.

    Attributes
    ----------
    context : SolveContext
        With the discretised scene.
    operator : Operator
        A - sigma B.
    prepared : PreparedSolver
        Solves with it.
    mass : Operator or None
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

    context: SolveContext
    operator: Operator
    prepared: PreparedSolver
    mass: Any
    shift: float
    unit: float
    products: int = 0
    solves: int = 0

    def step(self, v: Floats) -> Floats:
        """Return the step from v (n,) or (n, k)."""
        image = v if self.mass is None else self.mass.apply(v)
        columns = np.ascontiguousarray(image.reshape(len(v), -1))
        u, report = self.prepared.solve(columns, self.context.tolerance)
        self.products, self.solves = self.products + report.operator_applications, self.solves + 1
        self.context.progress("solve", 1.0 - 1.0 / (1.0 + 0.05 * self.solves))
        return np.asarray(u.reshape(v.shape))


def inverse_iteration(context: SolveContext, problem: Eigen, stiffness: Stiffness) -> InverseIteration:
    """Return the step of inverse iteration about the number near which eigenvalues are sought."""
    form = context.discretized
    bounds = np.asarray(context.scene.surface.bounds, dtype=np.float64)
    length = float((bounds[1] - bounds[0]).max())
    beside = SHIFT_BELOW_EIGENVALUES if problem.near is None else SHIFT_BESIDE_EIGENVALUES
    mass = form.boundary_mass(stiffness)
    if mass is not None:
        _check_reached(context, stiffness, mass)
        unit = 1 / length
        shift = (problem.near or 0.0) - beside * unit
    else:
        mass = form.mass
        unit = float(form.read(problem.diffusivity, "the diffusivity").mean()) / length**2
        near = float(form.read(problem.c, "the factor c").min()) if problem.near is None else problem.near
        shift = near - beside * unit
    key = ("less", left_side(problem.terms()), shift)
    operator, prepared = context.kept.get(key, _ready, context, stiffness, shift, mass)
    return InverseIteration(context, operator, prepared, mass, shift, unit)


def _ready(context: SolveContext, stiffness: Stiffness, shift: float, mass: Any) -> tuple[Operator, PreparedSolver]:
    operator = stiffness.less(shift, mass)
    return operator, context.prepare(operator)


def _check_reached(context: SolveContext, stiffness: Stiffness, mass: Any) -> None:
    """Refuse a Steklov problem with a piece that has every lambda as its eigenvalue.

    Raises
    ------
    SceneError
        If nothing holds on a piece of the manifold but Neumann conditions.
    """
    free = context.discretized.free_constants(stiffness)
    if free is not None and not mass.apply(free.indicator.toarray()).any(axis=0).all():
        raise SceneError(
            "The boundaries cut off a piece of the manifold on which nothing holds but Neumann conditions: there every "
            "lambda is an eigenvalue; give it a Steklov, Dirichlet or Robin condition."
        )
