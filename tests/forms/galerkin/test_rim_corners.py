"""Reentrant corners of rims: sectors around them follow the solution, and very thin necks there are warned of."""

from functools import partial

import numpy as np
import pytest
from extremes.envelope_scenes import hole, neck, slot
from extremes.small_geometry import PlateShape, comb, ell, even_places, faceted, plate, rectangle_cells, square_hole
from extremes.small_geometry import neck as plates_with_neck
from extremes.small_geometry import slot as plate_with_slot

import cpmkit as ck
from cpmkit.forms.galerkin.rim_corners import reentrant_corners
from cpmkit.mesh.adjacency import rim_of_edges
from cpmkit.mesh.mesh import Mesh

H = 0.05
#: A turn in space, so that nothing is aligned with the lattice.
TURN = np.linalg.qr(np.array([[1.0, 0.3, 0.2], [-0.3, 1.0, 0.4], [0.1, -0.5, 1.0]]))[0]


@pytest.mark.parametrize(
    ("make", "size", "bound"),
    [(slot, 0.2, 3e-4), (slot, 0.5, 2.5e-4), (slot, 2, 2.5e-4), (neck, 0.2, 4e-3), (neck, 0.5, 2e-3), (hole, 1, 2e-4)],
)
@pytest.mark.filterwarnings("ignore::cpmkit.CpmkitWarning")
def test_errors_beside_corners(make, size, bound):
    """Without sectors they are .08, .06, .05, .9, .9 and .07 percent."""
    known = make(size)
    for shift in (0.0, 0.37, 0.62):
        solution = ck.solve(known.scene, known.spacing, origin=np.full(3, (0.123 + shift) * known.spacing))
        assert np.sqrt(np.mean((solution.evaluate(known.points) - known.u) ** 2)) / np.ptp(known.u) < bound
        assert solution.report.iterations <= 29


@pytest.mark.parametrize(
    ("make", "bound"),
    [(partial(comb, 0.2 * H), 0.003), (partial(plates_with_neck, 0.5 * H), 0.0125), (ell, 0.0015)],
    ids=["comb", "neck", "L"],
)
@pytest.mark.filterwarnings("ignore::cpmkit.CpmkitWarning")
def test_first_eigenvalues(make, bound):
    """Without sectors they are 1.7, 4.7 and .3 percent off."""
    scene = plate(make())
    true = scene.truth()[1]
    for shift in (0.1234, 0.7234):
        values = ck.solve(scene.eigen_scene, H, origin=np.full(3, shift * H)).eigenvalues
        assert values[1] == pytest.approx(true, rel=bound)


@pytest.mark.parametrize(
    ("make", "width", "origin"),
    [
        (square_hole, 0.03, (0.0278, 0.0899, 0.068)),
        (comb, 0.02, (0.0396, 0.0791, 0.0873)),
        (comb, 0.05, (0.0222, 0.0196, 0.0879)),
    ],
)
def test_sectors_leave_matrices_definite(make, width, origin):
    """Without the penalty on pieces with few samples some of these have eigenvalues of the wrong sign."""
    shape = make(width)
    flat, faces = rectangle_cells(*(even_places(stops, H) for stops in (shape.x_stops, shape.y_stops)), shape.keep)
    scene = ck.Scene(faceted(np.pad(flat, ((0, 0), (0, 1))), faces), ck.ScreenedPoisson("x", 0.01))
    assert ck.solve(scene, 0.1, solver="multigrid", origin=np.array(origin)).report.iterations <= 28


def ragged_plate(squares, share, seed):
    """Return a flat plate of squares from which a share of those at the rim is missing."""
    rim = np.pad(np.zeros((squares - 2, squares - 2), dtype=bool), 1, constant_values=True)
    missing = rim & (np.random.default_rng(seed).random(rim.shape) < share)
    places = np.linspace(0, 1, squares + 1)
    flat, faces = rectangle_cells(
        places, places, lambda x, y: ~missing[(x * squares).astype(int), (y * squares).astype(int)]
    )
    return ck.source("mesh.triangles", vertices=np.pad(flat, ((0, 0), (0, 1))), faces=faces, closest="faceted")


@pytest.mark.parametrize("seed", [0, 2])
@pytest.mark.parametrize(
    ("squares", "spacing", "shift"),
    [
        (20, 0.05, 0.0),
        (20, 0.05, 0.5),
        (20, 0.1, 0.0),
        (20, 0.1, 0.25),
        (16, 0.2, 0.0),
        (16, 0.03, 0.5),
        (10, 0.04, 0.37),
    ],
)
def test_ragged_plates_in_lattice_planes(squares, spacing, shift, seed):
    """Pieces of a few triangles have functions without energy: zero at all samples, with all derivatives there."""
    scene = ck.Scene(ragged_plate(squares, 0.3, seed), ck.ScreenedPoisson("x", 1.0))
    solution = ck.solve(scene, spacing, solver="multigrid", origin=np.full(3, shift * spacing))
    assert solution.report.iterations <= 28


def test_cubic_splines_have_no_sectors():
    """They would add a third to the unknowns and to the iterations."""
    quadratic, cubic = (len(ck.discretize(plate(ell()).scene, H, degree=degree).sampled.ties) for degree in (2, 3))
    assert 0 < cubic < 0.7 * quadratic


def flat_mesh(shape):
    """Return a mesh of a plate in space."""
    vertices, faces = rectangle_cells(
        *(even_places(stops, 0.25) for stops in (shape.x_stops, shape.y_stops)), shape.keep
    )
    return Mesh.of(np.pad(vertices, ((0, 0), (0, 1))) @ TURN.T, faces)


def corners_of(mesh):
    return reentrant_corners(mesh, rim_of_edges(mesh))


def test_corners_and_their_sectors():
    corners = corners_of(flat_mesh(ell()))
    np.testing.assert_allclose(corners.places @ TURN, [[0.5, 0.5, 0]], atol=1e-12)
    np.testing.assert_allclose(np.degrees(corners.angles), 270)
    angle = np.radians([5, 85, 95, 175, 185, 265]) + np.radians(90)  # the quarter that is missing is the first
    points = (corners.places @ TURN + 0.1 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)) @ TURN.T
    sector, is_near = corners.sectors(points, 0.15)
    assert is_near.all()
    assert [len({*some.tolist()}) for some in (*np.split(sector, 3), sector)] == [1, 1, 1, 3]
    for spacing, near in ((0.08, True), (0.05, False)):
        sector, is_near = corners.sectors(points, spacing)
        assert (sector == -1).all()
        assert (is_near == near).all()


def test_smooth_and_convex_rims_have_no_corners():
    angle = np.linspace(0, 2 * np.pi, 9)[:-1]
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    ring = np.arange(8)
    inner, outer, after = ring, 8 + ring, (ring + 1) % 8
    faces = np.concatenate([np.stack([inner, outer, 8 + after], 1), np.stack([inner, 8 + after, after], 1)])
    mesh = Mesh.of(np.concatenate([circle, 2 * circle]), faces)
    assert not len(corners_of(mesh).places)
    assert len(corners_of(flat_mesh(square_hole(0.1))).places) == 4


def shape(x_stops, y_stops, keep):
    return PlateShape(sorted(x_stops), sorted(y_stops), keep)


def cross(width, length=1.0):
    """Return two strips that cross."""
    t = width / 2
    stops = [0, length / 2 - t, length / 2 + t, length]
    return shape(stops, stops, lambda x, y: (abs(x - length / 2) < t) | (abs(y - length / 2) < t))


def frame(width):
    """Return a square of four strips."""
    stops = [0, width, 1 - width, 1]
    return shape(stops, stops, lambda x, y: np.maximum(abs(x - 0.5), abs(y - 0.5)) > 0.5 - width)


def bridge_between_slots(width):
    t = width / 2
    return shape([0, 0.5 - t, 0.5 + t, 1], [0, 0.49, 0.51, 1], lambda x, y: (abs(x - 0.5) < t) | (abs(y - 0.5) > 0.01))


def bridge_between_holes(width):
    t = width / 2
    stops = [0, 0.3 - t, 0.5 - t, 0.5 + t, 0.7 + t, 1]
    return shape(stops, [0, 0.4, 0.6, 1], lambda x, y: (abs(abs(x - 0.5) - t - 0.1) > 0.1) | (abs(y - 0.5) > 0.1))


def neck_messages(source, spacing, shift=0.3, **options):
    """Return the warnings on necks of a scene of a source."""
    scene = ck.Scene(source, ck.ScreenedPoisson(lambda x: x[:, 0], 1.0))
    form = ck.discretize(scene, spacing, origin=np.full(3, shift * spacing), **options)
    return [message for message in form.sampled.warnings if "this neck" in message]


def source_of(plate_shape, size=1.0, radius=None):
    """Return a plate, turned, of a size, and bent to a part of a cylinder of a ``radius`` if one is given."""
    steps = (even_places(stops, 0.05) for stops in (plate_shape.x_stops, plate_shape.y_stops))
    flat, faces = rectangle_cells(*steps, plate_shape.keep)
    x, y = flat.T
    vertices = np.stack([x, y, 0 * x], axis=1)
    if radius is not None:
        vertices = np.stack([radius * np.sin(x / radius), y, radius * np.cos(x / radius)], axis=1)
    return ck.source("mesh.triangles", vertices=size * vertices @ TURN.T, faces=faces, closest="faceted")


NECKS = {
    "two plates": plates_with_neck,
    "a bridge between slots": bridge_between_slots,
    "a bridge between holes": bridge_between_holes,
}


@pytest.mark.parametrize("radius", [None, 0.4], ids=["flat", "curved"])
@pytest.mark.parametrize("name", NECKS)
def test_thin_necks_are_warned_of(name, radius):
    """The message has the place, the width and a cure."""
    for size, shift in ((1.0, 0.0), (1.0, 0.6), (100.0, 0.3)):
        source = source_of(NECKS[name](0.2 * H), size, radius)
        (message,) = neck_messages(source, size * H, shift)
        assert f"only {0.2 * H * size:.2g} wide" in message
        assert f"spacing={0.5 * H * size:.2g} or less" in message
        assert not neck_messages(source, 0.5 * H * size, shift)
        place = np.array([float(x) for x in message.split("near (")[1].split(")")[0].split(",")]) / size
        assert np.linalg.norm(source.given_mesh[0] / size - place, axis=1).min() < 1e-3
    assert not neck_messages(source_of(NECKS[name](0.5 * H), 1.0, radius), H)


THIN = {
    "a strip": shape([0, 1], [0, 0.2 * H], lambda x, _: x > -1),
    "a short strip": shape([0, 4 * H], [0, 0.3 * H], lambda x, _: x > -1),
    "strips that cross": cross(0.2 * H),
    "a frame": frame(0.3 * H),
    "a corner": ell(),
    "a slot": plate_with_slot(0.1 * H),
    "a comb": comb(0.2 * H),
    "a hole": square_hole(0.3 * H),
}


@pytest.mark.parametrize("name", THIN)
def test_what_is_thin_and_no_neck(name):
    for radius in (None, 0.4):
        for shift in (0.0, 0.6):
            assert not neck_messages(source_of(THIN[name], 1.0, radius), H, shift)


def test_an_acute_corner_is_no_neck():
    assert not neck_messages(faceted(np.array([[0, 0, 0], [1, 0.1, 0], [1, -0.1, 0]]), [[0, 2, 1]]), H)


def test_refined_necks_are_not_warned_of():
    scene = plate(plates_with_neck(0.2 * H)).scene
    plain, refined = (ck.discretize(scene, H, refine=refine) for refine in ("off", "auto"))
    assert any("this neck" in message for message in plain.sampled.warnings)
    assert not any("this neck" in message for message in refined.sampled.warnings)
    assert refined.size < 1.6 * plain.size
