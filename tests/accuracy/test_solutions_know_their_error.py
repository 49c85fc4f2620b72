"""Every solution tells its error: when it is read, at once, tightly, or not at all."""

import json

import numpy as np
import pytest
from model_problems import sphere_points
from trimesh.creation import box

import cpmkit as ck

SPHERE = ck.source("analytic.sphere")
AT = sphere_points()


def u(x):
    return x[:, 0] * x[:, 1] + x[:, 2]


SCENE = ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x: 7 * x[:, 0] * x[:, 1] + 3 * x[:, 2]))


@pytest.mark.parametrize("form", ["galerkin", "collocation"])
@pytest.mark.parametrize("how", [True, "tight"])
def test_at_once(form, how):
    solution = ck.solve(SCENE, 0.12, form=form, estimate=how)
    off = np.abs(solution.evaluate(AT) - u(AT)) / np.ptp(u(AT))
    assert 0.5 < solution.error.rms[0] / np.sqrt(np.mean(off**2)) < 3
    assert 0.5 < solution.error.largest[0] / off.max() < 3
    assert len(solution.error.coarse_solutions) == (2 if how == "tight" else 1)
    assert solution.summary()["error"]["rms"] == solution.error.rms.tolist()
    near = solution.error_at(AT)
    assert near.shape == (len(AT),)
    assert solution.error_at(AT[:0]).shape == (0,)
    assert 0.3 < np.sqrt(np.mean(near**2)) / (solution.error.rms[0] * solution.error.unit[0]) < 3


def test_when_it_is_read_and_only_once():
    solution = ck.solve(SCENE, 0.2)
    assert solution.estimated is None
    assert "error" not in solution.summary()
    assert solution.error is solution.error
    assert solution.error.solution is solution
    assert solution.error.coarse.spacing == pytest.approx(0.4)


def test_a_loaded_solution_knows_it_too(tmp_path):
    solution = ck.solve(SCENE, 0.2)
    solution.save(tmp_path / "u.npz")
    loaded = ck.load(tmp_path / "u.npz", SCENE)
    np.testing.assert_allclose(loaded.error.rms, solution.error.rms, rtol=1e-6)


def test_not_at_all():
    with pytest.raises(ck.InputError, match="has no estimate, since it was made with estimate=False"):
        _ = ck.solve(SCENE, 0.2, estimate=False).error


def test_another_back_end_has_no_coarser_lattice():
    vertices, faces = SPHERE.mesh(0.3)
    mesh = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    solution = ck.solve(ck.Scene(mesh, SCENE.problem), backend="fem")
    with pytest.raises(ck.InputError, match="estimated on a coarser lattice, and it has none"):
        _ = solution.error


def test_a_constant_has_an_error_of_rounding():
    estimate = ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(3.0)), 0.2).error
    assert estimate.unit == pytest.approx(3.0, rel=1e-6)
    assert estimate.largest[0] < 1e-8


def test_tips_and_thin_limbs_are_said_to_be_slow():
    arc = ck.Boundary("arc", ck.source("analytic.arc", start=0.0, end=2.0, normal=[0, 0, 1]), both=ck.Dirichlet(1.0))
    assert "boundaries end inside" in ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(0.0), [arc]), 0.2).error.slow
    limb = ck.source("analytic.cylinder", radius=0.05, length=2.0)
    assert "thin, folded or creased" in ck.solve(ck.Scene(limb, ck.ScreenedPoisson(1.0)), 0.1).error.slow
    assert not ck.solve(SCENE, 0.2).error.slow


def one_sided(share, c=100.0):
    """What fulfils -Lap u + c u = 0 and is regular at a pole, ``share`` of a diameter below it, as a series."""
    term = total = np.ones_like(share)
    for k in range(150):
        term = term * (k * (k + 1) + c) / (k + 1) ** 2 * share
        total = total + term
    return total


def test_layers_thinner_than_a_spacing_are_reported_and_their_error_is_not_taken_for_less():
    """-Lap u + c u = 0 between two values on a ring: layers 1 / sqrt(c) wide. Without conditions there is none."""
    ring = ck.Boundary("ring", ck.source("analytic.circle", normal=[0, 0, 1]), left=1.0, right=0.0)
    at = sphere_points(2000)
    at = at[np.abs(at[:, 2]) > 1e-3]
    scene = ck.Scene(SPHERE, ck.ScreenedPoisson(0.0, c=100.0), [ring])
    exact = np.where(at[:, 2] > 0, one_sided((1 - at[:, 2]) / 2) / one_sided(np.array(0.5)), 0.0)
    for spacing, reported in ((0.2, True), (0.1, False)):
        solution = ck.solve(scene, spacing)
        assert ("a layer beside conditions is 0.5 spacings wide" in solution.error.slow) == reported
        off = np.sqrt(np.mean((solution.evaluate(at) - exact) ** 2))
        assert solution.error.rms[0] * np.ptp(exact) > 0.45 * off
    for free in (ck.Scene(SPHERE, ck.ScreenedPoisson("x", c=400.0)), ck.Scene(SPHERE, ck.ScreenedPoisson("x"), [ring])):
        assert not ck.discretize(free, 0.1).diagnosis().slow


def test_folds_as_long_as_the_surface_is_wide_are_not_slow_as_they_are_tied():
    """A knife's edge of 30 degrees around a lens, and a cube's edges of 90."""
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    vertices = np.concatenate([rim, [[0, 0, 0.27], [0, 0, -0.27]]])
    following = (np.arange(60) + 1) % 60
    faces = [np.stack([np.arange(60), following, np.full(60, 60)], axis=1)]
    faces += [np.stack([following, np.arange(60), np.full(60, 61)], axis=1)]
    lens = ck.Scene((vertices, np.concatenate(faces)), ck.ScreenedPoisson("x"))
    cube = ck.Scene(box(), ck.ScreenedPoisson("x"))
    for spacing in (0.1, 0.05):
        for scene in (lens, cube):
            assert not ck.discretize(scene, spacing).diagnosis().slow


def test_waves_and_heat_have_an_error_in_time():
    heat = ck.Heat(lambda x: x[:, 0], until=1.0, step=0.1)
    circle = ck.source("analytic.circle")
    solution = ck.solve(ck.Scene(circle, heat), 0.05)
    at = circle.mesh(0.05)[0]
    off = np.abs(solution.evaluate(at) - np.exp(-1) * at[:, 0]).max() / np.ptp(np.exp(-1) * at[:, 0])
    assert 0.5 < solution.error.largest[0] / off < 3
    assert solution.error.in_time > 0.8 * solution.error.rms[0]


def test_a_file_and_a_command_line_ask_alike(tmp_path, monkeypatch):
    from click.testing import CliRunner

    from cpmkit.cli import main

    monkeypatch.chdir(tmp_path)
    text = """
[surface]
kind = "analytic.circle"
[problem]
kind = "screened"
f = "2*x"
[discretization]
tolerance = 1e-4
norm = "max"
[output]
files = ["summary.json"]
"""
    (tmp_path / "scene.toml").write_text(text)
    loaded = ck.load_scene("scene.toml")
    assert (loaded.spacing, loaded.options) == (None, {"tolerance": 1e-4, "norm": "max"})
    plain = CliRunner().invoke(main, ["solve", "scene.toml", "--json"])
    assert plain.exit_code == 0, plain.output
    found = json.loads(plain.stdout)["trade"]
    assert (found["status"], found["target"]["norm"]) == ("reached", "max")
    over = CliRunner().invoke(main, ["solve", "scene.toml", "--tolerance", "1e-2", "--norm", "rms"])
    assert "history    tolerance 0.01 reached: root mean square about" in over.stdout
    at = CliRunner().invoke(main, ["solve", "scene.toml", "--spacing", "0.1", "--json", "--estimate"])
    assert "trade" not in json.loads(at.stdout)
    assert json.loads(at.stdout)["error"]["rms"][0] < 1e-3
    both = text.replace("tolerance = 1e-4", "tolerance = 1e-4\nspacing = 0.1")
    (tmp_path / "both.toml").write_text(both)
    refused = CliRunner().invoke(main, ["solve", "both.toml"])
    assert refused.exit_code == 1
    assert "each decides how fine the lattice is" in refused.output


def test_the_error_of_a_frame_is_that_at_its_time():
    def heat(until, frames=0):
        problem = ck.Heat(lambda x: x[:, 2], until=until, step=0.1, frames=frames)
        return ck.solve(ck.Scene(ck.source("analytic.sphere"), problem), spacing=0.3)

    run = heat(0.4, frames=4)
    assert run.frames[3].time == pytest.approx(0.3)
    assert run.frames[3].error.of("max") == pytest.approx(heat(0.3).error.of("max"), rel=1e-6)
    with pytest.raises(ck.InputError, match="at the start"):
        _ = run.frames[0].error
