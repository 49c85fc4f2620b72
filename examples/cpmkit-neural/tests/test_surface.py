"""Feet of the cow are the nearest ones, its mesh is closed, and bounds that do not contain it are refused."""

import numpy as np
import pytest
from cpmkit_neural.cases import SPOT_FILE, rounded_cube, spot
from cpmkit_neural.feet import descend
from cpmkit_neural.plugin import neural_field

from cpmkit.plugin import InputError, norms


def near(cow, radius, count):
    """Points up to ``radius`` from the cow, in any direction."""
    rng = np.random.default_rng(2)
    direction = rng.normal(size=(count, 3))
    direction *= radius * rng.uniform(0, 1, (count, 1)) / norms(direction)[:, None]
    return cow.samples[rng.integers(0, len(cow.samples), count)] + direction


def test_feet_are_on_the_surface_and_seen_at_a_right_angle():
    cow = spot()
    x = near(cow, 0.1, 1000)
    feet = cow.closest_point(x)
    sure = ~feet.doubtful
    assert sure.mean() > 0.99
    assert np.abs(cow.field.value(feet.points)).max() <= 1e-13
    along = np.cross(x - feet.points, cow.normals(feet))
    assert norms(along)[sure].max() <= 1e-11


def test_no_descent_from_elsewhere_leads_nearer():
    cow = spot()
    x = np.random.default_rng(3).uniform(*cow.bounds, (300, 3))
    feet = cow.closest_point(x)
    for k in (1, 5, 25, 125):
        start = cow.samples[cow.tree.query(x, [k + 1])[1][:, 0]]
        other, _ = descend(cow.field, x, start, 2 * cow.covering, cow.size)
        assert (feet.distance <= norms(x - other) + 1e-12 * cow.size).all()


def test_the_centre_of_the_cube_is_doubtful_and_answered():
    feet = rounded_cube().closest_point(np.zeros((1, 3)))
    assert feet.doubtful[0]
    assert abs(feet.distance[0] - np.sqrt(3) * np.arccos(2 / 3)) <= 1e-12


@pytest.mark.parametrize("spacing", [0.5, 0.05])
def test_the_mesh_is_closed_has_no_handle_and_is_wound_by_its_normals(spacing):
    cow = spot()
    vertices, triangles = cow.mesh(spacing)
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, sides = np.unique(edges, axis=0, return_counts=True)
    assert (sides == 2).all()
    assert len(vertices) - len(edges) + len(triangles) == 2
    corners = vertices[triangles]
    volume = np.einsum("nd,nd->n", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert 0.5 < volume < 1.0


@pytest.mark.parametrize(
    ("bounds", "told"),
    [
        ([[0, -0.8, -0.8], [0.6, 1.1, 1.2]], "runs out of the bounds"),
        ([[0.4, 0.5, 0.5], [0.5, 0.6, 0.6]], "zero nowhere"),
        ([[1, 1, 1], [0, 0, 0]], "lower and the upper corner"),
    ],
)
def test_bounds_that_do_not_hold_the_surface_are_refused(bounds, told):
    with pytest.raises(InputError, match=told):
        neural_field(file=SPOT_FILE, bounds=bounds, resolution=32)


def test_a_network_without_bounds_asks_for_them(tmp_path):
    arrays = dict(np.load(SPOT_FILE))
    bounds = arrays.pop("bounds")
    np.savez(tmp_path / "bare.npz", **arrays)
    with pytest.raises(InputError, match="give the key bounds"):
        neural_field(file=tmp_path / "bare.npz")
    assert neural_field(file=tmp_path / "bare.npz", bounds=bounds, resolution=32).bounds.shape == (2, 3)
