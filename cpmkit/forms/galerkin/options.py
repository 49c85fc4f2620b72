"""The options that belong to the Galerkin form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.forms.options import Options
from cpmkit.manifold.abilities import has_finite_feet
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.mesh.cell_quadrature import SAMPLINGS
from cpmkit.mesh.mixed_cells import member_dimensions
from cpmkit.runtime.arrays import is_whole, whole
from cpmkit.runtime.options import DeclaredOptions, one_of, option
from cpmkit.scene.diffusivities import StateDiffusivity
from cpmkit.scene.junction import unsupported_junction
from cpmkit.scene.laws import Nonlinear
from cpmkit.scene.oriented import OrientedBoundary
from cpmkit.scene.scene import Scene


@dataclass(frozen=True)
class Stabilisation:
    """Dimensionless factors of the terms of the stabilisation."""

    #: e1, e2: Factors of the squares of the first and second derivatives along normals.
    e1: float
    e2: float
    g: float  #: Factor of the ghost penalty.
    e3: float = 0.0  #: Factor of the square of the third derivative along normals, for cubic splines.


#: Stabilisation by degree and name: "accurate" has .4 to .98 of the error of "default", and 1.4 to 2 times as many
#: steps.
STABILISATIONS = {
    1: {"default": Stabilisation(1e-1, 1e-2, 1e-4), "accurate": Stabilisation(1e-2, 1e-2, 1e-4)},
    2: {"default": Stabilisation(1e-2, 1e-2, 1e-4), "accurate": Stabilisation(1e-3, 1e-3, 1e-4)},
    3: {"default": Stabilisation(1e-2, 1e-2, 1e-4, 1e-2), "accurate": Stabilisation(1e-3, 1e-3, 1e-5, 1e-3)},
}
#: Stabilisation of quadratic splines on solids, by name: a ghost penalty beside cells that the skin cuts.
SOLID_STABILISATIONS = {"default": Stabilisation(0.0, 0.0, 1e-3), "accurate": Stabilisation(0.0, 0.0, 1e-4)}
#: The degrees that splines may have.
DEGREES = (1, 2, 3)

#: The families of equations that the form solves.
FAMILIES = ("steady", "time", "eigen", "biharmonic", "coupled")


def _check_degree(degree: Any, label: str) -> int:
    """Return the degree of the splines, or raise an InputError, which calls it ``label``, if not in `DEGREES`."""
    if not is_whole(degree) or degree not in DEGREES:
        raise InputError(
            f"{label} must be {', '.join(map(str, DEGREES[:-1]))} or {DEGREES[-1]} in the form 'galerkin', got "
            f"{shown(degree)}; form='collocation' takes 2 to 5."
        )
    return int(degree)


@dataclass(frozen=True)
class GalerkinOptions(DeclaredOptions):
    """The options that belong to the Galerkin form. Raises InputError if a value is not accepted."""

    degree: int = option(
        2,
        "Degree of the splines in the form ``galerkin``, 1 to 3, 2 by default: on smooth sources the error falls as "
        "the spacing to the power of the degree plus one.",
        _check_degree,
    )
    stabilisation: str = option(
        "default",
        "How strongly the Galerkin form stabilises splines off the manifold, where samples do not determine them. "
        "``accurate`` takes up to twice the iterations of ``default`` and reduces the error on coarse lattices only.",
        one_of(*STABILISATIONS[2]),
    )
    samples: str = option(
        "auto",
        "Whether the Galerkin form clips triangles of a surface where they leave the lattice's cells before it samples "
        "them: ``plain`` does not, ``clipped`` does, ``auto`` where the triangles are curved to follow the surface, or "
        "longer than half a spacing. Clipping reduces the error on smooth surfaces, for half as many samples more.",
        one_of(*SAMPLINGS),
    )
    tips: str = option(
        "extended",
        "What the Galerkin form does where a boundary ends inside a surface or a plane solid: ``extended`` lets u go "
        "on across its straight continuation; ``singular`` gives each end an unknown of its own besides, the root of "
        "the distance from it that u behaves like there.",
        one_of("extended", "singular"),
    )
    refine: str = option(
        "off",
        "Whether the Galerkin form takes finer splines where the solution of a steady problem on a surface asks for "
        "them: ``auto`` solves, and halves lattice cells where the residual is large, as at the ends of boundaries, at "
        "spikes and in layers, if that is expected to save unknowns; ``off`` does not.",
        one_of("off", "auto"),
    )
    refine_levels: int = option(
        3, "How many times ``refine`` may halve the spacing, from 1 to 4.", partial(whole, least=1, most=4)
    )

    @property
    def sampling(self) -> str:
        """The option ``samples``; with singular unknowns "auto" is "clipped", which has a third of the error."""
        return "clipped" if self.samples == "auto" and self.tips == "singular" else self.samples


def check_scene(scene: Scene, options: Options[GalerkinOptions]) -> None:
    """Raise SceneError, with the reason and advice, if the form with these options cannot discretise a scene."""
    problem, surface = scene.problem, scene.surface
    if problem.family not in FAMILIES:
        raise SceneError(f"the form {options.form!r} does not yet solve {problem.kind!r}; use form='collocation'.")
    terms = problem.terms()
    if terms.velocity is not None and options.own.tips == "singular":
        raise SceneError(
            "tips='singular' takes no velocity: what u is like at the end of a boundary that is flown past is not "
            "known; use tips='extended'."
        )
    if terms.velocity is not None and scene.has_tensor:
        raise SceneError(
            f"the form {options.form!r} takes no velocity beside a diffusivity that is a tensor; give one that is a "
            "number or a function that returns numbers."
        )
    if options.own.refine == "auto":
        reasons = {
            "no channels that are tied to each other": problem.family == "coupled",
            f"steady problems, got {problem.kind!r}: others move what asks for finer splines": problem.family
            != "steady",
            "surfaces, got a curve: a smaller spacing costs little there": surface.manifold_dim == 1,
            "no velocity: upwinding goes by one spacing": terms.velocity is not None,
            "no diffusivity that is a tensor or depends on u": scene.has_tensor
            or isinstance(terms.diffusivity, StateDiffusivity),
            "no conditions that depend on u": any(
                isinstance(condition.law, Nonlinear) for condition in scene.conditions
            ),
            f"splines of degree 2, got degree={options.own.degree}": options.own.degree != 2,
            "tips='extended' alone: the ends of boundaries are refined": options.own.tips == "singular",
        }
        for reason, holds in reasons.items():
            if holds:
                raise SceneError(f"refine='auto' takes {reason}; use refine='off'.")
    orders = [condition.order for condition in scene.conditions if condition.order is not None]
    if orders:
        raise SceneError(
            f"conditions of the form {options.form!r} have no order, got order={orders[0]}; leave it out, or use "
            "form='collocation'."
        )
    given = options.own.as_dict()
    reason = option_refused_on(surface, given)
    if reason:
        raise SceneError(f"the form {options.form!r} takes {reason}; leave the option out.")
    reason = reason_against(scene, given)
    if reason:
        raise SceneError(f"the form {options.form!r} takes {reason}; change that, or use form='collocation'.")
    if has_finite_feet(surface):
        raise SceneError(
            f"the form {options.form!r} integrates over the manifold, and closest points on this one are single "
            "samples; fit a surface to them, or use form='collocation'."
        )


def option_refused_on(surface: ClosestPointSource, given: Mapping[str, Any]) -> str:
    """Return what the form takes on a solid or a union, where an option that no other form has differs; else "".

    ``given`` are the options by name; those that are missing have their default.
    """
    own, dims = GalerkinOptions().as_dict() | {**given}, member_dimensions(surface)
    if surface.dim not in dims and len(dims) == 1:
        return ""
    on = "solids" if len(dims) == 1 else "unions of several dimensions"
    reasons = {
        f"refine='off' on {on}": own["refine"] != "off",
        "tips='extended' in solids in space": own["tips"] != "extended" and 3 in dims,
        f"samples='auto' on {on}": own["samples"] == "plain",
    }
    return next((reason for reason, holds in reasons.items() if holds), "")


def reason_against(scene: Scene, given: Mapping[str, Any]) -> str:
    """Return the reason for which the form refuses a scene on a solid or a union, as "the form takes ..."; else "".

    ``given`` are the options by name; missing options have their defaults.
    """
    surface, own = scene.surface, GalerkinOptions().as_dict() | {**given}
    dims = member_dimensions(surface)
    if not {*dims} <= {*range(1, surface.dim + 1)}:
        dimensions = " and ".join(map(str, dims))
        return f"curves, surfaces and solids, got a manifold of dimension {dimensions} in {surface.dim}D"
    if surface.dim not in dims and len(dims) == 1:
        return ""
    on = "solids" if len(dims) == 1 else "unions of several dimensions"
    inside = _boundaries_in_solid(scene)
    reasons = {
        f"splines of degree 2 on {on}, got degree={own['degree']}": own["degree"] != 2,
        "curves in a plane solid, or surfaces in one in space, as boundaries inside": any(
            not oriented.has_sides for oriented in inside
        ),
        "no second Laplacian on unions of several dimensions": len(dims) > 1 and scene.problem.family == "biharmonic",
    }
    junction = unsupported_junction(surface)
    accepted = "members that lie in others or on the boundary of solids, and curves that meet surfaces at points"
    reasons[f"{accepted}; {junction}"] = bool(junction)
    return next((reason for reason, holds in reasons.items() if holds), "")


def _boundaries_in_solid(scene: Scene) -> list[OrientedBoundary]:
    """Return the boundaries of the scene that lie in a solid."""
    oriented = [scene.oriented(boundary) for boundary in scene.boundaries]
    return [each for each in oriented if each.dimension == scene.surface.dim]
