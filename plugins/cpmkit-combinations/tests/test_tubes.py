"""Tubes around curves: feet against closed forms, drawn meshes, and radii at which a tube would meet itself."""

import numpy as np
import pytest

import cpmkit as ck

RING = ck.source("analytic.circle", normal=[0, 0, 1])
KNOT = ck.source("parametric.torus_knot")


def test_a_circles_tube_is_the_torus():
    x = np.random.default_rng(0).uniform(-1.6, 1.6, (2000, 3))
    found = ck.source("tube", around=RING, radius=0.4).closest_point(x)
    exact = ck.source("analytic.torus", major=1.0, minor=0.4).closest_point(x)
    assert np.abs(found.points - exact.points).max() < 1e-13
    assert np.abs(found.distance - exact.distance).max() < 1e-13


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("dim", [2, 3])
def test_a_tube_is_drawn_whole_with_its_outside_outside(dim, closed):
    center = [0.0] * dim
    curve = ck.source("analytic.circle" if closed else "analytic.arc", center=center, **({} if closed else ARC))
    made = ck.source("tube", around=curve, radius=0.3)
    sizes = []
    for spacing in (0.1, 0.05):
        vertices, cells = made.mesh(spacing)
        assert np.abs(curve.closest_point(vertices).distance - 0.3).max() < 1e-12
        ridges = np.sort(np.concatenate([np.delete(cells, k, axis=1) for k in range(dim)]), axis=1)
        assert (np.unique(ridges, axis=0, return_counts=True)[1] == 2).all()  # nothing is open
        middle = vertices[cells].mean(axis=1)
        outward = made.normals(made.closest_point(middle))
        assert (np.sum(right_of(vertices[cells]) * outward, axis=1) > 0).all()
        sizes.append(np.linalg.norm(right_of(vertices[cells]), axis=1).sum() / (1 if dim == 2 else 2))
    length = 2 * np.pi if closed else 2.0
    exact = {2: 2 * length, 3: 0.6 * np.pi * length}[dim] + (0 if closed else {2: 0.6 * np.pi, 3: 0.36 * np.pi}[dim])
    errors = exact - np.array(sizes)
    assert 0 < errors[1] < 0.02 * exact
    assert errors[1] < 0.4 * errors[0]  # second order


ARC = {"start": 0.0, "end": 2.0}


def right_of(corners):
    """Return (m, d) normals of cells, as long as segments are, and twice as large as triangles."""
    if corners.shape[2] == 2:
        along = corners[:, 1] - corners[:, 0]
        return np.stack([along[:, 1], -along[:, 0]], axis=1)
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def test_eigenvalues_of_a_circles_tube_are_those_of_the_torus():
    found, exact = (
        ck.solve(ck.Scene(one, ck.Eigen(4)), 0.2).eigenvalues
        for one in (ck.source("tube", around=RING, radius=0.4), ck.source("analytic.torus", minor=0.4))
    )
    assert found[1:] == pytest.approx(exact[1:], rel=2e-3)


def test_queries_on_the_curve_get_a_foot_and_are_doubtful():
    feet = ck.source("tube", around=RING, radius=0.3).closest_point([[1.0, 0, 0], [0.7, 0, 0]])
    assert feet.doubtful.tolist() == [True, False]
    assert np.linalg.norm(feet.points[0] - [1.0, 0, 0]) == pytest.approx(0.3)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("share", [0.0, 1e-13, 3e-12, 1e-11, 1e-9, 1e-6, 1e-3])
def test_feet_of_queries_beside_the_curve_are_on_the_tube_and_stay(share, dim):
    rod = ck.source("analytic.segment", start=[0.0] * dim, end=[2.0, 1.0, 0.5][:dim])
    made = ck.source("tube", around=rod, radius=0.5)
    rng = np.random.default_rng(1)
    on = rod.closest_point(rng.uniform(-1, 3, (2000, dim))).points
    x = on + 0.5 * share * rng.choice([-1, 1], on.shape)
    found = made.closest_point(x)
    feet = found.points
    assert np.abs(found.distance - np.linalg.norm(x - feet, axis=1)).max() < 1e-14
    assert np.abs(rod.closest_point(feet).distance - 0.5).max() < 1e-14
    assert np.abs(made.closest_point(feet).points - feet).max() < 1e-14


@pytest.mark.parametrize(
    ("around", "radius", "message"),
    [
        (RING, 1.2, "meets itself"),
        (KNOT, 1.0, "meets itself"),
        (ck.source("analytic.sphere"), 0.1, "around a curve"),
        (RING, 0.0, "above zero"),
    ],
)
def test_what_is_no_tube_is_refused(around, radius, message):
    with pytest.raises(ck.InputError, match=message):
        ck.source("tube", around=around, radius=radius)
