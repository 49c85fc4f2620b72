"""Wrong answers are blamed on the source that gave them, and data are asked where they are defined."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from bare import Bare

import cpmkit as ck

SPHERE = ck.source("analytic.sphere")
CIRCLE = ck.source("analytic.circle", center=[0, 0, 0.5], radius=np.sqrt(0.75), normal=[0, 0, 1])


@dataclass(frozen=True, eq=False)
class Faulty(Bare):
    """Answers with ``broken`` applied to the record and the queries."""

    broken: object = None

    def closest_point(self, x, /):
        return self.broken(self.source.closest_point(x), x)


def nan_inside(feet, x):
    inside = np.linalg.norm(x, axis=1) < 0.95
    return replace(feet, points=np.where(inside[:, None], np.nan, feet.points))


FAULTS = {
    "type": (lambda feet, x: feet.points, "must return ClosestPoints.*got ndarray"),
    "points": (
        lambda feet, x: replace(feet, points=feet.points[:, :2]),
        r"points of shape \(\d+, 3\) .* got \(\d+, 2\)",
    ),
    "distance": (lambda feet, x: replace(feet, distance=feet.distance[:, None]), r"distance of shape"),
    "edge": (lambda feet, x: replace(feet, edge=np.array(-1)), r"edge of shape"),
    "infinite": (lambda feet, x: replace(feet, distance=feet.distance + np.inf), "finite points and distances"),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("part", ["surface", "boundary"])
def test_a_source_that_answers_wrongly_is_blamed_when_the_scene_is_made(fault, part):
    broken, message = FAULTS[fault]
    surface, circle = (
        Faulty(one, broken) if part == what else one for one, what in ((SPHERE, "surface"), (CIRCLE, "boundary"))
    )
    with pytest.raises(ck.InputError, match=f"closest_point of Faulty must return.*{message.split('return')[-1]}"):
        ck.Scene(surface, ck.Laplace(), [ck.Boundary("circle", circle, both=ck.Dirichlet(1.0))])


def test_a_source_that_is_undefined_somewhere_is_named_with_the_place():
    """It was the right-hand side that had to be finite."""
    source = ck.source("moved", of=Faulty(SPHERE, nan_inside), translation=[100.0, 0.0, 0.0])
    message = r"of Moved of Faulty must return finite points and distances, got \[nan, nan, nan\].*\[100\.0, 0\.0"
    with pytest.raises(ck.InputError, match=message):
        ck.solve(ck.Scene(source, ck.ScreenedPoisson(lambda x: x[:, 1], c=1.0)), 0.25)


def test_data_are_evaluated_at_the_boundary_itself():
    """The angle about the axis has no value at the pole, where the surface's centre has its foot."""

    def data(x):
        radius = np.hypot(x[:, 0], x[:, 1])
        with np.errstate(all="ignore"):
            return np.where(radius > 0.2, x[:, 0] / radius, np.nan)

    cap = ck.source("analytic.cap", height=-0.5)
    circle = ck.Boundary("circle", CIRCLE, both=ck.Dirichlet(data))
    assert ck.Scene(SPHERE, ck.Laplace(), [circle]).channels == 1
    assert ck.Scene(cap, ck.Laplace(), [circle], edge=ck.Dirichlet(data)).channels == 1
    values = ck.solve(ck.Scene(SPHERE, ck.Laplace(), [circle]), 0.25).evaluate(CIRCLE.mesh(0.3)[0])
    assert values == pytest.approx(data(CIRCLE.mesh(0.3)[0]), abs=0.02)


def test_a_boundary_in_another_space_is_refused_when_the_scene_is_made():
    flat = ck.Boundary("flat", ck.source("analytic.circle"), both=ck.Dirichlet(lambda x: x[:, 2]))
    with pytest.raises(ck.SceneError, match="'flat' lies in 2D, the surface in 3D"):
        ck.Scene(SPHERE, ck.Laplace(), [flat])


def test_a_scene_without_boundaries_asks_a_handful_of_points():
    target = []

    def counted(feet, x):
        target.append(len(x))
        return feet

    ck.Scene(Faulty(SPHERE, counted), ck.ScreenedPoisson(1.0))
    assert sum(target) <= 10
