"""Very thin necks that begin at reentrant corners of the rim are warned of."""

import numpy as np
import pytest
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


def flat_mesh(shape):
    """Return a mesh of a plate in space."""
    vertices, faces = rectangle_cells(
        *(even_places(stops, 0.25) for stops in (shape.x_stops, shape.y_stops)), shape.keep
    )
    return Mesh.of(np.pad(vertices, ((0, 0), (0, 1))) @ TURN.T, faces)


def corners_of(mesh):
    return reentrant_corners(mesh, rim_of_edges(mesh))


def test_the_corner_of_an_l_is_reentrant():
    corners = corners_of(flat_mesh(ell()))
    np.testing.assert_allclose(corners.places @ TURN, [[0.5, 0.5, 0]], atol=1e-12)
    np.testing.assert_allclose(corners.inward[0] @ corners.inward[0].T, np.eye(2), atol=1e-12)


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
