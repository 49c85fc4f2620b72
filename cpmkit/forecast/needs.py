"""How much memory a solve of so many unknowns needs, by the form and the solver that will be taken."""

from __future__ import annotations

from typing import Any

from cpmkit.forms.galerkin import galerkin_cost as galerkin
from cpmkit.forms.galerkin.galerkin_operator import multigrid_applies
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.options import Options
from cpmkit.linear.solver_options import choose_solver
from cpmkit.manifold.local_source import largest_dim
from cpmkit.runtime import memory
from cpmkit.scene.scene import Scene


def solver_for(scene: Scene, options: Options[Any], solver: str, unknowns: float) -> str:
    """Return the solver that is taken for so many unknowns where ``solver`` is asked for."""
    m, count = largest_dim(scene.surface), round(unknowns)
    if not isinstance(options.own, GalerkinOptions):
        return choose_solver(solver, count, m, scene.problem.factorise_up_to)
    iterated = multigrid_applies(scene)
    return choose_solver(solver, count, m, scene.problem.factors_up_to(iterated), "multigrid" if iterated else "direct")


def bytes_needed(
    scene: Scene, options: Options[Any], solver: str, unknowns: float, samples: float | None = None
) -> float:
    """Return the bytes at the peak of a solve by ``solver``, as :func:`solver_for` names it.

    With so many ``samples`` of the Galerkin form, if they are known.
    """
    if isinstance(options.own, GalerkinOptions):
        factors = galerkin.factorised_share(scene, solver)
        m, degree = largest_dim(scene.surface), options.own.degree
        return galerkin.peak_bytes(unknowns, m, factors, samples, degree, galerkin.scene_extras(scene))
    return unknowns * memory.bytes_per_unknown(scene.surface.dim, options.own.degree, solver)
