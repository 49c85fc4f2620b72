"""A preconditioner that is lent: the same solution in more iterations, and its own where it does not do."""

from __future__ import annotations

import numpy as np
import pytest

import cpmkit as ck
from cpmkit import Scene, assemble
from cpmkit.linear.multigrid.solver import MultigridSolver
from cpmkit.linear.preconditioned import ReusablePreconditioner, SharedPreconditioner
from cpmkit.plugin import Floats, PreparedSolver

SPHERE = ck.source("analytic.sphere")


def _turning(rate: float) -> Scene:
    def velocity(points: Floats) -> Floats:
        return rate * np.cross([0.0, 0.0, 1.0], points)

    return ck.Scene(SPHERE, ck.Elliptic("x + z", diffusivity=0.05, velocity=velocity, c=1.0))


def test_a_system_that_differs_a_little_is_solved_with_another_ones_preconditioner() -> None:
    own, near, far = (ck.prepare(_turning(rate), 0.2, form="galerkin").discretized for rate in (1.0, 1.1, -6.0))
    system = assemble(own)
    lender = MultigridSolver().prepare(system.operator, own.levels(system.operator))
    assert isinstance(lender, ReusablePreconditioner)
    made: list[PreparedSolver] = []
    for form, rebuilt, iterations in ((near, 0, 30), (far, 1, 3)):
        other = assemble(form)
        exact = MultigridSolver().prepare(other.operator, form.levels(other.operator))

        def prepare(exact: PreparedSolver = exact) -> PreparedSolver:
            made.append(exact)
            return exact

        lent = SharedPreconditioner(type(lender)(other.operator, lender.cycle, iterations), prepare)
        u, _ = lent.solve(other.right_side, 1e-8)
        np.testing.assert_allclose(u, exact.solve(other.right_side, 1e-8)[0], atol=1e-6)
        assert len(made) == rebuilt


def test_equations_on_a_lending_scene_have_the_solutions_of_any() -> None:
    prepared = ck.prepare(_turning(1.0), 0.2, form="galerkin", solver="multigrid")
    lending, points = prepared.sharing_preconditioner(), SPHERE.closest_point(np.eye(3)).points
    for rate in (1.0, 1.1, 1.2):
        problem = _turning(rate).problem
        found = lending.solve(problem=problem).evaluate(points)
        assert found == pytest.approx(prepared.solve(problem=problem).evaluate(points), abs=1e-8)
    assert len(lending.cache.shared) == 1
