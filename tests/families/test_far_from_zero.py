"""u + constant solves what u solves: what is found of u does not depend on where zero lies."""

import numpy as np
import pytest

import cpmkit as ck

SPHERE, CIRCLE = ck.source("analytic.sphere"), ck.source("analytic.circle")
#: Rounding of data is multiplied by so much at most: condition numbers of these systems, their squares' roots at most.
ROUNDING_FACTOR = 2e3


def directions(dim):
    points = np.random.default_rng(0).normal(size=(60, dim))
    return points / np.linalg.norm(points, axis=1)[:, None]


def product(points):
    return points[:, 0] * points[:, 1]


def ring(shift, **conditions):
    return [ck.Boundary("ring", ck.source("analytic.circle", normal=[0, 0, 1]), **conditions)]


def shifted(shift):
    return lambda points: shift + product(points)


def dirichlet(shift):
    return ck.Scene(SPHERE, ck.Poisson(lambda p: 6 * product(p)), ring(shift, both=ck.Dirichlet(shifted(shift))))


def robin(shift):
    conditions = ck.Robin(1.0, 1.0, shifted(shift))
    return ck.Scene(SPHERE, ck.Poisson(lambda p: 6 * product(p)), ring(shift, both=conditions))


def jump(shift):
    conditions = {"left": ck.Dirichlet(shift), "right": ck.Dirichlet(shift + 1)}
    return ck.Scene(SPHERE, ck.Laplace(), ring(shift, **conditions))


def screened(shift):
    return ck.Scene(CIRCLE, ck.ScreenedPoisson([lambda p: shift + 2 * p[:, 0], lambda p: p[:, 1]]))


def cut(shift):
    point = ck.source("analytic.point", at=[1, 0])
    ends = ck.Boundary("cut", point, left=ck.Dirichlet(shift + 1), right=ck.Dirichlet(shift))
    return ck.Scene(CIRCLE, ck.Poisson(product), [ends])


def heat(shift):
    return ck.Scene(CIRCLE, ck.Heat(lambda p: shift + p[:, 0], until=0.2, step=0.1))


def wave(shift):
    return ck.Scene(CIRCLE, ck.Wave(lambda p: shift + p[:, 0], until=0.2, step=0.1, scheme="implicit"))


def biharmonic(shift):
    return ck.Scene(CIRCLE, ck.Biharmonic(lambda p: shift + 2 * p[:, 0], c=1.0))


def coupled(shift):
    turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
    f = [lambda p: shift + 2 * p[:, 0], lambda p: -shift + 2 * p[:, 1]]
    return ck.Scene(CIRCLE, ck.Coupled(lambda p: np.broadcast_to(turn, (len(p), 2, 2)), f, c=1.0))


MULTIGRID, REFERENCE = {"solver": "multigrid"}, {"form": "collocation", "solver": "reference"}
CASES = [
    *((scene, 0.25, options) for scene in (dirichlet, robin, jump) for options in (MULTIGRID, {"solver": "direct"})),
    *((scene, 0.1, MULTIGRID) for scene in (screened, cut, heat, wave, coupled)),
    (dirichlet, 0.25, REFERENCE),
    *((scene, 0.1, REFERENCE) for scene in (screened, cut, heat, wave, biharmonic)),
]


@pytest.mark.parametrize(("make", "spacing", "options"), CASES, ids=lambda case: getattr(case, "__name__", ""))
def test_a_constant_changes_nothing_but_rounding(make, spacing, options):
    shift, tolerance = 1e8, 1e-9
    points = directions(make(0.0).surface.dim)
    plain, far = (ck.solve(make(constant), spacing, solver_tolerance=tolerance, **options) for constant in (0.0, shift))
    found, wanted = (solution.evaluate(points).reshape(len(points), -1) for solution in (far, plain))
    apart = np.ptp(found - wanted, axis=0) if make is coupled else np.abs(found[:, 0] - wanted[:, 0] - shift)
    allowed = 1e3 * tolerance * np.ptp(wanted) + ROUNDING_FACTOR * np.finfo(float).eps * shift
    assert apart.max() <= allowed
    assert far.report.solver == plain.report.solver


SIZES = [(1e9, 1.0, 1e-3), (1.0, 0.0, 1e-200)]


@pytest.mark.parametrize(("shift", "large", "small"), SIZES)
@pytest.mark.parametrize("options", [MULTIGRID, REFERENCE], ids=["multigrid", "reference"])
@pytest.mark.parametrize("family", ["screened", "held", "heat"])
def test_pieces_whose_data_are_of_unlike_size_do_not_know_each_other(family, options, shift, large, small):
    places = {-2.0: (shift, large), 2.0: (0.0, small)}

    def scene(left, right):
        def f(p):
            (first, one), (second, other) = left, right
            return np.where(p[:, 0] < 0, first + one * p[:, 1], second + other * p[:, 1])

        members = [ck.source("analytic.circle", center=[x, 0]) for x in places]
        union = ck.source("union", members=members)
        if family == "heat":
            return ck.Scene(union, ck.Heat(f, until=0.2, step=0.1))
        if family == "screened":
            return ck.Scene(union, ck.ScreenedPoisson(f))
        tops = ck.source("union", members=[ck.source("analytic.point", at=[x, 1]) for x in places])
        return ck.Scene(union, ck.Poisson(0), [ck.Boundary("tops", tops, both=ck.Dirichlet(f))])

    unit = ck.solve(scene((0.0, 1.0), (0.0, 1.0)), 0.1, solver_tolerance=1e-9, **options)
    found = ck.solve(scene(*places.values()), 0.1, solver_tolerance=1e-9, **options)
    for x, (constant, size) in places.items():
        points = directions(2) + [x, 0]
        values, wanted = found.evaluate(points), constant + size * unit.evaluate(points)
        allowed = 1e-6 * size + ROUNDING_FACTOR * np.finfo(float).eps * constant
        np.testing.assert_allclose(values, wanted, rtol=0, atol=allowed)


def test_by_default_errors_and_what_is_reported_of_them_are_those_of_the_range():
    plain, far = (ck.solve(dirichlet(shift), 0.2, solver="multigrid") for shift in (0.0, 1e9))
    assert far.error.unit[0] == pytest.approx(plain.error.unit[0], rel=1e-3)
    assert far.error.largest[0] == pytest.approx(plain.error.largest[0], rel=0.3)


def test_newtons_method_settles_by_the_range():
    def found(shift):
        ends = ck.Boundary(
            "cut", ck.source("analytic.point", at=[1, 0]), left=ck.Dirichlet(shift + 1), right=ck.Dirichlet(shift)
        )
        law = ck.PLaplacian(p=4, f=lambda p: 0 * p[:, 0] + 1.0, regularization=1e-2)
        return ck.solve(ck.Scene(CIRCLE, law, [ends]), 0.1).evaluate(directions(2))

    np.testing.assert_allclose(found(1e6) - 1e6, found(0.0), rtol=0, atol=1e-5)


@pytest.mark.parametrize(("c", "warned"), [(1e-12, True), (1e-3, False)])
def test_a_mean_that_quadrature_decides_is_warned_of(c, warned):
    solution = ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(lambda p: (2 + c) * p[:, 0], c=c)), 0.25)
    assert any("small c" in text for text in solution.warnings) == warned


@pytest.mark.parametrize("form", ["galerkin", "collocation"])
def test_steps_far_longer_than_heat_takes_to_spread_end_at_the_mean(form):
    scene = ck.Scene(SPHERE, ck.Heat(lambda p: p[:, 0] + 1, until=1e6, step=1e5))
    found = ck.solve(scene, 0.25, form=form).evaluate(directions(3))
    np.testing.assert_allclose(found, 1.0, rtol=0, atol=1e-6)


def test_a_curve_of_many_thousand_unknowns_is_not_refused_for_rounding():
    solution = ck.solve(ck.Scene(CIRCLE, ck.ScreenedPoisson(lambda p: 2 * p[:, 0])), 5e-4)
    points = directions(2)
    np.testing.assert_allclose(solution.evaluate(points), points[:, 0], rtol=0, atol=1e-8)
