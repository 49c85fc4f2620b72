"""The block iteration finds what factors find, in far less than their work, and refuses what it cannot seek."""

from dataclasses import replace

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.linear.multigrid import solver as multigrid

SPHERE, CAP = ck.source("analytic.sphere"), ck.source("analytic.cap")
SCENES = {
    "closed": ck.Scene(SPHERE, ck.Eigen(9)),
    "Dirichlet": ck.Scene(CAP, ck.Eigen(6), edge=ck.Dirichlet(0)),
    "Robin": ck.Scene(CAP, ck.Eigen(3), edge=ck.Robin(1.0, 2.0, 0.0)),
    "Steklov": ck.Scene(CAP, ck.Eigen(5), edge=ck.Steklov()),
    "potential": ck.Scene(SPHERE, ck.Eigen(2, c=lambda x: 5 * x[:, 2], diffusivity=lambda x: 2 + x[:, 2])),
}


@pytest.mark.parametrize("name", SCENES)
def test_it_finds_what_factors_find(name):
    direct, block = (ck.solve(SCENES[name], 0.25, solver=solver) for solver in ("direct", "multigrid"))
    assert block.report.solver == "multigrid"
    assert block.eigenvalues == pytest.approx(direct.eigenvalues, rel=1e-10, abs=1e-10)
    assert block.residuals.max() <= 1e-10
    ours, theirs = (one.evaluate(direct.discretized.points[::50]) for one in (block, direct))
    span = np.linalg.lstsq(theirs, ours, rcond=None)[0]  # signs, and bases of multiplets, may differ
    assert np.abs(theirs @ span - ours).max() <= 1e-7


@pytest.mark.parametrize(("spacing", "count"), [(0.2, 9), pytest.param(0.1, 25, marks=pytest.mark.slow)])
def test_its_work_is_that_of_few_solves(spacing, count):
    one = ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x: x[:, 0])), spacing, solver="multigrid")
    many = ck.solve(ck.Scene(SPHERE, ck.Eigen(count)), spacing, solver="multigrid")
    assert many.report.operator_applications <= 60 * one.report.operator_applications
    assert many.report.iterations <= 30


def test_an_iteration_that_does_not_reach_the_tolerance_is_no_answer(monkeypatch):
    monkeypatch.setattr("cpmkit.families.eigen.block_iteration.MOST_ROUNDS", 3)
    with pytest.raises(ck.ConvergenceError, match=r"of their size after 3 rounds.* use solver='direct', or"):
        ck.solve(SCENES["closed"], 0.25, solver="multigrid")


class _Reversed:
    """Factors whose solutions have the wrong sign."""

    def __init__(self, factors):
        self.factors = factors

    def solve(self, b):
        return -self.factors.solve(b)


def test_a_cycle_that_rounding_makes_indefinite_is_made_again_without(monkeypatch):
    """As on meshes with jagged rims, where entries of the matrix differ by 1e6."""
    right = multigrid.build_cycle
    built = []

    def build(*arguments, is_rounded=True):
        built.append(is_rounded)
        cycle = right(*arguments, is_rounded=is_rounded)
        return replace(cycle, coarsest=_Reversed(cycle.coarsest)) if is_rounded else cycle

    good = ck.solve(SCENES["Dirichlet"], 0.2, solver="multigrid")
    monkeypatch.setattr(multigrid, "build_cycle", build)
    mended = ck.solve(SCENES["Dirichlet"], 0.2, solver="multigrid")
    assert built == [True, False]
    assert mended.eigenvalues == pytest.approx(good.eigenvalues, rel=1e-10)
    assert mended.report.iterations <= good.report.iterations + 2


def test_numbers_inside_the_spectrum_are_neared_by_solves():
    scene = ck.Scene(SPHERE, ck.Eigen(5, near=6.1))
    found = [ck.solve(scene, 0.3, solver=solver) for solver in ("direct", "multigrid")]
    assert found[0].eigenvalues == pytest.approx([6] * 5, rel=5e-3)
    assert found[1].eigenvalues == pytest.approx(found[0].eigenvalues, rel=1e-9)
    assert ck.explain(scene, 0.05, dry_run=True).solver == "direct"


def test_functions_that_do_not_fit_are_refused_before_they_are_made(monkeypatch):
    monkeypatch.setattr("cpmkit.families.eigen.block_iteration.PEAK_BLOCKS", 10**9)
    with pytest.raises(ck.ResolutionError, match=r"count=9 of \d+ unknowns needs about .* GiB for functions, and"):
        ck.solve(SCENES["closed"], 0.25, solver="multigrid")
