"""The mesh is cut at creases and junctions, and u is tied there: orders, laws, equal answers on a flat sheet."""

import numpy as np
import pytest
from model_problems import order_of

import cpmkit as ck
from cpmkit.mesh.mesh import Mesh
from cpmkit.meshing.creases import crease_facets

pytestmark = pytest.mark.filterwarnings("ignore::cpmkit.CpmkitWarning")
#: Turns in space and in the plane, so that nothing is aligned with the lattice.
TURN = np.linalg.qr(np.array([[1.0, 0.3, 0.2], [-0.3, 1.0, 0.4], [0.1, -0.5, 1.0]]))[0]
PLANE_TURN = np.array([[0.8, -0.6], [0.6, 0.8]])
C, WIDTH = 4.0, 0.4
FOLD, ACUTE, T, Y, X = [0, 90], [0, 20], [0, 90, 180], [0, 120, 240], [0, 90, 180, 270]


def arms(angles):
    """Return unit vectors (m, 2) at angles in degrees."""
    return np.stack([np.cos(np.radians(angles)), np.sin(np.radians(angles))], axis=1)


def sheets(angles, n=24):
    """Return a mesh of rectangles of length 1 that meet along an axis, not turned."""
    s, y = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, WIDTH, 11), indexing="ij")
    number = np.arange(s.size).reshape(s.shape)
    corners = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    a, b, c, d = (corner.ravel() for corner in corners)
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    points = [np.stack([s * e[0], y, s * e[1]], axis=-1).reshape(-1, 3) for e in arms(angles)]
    return np.concatenate(points), np.concatenate([faces + k * s.size for k in range(len(angles))])


def on_arms(angles, values):
    """Return the data that are ``values[k]`` (functions of the distance s) on arm k, for points (n, 2)."""
    directions = arms(angles)

    def data(x):
        s = x @ directions.T
        off = np.where(s < -1e-9, np.inf, np.abs(x @ np.stack([-directions[:, 1], directions[:, 0]])))
        arm = off.argmin(axis=1)
        return np.choose(arm, [value(s[np.arange(len(x)), arm]) for value in values])

    return data


def loads(count):
    """Return different constants, one for each arm."""
    return np.array([1.0, -1.0, 2.0, -3.0])[:count]


def exact(count, s):
    """Return u (count, n) at distance s (n,) on each arm: -u'' + C u = f, no flux at ends, balance at the junction."""
    part = loads(count)[:, None] / C
    return part + (part.mean() - part) * np.cosh(np.sqrt(C) * (1 - s)) / np.cosh(np.sqrt(C))


def constant_loads(angles):
    """Return the data that are the constant of :func:`loads` on each arm."""
    return on_arms(angles, [lambda s, f=f: np.full_like(s, f) for f in loads(len(angles))])


def sheet_error(angles, h, shift=0.0, closest="smooth", **options):
    """Return the rms error, as a share of the range, on sheets at these angles, read as ``closest`` says."""
    vertices, faces = sheets(angles)
    data = constant_loads(angles)
    source = ck.source("mesh.triangles", vertices=vertices @ TURN.T, faces=faces, closest=closest)
    problem = ck.ScreenedPoisson(lambda x: data((x @ TURN)[:, [0, 2]]), C)
    solution = ck.solve(ck.Scene(source, problem), h, origin=np.full(3, 0.123 * h + shift * h), **options)
    s = np.linspace(0.003, 0.997, 60)
    points = np.concatenate([np.stack([s * e[0], np.full_like(s, 0.17), s * e[1]], axis=1) for e in arms(angles)])
    u = exact(len(angles), s)
    return np.sqrt(np.mean((solution.evaluate(points @ TURN.T) - u.ravel()) ** 2)) / np.ptp(u)


def curve_error(angles, h, dim, shift=0.0):
    """Return the rms error, as a share of the range, on segments that meet at these angles."""
    turn = PLANE_TURN if dim == 2 else TURN
    data, plane = constant_loads(angles), [0, 1]
    directions = np.pad(arms(angles), ((0, 0), (0, dim - 2))) @ turn.T
    members = [ck.source("analytic.segment", start=[0.0] * dim, end=e.tolist()) for e in directions]
    problem = ck.ScreenedPoisson(lambda x: data((x @ turn)[:, plane]), C)
    scene = ck.Scene(ck.source("union", members=members), problem)
    solution = ck.solve(scene, h, origin=np.full(dim, 0.123 * h + shift * h))
    s = np.linspace(0.003, 0.997, 60)
    u = exact(len(angles), s)
    points = np.concatenate([s[:, None] * e for e in directions])
    return np.sqrt(np.mean((solution.evaluate(points) - u.ravel()) ** 2)) / np.ptp(u)


@pytest.mark.parametrize("closest", ["smooth", "faceted"])
@pytest.mark.parametrize("angles", [FOLD, ACUTE, T, Y, X], ids=["fold", "acute fold", "T", "Y", "X"])
def test_sheets_that_meet_are_of_high_order(angles, closest):
    """Triangles beside creases and junctions stay flat if they are read as smooth, and get more exact samples."""
    spacings = (0.2, 0.1, 0.05)
    errors = [max(sheet_error(angles, h, shift, closest) for shift in (0.0, 0.37)) for h in spacings]
    assert order_of(spacings, errors) > (2.5 if closest == "smooth" else 2.0)
    assert errors[-1] < 2e-6


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("angles", [FOLD, ACUTE, T, Y, X], ids=["corner", "acute", "T", "Y", "X"])
def test_curves_that_meet_are_of_third_order(angles, dim):
    spacings = (0.1, 0.05, 0.025)
    errors = [max(curve_error(angles, h, dim, shift) for shift in (0.0, 0.37)) for h in spacings]
    assert order_of(spacings, errors) > 2.7
    assert errors[-1] < 3e-7


def bent(vertices, angle):
    """Return the flat strip in x from -1 to 1 (v, 3) folded by ``angle`` degrees at x = 0, and turned."""
    bend = np.radians(angle)
    x = vertices[:, 0]
    right = np.maximum(x, 0.0)
    return np.stack([np.minimum(x, 0.0) + np.cos(bend) * right, vertices[:, 1], np.sin(bend) * right], axis=1) @ TURN.T


def is_right(points, angle):
    """Return whether (n,) points (n, 3) are on the right part of the folded strip."""
    bend, x = np.radians(angle), np.asarray(points) @ TURN
    off_right = np.abs(np.cos(bend) * x[:, 2] - np.sin(bend) * x[:, 0])
    return (off_right < np.abs(x[:, 2])) & (np.cos(bend) * x[:, 0] + np.sin(bend) * x[:, 2] > 0)


def flat(points, angle):
    """Return the points (n, 2) of the flat strip of points (n, 3) of the folded strip."""
    bend, x = np.radians(angle), np.asarray(points) @ TURN
    right = np.cos(bend) * x[:, 0] + np.sin(bend) * x[:, 2]
    return np.stack([np.where(is_right(points, angle), right, x[:, 0]), x[:, 1]], axis=1)


def strip(angle, h, make, cut=None, **options):
    """Return the solution of ``make(flat_of, angle)`` on the strip folded by an angle; flat_of returns flat points.

    ``cut`` are the conditions of a boundary along the strip, at half its height.
    """
    vertices, faces = sheets([180, 0])
    vertices, first = np.unique(vertices.round(12), axis=0, return_inverse=True)
    source = ck.source("mesh.triangles", vertices=bent(vertices, angle), faces=first.ravel()[faces])
    middle = bent(np.array([[-1.0, WIDTH / 2, 0], [0, WIDTH / 2, 0], [1, WIDTH / 2, 0]]), angle)
    line = [] if cut is None else [ck.Boundary("line", ck.source("mesh.polyline", points=middle), **cut)]
    return ck.solve(ck.Scene(source, make(lambda x: flat(x, angle), angle), line), h, **options)


def probe():
    """Return points (n, 3) of the flat strip."""
    return np.stack([np.linspace(-0.95, 0.95, 40), np.full(40, 0.21), np.zeros(40)], axis=1)


def along(angle, x):
    """Return the unit tangent (n, 3) along the strip at points (n, 3) of it."""
    bend = np.radians(angle)
    tangent = np.where(is_right(x, angle)[:, None], [np.cos(bend), 0.0, np.sin(bend)], [1.0, 0.0, 0.0])
    return tangent @ TURN.T


def tensors(angle, x):
    """Return tensors (n, 3, 3) that conduct four times better at 30 degrees to the strip than across that direction."""
    first = along(angle, x)
    second = np.broadcast_to([0.0, 1.0, 0.0] @ TURN.T, first.shape)
    well, badly = 0.866 * first + 0.5 * second, 0.866 * second - 0.5 * first
    return 2.0 * well[:, :, None] * well[:, None] + 0.5 * badly[:, :, None] * badly[:, None]


PROBLEMS = {
    "screened Poisson": lambda f, a: ck.ScreenedPoisson(lambda x: np.sin(3 * f(x)[:, 0] + 1), 1.0),
    "heat": lambda f, a: ck.Heat(lambda x: np.cos(2 * f(x)[:, 0] + 1), until=0.1, step=0.02),
    "velocity": lambda f, a: ck.Heat(
        lambda x: np.exp(-20 * (f(x)[:, 0] + 0.4) ** 2),
        until=0.4,
        step=0.04,
        kappa=0.05,
        velocity=lambda x: along(a, x),
    ),
    "tensor": lambda f, a: ck.Elliptic(
        lambda x: np.sin(3 * f(x)[:, 0] + 1), diffusivity=lambda x: tensors(a, x), c=1.0
    ),
    "plate": lambda f, a: ck.Biharmonic(lambda x: np.sin(3 * f(x)[:, 0] + 1)),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_fold_changes_nothing_on_a_strip(name):
    off = []
    for h in (0.1, 0.05):
        values = [strip(angle, h, PROBLEMS[name]).evaluate(bent(probe(), angle)) for angle in (0, 75)]
        off.append(np.abs(values[1] - values[0]).max() / np.ptp(values[0]))
    assert off[1] < 2e-3
    assert off[1] < 0.5 * off[0]


CUTS = {
    "values": lambda f: {"left": lambda x: np.sin(2 * f(x)[:, 0]), "right": lambda x: np.cos(f(x)[:, 0])},
    "flux": lambda f: {"left": ck.Neumann(1.0), "right": ck.Neumann(-0.5)},
    "resistance": lambda f: {"across": ck.Transmission(resistance=0.5, jump=0.2)},
}


@pytest.mark.parametrize("name", CUTS)
def test_a_fold_changes_nothing_for_a_boundary_that_crosses_it(name):
    off = []
    for h in (0.1, 0.05):
        values = []
        for angle in (0, 75):
            conditions = CUTS[name](lambda x, angle=angle: flat(x, angle))
            solution = strip(angle, h, PROBLEMS["screened Poisson"], conditions)
            values.append(solution.evaluate(bent(probe() - [0, 0.05, 0], angle)))
        off.append(np.abs(values[1] - values[0]).max() / np.ptp(values[0]))
    assert off[1] < 2e-3
    assert off[1] < 0.5 * off[0]


def test_a_fold_keeps_the_eigenvalues_of_a_strip_and_none_is_negative():
    found = [strip(angle, 0.05, lambda *_: ck.Eigen(count=5)).eigenvalues for angle in (0, 75)]
    np.testing.assert_allclose(found[1][1:], found[0][1:], rtol=1e-4)
    assert np.abs(found[1][0]) < 1e-8


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("angles", [FOLD, T, X])
def test_constants_and_heat_are_kept_in_knot_planes(angles, degree):
    vertices, faces = sheets(angles)
    source = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    options = {"degree": degree, "origin": [0.05, 0.05, 0.05]}  # creases and sheets in knot planes
    ones = ck.solve(ck.Scene(source, ck.ScreenedPoisson(1.0, 1.0)), 0.1, **options)
    np.testing.assert_allclose(ones.evaluate(vertices), 1.0, atol=1e-10)
    heat = ck.Heat(lambda x: x[:, 0] + x[:, 2] ** 2, until=0.1, step=0.05, frames=1)
    solution = ck.solve(ck.Scene(source, heat), 0.1, **options)
    np.testing.assert_allclose(solution.totals, solution.frames[0].totals, rtol=1e-9)


def test_the_order_of_the_members_of_a_union_does_not_matter():
    directions = np.pad(arms(T), ((0, 0), (0, 1))) @ TURN.T
    members = [ck.source("analytic.segment", start=[0.0] * 3, end=e.tolist()) for e in directions]
    x = np.concatenate([np.linspace(0.01, 0.99, 20)[:, None] * e for e in directions])
    found = [
        ck.solve(ck.Scene(ck.source("union", members=each), ck.ScreenedPoisson("sin(3*x) + z", 1.0)), 0.05).evaluate(x)
        for each in (members, members[::-1])
    ]
    np.testing.assert_allclose(found[1], found[0], atol=1e-5)


def test_smooth_shapes_and_shallow_or_short_creases_are_not_cut():
    sphere = ck.source("analytic.sphere")
    solution = ck.solve(ck.Scene(sphere, ck.ScreenedPoisson("x", 1.0)), 0.25)
    assert not len(solution.discretized.sampled.tied)
    vertices, faces = sheets(FOLD)
    vertices, first = np.unique(vertices.round(12), axis=0, return_inverse=True)
    fold = Mesh.of(vertices, np.asarray(first.ravel()[faces]))
    assert len(crease_facets(fold, 0.05)) == 10  # from rim to rim


def test_a_crease_that_fades_is_cut_only_if_it_is_long():
    vertices, faces = sheets([180, 0])
    slope = 0.9 * (1 - vertices[:, 1] / WIDTH)  # above 30 degrees up to 0.36 of the width, 0.14
    vertices[:, 2] = slope * np.maximum(vertices[:, 0], 0.0)
    vertices, first = np.unique(vertices.round(12), axis=0, return_inverse=True)
    mesh = Mesh.of(vertices, np.asarray(first.ravel()[faces]))
    assert len(crease_facets(mesh, 0.08)) == 0
    assert len(crease_facets(mesh, 0.06)) in (3, 4)


def box_of(side):
    """Return the mesh of a cube."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    box = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    box += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    return Mesh.of(side * corners, np.array(box))


def test_faces_below_a_quarter_of_a_square_spacing_join_others():
    assert len(crease_facets(box_of(0.55), 1.0)) == 12
    assert len(crease_facets(box_of(0.45), 1.0)) < 12


def test_a_prism_read_as_smooth_is_cut_at_the_edges_that_stay():
    """Of eleven sides, which turn by 33 degrees: all have corners on the rims of the ends, and stay flat."""
    turns = 2 * np.pi * np.arange(11) / 11
    rim = np.stack([np.cos(turns), np.sin(turns), np.zeros(11)], axis=1)
    i, j = np.arange(11), (np.arange(11) + 1) % 11
    vertices = np.concatenate([rim, rim + [0, 0, 1.0], [[0, 0, 0], [0, 0, 1.0]]]) @ TURN.T
    sides = [np.stack([i, j, j + 11], axis=1), np.stack([i, j + 11, i + 11], axis=1)]
    ends = [np.stack([j, i, np.full(11, 22)], axis=1), np.stack([i + 11, j + 11, np.full(11, 23)], axis=1)]
    keys = {"vertices": vertices, "faces": np.concatenate(sides + ends)}
    problem = ck.ScreenedPoisson("sin(3*x) + y", 1.0)
    smooth, flat = (
        ck.solve(ck.Scene(ck.source("mesh.triangles", **keys, closest=closest), problem), 0.14)
        for closest in ("smooth", "faceted")
    )
    assert smooth.work.unknowns == flat.work.unknowns
    x = vertices[:11] + 0.5 * (vertices[11:22] - vertices[:11])
    np.testing.assert_allclose(smooth.evaluate(x), flat.evaluate(x), atol=2e-5)


def test_a_flap_smaller_than_a_sample_stays_with_its_sheet():
    vertices, faces = sheets([0, 180])
    vertices, first = np.unique(vertices.round(12), axis=0, return_inverse=True)
    edge = np.flatnonzero(np.abs(vertices[:, 0]) < 1e-9)[:2]
    vertices = np.concatenate([vertices, [[0.0, WIDTH / 20, 1e-3]]])
    faces = np.concatenate([first.ravel()[faces], [[*edge, len(vertices) - 1]]])
    assert len(crease_facets(Mesh.of(vertices, faces), 0.05)) == 0


def test_a_tube_thinner_than_the_cells_is_not_cut_to_pieces():
    limb = ck.Scene(ck.source("analytic.cylinder", radius=0.05, length=2.0), ck.ScreenedPoisson("z"))
    assert ck.discretize(limb, 0.2).size < 1000


def test_small_faces_take_no_more_iterations():
    """Boxes 2.2 spacings wide: 78 iterations where the strip has the unknowns at ties alone."""
    box = box_of(2.2)
    places = 4.2 * np.array([[i, j, k] for i in range(3) for j in range(3) for k in range(3)])
    vertices = np.concatenate([box.vertices + place for place in places]) @ TURN.T
    faces = np.concatenate([box.cells + 8 * k for k in range(len(places))])
    scene = ck.Scene(ck.source("mesh.triangles", vertices=vertices, faces=faces), ck.ScreenedPoisson("sin(x)", 0.01))
    assert ck.solve(scene, 1.0, solver="multigrid").report.iterations <= 28
