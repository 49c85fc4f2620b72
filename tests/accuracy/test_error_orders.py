"""What differences of solutions are divided by: on coarse lattices, near folds, on one-sided strips."""

import numpy as np
import pytest
from galerkin_scenes import fold, plate
from model_problems import sphere_points

import cpmkit as ck
from cpmkit.accuracy.error_estimate import estimate_from
from cpmkit.accuracy.estimate import shifted_origin

SPHERE, AT = ck.source("analytic.sphere"), sphere_points()


def estimate_of(scene, spacing, coarse):
    """Return a solution's estimate from one at a coarser spacing, elsewhere."""
    other = ck.solve(scene, coarse, origin=shifted_origin(scene, coarse), form="galerkin")
    return estimate_from(ck.solve(scene, spacing, form="galerkin"), [other])


@pytest.mark.parametrize("ratio", [1.5, 2.0])
@pytest.mark.parametrize("waves", [1, 4])
def test_estimates_hold_from_the_coarsest_lattices_on(waves, ratio):
    u = lambda x: np.sin(waves * x[:, 2])  # noqa: E731
    load = lambda x: (1 + waves**2 * (1 - x[:, 2] ** 2)) * u(x) + 2 * waves * x[:, 2] * np.cos(waves * x[:, 2])  # noqa: E731
    scene, unit = ck.Scene(SPHERE, ck.ScreenedPoisson(load)), np.ptp(u(AT))
    for spacing in (0.4, 0.28, 0.2):
        estimate = estimate_of(scene, spacing, ratio * spacing)
        off = (estimate.solution.evaluate(AT) - u(AT)) / unit
        assert 0.4 < estimate.of("rms") / np.sqrt(np.mean(off**2)) < 3
        assert 0.4 < estimate.of("max") / np.abs(off).max() < 3


def test_errors_are_taken_to_fall_faster_the_finer_the_lattices_and_the_nearer_the_solutions():
    form, coarse, fine = (
        ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(1.0)), h, form="galerkin").discretized for h in (0.3, 0.6, 0.32)
    )
    by_spacing = [form.diagnosis(other).order for other in (coarse, fine)]
    by_distance = [form.diagnosis(fine, difference=apart).order for apart in (1e-1, 1e-2, 1e-3, 1e-4)]
    assert by_spacing[0] < by_spacing[1] == by_distance[-1]
    assert by_distance == sorted(by_distance)
    assert form.diagnosis().order == pytest.approx(np.log2(1 + 6.0))


@pytest.mark.parametrize("mesh", [plate(0.02), fold(20)])
def test_errors_beside_folds_are_taken_to_fall_fast(mesh):
    vertices, faces = mesh
    source = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    estimate = estimate_of(ck.Scene(source, ck.ScreenedPoisson(lambda x: x[:, 0])), 0.05, 0.1)
    assert estimate.order > 1.5
    assert not estimate.slow


def test_a_strip_with_one_side_is_not_folded_where_its_cells_turn_round():
    scene = ck.Scene(ck.source("parametric.moebius"), ck.ScreenedPoisson(lambda x: x[:, 2]))
    estimate = estimate_of(scene, 0.1, 0.2)
    assert estimate.solution.discretized.resolution.normal_spread.unresolved_share == 0.0
    assert estimate.order > 2.5
    assert not estimate.slow


def test_errors_are_taken_to_fall_slower_where_the_coarser_lattice_alone_does_not_see_bends():
    """A torus of radius .4, and an edge of radius .035: with the divisor of smooth sources estimates were a third."""
    torus = ck.Scene(ck.source("analytic.torus", major=1.0, minor=0.4), ck.ScreenedPoisson(1.0))
    fine, near, far = (ck.discretize(torus, h, form="galerkin") for h in (0.1, 0.15, 0.27))
    assert fine.resolution.normal_spread.bending_share == near.resolution.normal_spread.bending_share == 0.0
    assert far.resolution.normal_spread.bending_share > 1e-4
    assert fine.diagnosis(far).order == pytest.approx(np.log2(1 + 3.0))
    assert fine.diagnosis(near).order > np.log2(1 + 6.0)
