"""A linear solver from outside is one class: prepare once, solve often; every family takes it."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from model_problems import sphere_points

import cpmkit as ck
from cpmkit import plugins
from cpmkit.plugin import Operator, hookimpl, judge


@dataclass(frozen=True)
class Gmres:
    """SciPy's GMRES with Jacobi's preconditioner."""

    restart: int = 60
    prepared: list = field(default_factory=list)

    def prepare(self, operator, levels=()):
        self.prepared.append(operator)
        return PreparedGmres(operator, self.restart)


@dataclass(frozen=True, eq=False)
class PreparedGmres:
    operator: Operator
    restart: int

    def solve(self, b, tolerance, guess=None, progress=None):
        from scipy.sparse.linalg import LinearOperator, gmres

        n, diagonal = self.operator.size, np.broadcast_to(self.operator.diagonal, (self.operator.size, 1))[:, 0]
        matrix = LinearOperator((n, n), matvec=self.operator.apply, dtype=float)
        jacobi = LinearOperator((n, n), matvec=lambda v: v / diagonal, dtype=float)
        steps = []
        columns = [
            gmres(
                matrix,
                column,
                None if guess is None else guess[:, k],
                rtol=0.3 * tolerance,
                restart=self.restart,
                M=jacobi,
                callback=steps.append,
                callback_type="pr_norm",
            )[0]
            for k, column in enumerate(b.T)
        ]
        u = np.stack(columns, axis=1)
        return u, judge(self.operator, b, u, "test.gmres", tolerance, len(steps), len(steps), "ask for more")


@pytest.fixture
def made(monkeypatch):
    solvers = []

    class Plugin:
        @hookimpl
        def cpmkit_solvers(self):
            return {"test.gmres": lambda *, restart=60: solvers.append(Gmres(restart)) or solvers[-1]}

    offered = plugins.factory
    known = plugins.InstalledKind("test.gmres", "test", "0", "test")
    monkeypatch.setattr("cpmkit.linear.solver_options.installed_kinds", lambda: [known])
    monkeypatch.setattr(
        "cpmkit.linear.solver_options.factory",
        lambda name, hook: Plugin().cpmkit_solvers()[name] if name == "test.gmres" else offered(name, hook),
    )
    return solvers


def product(x):
    return x[:, 0] * x[:, 1]


CUT = ck.Boundary("cut", ck.source("analytic.circle", normal=[0, 0, 1]), both=ck.Dirichlet(0.0))
PROBLEMS = {
    "steady": (ck.ScreenedPoisson([product, 1.0]), 1),
    "heat": (ck.Heat(product, until=0.2, step=0.05, scheme="backward-euler"), 1),
    "eigenvalues": (ck.Eigen(2), 1),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_it_is_prepared_once_and_gives_what_the_others_give(made, name):
    problem, times = PROBLEMS[name]
    scene = ck.Scene(ck.source("analytic.sphere"), problem, [CUT])
    form = "collocation" if name == "eigenvalues" else "auto"  # Jacobi's preconditioner is slow to 1e-12 on splines
    solution = ck.solve(scene, 0.35, solver="test.gmres", restart=80, form=form)
    assert [len(one.prepared) for one in made][-1] == times
    assert solution.report.solver == "test.gmres"
    other = ck.solve(scene, 0.35, solver="direct", form=form)
    if name == "eigenvalues":
        np.testing.assert_allclose(solution.eigenvalues, other.eigenvalues, rtol=1e-6)
    else:
        points = sphere_points(30)
        np.testing.assert_allclose(solution.evaluate(points), other.evaluate(points), atol=1e-8)


def test_its_options_are_its_own(made):
    scene = ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(1.0))
    with pytest.raises(ck.CpmkitError, match=r"unknown key 'patience'.*restart"):
        ck.solve(scene, 0.3, solver="test.gmres", patience=3)
