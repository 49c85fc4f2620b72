"""The matrix of an equation with the properties that solvers need, and the scenes that multigrid applies to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.advection import Advection
from cpmkit.forms.galerkin.conditions.condition_terms import ConditionTerms
from cpmkit.linear.multigrid.cycle import Level
from cpmkit.linear.operators import CsrOperator
from cpmkit.linear.protocols import Operator
from cpmkit.scene.laws import Interface, Spectral
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, SparseMatrix

#: Levels are made while k h of the level is at most the first number, 6.3 nodes a wavelength, and the first level while
#: it is at most the second. On spheres and tori of 20 to 90 thousand unknowns iterations are 15 to 18 up to 1, as
#: without waves, 19 to 25 at 1.6 and more where k is larger, 34 to 62 at 2, and 150 are not enough at 3.2.
MOST_RADIANS, MOST_RADIANS_OF_FIRST = 1.0, 1.6


@dataclass(frozen=True, eq=False)
class GalerkinOperator(CsrOperator):
    """The operator A, with the properties of it that solvers need."""

    conditions: ConditionTerms | None = None  #: The terms of the conditions that A contains.
    fixed: bool = False  #: Whether c u alone determines constants, as c is positive everywhere.
    waves: float = 0.0  #: The largest squared wavenumber k^2 = -c / a; 0 if c is nowhere negative.
    #: least, lowest: The smallest diffusivity a, and the smallest c.
    least: float = 1.0
    lowest: float = 0.0
    advection: Advection | None = None  #: The terms of a velocity.
    #: The factor of the advection in this operator, which may be the sum of a mass and a multiple of A.
    share: float = 1.0

    def scaled_plus_mass(self, factor: float, mass: Operator | None = None) -> CsrOperator:
        """Return ``M + factor A``, with M the ``mass``, by default the identity."""
        shifted = super().scaled_plus_mass(factor, mass)
        if self.advection is None:
            return shifted
        return replace(self, matrix=shifted.matrix, share=factor * self.share)

    def minus_shifted_mass(self, shift: float, mass: Operator | None = None) -> CsrOperator:
        """Return ``A - shift M``, with M the ``mass``, by default the identity; conditions and advection are not kept.

        Its solutions are waves if the shift is above the smallest c.
        """
        plain, lowest = super().minus_shifted_mass(shift, mass), self.lowest - shift
        waves = max(-lowest, 0.0) / self.least
        return GalerkinOperator(
            plain.matrix,
            plain.symmetric,
            waves > 0,
            self.symmetric_pattern,
            waves=waves,
            least=self.least,
            lowest=lowest,
        )

    def usable_levels(self, levels: Sequence[Level], spacing: float) -> Sequence[Level]:
        """Return the ``levels``, the first of which has twice the ``spacing``, up to the last that resolves the waves.

        Without waves all are returned, and with a velocity all with the upwinding that they need.
        """
        if self.advection is not None:
            return self.advection.add_to_levels(levels, self.share)
        if not self.waves:
            return levels
        radians = [self.waves**0.5 * spacing * 2 ** (number + 1) for number in range(len(levels))]
        most = max(MOST_RADIANS, min(radians[0], MOST_RADIANS_OF_FIRST)) if radians else MOST_RADIANS
        return levels[: sum(radian <= most for radian in radians)]


def build_operator(
    matrix: SparseMatrix, conditions: ConditionTerms, a: Floats, c: Floats | None, advection: Advection | None = None
) -> GalerkinOperator:
    """Return the operator of a ``matrix`` (n, n), with its properties from the coefficients of the equation.

    The diffusivity ``a`` and the factor ``c`` of u are (q,), at all samples, or (1,); ``c`` is None for zero.
    """
    waves = 0.0 if c is None else max(float((-c / a).max()), 0.0)
    fixed = c is not None and bool((c > 0).all())
    lowest = 0.0 if c is None else float(c.min())
    symmetric = advection is None
    properties = conditions, fixed, waves, float(a.min()), lowest, advection
    return GalerkinOperator(matrix, symmetric, symmetric and waves > 0, not symmetric, *properties)


def multigrid_applies(scene: Scene) -> bool:
    """Return whether multigrid solves the systems of a scene: they are surely positive, or their solutions are waves.

    Eigenvalue problems are solved with a shift. It lies below all eigenvalues unless the user gives the number near
    which they are sought, or conditions or c may make them negative. Solutions are waves for equations with c below
    zero, and for eigenvalues sought near a number unless a condition contains the eigenvalue.
    """
    problem: Any = scene.problem
    laws = [condition.law for condition in scene.conditions]
    if problem.family != "eigen":
        return True
    if not all(law.is_dissipative or isinstance(law, (Interface, Spectral)) for law in laws):
        return False
    if not any(isinstance(law, Spectral) for law in laws):
        return True
    return problem.near is None and not callable(problem.c) and bool(np.all(np.asarray(problem.c) >= 0))
