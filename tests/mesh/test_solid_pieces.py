"""Moments of solids in lattice cells by the divergence theorem, and the connected parts of a solid in a cell."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cpmkit.mesh.mesh import Mesh
from cpmkit.mesh.skin_pieces import skin_pieces, triangle_rule
from cpmkit.mesh.solid_moments import MOMENTS, gauss_points, gauss_weights
from cpmkit.mesh.solid_pieces import solid_patches
from cpmkit.runtime.index_sets import connected_components

CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) - 0.5
FACES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
TRIANGLES = np.array([[face[0], face[k], face[k + 1]] for face in FACES for k in (1, 2)])
#: By the product rule of high degree on the unit cube.
PLACES, WEIGHTS = gauss_points(8, 3)


def boxes(*placed):
    """The skin of boxes, each given by its sides, centre and rotation."""
    vertices = [CORNERS * np.array(sides) @ turn.T + centre for sides, centre, turn in placed]
    cells = [TRIANGLES + 8 * k for k in range(len(placed))]
    return Mesh.of(np.concatenate(vertices), np.concatenate(cells))


def polynomial(x):
    return x[..., 0] ** 3 * x[..., 1] + x[..., 2] ** 2 * x[..., 1] ** 2 - x[..., 0]


def integral(patches, moments):
    """The integral over the solid of the polynomial, by the Gauss points of all cells, in units of the spacing."""
    cut, full = gauss_points(MOMENTS, 3), gauss_points(3, 3)
    inside = polynomial(patches.full[:, None] + full[0] - 0.5) @ full[1]
    at_cut = polynomial(patches.cells[: patches.cut, None] + cut[0] - 0.5)
    return np.sum(gauss_weights(moments) * at_cut) + inside.sum()


@pytest.mark.parametrize("seed", range(6))
def test_integrals_over_turned_boxes_are_exact(seed):
    rng = np.random.default_rng(seed)
    turn, centre, sides = Rotation.random(random_state=seed).as_matrix(), rng.uniform(size=3), rng.uniform(1.5, 4.0, 3)
    patches = solid_patches(skin_pieces(boxes((sides, centre, turn)), 1.0))
    moments, sums = patches.moments()
    exact = sides.prod() * (WEIGHTS @ polynomial((PLACES - 0.5) * sides @ turn.T + centre))
    assert np.abs(sums).max() < 1e-12
    assert integral(patches, moments) == pytest.approx(exact, rel=1e-11, abs=1e-11)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("gap", [1e-5, 0.01, 0.3])
def test_parts_with_a_gap_between_have_patches_of_their_own(gap, seed):
    """Their moments are exact, too, whichever way the gap runs through the cells."""
    turn, centre = Rotation.random(random_state=seed).as_matrix(), np.random.default_rng(seed).uniform(size=3)
    half = 0.5 * (2 + gap) * turn[:, 0]
    placed = [([2.0, 3.0, 2.5], centre - half, turn), ([2.0, 3.0, 2.5], centre + half, turn)]
    patches = solid_patches(skin_pieces(boxes(*placed), 1.0))
    moments, _ = patches.moments()
    count, piece = connected_components(len(patches.cells), patches.touching())
    assert count == 2
    volumes = np.concatenate([moments[:, 0, 0], np.ones(len(patches.full))])
    assert np.bincount(piece, volumes) == pytest.approx([15.0, 15.0], rel=1e-12)
    exact = sum(15.0 * (WEIGHTS @ polynomial((PLACES - 0.5) * sides @ turn.T + at)) for sides, at, turn in placed)
    assert integral(patches, moments) == pytest.approx(exact, rel=1e-11, abs=1e-10)


def test_a_bubble_and_a_speck_within_one_cell():
    """A small box inside a bubble inside a large box: one cell has two parts, one within the other."""
    still, centre = np.eye(3), np.array([0.03, 0.02, -0.01])
    skin = boxes(([5.0] * 3, centre, still), ([0.6] * 3, centre, still), ([0.3] * 3, centre, still))
    cells = skin.cells.copy()
    cells[12:24] = cells[12:24][:, ::-1]  # the solid is outside of the bubble
    patches = solid_patches(skin_pieces(Mesh.of(skin.vertices, cells), 1.0))
    moments, _ = patches.moments()
    _, piece = connected_components(len(patches.cells), patches.touching())
    volumes = np.bincount(piece, np.concatenate([moments[:, 0, 0], np.ones(len(patches.full))]))
    assert np.sort(volumes) == pytest.approx([0.3**3, 5.0**3 - 0.6**3])
    patch = patches.patches_at(np.zeros((3, 3), dtype=np.int64), np.array([centre, [0.45, 0.0, 0.0], [0.25, 0.0, 0.0]]))
    assert patch[2] == -1  # in the bubble
    assert moments[patch[:2], 0, 0] == pytest.approx([0.3**3, 1 - 0.6**3])


def test_the_rules_on_triangles():
    for exact, degree in ((True, 6), (False, 4)):
        points, weights = triangle_rule(exact)
        for i, j in np.ndindex(degree + 1, degree + 1):
            if i + j <= degree:
                corner, middle = gauss_points(8, 2)
                u, v = corner[:, 0], corner[:, 1] * (1 - corner[:, 0])  # the unit square collapsed to a triangle
                value = 2 * np.sum(middle * (1 - corner[:, 0]) * u**i * v**j)
                assert weights @ (points[:, 0] ** i * points[:, 1] ** j) == pytest.approx(value, rel=1e-12)
