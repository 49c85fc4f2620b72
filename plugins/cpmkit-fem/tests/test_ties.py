"""Boundaries that couple their sides, by finite elements: two materials, jumps, fluxes, resistances."""

import numpy as np
import pytest
from model_problems import order_of
from sphere_zones import CIRCLE, SPHERE, coupled, errors, on_left, sphere_points

import cpmkit as ck

SPACINGS = (0.3, 0.2, 0.14)
AT = sphere_points(1500)


@pytest.mark.parametrize(("contrast", "resistance"), [(1.0, 0.0), (30.0, 0.0), (1.0, 0.3), (30.0, 1e4)])
def test_two_materials_with_jump_flux_and_resistance_are_of_second_order(contrast, resistance):
    found = [errors(ck.solve(coupled(contrast, resistance), h, backend="fem"), AT)[1] for h in SPACINGS]
    assert order_of(SPACINGS, found) > 1.7
    assert found[-1] < 5e-3


def test_the_other_side_of_the_reference_agrees():
    scene = coupled(3.0, 0.3)
    fem, splines = ck.solve(scene, 0.14, backend="fem"), ck.solve(scene, 0.14)
    on = CIRCLE.mesh(0.3)[0]
    for side in ("left", "right"):
        assert np.abs(fem.evaluate(on, side) - splines.evaluate(on, side)).max() < 0.02


def test_nothing_happens_across_an_idle_seam():
    """Without a jump, a flux or a resistance the boundary is not there: as on the same mesh without a condition."""
    problem = ck.ScreenedPoisson("x*y + z")
    seam = ck.Boundary("seam", CIRCLE, across=ck.Transmission())
    free = ck.solve(ck.Scene(SPHERE, problem), 0.2, backend="fem").evaluate(AT)
    tied = ck.solve(ck.Scene(SPHERE, problem, [seam]), 0.2, backend="fem")
    assert np.abs(tied.evaluate(AT) - free).max() < 0.02 * np.ptp(free)
    on = CIRCLE.mesh(0.3)[0]
    np.testing.assert_allclose(tied.evaluate(on, "left"), tied.evaluate(on, "right"), atol=1e-3 * np.ptp(free))


def test_heat_passes_a_contact():
    """A hot cap behind a poor contact: both sides come to its share of the area, .35, though slowly."""
    seam = ck.Boundary("seam", CIRCLE, across=ck.Transmission(resistance=5.0))
    heat = ck.Heat(lambda x: 1.0 * on_left(x), until=40.0, step=1.0)
    solution = ck.solve(ck.Scene(SPHERE, heat, [seam]), 0.3, backend="fem")
    early = ck.solve(ck.Scene(SPHERE, ck.Heat(heat.initial, until=1.0, step=1.0), [seam]), 0.3, backend="fem")
    assert np.ptp(early.evaluate(AT)) > 0.3
    assert np.abs(solution.evaluate(AT) - 0.35).max() < 0.03


def test_a_constant_stays_free_on_both_sides_together():
    """One constant, not two: data that balance over the whole surface, and not on either side."""
    seam = ck.Boundary("seam", CIRCLE, across=ck.Transmission(resistance=0.5))
    solution = ck.solve(ck.Scene(SPHERE, ck.Poisson("z"), [seam]), 0.2, backend="fem")
    assert abs(np.mean(solution.evaluate(AT))) < 0.05
    assert not any("balance" in one for one in solution.warnings)


def test_new_data_need_no_new_tables():
    prepared = ck.prepare(coupled(3.0, 0.3), 0.3, backend="fem")
    other = ck.Transmission(0.5, 1.0, resistance=0.3)
    scene = coupled(3.0, 0.3)
    fresh = ck.Scene(SPHERE, scene.problem, [ck.Boundary("C", CIRCLE, across=other)])
    again = prepared.solve(data={"C": {"across": other}})
    np.testing.assert_allclose(again.evaluate(AT), ck.solve(fresh, 0.3, backend="fem").evaluate(AT), atol=1e-9)


def test_a_seam_on_the_rim_is_refused():
    cap = ck.source("analytic.cap", height=0.0)
    rim = ck.Boundary("rim", ck.source("analytic.circle", normal=[0, 0, 1]), across=ck.Transmission())
    with pytest.raises(ck.SceneError, match="'rim' couples two sides, and has only one on this mesh"):
        ck.solve(ck.Scene(cap, ck.ScreenedPoisson(1.0), [rim]), 0.2, backend="fem")
