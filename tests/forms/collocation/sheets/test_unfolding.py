"""Where a surface bends more sharply than a stencil is wide it can be unfolded: exact where it is rolled paper."""

from dataclasses import dataclass

import numpy as np
import pytest
from layouts import lay_out
from model_problems import order_of, sphere_points
from scipy.integrate import quad
from sheet_problems import circles, spiral
from thin_ellipsoid import odd_solution
from trimesh.creation import box

import cpmkit as ck
from cpmkit.forms.collocation.conservation.mean_weights import mean_weights
from cpmkit.forms.collocation.sheets.sheets import REUSED_FOOT_SPACINGS
from cpmkit.grid.stencils import stencil_cells, stencil_nodes
from cpmkit.manifold.local_source import localize
from cpmkit.manifold.tangent_space import normals
from cpmkit.manifold.unfolding import unfold
from cpmkit.protocols import ClosestPoints


@dataclass(frozen=True)
class Cylinder:
    """About the z axis, without an end; its normals have no sign."""

    radius: float
    dim = 3
    manifold_dim = 2
    exact = True

    @property
    def bounds(self):
        return np.array([[-9.0] * 3, [9.0] * 3])

    def closest_point(self, x):
        points = x.copy()
        points[:, :2] *= self.radius / np.linalg.norm(x[:, :2], axis=1, keepdims=True)
        return ClosestPoints(points, np.linalg.norm(x - points, axis=1), np.full(len(x), -1))


class SignedCylinder(Cylinder):
    def normals(self, feet):
        return feet.points * [1 / self.radius, 1 / self.radius, 0]


@pytest.mark.parametrize("kind", [Cylinder, SignedCylinder])
@pytest.mark.parametrize(("radius", "off"), [(4.0, 0.03), (2.0, 0.1), (1.0, 0.3)])
def test_a_point_of_a_cylinder_is_as_far_along_it_as_the_node_is_across(kind, radius, off):
    """The geodesics of a rolled sheet are the straight lines of the flat one; ``off`` is in spacings, of up to 3."""
    source, random = localize(kind(radius), np.zeros(3)), np.random.default_rng(2)
    start = source.closest_point(np.tile([1.3 * radius, 0, 0], (200, 1)))
    across = random.uniform(-2, 2, size=(200, 2))
    goal = start.points + np.concatenate([random.uniform(-2, 2, size=(200, 1)), across], axis=1)
    found = unfold(source, start, normals(source, start, 0.1), goal, 1.0, kind is SignedCylinder).points
    turn = across[:, 0] / radius
    exact = np.stack([radius * np.cos(turn), radius * np.sin(turn), across[:, 1]], axis=1)
    assert np.linalg.norm(found - exact, axis=1).max() <= off


def thin_ellipse(b):
    """An ellipse of half axes 1 and b with its lowest eigenvalues; at the tips its radius is b squared."""
    length = 4 * quad(lambda t: np.hypot(np.sin(t), b * np.cos(t)), 0, np.pi / 2, limit=200)[0]
    scene = ck.Scene(ck.source("parametric.curve", x=["cos(t)", f"{b!r}*sin(t)"], range=[0, 2 * np.pi]), ck.Eigen(5))
    return scene, (2 * np.pi * np.array([1, 1, 2, 2]) / length) ** 2


def test_a_stencil_reads_of_unfolded_twins_those_whose_feet_are_near():
    """Not any that is on its sheet: those that others asked for have their feet elsewhere on it."""
    band = lay_out(thin_ellipse(0.05)[0], 0.1, sheets="unfolded").band
    sheets, rows = band.sheets, np.arange(band.inner)
    read = stencil_nodes(band, stencil_cells(band.feet.points[rows], 0.1, band.degree)[0]).astype(np.int64)
    before, readable = read, np.arange(len(band.nodes)) < band.inner
    read, missed = sheets.select_twins(band.feet.take(rows), sheets.normals[rows], before, readable)
    rolled = band.is_unfolded[read]
    rolled[missed.row, missed.column] = False
    assert rolled.sum() > 100
    row, column = np.nonzero(rolled)
    goal = 0.1 * band.nodes[before[row, column]]
    wanted = unfold(sheets.source, band.feet.take(row), sheets.normals[row], goal, 0.1, sheets.signed).points
    away = np.linalg.norm(band.feet.points[read[row, column]] - wanted, axis=1)
    assert away.max() <= REUSED_FOOT_SPACINGS * 0.1


@pytest.mark.parametrize("b", [0.3, pytest.param(0.2, marks=pytest.mark.slow)])
def test_bends_of_about_a_spacing_let_flux_pass(b):
    """Eigenvalues of ellipses whose tips have radii of 0.9 and 0.4 spacings, rms over positions of the grid."""
    scene, exact = thin_ellipse(b)
    random, off = np.random.default_rng(0), {True: [], "unfolded": []}
    for origin in 0.1 * random.uniform(size=(4, 2)):
        for sheets, errors in off.items():
            found = ck.solve(scene, 0.1, origin=origin, sheets=sheets).eigenvalues
            errors.append(found[1:] / exact - 1)
    parted, unfolded = (np.sqrt(np.mean(np.square(errors))) for errors in off.values())
    assert unfolded <= 0.03
    assert unfolded <= 0.8 * parted


def test_smooth_sheets_are_as_accurate():
    """Where no bend is sharp nothing is unfolded: not between circles, nor between the turns of a spiral."""
    for scene, points, _ in (circles(0.05), spiral(0.1)):
        parted, unfolded = (ck.solve(scene, 0.05, sheets=sheets) for sheets in (True, "unfolded"))
        assert np.allclose(parted.evaluate(points), unfolded.evaluate(points), rtol=0, atol=1e-6)
        assert not unfolded.discretized.tables.layout.band.is_unfolded.any()


@pytest.mark.slow
def test_a_thin_smooth_ellipsoid_stays_of_second_order():
    scene, u = odd_solution(0.1)
    points, spacings = sphere_points(2000) * [1, 1, 0.1], (0.1, 0.07, 0.05)
    errors = [np.abs(ck.solve(scene, h, sheets="unfolded").evaluate(points) - u(points)).max() for h in spacings]
    assert errors[-1] <= 4e-3
    assert order_of(spacings, errors) >= 1.8


def test_unfolding_is_saved_and_loaded(tmp_path):
    scene, _ = thin_ellipse(0.05)
    screened = ck.Scene(scene.surface, ck.ScreenedPoisson(lambda x: x[:, 0], c=1.0))
    solution = ck.solve(screened, 0.1, sheets="unfolded")
    assert solution.discretized.tables.layout.band.is_unfolded.any()
    solution.save(tmp_path / "unfolded.npz")
    loaded = ck.load(tmp_path / "unfolded.npz", screened)
    assert (loaded.values == solution.values).all()
    assert loaded.discretized.tables.layout.options.own.sheets == "unfolded"


def test_an_explanation_tells_of_the_unfolded_twins():
    scene, _ = thin_ellipse(0.2)
    count = int(lay_out(scene, 0.1, sheets="unfolded").band.is_unfolded.sum())
    (twins,) = [part for part in ck.explain(scene, 0.1, sheets="unfolded", rehearse=True).parts if part.name == "twins"]
    assert count > 10
    assert f"{count} of them where the surface is unfolded" in twins.reason
    assert "unfolded" not in str(ck.explain(scene, 0.1, rehearse=True))


def test_means_do_not_count_the_unfolded_twins():
    """The mean of x squared over an ellipse whose tips are unfolded, by its arc length."""
    b = 0.3
    length, moment = (
        quad(lambda t, k=k: np.cos(t) ** k * np.hypot(np.sin(t), b * np.cos(t)), 0, np.pi)[0] for k in (0, 2)
    )
    tables = ck.solve(thin_ellipse(b)[0], 0.05, sheets="unfolded").discretized.tables
    weights, unfolded = mean_weights(tables), tables.layout.band.is_unfolded
    x = tables.layout.lattice.to_scene(tables.layout.band.feet.points[: len(weights)])[:, 0]
    assert unfolded.any()
    assert (weights[unfolded] == 0).all()
    assert weights @ x**2 / weights.sum() == pytest.approx(moment / length, rel=0.02)


def test_creases_of_exact_closest_points_are_warned_of():
    cube = ck.source("mesh.triangles", vertices=box().vertices, faces=box().faces, closest="faceted")
    scene = ck.Scene(cube, ck.ScreenedPoisson(lambda x: x[:, 0], c=10.0))
    warned = {sheets: ck.solve(scene, 0.25, sheets=sheets).warnings for sheets in (True, "unfolded")}
    assert any("Unfolding goes astray at creases" in warning for warning in warned["unfolded"])
    assert not any("Unfolding" in warning for warning in warned[True])


def test_fourth_order_unfolds_nothing():
    scene = ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(1.0))
    with pytest.raises(ck.InputError, match="order=4 unfolds nothing"):
        ck.solve(scene, 0.05, degree=4, order=4, sheets="unfolded")
