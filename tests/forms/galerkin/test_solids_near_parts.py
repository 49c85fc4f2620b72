"""Solids with thin parts, gaps and slits: every part in a lattice cell has unknowns of its own, and stays definite."""

import numpy as np
import pytest
import trimesh
from scipy.sparse.linalg import eigsh

import cpmkit as ck
from cpmkit.forms.galerkin.dof_map import connected_pieces

POSITIONS = [(0.3, [0.013, 0.021, 0.037]), (1.1, [0.44, 0.27, 0.09])]


def bars(dim, gap, thick, turn, shift):
    """Two boxes of a thickness along the first axis, with a gap between, and a function that is linear in each."""
    move = {"rotation": turn if dim == 2 else [turn, 0.2, 0.5], "translation": shift[:dim]}
    ends = (-gap / 2 - thick, -gap / 2), (gap / 2, gap / 2 + thick)
    parts = [
        ck.source("analytic.box", lower=[low] + [-0.5] * (dim - 1), upper=[high] + [0.5] * (dim - 1), **move)
        for low, high in ends
    ]
    flat = np.random.default_rng(0).uniform(-0.5, 0.5, (200, dim))
    middles = parts[0].bounds.mean(axis=0), parts[1].bounds.mean(axis=0)
    across = (middles[1] - middles[0]) / np.linalg.norm(middles[1] - middles[0])
    centre = 0.5 * (middles[0] + middles[1])

    def values(x):
        return np.where((x - centre) @ across < 0, 1.0 + x[:, 1], 5.0 - 2 * x[:, 0])

    points = np.concatenate([part.closest_point(centre + flat).points for part in parts])
    return ck.source("union", members=parts), values, points


@pytest.mark.parametrize(("turn", "shift"), POSITIONS)
@pytest.mark.parametrize(
    ("dim", "spacing", "gap", "thick"),
    [(2, 0.2, 0.002, 0.5), (2, 0.2, 0.0002, 0.01), (3, 0.35, 0.0035, 0.5), (3, 0.35, 0.035, 0.0175)],
)
def test_parts_that_nearly_touch(dim, spacing, gap, thick, turn, shift):
    """Values and fluxes on both sides of a gap of .001 to .1 spacings do not mix, in parts of any thickness."""
    source, values, points = bars(dim, gap, thick, turn, shift)
    scene = ck.Scene(source, ck.Laplace(), edge=ck.Dirichlet(values))
    solution = ck.solve(scene, spacing, form="galerkin")
    assert connected_pieces(solution.discretized.space.dof_map)[0] == 2
    assert np.abs(solution.evaluate(points) - values(points)).max() < 1e-9
    assert solution.integrate(1) == pytest.approx(2 * thick, rel=1e-11)


@pytest.mark.parametrize(("thick", "is_thin"), [(1.5, False), (0.5, False), (0.1, True), (0.01, True)])
@pytest.mark.parametrize("dim", [2, 3])
def test_solids_much_thinner_than_the_spacing_are_named_by_the_estimate(dim, thick, is_thin):
    spacing = 0.1
    upper = [1.0] * (dim - 1) + [thick * spacing]
    slab = ck.source("analytic.box", lower=[0.0] * dim, upper=upper, rotation=0.3 if dim == 2 else [0.3, 0.2, 0.5])
    solution = ck.solve(ck.Scene(slab, ck.ScreenedPoisson("x*y")), spacing)
    assert ("thinner than a third of the spacing" in solution.error.slow) == is_thin


@pytest.mark.parametrize("thick", [1.0, 0.05, 0.003])
@pytest.mark.parametrize("edge", [ck.Dirichlet(1.0), ck.Neumann(0.0)], ids=["value", "no flux"])
@pytest.mark.parametrize("dim", [2, 3])
def test_slabs_thinner_than_a_spacing_are_definite(dim, edge, thick):
    spacing = 0.2
    box = ck.source(
        "analytic.box",
        lower=[0.0] * dim,
        upper=[1.0] * (dim - 1) + [thick * spacing],
        rotation=0.3 if dim == 2 else [0.3, 0.2, 0.5],
    )
    solution = ck.solve(ck.Scene(box, ck.ScreenedPoisson(1.0), edge=edge), spacing, form="galerkin")
    matrix = solution.discretized.stiffness(solution.scene.problem.terms()).matrix
    assert abs(matrix - matrix.T).max() < 1e-12 * abs(matrix).max()
    assert np.linalg.eigvalsh(matrix.toarray())[0] > 0
    assert np.abs(solution.evaluate(solution.discretized.some_points(500)[1]) - 1).max() < 1e-9


@pytest.mark.parametrize("width", [0.01, 1e-5])
def test_a_slit_parts_its_sides(width):
    """Nothing crosses a notch much thinner than a spacing, but around its tip."""
    corners = [[0, 0], [1, 0], [1, 0.5 - width / 2], [0.3, 0.5], [1, 0.5 + width / 2], [1, 1], [0, 1], [0, 0]]
    source = ck.source("solid", of=ck.source("mesh.polyline", points=corners))

    def sign(x):
        return np.where(x[:, 1] > 0.5, 1.0, -1.0)

    solution = ck.solve(ck.Scene(source, ck.ScreenedPoisson(sign, 4.0)), 0.05, form="galerkin")
    above, below = solution.evaluate([[0.9, 0.5 + width], [0.9, 0.5 - width]])
    assert above > 0.15
    assert below < -0.15


@pytest.mark.parametrize("dim", [2, 3])
def test_near_disks_and_balls_do_not_mix(dim):
    """A gap of .05 spacings between curved parts, with different equations on its sides."""
    spacing = 0.1 if dim == 2 else 0.25
    shape, apart = ("analytic.circle", "analytic.sphere")[dim - 2], (1 + 0.025 * spacing) * np.eye(dim)[0]
    parts = [ck.source(shape, center=sign * apart) for sign in (-1, 1)]
    source = ck.source("solid", of=ck.source("union", members=parts))

    def values(x):
        return np.where(x[:, 0] < 0, 1 + np.sin(x[:, 1]), 5 - np.cos(x[:, 1]))

    def right_side(x):
        return np.where(x[:, 0] < 0, 1 + 2 * np.sin(x[:, 1]), 5 - 2 * np.cos(x[:, 1]))

    scene = ck.Scene(source, ck.ScreenedPoisson(right_side), edge=ck.Dirichlet(values))
    solution = ck.solve(scene, spacing, form="galerkin")
    points = np.random.default_rng(0).uniform(-1, 1, (800, dim))
    points = points[np.linalg.norm(points, axis=1) < 1]
    at = np.concatenate([points - apart, points + apart])
    assert np.abs(solution.evaluate(at) - values(at)).max() < (5e-5 if dim == 2 else 2e-3)


@pytest.mark.parametrize("spacing", [0.05, 0.08, 0.125, 0.2])
def test_sides_along_the_lattice_at_any_position(spacing):
    """An L along the axes: its area is exact where sides lie in knot planes, between them, and anywhere."""
    corners = [[0, 0], [1, 0], [1, 0.5], [0.5, 0.5], [0.5, 1], [0, 1], [0, 0]]
    scene = ck.Scene(ck.source("solid", of=ck.source("mesh.polyline", points=corners)), ck.ScreenedPoisson(1.0))
    shares = np.concatenate([np.random.default_rng(0).uniform(size=(8, 2)), np.indices((4, 4)).reshape(2, -1).T / 4])
    for share in shares:
        solution = ck.solve(scene, spacing, form="galerkin", origin=spacing * share)
        assert solution.integrate(1) == pytest.approx(0.75, rel=1e-10)
        assert np.abs(solution.values - 1).max() < 1e-9


@pytest.mark.parametrize("shift", [0.0, 0.5, 0.25, 1e-12, 1e-7])
@pytest.mark.parametrize("dim", [2, 3])
def test_faces_in_and_near_knot_planes(dim, shift):
    """Whatever lies in a plane between lattice cells: constants and volume are exact, and nothing is singular."""
    spacing = 0.25
    box = ck.source("analytic.box", lower=[0.0] * dim, upper=[1.0] * dim)
    scene = ck.Scene(box, ck.Eigen(3))
    solution = ck.solve(scene, spacing, form="galerkin", origin=[shift * spacing] * dim)
    assert solution.discretized.point_weights.sum() == pytest.approx(1.0, rel=1e-12)
    assert abs(solution.eigenvalues[0]) < 1e-9
    assert solution.eigenvalues[1] == pytest.approx(np.pi**2, rel=2e-3)
    stiffness = solution.discretized.stiffness(scene.problem.terms()).matrix
    assert eigsh(stiffness, 1, sigma=-1.0, return_eigenvectors=False)[0] > -1e-9


def volume(solid, h):
    return ck.solve(ck.Scene(solid, ck.ScreenedPoisson(1.0)), h, form="galerkin").integrate(
        lambda x, u: np.ones(len(x))
    )


@pytest.mark.parametrize(("inner", "spacing"), [(0.9, 0.3), (0.99, 0.3), (0.995, 0.3)])
def test_thin_shells_have_the_volume_between_their_spheres(inner, spacing):
    """Closest points of a part of the skin may lie on the other part."""
    spheres = [ck.source("analytic.sphere", radius=radius) for radius in (1.0, inner)]
    solid = ck.source("solid", of=ck.source("union", members=spheres))
    assert volume(solid, spacing) == pytest.approx(4 / 3 * np.pi * (1 - inner**3), rel=1e-4)


@pytest.mark.parametrize("spacing", [0.3, 0.2, 0.15])
def test_nearly_flat_faces_in_knot_planes_enclose_their_volume(spacing):
    """Read as smooth, faces cross the planes many times within rounding of them."""
    cube = trimesh.creation.box([1, 1, 1]).subdivide().subdivide().subdivide().subdivide()
    mesh = ck.source("mesh.triangles", vertices=cube.vertices + 0.5, faces=cube.faces)
    assert volume(ck.source("solid", of=mesh), spacing) == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize("minor", [0.03, 0.05])
def test_boundaries_curved_below_the_spacing_are_refused(minor):
    torus = ck.source("solid", of=ck.source("analytic.torus", major=1.0, minor=minor))
    with pytest.raises(ck.ResolutionError, match=r"too coarse for the boundary of the solid near .* use spacing=0.1"):
        volume(torus, 0.2)
