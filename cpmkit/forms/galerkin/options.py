"""The options that belong to the Galerkin form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.forms.galerkin.space.energy import STABILISATIONS
from cpmkit.forms.galerkin.space.splines import DEGREES
from cpmkit.mesh.cell_quadrature import SAMPLINGS
from cpmkit.runtime.arrays import whole
from cpmkit.runtime.options import DeclaredOptions, one_of, option

#: The families of equations that the form solves.
FAMILIES = ("steady", "time", "eigen", "biharmonic", "coupled")
#: Largest number of times that ``refine`` may halve the spacing.
MOST_LEVELS = 4


def _check_degree(degree: Any, label: str) -> int:
    """Return the degree of the splines, or raise an InputError if it is not one of `DEGREES`."""
    if isinstance(degree, bool) or not isinstance(degree, (int, np.integer)) or int(degree) not in DEGREES:
        raise InputError(
            f"{label} must be {', '.join(map(str, DEGREES[:-1]))} or {DEGREES[-1]} in the form 'galerkin', got "
            f"{shown(degree)}; form='collocation' takes 2 to 5."
        )
    return int(degree)


def _check_levels(levels: Any, label: str) -> int:
    """Return the number of levels, or raise an InputError if it is not from 1 to `MOST_LEVELS`."""
    number = whole(levels, label, 1)
    if not 1 <= number <= MOST_LEVELS:
        raise InputError(
            f"{label} must be a whole number from 1 to {MOST_LEVELS}, got {number}; use a smaller spacing."
        )
    return number


@dataclass(frozen=True)
class GalerkinOptions(DeclaredOptions):
    """The options that belong to the Galerkin form.

    Raises
    ------
    InputError
        If a value is not accepted.
    """

    degree: int = option(
        2,
        "Degree of the splines in the form ``galerkin``, 1 to 3, 2 by default: on smooth sources the error falls as "
        "the spacing to the power of the degree plus one.",
        _check_degree,
    )
    stabilisation: str = option(
        "default",
        "How strongly the Galerkin form stabilises splines off the manifold, where samples do not determine them. "
        "``accurate`` takes 1.4 to 2 times the iterations of ``default`` and gains on coarse lattices alone: on smooth "
        "sources of degree 2 it leaves .8 of the error at five spacings a radius, .93 at ten and .98 at twenty, where "
        "a smaller spacing buys more; of degree 1 it leaves .4 to .9.",
        one_of(*STABILISATIONS),
    )
    samples: str = option(
        "auto",
        "Whether the Galerkin form clips triangles of a surface where they leave the lattice's cells before it samples "
        "them: ``plain`` does not, ``clipped`` does, ``auto`` where the triangles are bent to follow the surface, or "
        "longer than half a spacing: half the error at h = 0.1 of a unit sphere, a sixth at 0.05, for half as many "
        "samples more.",
        one_of(*SAMPLINGS),
    )
    tips: str = option(
        "extended",
        "What the Galerkin form does where a boundary ends inside a surface: ``extended`` lets u go on across its "
        "straight continuation; ``singular`` gives each end an unknown of its own besides, the root of the distance "
        "from it that u behaves like there.",
        one_of("extended", "singular"),
    )
    refine: str = option(
        "off",
        "Whether the Galerkin form takes finer splines where the solution of a steady problem on a surface asks for "
        "them: ``auto`` solves, and parts lattice cells where the residual is large, as at the ends of boundaries, at "
        "spikes and in layers, if that is expected to save unknowns; ``off`` does not.",
        one_of("off", "auto"),
    )
    refine_levels: int = option(
        3,
        "How many times ``refine`` may halve the spacing, from 1 to 4.",
        _check_levels,
    )

    @property
    def sampling(self) -> str:
        """The option ``samples``, in which "auto" becomes "clipped" beside singular unknowns.

        There clipping leaves a third of the error, at h = 0.05 of a plate.
        """
        return "clipped" if self.samples == "auto" and self.tips == "singular" else self.samples
