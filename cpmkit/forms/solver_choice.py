"""Which linear solver a scene takes in a form: one rule for those who solve it and those who foretell it."""

from __future__ import annotations

from cpmkit.forms.contract import Discretized
from cpmkit.linear.solver_options import choose_solver
from cpmkit.manifold.local_source import largest_dim


def solver_of(form: Discretized, target: str, unknowns: int | None = None) -> str:
    """Return the solver that ``target`` means for a discretised scene, or as it would be with so many ``unknowns``."""
    problem, many = form.scene.problem, form.size if unknowns is None else unknowns
    factor = problem.factors_up_to(form.multigrid) * form.factorise_up_to
    return choose_solver(target, many, largest_dim(form.scene.surface), factor, form.iterative_solver)
