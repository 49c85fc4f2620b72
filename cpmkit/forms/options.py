"""How a scene is discretised, as one value: what all forms share, and what belongs to the one that is taken."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from cpmkit.forms.contract import Discretized
from cpmkit.linear.solver_options import choose_solver
from cpmkit.manifold.local_source import largest_dim
from cpmkit.runtime.arrays import positive
from cpmkit.runtime.options import OPTION_KEY, DeclaredOptions, Option, option

Own = TypeVar("Own", bound=DeclaredOptions)
#: In place of a form's name: the one that fits the scene.
AUTO = "auto"


@dataclass(frozen=True, eq=False)
class Options(DeclaredOptions, Generic[Own]):
    """How a scene is discretised; ``own`` are the options that belong to the form, ``reason`` why it is that form."""

    spacing: float = field(
        metadata={
            OPTION_KEY: Option("Distance of neighbouring lattice nodes, in the scene's unit of length.", positive)
        }
    )
    own: Own
    origin: Any = option(None, "Position of a lattice node, (d,); by default the centre of the surface's bounds.")
    form: str = option(
        AUTO,
        "How the equation is put on the lattice: ``collocation``, the paper's method, ``galerkin``, splines with the "
        "energy summed over samples of the manifold, or ``auto``, which takes the one that fits the scene.",
        methods={"collocation": "collocation", "galerkin": "galerkin"},
    )
    reason: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return the values of all options, the form's own among them, by their names."""
        return {**super().as_dict(), **self.own.as_dict()}


def solver_of(form: Discretized, target: str, unknowns: int | None = None) -> str:
    """Return the solver that ``target`` means for a discretised scene, or as it would be with so many ``unknowns``."""
    problem, traits = form.scene.problem, form.traits
    factor = problem.factors_up_to(traits.iterative_solver == "multigrid") * traits.factorise_up_to
    count = form.size if unknowns is None else unknowns
    return choose_solver(target, count, largest_dim(form.scene.surface), factor, traits.iterative_solver)


def lattice_options(form: Discretized) -> Options[Any] | None:
    """Return the options with which a scene was discretised on a lattice; None of a form without one."""
    options = getattr(form, "options", None)
    return options if isinstance(options, Options) else None
