"""One step of inverse iteration, ``(A - sigma B)^-1 B``, for the eigenvalue problem ``A u = lambda B u``.

B is the form's mass, or, where conditions of Steklov stand, what they bring.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.families.context import SolveContext, left_side
from cpmkit.linear.direct import IndefiniteError, PositiveFactors
from cpmkit.linear.protocols import Operator, Preconditioner, PreparedSolver, Stiffness
from cpmkit.scene.compound_equations import Eigen
from cpmkit.scene.diffusivities import mean_diffusivity
from cpmkit.types import Floats

#: Distance of the shift from the wanted number, in typical eigenvalues of a manifold of this size: below the spectrum,
#: or beside a number inside it.
SHIFT_BELOW_EIGENVALUES, SHIFT_BESIDE_EIGENVALUES = 1.0, 0.05
#: How often the shift is lowered, by four times as much each time, where there are eigenvalues below it.
LOWERED_SHIFTS = 12


@dataclass(frozen=True, eq=False)
class Pairs:
    """Eigenvalues (k,) and vectors (n, k), complex of unsymmetric problems, in any order."""

    values: Any
    vectors: Any


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

    @property
    def symmetric(self) -> bool:
        """Whether A and B are surely symmetric: eigenvalues are real then, and functions orthogonal."""
        return self.operator.symmetric and (self.mass is None or self.mass.symmetric)

    @property
    def preconditioner(self) -> Preconditioner | None:
        """What is a cheap step in place of a solve; None where solves are cheap, or none is known."""
        return self.prepared if self.symmetric and isinstance(self.prepared, Preconditioner) else None

    def image(self, v: Floats) -> Floats:
        """Return B v."""
        return v if self.mass is None else np.asarray(self.mass.apply(v))

    def step(self, v: Floats) -> Floats:
        """Return the step from v (n,) or (n, k)."""
        return self.inverted(self.image(v))

    def inverted(self, image: Floats) -> Floats:
        """Return ``(A - sigma B)^-1`` times (n,) or (n, k)."""
        columns = np.ascontiguousarray(image.reshape(len(image), -1))
        u, report = self.prepared.solve(columns, self.context.tolerance)
        self.products, self.solves = self.products + report.operator_applications, self.solves + 1
        self.report_progress()
        return np.asarray(u.reshape(image.shape))

    def preconditioned(self, residual: Floats) -> Floats:
        """Return one cheap step from a residual (n, k)."""
        assert self.preconditioner is not None
        self.products += self.preconditioner.step_products * residual.shape[1]
        self.solves += 1
        self.report_progress()
        return self.preconditioner.precondition(np.ascontiguousarray(residual))

    def report_progress(self) -> None:
        """Tell how far it is, as well as that is known."""
        self.context.progress("solve", 1.0 - 1.0 / (1.0 + 0.05 * self.solves))


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
        unit = mean_diffusivity(problem.diffusivity, form.points) / length**2
        near = float(form.data_at_points(problem.c, "the factor c").min()) if problem.near is None else problem.near
        shift = near - beside * unit
    if problem.near is None and stiffness.symmetric and form.traits.iterative_solver != "multigrid":
        key = ("below", left_side(problem.terms()), shift)
        shift = context.kept.get(key, _below_all, stiffness, mass, shift, unit)
    key = ("less", left_side(problem.terms()), shift)
    operator, prepared = context.kept.get(key, _ready, context, stiffness, shift, mass)
    return InverseIteration(context, operator, prepared, mass, shift, unit)


def _below_all(stiffness: Stiffness, mass: Any, shift: float, unit: float) -> float:
    """Return a number below all eigenvalues, of which conditions that feed may bring some far below zero.

    Raises
    ------
    SceneError
        If there is none to be found.
    """
    for _ in range(LOWERED_SHIFTS):
        try:
            PositiveFactors.of(stiffness.minus_shifted_mass(shift, mass).to_csr(), "at the shift")
        except IndefiniteError:
            shift, unit = shift - 4 * unit, 4 * unit
            continue
        return shift
    raise SceneError(
        f"There are eigenvalues below {shift:.3g}, and no end of them was found: conditions or c feed more than the "
        "spacing resolves; give near= for those that are meant, or use a smaller spacing."
    )


def _ready(context: SolveContext, stiffness: Stiffness, shift: float, mass: Any) -> tuple[Operator, PreparedSolver]:
    operator = stiffness.minus_shifted_mass(shift, mass)
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
