"""Solvers that take no levels have none made."""

import cpmkit as ck


def test_factors_need_no_coarser_lattices(monkeypatch):
    scene = ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(1.0))
    calls, galerkin = [], type(ck.discretize(scene, 0.1))
    levels = galerkin.levels
    monkeypatch.setattr(galerkin, "levels", lambda self, operator: calls.append(1) or levels(self, operator))
    for solver, count in (("direct", 0), ("reference", 0), ("multigrid", 1)):
        ck.solve(scene, 0.1, solver=solver)
        assert len(calls) == count
