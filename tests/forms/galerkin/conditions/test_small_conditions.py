"""Values at one point of a surface, and on curves below the spacing, are warned of."""

import numpy as np
import pytest

import cpmkit as ck

SPHERE = ck.source("analytic.sphere")
PIN = ck.Boundary("pin", ck.source("analytic.point", at=[0.0, 0.6, 0.8]), both=ck.Dirichlet(0.0))
POINT = "a point of a surface"

WITHOUT_LIMIT = {
    "screened": ck.ScreenedPoisson(1.0),
    "elliptic with a tensor": ck.Elliptic(1.0, diffusivity=np.diag([1.0, 2.0, 3.0]), c=1.0),
    "poisson with a source that is not zero in the mean": ck.Poisson(lambda x: 1.0 + x[:, 0]),
    "helmholtz": ck.Helmholtz(1.0, wavenumber=1.0),
    "eigenvalues": ck.Eigen(2),
}
WITH_LIMIT = {
    "laplace": ck.Laplace(),
    "poisson with a source of mean zero": ck.Poisson(lambda x: x[:, 0]),
    "biharmonic": ck.Biharmonic(lambda x: x[:, 0]),
}


def of_points(solution):
    return [text for text in solution.warnings if POINT in text]


@pytest.mark.parametrize("name", WITHOUT_LIMIT)
def test_a_value_at_one_point_has_no_limit(name):
    assert of_points(ck.solve(ck.Scene(SPHERE, WITHOUT_LIMIT[name], [PIN]), 0.4, form="galerkin"))


@pytest.mark.parametrize("name", WITH_LIMIT)
def test_a_value_at_one_point_has_a_limit(name):
    assert not of_points(ck.solve(ck.Scene(SPHERE, WITH_LIMIT[name], [PIN]), 0.4, form="galerkin"))


@pytest.mark.parametrize("options", [{"form": "collocation"}, {"backend": "fem"}], ids=["collocation", "fem"])
def test_other_methods_warn_as_well(options):
    assert of_points(ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(1.0), [PIN]), 0.4, **options))
    assert not of_points(ck.solve(ck.Scene(SPHERE, ck.Laplace(), [PIN]), 0.4, **options))


@pytest.mark.parametrize(
    "options",
    [{"form": "galerkin"}, {"form": "collocation"}, {"backend": "fem"}],
    ids=["galerkin", "collocation", "fem"],
)
def test_values_at_two_points_have_no_limit(options):
    places = [[0.0, 0.6, 0.8], [0.0, -0.6, 0.8]]
    points = ck.source("union", members=[ck.source("analytic.point", at=at) for at in places])
    pins = ck.Boundary("pins", points, both=ck.Dirichlet(lambda x: x[:, 1]))
    assert of_points(ck.solve(ck.Scene(SPHERE, ck.Laplace(), [pins]), 0.4, **options))


def arc(length):
    return ck.source("analytic.arc", center=[0, 0, 0], radius=1.0, normal=[1, 0, 0], start=0.3, end=0.3 + length)


@pytest.mark.parametrize("radius", [1e-3, 1.0, 1e3])
def test_a_value_at_a_point_of_a_curve_has_a_limit_at_any_scale(radius):
    pin = ck.Boundary("pin", ck.source("analytic.point", at=[radius, 0.0]), both=ck.Dirichlet(0.0))
    scene = ck.Scene(ck.source("analytic.circle", radius=radius), ck.ScreenedPoisson(1.0), [pin])
    assert not ck.solve(scene, 0.1 * radius, form="galerkin").warnings


def imposed_on(length):
    return ck.Scene(SPHERE, ck.ScreenedPoisson(1.0), [ck.Boundary("arc", arc(length), both=ck.Dirichlet(0.0))])


def of_curves(solution):
    return [text for text in solution.warnings if "a curve smaller than" in text and "'arc'" in text]


@pytest.mark.parametrize("length", [0.05, 0.01, 0.005])
def test_an_arc_far_below_the_spacing(length):
    solution = ck.solve(imposed_on(length), 0.25, form="galerkin")
    assert 0.8 < solution.evaluate([[0.0, 0.0, -1.0]])[0] < 1.0
    assert of_curves(solution)


@pytest.mark.parametrize(
    ("options", "short", "long"),
    [({"form": "collocation"}, 0.15, 0.3), ({"backend": "fem"}, 0.05, 0.15), ({"form": "galerkin"}, 0.05, 0.15)],
    ids=["collocation", "fem", "galerkin"],
)
def test_each_method_names_curves_that_it_takes_for_larger_ones(options, short, long):
    assert of_curves(ck.solve(imposed_on(short), 0.25, **options))
    assert not of_curves(ck.solve(imposed_on(long), 0.25, **options))
