"""The options of a discretisation: those that all forms share, and those of the chosen form."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from cpmkit.linear.solver_options import choose_solver
from cpmkit.manifold.local_source import largest_dim
from cpmkit.runtime.arrays import positive
from cpmkit.runtime.options import OPTION_KEY, DeclaredOptions, Option, option

if TYPE_CHECKING:
    from cpmkit.forms.contract import Discretized

Own = TypeVar("Own", bound=DeclaredOptions)
#: The value of the option ``form`` that chooses the form that fits the scene.
AUTO = "auto"


@dataclass(frozen=True, eq=False)
class Options(DeclaredOptions, Generic[Own]):
    """How a scene is discretised: ``own`` are the options of the form, ``reason`` says why that form was chosen."""

    spacing: float = field(
        metadata={
            OPTION_KEY: Option("Distance of neighbouring lattice nodes, in the scene's unit of length.", positive)
        }
    )
    own: Own
    origin: Any = option(None, "Position of a lattice node, (d,); by default the centre of the surface's bounds.")
    form: str = option(
        AUTO,
        "How the equation is discretised on the lattice: ``collocation``, the closest point method, ``galerkin``, "
        "splines with the energy integrated over the manifold, or ``auto``, which takes the one that fits the scene.",
        methods={"collocation": "collocation", "galerkin": "galerkin"},
    )
    reason: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return the values of all options, those of the form included, by their names."""
        return {**super().as_dict(), **self.own.as_dict()}


def solver_of(form: Discretized, target: str) -> str:
    """Return the name of the solver that ``target`` ("auto" or a name) means for a discretised scene."""
    problem, traits = form.scene.problem, form.traits
    factor = problem.factors_up_to(traits.iterative_solver == "multigrid") * traits.factorise_up_to
    return choose_solver(target, form.size, largest_dim(form.scene.surface), factor, traits.iterative_solver)


def lattice_options(form: Discretized) -> Options[Any] | None:
    """Return the options with which a scene was discretised on a lattice; None if the form has no lattice."""
    options = getattr(form, "options", None)
    return options if isinstance(options, Options) else None
