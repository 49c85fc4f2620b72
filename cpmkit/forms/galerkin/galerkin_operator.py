"""A as the Galerkin form makes it: a matrix that remembers what it was made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.galerkin.advection import Advection
from cpmkit.forms.galerkin.conditions.condition_terms import ConditionTerms
from cpmkit.linear.multigrid.cycle import Level
from cpmkit.linear.operators import Bordered, CsrOperator
from cpmkit.linear.protocols import Operator
from cpmkit.scene.compound_equations import Eigen
from cpmkit.scene.laws import Interface, Spectral, is_dissipative
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array


#: Levels are made while k h is at most this there, 6.3 nodes a wavelength, and the first while it is at most the second
#: number. On spheres and tori of 20 to 90 thousand unknowns iterations are 15 to 18 up to 1, as without waves, 19 to 25
#: at 1.6 and more where k is larger, 34 to 62 at 2, and 150 do not do at 3.2.
MOST_RADIANS, MOST_RADIANS_OF_FIRST = 1.0, 1.6


@dataclass(frozen=True, eq=False)
class GalerkinOperator(CsrOperator):
    """A, with the terms of the conditions that are in it.

    Attributes
    ----------
    conditions : ConditionTerms, optional
        The terms.
    fixed : bool
        Whether c u fixes the constants by itself.
    waves : float
        The largest k^2 anywhere, -c / a of the equation; 0 where c takes nothing.
    least, lowest : float
        The smallest diffusivity a, and the smallest c.
    carried : Carried, optional
        What a velocity does.
    share : float
        How many times A is in this, which may be A beside a mass.
    """

    conditions: ConditionTerms | None = None
    fixed: bool = False
    waves: float = 0.0
    least: float = 1.0
    lowest: float = 0.0
    carried: Advection | None = None
    share: float = 1.0

    def scaled_plus_mass(self, factor: float, mass: Operator | None = None) -> CsrOperator:
        """Return ``M + factor A``, M the identity where no mass is given."""
        made = super().scaled_plus_mass(factor, mass)
        return made if self.carried is None else replace(self, matrix=made.matrix, share=factor * self.share)

    def minus_shifted_mass(self, shift: float, mass: Operator | None = None) -> CsrOperator:
        """Return ``A - shift M``; a shift above the smallest c makes waves, M being the mass on the manifold."""
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


def build_operator(
    matrix: csr_array, conditions: ConditionTerms, a: Floats, c: Floats | None, carried: Advection | None = None
) -> GalerkinOperator:
    """Return A where the diffusivity is ``a`` (q,) and the factor of u is ``c`` (q,) at all samples, or (1,)."""
    waves = 0.0 if c is None else max(float((-c / a).max()), 0.0)
    fixed = c is not None and bool((c > 0).all())
    lowest = 0.0 if c is None else float(c.min())
    symmetric = carried is None
    of_equation = conditions, fixed, waves, float(a.min()), lowest, carried
    return GalerkinOperator(matrix, symmetric, symmetric and waves > 0, not symmetric, *of_equation)


def levels_resolving_waves(levels: Sequence[Level], operator: Operator, spacing: float) -> Sequence[Level]:
    """Return those of the ``levels``, the first of which leads to twice the ``spacing``, that resolve A's waves.

    Where a velocity carries u, all of them with the upwinding that they need.
    """
    inner = operator.operator if isinstance(operator, Bordered) else operator
    if isinstance(inner, GalerkinOperator) and inner.carried is not None:
        return inner.carried.on_levels(levels, inner.share)
    square = operator.waves if isinstance(operator, GalerkinOperator) else 0.0
    if not square:
        return levels
    radians = [square**0.5 * spacing * 2 ** (number + 1) for number in range(len(levels))]
    most = max(MOST_RADIANS, min(radians[0], MOST_RADIANS_OF_FIRST)) if radians else MOST_RADIANS
    return levels[: sum(one <= most for one in radians)]


def is_surely_definite(scene: Scene) -> bool:
    """Tell whether what is factorised or iterated on has no eigenvalue below zero, as far as numbers tell.

    Eigenvalues are sought by a shift. It lies below all of them unless a number is given, or conditions or c take from
    the energy. A c that is a function is asked nowhere: a multigrid refuses what turns out to be indefinite.
    """
    problem = scene.problem
    if not isinstance(problem, Eigen):
        c = problem.terms().c
        return callable(c) or bool(np.all(np.asarray(c) >= 0))
    laws = [one.law for one in scene.conditions]
    takes = not all(is_dissipative(law) or isinstance(law, (Interface, Spectral)) for law in laws)
    if takes or problem.near is not None:
        return False
    steklov = any(isinstance(law, Spectral) for law in laws)
    return not steklov or (not callable(problem.c) and bool(np.all(np.asarray(problem.c) >= 0)))


def multigrid_applies(scene: Scene) -> bool:
    """Tell whether a multigrid serves: systems are surely positive, or what is below zero are waves.

    That is so of equations with c below zero, and of eigenvalues sought near a number, unless conditions take from the
    energy or have the lambda that is sought.
    """
    problem = scene.problem
    if not isinstance(problem, Eigen) or is_surely_definite(scene):
        return True
    laws = [one.law for one in scene.conditions]
    return problem.near is not None and all(is_dissipative(law) or isinstance(law, Interface) for law in laws)
