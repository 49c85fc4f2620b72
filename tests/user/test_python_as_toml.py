"""What a scene file takes, Python takes: formulas as text, numbers for conditions, one point, both sides."""

import numpy as np
import pytest

import cpmkit as ck

CIRCLE = ck.source("analytic.circle")
PIN = ck.source("analytic.point", at=[1, 0])
POINTS = np.array([[0.6, 0.8], [-1.0, 0.0], [0.0, -1.0]])
CUT = ck.Scene(CIRCLE, ck.Laplace(), [ck.Boundary("cut", PIN, left=1.0, right="0*x")])


@pytest.fixture(scope="module")
def cut():
    return ck.solve(CUT, spacing=0.1)


@pytest.mark.parametrize(
    ("told", "function"),
    [
        (ck.ScreenedPoisson("x*y"), ck.ScreenedPoisson(lambda p: p[:, 0] * p[:, 1])),
        (ck.ScreenedPoisson(["x", 2.0]), ck.ScreenedPoisson([lambda p: p[:, 0], 2.0])),
        (
            ck.Elliptic("x", diffusivity="2 + y", velocity=["-y", "x"], c=1.0),
            ck.Elliptic(
                lambda p: p[:, 0],
                diffusivity=lambda p: 2 + p[:, 1],
                velocity=lambda p: np.stack([-p[:, 1], p[:, 0]], axis=1),
                c=1.0,
            ),
        ),
        (
            ck.NonlinearDiffusion("1 + u**2", f="x", c=1.0),
            ck.NonlinearDiffusion(lambda u: 1 + u**2, f=lambda p: p[:, 0], c=1.0),
        ),
        (
            ck.ReactionDiffusion(["0.1", "x"], ["u2 - u1", "-u2"], kappa=["1 + 0*x", 0.5], until=0.2, step=0.1),
            ck.ReactionDiffusion(
                [0.1, lambda p: p[:, 0]],
                lambda u: np.stack([u[:, 1] - u[:, 0], -u[:, 1]], axis=1),
                kappa=[lambda p: 1 + 0 * p[:, 0], 0.5],
                until=0.2,
                step=0.1,
            ),
        ),
    ],
    ids=lambda problem: problem.kind,
)
def test_text_is_the_function_that_it_spells(told, function):
    found, wanted = (ck.solve(ck.Scene(CIRCLE, one), spacing=0.2) for one in (told, function))
    np.testing.assert_allclose(found.evaluate(POINTS), wanted.evaluate(POINTS), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ck.Poisson("x +"), "f of poisson: the formula 'x \\+' does not parse"),
        (lambda: ck.Dirichlet("sinn(x)"), "value of dirichlet: .*did you mean 'sin'"),
        (lambda: ck.Scene(CIRCLE, ck.Poisson("z")), "uses z, and points here have x and y alone"),
        (lambda: ck.Elliptic(velocity=["t", "x"]), "velocity of elliptic must not depend on t"),
        (lambda: ck.Heat("x", until=1.0, step=0.1, kappa="1 + t"), "kappa of heat must not depend on t"),
        (lambda: ck.Boundary("cut", PIN, both=ck.Laplace()), "both. must be .*a number or formula"),
        (lambda: ck.Boundary("cut", PIN, both=ck.Dirichlet), "both. must be .*a number or formula"),
        (lambda: ck.Boundary("cut", PIN, both=True), "both. must be .*a number or formula"),
        (lambda: ck.Scene(CIRCLE, ck.Laplace(), edge=ck.Laplace()), "edge. must be .*a number or formula"),
    ],
)
def test_what_is_no_datum_is_refused_with_its_place(make, message):
    with pytest.raises(ck.CpmkitError, match=message):
        make()


def test_numbers_and_formulas_are_dirichlet_conditions():
    both = ck.Boundary("cut", PIN, both="2 + y")
    assert (both.both.kind, both.condition("right").kind) == ("dirichlet", "dirichlet")
    segment = ck.source("analytic.segment", start=[0, 0], end=[1, 0])
    for edge in ({0: 1.0, 1: "1 + x"}, "1 + x", lambda p: 1 + p[:, 0]):
        bar = ck.solve(ck.Scene(segment, ck.Laplace(), edge=edge), spacing=0.1)
        assert bar.evaluate([[0.25, 0.0]])[0] == pytest.approx(1.25)


def test_a_scene_file_takes_numbers_and_formulas_for_conditions(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(
        "[surface]\nkind = 'analytic.segment'\nstart = [0, 0]\nend = [1, 0]\nedge = { 0 = 1.0, 1 = '1 + x' }\n"
        "[problem]\nkind = 'laplace'\n"
        "[[boundary]]\nname = 'cut'\nkind = 'analytic.point'\nat = [0.5, 0]\nleft = '3*x'\nright = 2\n"
    )
    scene = ck.load_scene(file).scene
    assert {one.kind for one in scene.conditions} == {"dirichlet"}
    solution = ck.solve(scene, spacing=0.05)
    assert solution.evaluate([0.5, 0.0], side="both") == pytest.approx([1.5, 2.0])
    file.write_text(file.read_text().replace("right = 2", "right = true"))
    with pytest.raises(ck.SceneError, match=r"right of .* must be a table, got True"):
        ck.load_scene(file)


@pytest.mark.parametrize(
    ("given", "meant"),
    [({"toleranc": 1e-3}, "tolerance"), ({"degre": 2}, "degree"), ({"form": "galerkn"}, "galerkin")],
)
def test_a_misspelt_option_is_answered_with_the_one_that_may_be_meant(given, meant):
    with pytest.raises(ck.InputError, match=f"did you mean '{meant}'"):
        ck.solve(CUT, 0.2, **given)
    prepared = ck.prepare(CUT, 0.2)
    with pytest.raises(ck.InputError, match="did you mean 'problem'"):
        prepared.solve(problm=ck.Laplace())


def test_data_of_a_prepared_scene_may_be_numbers():
    prepared = ck.prepare(CUT, spacing=0.1)
    doubled = prepared.solve(data={"cut": {"left": 2.0, "right": "0*x"}})
    np.testing.assert_allclose(doubled.evaluate(POINTS), 2 * prepared.solve().evaluate(POINTS))


def test_one_point_gives_one_value(cut):
    value = cut.evaluate([-1, 0])
    assert isinstance(value, float)
    assert value == cut.evaluate([[-1, 0]])[0]
    assert cut.gradient([0, 1]).shape == (2,)
    assert isinstance(cut.error_at([0, 1]), float)
    two = ck.solve(ck.Scene(CIRCLE, ck.ScreenedPoisson([1.0, "x"])), spacing=0.2)
    assert two.evaluate([0, 1]).shape == (2,)
    for wrong in ([0, 1, 2], [[0, 1], [2]], 3.0):
        with pytest.raises(ck.InputError, match="points must"):
            cut.evaluate(wrong)


def test_both_sides_are_read_at_once(cut):
    points = [[1.0, 0.0], [-1.0, 0.0]]
    both = cut.evaluate(points, side="both")
    assert both.shape == (2, 2)
    np.testing.assert_allclose(both[0], [1.0, 0.0], atol=1e-6)
    assert both[1, 0] == both[1, 1]
    np.testing.assert_array_equal(both[:, 1], cut.evaluate(points, side="right"))
    assert cut.evaluate([1.0, 0.0], side="both").shape == (2,)


def test_a_solution_is_a_function_of_position(cut):
    np.testing.assert_array_equal(cut(POINTS), cut.evaluate(POINTS))
    again = ck.solve(ck.Scene(CIRCLE, ck.ScreenedPoisson(cut, c=1e6)), spacing=0.1)
    np.testing.assert_allclose(1e6 * again(POINTS), cut(POINTS), atol=1e-3)


@pytest.mark.parametrize("form", ["galerkin", "collocation"])
def test_a_run_may_begin_at_any_time(form):
    def run(t0, forcing):
        heat = ck.Heat("x", until=t0 + 0.3, step=0.05, f=forcing, frames=3, t0=t0)
        return ck.solve(ck.Scene(CIRCLE, heat), spacing=0.2, form=form)

    late, early = run(2.0, "x*sin(t)"), run(0.0, "x*sin(t + 2)")
    assert late.time == pytest.approx(2.3)
    assert [frame.time for frame in late.frames] == pytest.approx([2.0, 2.1, 2.2, 2.3])
    np.testing.assert_allclose(late.evaluate(POINTS), early.evaluate(POINTS), rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(late.frames[0].evaluate(POINTS), early.frames[0].evaluate(POINTS))


def test_a_wave_reads_the_rates_of_its_data_where_it_begins():
    segment = ck.source("analytic.segment", start=[0, 0], end=[1, 0])

    def run(t0, given):
        wave = ck.Wave(0.0, until=t0 + 0.2, step=0.02, initial_rate="1 - x", t0=t0)
        return ck.solve(ck.Scene(segment, wave, edge={0: given, 1: 0.0}), spacing=0.1, form="collocation")

    late, early = run(3.0, "t - 3"), run(0.0, "t")
    np.testing.assert_allclose(late([[0.2, 0.0]]), early([[0.2, 0.0]]), rtol=1e-9)


def test_a_run_that_began_later_goes_on_from_its_checkpoint(tmp_path):
    def heat(until):
        return ck.Scene(CIRCLE, ck.Heat("x", until=until, step=0.1, f="t", frames=[1.0], t0=1.0))

    ck.solve(heat(1.3), spacing=0.2, checkpoint=tmp_path / "run.npz")
    resumed = ck.solve(heat(1.6), spacing=0.2, resume=tmp_path / "run.npz")
    np.testing.assert_array_equal(resumed.values, ck.solve(heat(1.6), spacing=0.2).values)
    with pytest.raises(ck.InputError, match="until of heat must be later than t0=2"):
        ck.Heat("x", until=1.0, step=0.1, t0=2.0)
