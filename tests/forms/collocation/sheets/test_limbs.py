"""Limbs as near to each other as stencils are wide: told, and refused where the operator has a wrong sign."""

import numpy as np
import pytest
from layouts import lay_out

import cpmkit as ck
from cpmkit.forms.collocation.diagnosis.definiteness import lowest_eigenvalue
from cpmkit.forms.collocation.diagnosis.survey import find_unresolved
from cpmkit.forms.collocation.diagnosis.valleys import limb_feature
from cpmkit.forms.free_constants import Imbalance
from cpmkit.protocols import ClosestPoints

AXES = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]


class Capsule:
    """A tube of a diameter with round ends, by its closest points; ``aside`` along the second axis."""

    dim, manifold_dim, exact = 3, 2, True

    def __init__(self, diameter, aside):
        self.start, self.end = AXES[1] * aside - 3 * AXES[0], AXES[1] * aside + 3 * AXES[0]
        self.radius = diameter / 2
        ends = np.stack([self.start, self.end])
        self.bounds = np.stack([ends.min(axis=0) - self.radius, ends.max(axis=0) + self.radius])

    def centre(self, x):
        along = np.clip((x - self.start) @ (self.end - self.start) / 36, 0, 1)
        return self.start + along[:, None] * (self.end - self.start)

    def closest_point(self, x):
        away = x - self.centre(x)
        length = np.linalg.norm(away, axis=1)
        unit = np.where(length[:, None] > 1e-12, away / np.maximum(length, 1e-12)[:, None], AXES[2])
        return ClosestPoints(self.centre(x) + self.radius * unit, np.abs(length - self.radius), np.full(len(x), -1))

    def normals(self, feet):
        return (feet.points - self.centre(feet.points)) / self.radius


def two(diameter, gap, problem):
    aside = (diameter + gap) / 2
    members = [Capsule(diameter, -aside), Capsule(diameter, aside)]
    return ck.Scene(ck.source("union", members=members), problem)


def one_and_nothing(points):
    return 1.0 * (points @ AXES[1] > 0)


@pytest.mark.parametrize(
    ("diameter", "gap"),
    [
        (1.8, 1.5),
        (2, 2),
        (4, 1.5),
        *[pytest.param(*pair, marks=pytest.mark.slow) for pair in ((2, 2.5), (3, 1.5), (3, 2))],
    ],
)
def test_limbs_side_by_side_are_told_with_their_place_their_gap_and_about_their_error(diameter, gap):
    """-Lap u + u = f with f = 1 on one and 0 on the other: so is u."""
    scene = two(diameter, gap, ck.ScreenedPoisson(one_and_nothing))
    layout = lay_out(scene, 1.0)
    found = limb_feature(layout)
    points = layout.lattice.to_scene(layout.band.feet.points)
    solution = ck.solve(scene, 1.0, form="collocation")
    error = np.abs(solution.evaluate(points) - one_and_nothing(points)).max()
    assert 1 / 3 < found.error / error < 3
    assert 0.9 * gap < found.worst < 1.8 * gap
    assert abs(np.dot(found.place, AXES[1])) < diameter / 2 + gap
    assert 0.2 < found.cure < 0.9
    assert found.sentence in solution.warnings


def test_limbs_far_apart_and_one_alone_are_not_told():
    for scene in (two(3, 4.5, ck.Poisson(0.0)), ck.Scene(Capsule(1.5, 0.0), ck.Poisson(0.0))):
        assert limb_feature(lay_out(scene, 1.0)) is None


@pytest.mark.parametrize(
    "problem",
    [
        ck.Heat(one_and_nothing, until=1.0, step=0.1),
        ck.Wave(one_and_nothing, until=1.0, step=0.2),
        ck.Eigen(3),
        ck.ScreenedPoisson(one_and_nothing, c=0.01),
    ],
    ids=lambda problem: problem.kind,
)
def test_an_eigenvalue_of_the_wrong_sign_is_refused_with_a_spacing_that_does(problem):
    told = r"near \(.*eigenvalue of the wrong sign, -0\.0.* use a spacing of 0\.\d+, .* or sheets=\"unfolded\""
    with pytest.raises(ck.ResolutionError, match=told):
        ck.solve(two(2, 2, problem), 1.0, form="collocation")


def test_where_c_lifts_the_operator_or_limbs_are_thick_nothing_is_refused():
    solution = ck.solve(two(2, 2, ck.ScreenedPoisson(one_and_nothing, c=1.0)), 1.0, form="collocation")
    assert any("Limbs side by side" in text for text in solution.warnings)
    assert ck.solve(two(3, 4.5, ck.Heat(one_and_nothing, until=1.0, step=0.25)), 1.0, form="collocation").warnings
    eigen = ck.solve(two(3, 3.5, ck.Eigen(3)), 1.0)
    assert eigen.eigenvalues[:2] == pytest.approx([0, 0], abs=2e-3)


def test_arnoldi_finds_the_lowest_eigenvalue_only_where_there_is_one():
    for diameter, gap, negative in ((2, 2, True), (3, 4.5, False)):
        scene = two(diameter, gap, ck.Poisson(0.0))
        operator = ck.discretize(scene, 1.0, form="collocation").stiffness(scene.problem.terms())
        value, products = lowest_eigenvalue(operator, -1e-3)
        lowest = np.linalg.eigvals(operator.to_csr().toarray()).real.min()
        assert (value is not None) == negative == (lowest < -1e-3)
        assert products <= 120
        if negative:
            assert value == pytest.approx(lowest, rel=0.5)


def test_a_rim_as_sharp_as_the_grid_and_the_dziuk_surface_are_told():
    """A plate with a rim sharper than the spacing, and a surface whose smallest radius is that: 1.7 percent off."""
    plate = ck.source(
        "levelset.expression", phi="(x**2 + y**2)**4 + (z/0.2)**8 - 1", bounds=[[-1.2, -1.2, -0.4], [1.2, 1.2, 0.4]]
    )
    for source, spacing, at_least in ((plate, 0.2, 0.05), (ck.source("levelset.dziuk"), 0.1, 0.005)):
        layout = lay_out(ck.Scene(source, ck.Poisson(0.0)), spacing)
        (bend,) = [one for one in find_unresolved(layout) if one.kind == "bend"]
        assert bend.error > at_least


def test_a_run_that_grows_without_a_cause_is_refused(monkeypatch):
    """The probe switched off: the run itself tells."""
    monkeypatch.setattr("cpmkit.forms.collocation.form.Collocation.indefinite", lambda *_: ("", 0))
    for problem in (
        ck.Heat(one_and_nothing, until=4000.0, step=10.0),
        ck.Wave(one_and_nothing, until=200.0, step=0.4),
    ):
        with pytest.raises(ck.ResolutionError, match="grows without a cause: at time"):
            ck.solve(two(2, 2, problem), 1.0, form="collocation")


def test_heat_that_leaks_is_told_and_heat_that_stays_is_not():
    """Of a tube 1.5 spacings thick it is not kept, of a sphere it is, with a source that is added to it and without."""

    def warm(points):
        return np.exp(-((points - 3.5 * AXES[0] - AXES[1]) ** 2).sum(axis=1) / 2)

    tube = ck.solve(ck.Scene(Capsule(1.5, 0.0), ck.Heat(warm, until=1.0, step=0.1)), 1.0, form="collocation")
    (told,) = [
        text for text in tube.warnings if text.startswith("Heat was gained on a piece that nothing flows out of")
    ]
    assert "3.7% of the heat there" in told
    for f in (0.0, 2.0):
        heat = ck.Heat(lambda x: np.exp(x[:, 2]), until=0.5, step=0.1, f=f)
        assert not ck.solve(ck.Scene(ck.source("analytic.sphere"), heat), 0.2, form="collocation").warnings


def test_a_mean_that_was_far_off_says_by_how_much_the_rest_may_be_off():
    (told,) = Imbalance("mean", value=(0.33,), size=(0.3,), explained=0.01).warnings
    assert "the rest of the solution may be off by up to 110.0% of its range" in told


@pytest.mark.slow
def test_the_error_foretold_is_the_larger_of_what_bends_cost_and_what_the_mean_missed():
    plate = ck.source(
        "levelset.expression", phi="(x**2 + y**2)**4 + (z/0.1)**8 - 1", bounds=[[-1.2, -1.2, -0.4], [1.2, 1.2, 0.4]]
    )
    solution = ck.solve(
        ck.Scene(plate, ck.ScreenedPoisson(lambda x: 1.0 * (x[:, 2] > 0), c=0.01)), 0.2, form="collocation"
    )
    (bend,) = [one for one in find_unresolved(solution.discretized.tables.layout) if one.kind == "bend"]
    (mean,) = solution.imbalances
    assert mean.relative > bend.error
    (told,) = [text for text in solution.warnings if "bends more sharply" in text]
    assert f"expect an error of about {min(mean.relative, 1.0):.1%}" in told


def test_of_the_plain_method_a_wrong_sign_is_told_in_steady_problems_and_refused_in_time(monkeypatch):
    """It is there to be compared with; runs in time would explode."""
    import cpmkit.forms.collocation.diagnosis.definiteness as looking

    monkeypatch.setattr(looking, "lowest_eigenvalue", lambda *_: (-0.5, 20))
    screened, heat = ck.ScreenedPoisson(one_and_nothing, c=0.01), ck.Heat(one_and_nothing, until=1.0, step=0.5)
    solution = ck.solve(two(3, 1, screened), 1.0, sheets=False)
    assert any("eigenvalue of the wrong sign, -0.5" in text for text in solution.warnings)
    for problem, sheets in ((screened, True), (heat, True), (heat, False)):
        with pytest.raises(ck.ResolutionError, match="eigenvalue of the wrong sign"):
            ck.solve(two(3, 1, problem), 1.0, sheets=sheets)
