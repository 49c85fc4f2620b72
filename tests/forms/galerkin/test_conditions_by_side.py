"""No value is read across a boundary, left is what the conventions say, and fluxes are those of the sides."""

import numpy as np
import pytest
from cut_meshes import icosphere
from model_problems import on_circle, order_of
from sphere_zones import AXIS, CIRCLE, HEIGHT, SPHERE, Zone, sphere_points, unlike

import cpmkit as ck

FINE = icosphere(3)
SIDES = {"left": ck.Dirichlet(1.0), "right": ck.Dirichlet(-1.0)}


def meshed(turned=False):
    cells = FINE.cells[:, ::-1] if turned else FINE.cells
    return ck.source("mesh.triangles", vertices=FINE.vertices, faces=cells, closest="faceted")


def star(corners, inner, turned=False):
    """A closed polyline beside the sphere: corners in turn at .8 and ``inner`` of it from an axis, finely drawn."""
    angle = 2 * np.pi * np.arange(corners) / corners
    radius = np.where(np.arange(corners) % 2, 0.7 * inner, 0.7)
    at = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - radius**2)], axis=1)
    share = np.linspace(0, 1, 20, endpoint=False)[:, None]
    drawn = np.concatenate([(1 - share) * a + share * b for a, b in zip(at, np.roll(at, -1, axis=0), strict=True)])
    drawn = (
        drawn / np.linalg.norm(drawn, axis=1)[:, None] @ np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    )
    return ck.source("mesh.polyline", points=drawn[::-1] if turned else drawn, closed=True)


class ByClosestPoints:
    """A curve of which nothing is known but closest points."""

    def __init__(self, source):
        self.dim, self.manifold_dim, self.bounds = source.dim, source.manifold_dim, source.bounds
        self.exact, self.closest_point = source.exact, source.closest_point


def both(surface, curve, form, spacing=0.2, problem=None):
    named = {"left_of": AXIS} if isinstance(curve, ByClosestPoints) else {}
    scene = ck.Scene(surface, problem or ck.Laplace(), [ck.Boundary("C", curve, **SIDES, **named)])
    return ck.solve(scene, spacing, form=form, solver="direct")


@pytest.mark.parametrize(
    ("surface", "curve"),
    [
        (SPHERE, CIRCLE),
        (SPHERE, star(4, 1.0)),
        (meshed(), star(10, 0.45)),
        (meshed(turned=True), star(10, 0.45, turned=True)),
        (SPHERE, ByClosestPoints(CIRCLE)),
    ],
)
def test_nothing_is_read_across(surface, curve):
    """Two constants, at 1e-4 to 1 spacing from the curve that parts them."""
    spacing = 0.2
    solution, rng = both(surface, curve, "galerkin", spacing), np.random.default_rng(0)
    drawn = surface.closest_point(sphere_points(4000)).points
    near = curve.closest_point(drawn)
    rows = np.argsort(near.distance)[:800]
    feet, aside = near.points[rows], drawn[rows] - near.points[rows]
    aside /= np.linalg.norm(aside, axis=1)[:, None]
    at = surface.closest_point(feet + spacing * 10 ** rng.uniform(-4, 0, (800, 1)) * aside).points
    signed = solution.signed_distance("C", at)
    clear = np.abs(signed) > 1e-3 * spacing
    assert np.count_nonzero(clear & (signed > 0)) > 100
    assert np.count_nonzero(clear & (signed < 0)) > 100
    np.testing.assert_allclose(solution.evaluate(at)[clear], np.sign(signed[clear]), atol=1e-6)
    np.testing.assert_allclose(solution.evaluate(feet, side="left"), 1.0, atol=1e-6)
    np.testing.assert_allclose(solution.evaluate(feet, side={"C": "right"}), -1.0, atol=1e-6)
    beside = solution.signed_distance("C", feet)  # feet on a mesh lie beside the curve, by up to 1e-6
    sign = np.where(np.abs(beside) < 1e-9 * spacing, 1.0, np.sign(beside))
    np.testing.assert_allclose(solution.evaluate(feet), sign, atol=1e-6)


POLYGON = on_circle(np.linspace(0, 2 * np.pi, 100, endpoint=False))
POINT = ck.source("analytic.point", at=[1.0, 0])


@pytest.mark.parametrize(
    ("surface", "curve"),
    [
        (SPHERE, CIRCLE),
        (SPHERE, ck.source("analytic.circle", center=HEIGHT * AXIS, normal=-AXIS, radius=np.sqrt(1 - HEIGHT**2))),
        (SPHERE, star(4, 1.0)),
        (SPHERE, star(4, 1.0, turned=True)),
        (meshed(), CIRCLE),
        (meshed(turned=True), CIRCLE),
        (meshed(turned=True), star(4, 1.0, turned=True)),
        (ck.source("analytic.circle"), POINT),
        (ck.source("mesh.polyline", points=POLYGON, closed=True), POINT),
        (ck.source("mesh.polyline", points=POLYGON[::-1], closed=True), POINT),
    ],
)
def test_left_is_that_of_the_other_form(surface, curve):
    at = surface.closest_point(np.random.default_rng(1).normal(size=(400, surface.dim))).points
    one, other = (both(surface, curve, form, problem=ck.ScreenedPoisson(0.0)) for form in ("galerkin", "collocation"))
    signed = one.signed_distance("C", at)
    told = other.signed_distance("C", at)  # of points near the curve alone
    # where a curve lies off a mesh, only Galerkin's point of its projection is the nearest
    np.testing.assert_allclose(signed[np.isfinite(told)], told[np.isfinite(told)], rtol=1e-6, atol=1e-6)
    clear = np.abs(signed) > 0.02
    np.testing.assert_allclose(one.evaluate(at)[clear], other.evaluate(at)[clear], atol=0.15)
    near = clear & (np.abs(signed) < 0.1)
    assert np.all(one.evaluate(at)[near] * np.sign(signed[near]) > 0)


def test_fluxes_out_of_both_sides():
    turns = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    plane = np.linalg.svd(AXIS[None])[2][1:]
    radius = np.sqrt(1 - HEIGHT**2)
    on = HEIGHT * AXIS + radius * (np.cos(turns)[:, None] * plane[0] + np.sin(turns)[:, None] * plane[1])
    exact = {"left": -Zone("left", 1.0).leftward(on), "right": Zone("right", 1.0).leftward(on)}
    spacings, found = [0.4, 0.25, 0.15], []
    for spacing in spacings:
        solution = ck.solve(unlike("dirichlet", "neumann"), spacing, form="galerkin", solver="direct")
        off = [solution.flux_density("C", side, on) - slope for side, slope in exact.items()]
        found.append(max(np.sqrt(np.mean(one**2)) for one in off))
        assert max(np.abs(one).max() for one in off) < 0.25 * spacing
        for side, slope in exact.items():
            assert solution.flux("C", side) == pytest.approx(2 * np.pi * radius * slope.mean(), abs=0.01)
    assert order_of(spacings, found) > 1.2


def test_a_moebius_strip_cut_along_its_core():
    """It has no left: equal data on both sides are fine, and unlike ones are refused."""
    turn, across = np.meshgrid(np.linspace(0, 2 * np.pi, 120, endpoint=False), np.linspace(-0.3, 0.3, 7), indexing="ij")
    radius = 1 + across * np.cos(turn / 2)
    vertices = np.stack([radius * np.cos(turn), radius * np.sin(turn), across * np.sin(turn / 2)], axis=-1).reshape(
        -1, 3
    )
    number = np.arange(840).reshape(120, 7)
    after = np.concatenate([number[1:], number[:1, ::-1]])
    a, b, c, d = number[:, :-1], after[:, :-1], after[:, 1:], number[:, 1:]
    cells = np.concatenate([np.stack(one, axis=-1).reshape(-1, 3) for one in ((a, b, c), (a, c, d))])
    strip = ck.source("mesh.triangles", vertices=vertices, faces=cells, closest="faceted")
    core = ck.source("mesh.polyline", points=vertices[number[:, 3]], closed=True)
    cut = ck.Boundary("core", core, both=ck.Dirichlet(2.0))
    scene = ck.Scene(strip, ck.Laplace(), [cut], edge=ck.Dirichlet(0.0))
    found = ck.solve(scene, 0.1, form="galerkin").evaluate(vertices)
    np.testing.assert_allclose(found, ck.solve(scene, backend="fem").evaluate(vertices), atol=0.02)
    unlike = ck.Boundary("core", core, left=ck.Dirichlet(2.0), right=ck.Dirichlet(1.0))
    with pytest.raises(ck.SceneError, match="left"):
        ck.solve(ck.Scene(strip, ck.Laplace(), [unlike]), 0.1, form="galerkin")
