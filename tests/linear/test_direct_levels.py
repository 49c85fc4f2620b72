"""Solvers that take no levels have none made."""

import cpmkit as ck
from cpmkit.forms.galerkin.form import Galerkin


def test_factors_need_no_coarser_lattices(monkeypatch):
    target = []
    levels = Galerkin.levels
    monkeypatch.setattr(Galerkin, "levels", lambda self, operator: target.append(1) or levels(self, operator))
    scene = ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(1.0))
    for solver, count in (("direct", 0), ("reference", 0), ("multigrid", 1)):
        ck.solve(scene, 0.1, solver=solver)
        assert len(target) == count
