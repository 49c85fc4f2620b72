"""Parts that are near in space but not along the manifold get charts of their own: errors, laws, what stays uncut."""

from functools import cache

import numpy as np
import pytest
import trimesh
from coarse_meshes import torus
from extremes.envelope_scenes import SPACING, TILT, along, hole, neck, slot, u_turn, u_turn_line
from model_problems import order_of
from palm_mesh import palm

import cpmkit as ck
from cpmkit.scenefile.look import Look
from cpmkit.view.drawing import draw_mesh

pytestmark = pytest.mark.filterwarnings("ignore::cpmkit.CpmkitWarning")
SHIFTS, BALL = (0.0, 0.37), trimesh.creation.icosphere(4)
#: A turn in space, so that nothing is aligned with the lattice.
TURN = np.linalg.qr(np.array([[1.0, 0.3, 0.2], [-0.3, 1.0, 0.4], [0.1, -0.5, 1.0]]))[0]


def wave(polyline):
    """Return the length of a polyline, and u = cos(k s), one half wave along it, with f of -u'' + 4 u = f."""
    length = np.linalg.norm(np.diff(polyline, axis=0), axis=1).sum()
    k = np.pi / length
    return length, lambda s: np.cos(k * s), lambda s: (4 + k * k) * np.cos(k * s)


def triangles(vertices, faces):
    """Return the source of a mesh, read as facets."""
    return ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="faceted")


@cache
def half_slot():
    """Return a plate with a slot half a spacing wide, whose truth takes finite elements."""
    return slot(0.5)


def solve_known(known, h, shift=0.0, **options):
    """Return the solution of a known scene, and its root mean square error as a share of the range."""
    solution = ck.solve(known.scene, h, origin=np.full(3, (0.123 + shift) * h), **options)
    return solution, np.sqrt(np.mean((solution.evaluate(known.points) - known.u) ** 2)) / np.ptp(known.u)


def turned_sheets(radius):
    """Return the known scene of a sheet with a U-turn: u is cos(pi z) times a half wave along the polyline."""
    return u_turn(radius / SPACING)


@pytest.mark.parametrize("radius", [0.1, 0.5, *(pytest.param(one, marks=pytest.mark.slow) for one in (0.25, 1.0))])
def test_a_u_turn_of_a_sheet(radius):
    """Without charts the errors are 1.6, .9, .3 and .06 percent."""
    for shift in SHIFTS:
        solution, error = solve_known(turned_sheets(0.05 * radius), 0.05, shift, solver="multigrid")
        assert error < 2e-4
        assert solution.report.iterations <= 28
        assert solution.discretized.sampled.has_charts


@pytest.mark.parametrize("radius", [pytest.param(0.25, marks=pytest.mark.slow), 0.5])
def test_the_order_of_u_turns_of_a_fixed_number_of_spacings(radius):
    spacings = (0.1, 0.07, 0.05)
    errors = [max(solve_known(turned_sheets(radius * h), h, shift)[1] for shift in SHIFTS) for h in spacings]
    assert order_of(spacings, errors) > 1.1  # the turn stays below the spacing
    assert errors[0] < 2e-4


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("radius", [0.1, 0.25, 0.5])
def test_a_u_turn_of_a_curve(radius, dim):
    """Without charts the errors are .1 to 1.4 percent."""
    h, polyline = 0.05, u_turn_line(0.05 * radius)
    length, u, f = wave(polyline)
    turn = TURN if dim == 3 else np.array([[0.8, -0.6], [0.6, 0.8]])
    points = np.pad(polyline, ((0, 0), (0, dim - 2))) @ turn.T
    problem = ck.ScreenedPoisson(lambda x: f(along(polyline, (x @ turn)[:, :2])[1]), 4.0)
    scene = ck.Scene(ck.source("mesh.polyline", points=points), problem)
    s = np.linspace(0.01, 0.99, 200) * length
    lengths = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(polyline, axis=0), axis=1))])
    x = np.stack([np.interp(s, lengths, column) for column in points.T], axis=1)
    for shift in SHIFTS:
        solution = ck.solve(scene, h, origin=np.full(dim, (0.123 + shift) * h))
        assert np.sqrt(np.mean((solution.evaluate(x) - u(s)) ** 2)) < 4e-4  # of a range of 2


@pytest.mark.parametrize(
    ("make", "before"), [(slot, 0.012), (neck, 0.059), (hole, 0.002)], ids=["slot", "neck", "hole"]
)
def test_slots_necks_and_holes(make, before):
    """They are half a spacing wide, holes one; without charts the errors are about those ``before``."""
    known = half_slot() if make is slot else make(1.0 if make is hole else 0.5)
    for shift in SHIFTS:
        solution, error = solve_known(known, known.spacing, shift)
        assert error < 0.6 * before
        assert solution.discretized.sampled.has_charts


def test_refined_splines_are_tied():
    known = half_slot()
    plain, error = solve_known(known, known.spacing)
    refined, smaller = solve_known(known, known.spacing, refine="auto")
    assert refined.work.unknowns > plain.work.unknowns
    assert smaller < 0.5 * error


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_constants_and_heat_are_kept(degree):
    known = turned_sheets(0.02)
    surface = known.scene.surface
    ones = ck.solve(ck.Scene(surface, ck.ScreenedPoisson(1.0, 1.0)), 0.1, degree=degree)
    assert len(ones.discretized.sampled.tied)
    np.testing.assert_allclose(ones.evaluate(known.points), 1.0, atol=1e-10)
    heat = ck.Heat(lambda x: x[:, 0] + x[:, 2] ** 2, until=0.1, step=0.05, frames=1)
    solution = ck.solve(ck.Scene(surface, heat), 0.1, degree=degree)
    np.testing.assert_allclose(solution.totals, solution.frames[0].totals, rtol=1e-9)


def test_no_eigenvalue_is_negative():
    values = ck.solve(ck.Scene(turned_sheets(0.02).scene.surface, ck.Eigen(count=4)), 0.1).eigenvalues
    assert abs(values[0]) < 1e-8
    assert (values[1:] > 0.1).all()


@pytest.mark.parametrize("thickness", [0.05, 0.1])
@pytest.mark.parametrize("h", [0.25, 0.15, 0.1])
def test_sides_of_a_boundary_continue_across_charts(thickness, h):
    """A curve around a thin ellipsoid: both parts have the value of their side, and are read there."""
    surface = triangles(BALL.vertices * [1, 1, thickness] @ TURN.T, BALL.faces)
    angle, x = np.linspace(0, 2 * np.pi, 80), 0.1 if h == 0.1 else 0.5
    circle = np.stack([np.full(80, x), np.cos(angle), thickness * np.sin(angle)], axis=1)
    circle[:, 1:] *= np.sqrt(1 - x * x)
    cut = ck.Boundary("cut", ck.source("mesh.polyline", points=circle @ TURN.T), left=1.0, right=2.0)
    for shift in (0.0, 0.4):
        solution = ck.solve(ck.Scene(surface, ck.Laplace(), [cut]), h, origin=np.full(3, shift * h))
        assert len(solution.discretized.sampled.tied)
        for side, value in (("left", 1.0), ("right", 2.0)):
            np.testing.assert_allclose(solution.evaluate(circle @ TURN.T, side=side), value, atol=1e-9)
        off = np.abs(BALL.vertices[:, 0] - x) > 0.02
        beyond = BALL.vertices[:, 0] > x
        values = solution.evaluate(surface.given_mesh[0])
        assert max(np.ptp(values[off & beyond]), np.ptp(values[off & ~beyond])) < 1e-9


def test_ties_are_shown():
    solution = ck.solve(turned_sheets(0.02).scene, 0.1)
    assert solution.ties.shape[1:] == (2, 3)
    assert len(solution.ties) == solution.discretization()["ties"]
    heights = TILT.local(solution.ties.reshape(-1, 3))[:, 2]
    assert (heights.min(), heights.max()) == pytest.approx((0, 1))  # from rim to rim
    (part,) = [part for part in ck.explain(solution.scene, 0.1, dry_run=True).parts if part.name == "ties"]
    assert part.amount == f"{len(solution.ties)} facets"
    mesh = solution.display_mesh()
    shown, bare = (draw_mesh(solution, mesh, Look(ties=ties), 400, False).ink.points for ties in (True, False))
    assert len(shown) == 4 * len(solution.ties)
    assert not len(bare)
    corner = ck.Scene(ck.source("mesh.polyline", points=[[0, 0], [1, 0], [1, 1]]), ck.ScreenedPoisson("x"))
    np.testing.assert_allclose(ck.solve(corner, 0.1).ties, [[[1, 0]]])


def test_a_finer_mesh_of_the_same_surface_is_cut_alike():
    coarse = turned_sheets(0.0125)
    vertices, faces = coarse.scene.surface.given_mesh
    finer = triangles(*trimesh.remesh.subdivide_to_size(vertices, faces, 0.05))
    sizes = []
    for surface in (coarse.scene.surface, finer):
        scene = ck.Scene(surface, coarse.scene.problem)
        solution, error = solve_known(type(coarse)(scene, coarse.points, coarse.u), 0.05)
        assert error < 2e-4
        sizes.append(solution.work.unknowns)
    assert sizes[1] == pytest.approx(sizes[0], rel=0.03)


@pytest.mark.parametrize(("h", "shift"), [(0.104, 0.7234), (0.073, 0.1234)])
def test_charts_of_cubic_splines_leave_matrices_definite(h, shift, real_mesh):
    """With charts of a twentieth of a square spacing these have eigenvalues of the wrong sign."""
    vertices, faces = ck.read_mesh(real_mesh("spot.obj"))
    vertices = 2 * (vertices - vertices.mean(axis=0)) / np.ptp(vertices, axis=0).max()
    scene = ck.Scene(triangles(TILT.world(vertices), faces), ck.ScreenedPoisson("x", 4.0))
    options = {"degree": 3, "solver": "multigrid", "origin": np.full(3, shift * h)}
    assert ck.solve(scene, h, **options).report.iterations <= 40


BOX = [[-1.2] * 3, [1.2] * 3]
SMOOTH = {
    "sphere": lambda: ck.source("analytic.sphere"),
    "torus": lambda: ck.source("analytic.torus", minor=0.2),
    "ellipsoid": lambda: ck.source("levelset.expression", phi="x**2 + (y/0.8)**2 + (z/0.5)**2 - 1", bounds=BOX),
    "icosphere": lambda: triangles(BALL.vertices, BALL.faces),
    "mesh of a torus": lambda: triangles(*torus(60, 24)),
    "tube of a radius of a spacing": lambda: ck.source("analytic.cylinder", radius=0.1, length=1.0),
    "tube of half of it": lambda: ck.source("analytic.cylinder", radius=0.05, length=1.0),
    "circle": lambda: ck.source("analytic.circle"),
    "small circle": lambda: ck.source("analytic.circle", radius=0.15),
    "helix": lambda: ck.source("parametric.helix"),
}


@pytest.mark.parametrize("name", SMOOTH)
def test_smooth_shapes_have_no_charts(name):
    form = ck.discretize(ck.Scene(SMOOTH[name](), ck.ScreenedPoisson(1.0)), 0.1)
    assert not len(form.sampled.tied)


@pytest.mark.parametrize("spacing", [0.05, 0.06, 0.07])
def test_projections_are_determined_on_charts_of_a_few_triangles(spacing):
    vertices, faces = palm()  # of coarse fingers, at whose ends charts below a tenth of the squared spacing are left
    space = ck.prepare(ck.Scene(triangles(vertices, faces), ck.Poisson(1.0)), spacing).discretized.space
    diagonal = space.projection_matrix.diagonal() ** -0.5
    eigenvalues = np.linalg.eigvalsh(diagonal[:, None] * space.projection_matrix.toarray() * diagonal)
    assert eigenvalues[0] > 1e-7


def test_values_of_projections_are_determined_where_the_matrix_is_singular(monkeypatch):
    monkeypatch.setattr("cpmkit.forms.galerkin.space.spline_space.SPARSE_SHARES", (0.0, 0.0))
    form = ck.discretize(ck.Scene(triangles(*palm()), ck.Poisson(1.0)), 0.06)
    height = form.points[:, 1:2]
    np.testing.assert_allclose(form.at_points(form.project(height)), height, atol=3e-3)
