"""The options that belong to the Galerkin form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.forms.galerkin.quadrature.cell_quadrature import SAMPLINGS
from cpmkit.forms.galerkin.space.energy import STABILISATIONS
from cpmkit.forms.galerkin.space.splines import DEGREES
from cpmkit.runtime.arrays import whole
from cpmkit.runtime.options import DeclaredOptions, option

#: The families of equations that the form carries.
FAMILIES = ("steady", "time", "eigen", "biharmonic", "coupled")
#: How the ends of boundaries inside a surface may be treated.
TIPS = ("extended", "singular")
#: Whether splines are finer where the solution asks for it.
REFINEMENTS = ("off", "auto")
#: How many times a lattice cell may be parted there.
FEWEST_LEVELS, MOST_LEVELS = 1, 4


def _check_stabilisation(stabilisation: Any, what: str) -> Any:
    if not isinstance(stabilisation, str) or stabilisation not in STABILISATIONS:
        raise InputError(f"{what} must be {' or '.join(map(repr, STABILISATIONS))}, got {shown(stabilisation)}.")
    return stabilisation


def _check_sampling(samples: Any, what: str) -> Any:
    if not isinstance(samples, str) or samples not in SAMPLINGS:
        raise InputError(
            f"{what} must be {', '.join(map(repr, SAMPLINGS[:-1]))} or {SAMPLINGS[-1]!r}, got {shown(samples)}."
        )
    return samples


def _check_tips(tips: Any, what: str) -> Any:
    if not isinstance(tips, str) or tips not in TIPS:
        raise InputError(f"{what} must be {' or '.join(map(repr, TIPS))}, got {shown(tips)}.")
    return tips


def _check_degree(degree: Any, what: str) -> Any:
    if isinstance(degree, bool) or not isinstance(degree, (int, np.integer)) or int(degree) not in DEGREES:
        raise InputError(
            f"{what} must be {', '.join(map(str, DEGREES[:-1]))} or {DEGREES[-1]} in the form 'galerkin', got "
            f"{shown(degree)}; form='collocation' takes 2 to 5."
        )
    return int(degree)


def _check_refinement(refine: Any, what: str) -> Any:
    if not isinstance(refine, str) or refine not in REFINEMENTS:
        raise InputError(f"{what} must be {' or '.join(map(repr, REFINEMENTS))}, got {shown(refine)}.")
    return refine


def _check_levels(levels: Any, what: str) -> int:
    least, most = FEWEST_LEVELS, MOST_LEVELS
    found = whole(levels, what, 1)
    if not least <= found <= most:
        raise InputError(f"{what} must be a whole number from {least} to {most}, got {found}; use a smaller spacing.")
    return found


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
        _check_stabilisation,
    )
    samples: str = option(
        "auto",
        "Whether the Galerkin form clips triangles of a surface where they leave the lattice's cells before it samples "
        "them: ``plain`` does not, ``clipped`` does, ``auto`` where the triangles are bent to follow the surface, or "
        "longer than half a spacing: half the error at h = 0.1 of a unit sphere, a sixth at 0.05, for half as many "
        "samples more.",
        _check_sampling,
    )
    tips: str = option(
        "extended",
        "What the Galerkin form does where a boundary ends inside a surface: ``extended`` lets u go on across its "
        "straight continuation; ``singular`` gives each end an unknown of its own besides, the root of the distance "
        "from it that u behaves like there.",
        _check_tips,
    )
    refine: str = option(
        "off",
        "Whether the Galerkin form takes finer splines where the solution of a steady problem on a surface asks for "
        "them: ``auto`` solves, and parts lattice cells where the residual is large, as at the ends of boundaries, at "
        "spikes and in layers, if that is expected to save unknowns; ``off`` does not.",
        _check_refinement,
    )
    refine_levels: int = option(
        3,
        "How many times ``refine`` may halve the spacing, from 1 to 4.",
        _check_levels,
    )

    @property
    def sampling(self) -> str:
        """How samples are taken: beside singular unknowns "auto" clips, a third of the error at h = 0.05 of a plate."""
        return "clipped" if self.samples == "auto" and self.tips == "singular" else self.samples
