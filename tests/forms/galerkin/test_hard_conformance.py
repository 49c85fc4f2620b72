"""The form's laws on every example of every kind of curve and surface that a plugin supplies."""

import numpy as np
import pytest
from made_cases import CASES, source_of
from scipy.sparse.linalg import splu

import cpmkit as ck
from cpmkit.forms.galerkin.dof_map import connected_pieces
from cpmkit.plugin import HasMesh

#: Cases of solids, of points and of mixed cells, told by how their names begin: sources are made where they are tested.
NO_SURFACE = (
    "analytic.point",
    "analytic.box",
    "union (a torus, a sphere and",
    "moved (union)",
    "solid",
    "points",
    "cut.plane (circle",
    "cut.function (curve",
)
SURFACES = [case for case in CASES if not str(case).startswith(NO_SURFACE)]
#: Closest points that have no tangents make no surface, and that is said.
REFUSED = ["pointcloud.points (nearest)"]
FIT = [case for case in SURFACES if str(case) not in REFUSED]


def is_surface(source):
    return source.manifold_dim in range(1, source.dim)


def scene_of(source, cells):
    """Return the spacing that gives ``cells`` on the largest side, and a scene whose solution is 2."""
    spacing = float(np.ptp(source.bounds, axis=0).max()) / cells
    return spacing, ck.Scene(source, ck.ScreenedPoisson(3.0 / spacing**2, c=1.5 / spacing**2))


def drawn_measure(source, spacing):
    """Return the measure of the source's own drawing; None where it draws points."""
    vertices, cells = source.mesh(spacing)
    if cells.shape[1] == 1:
        return None
    edges = vertices[cells[:, 1:]] - vertices[cells[:, :1]]
    gram = np.einsum("mik,mjk->mij", edges, edges)
    return np.sqrt(np.abs(np.linalg.det(gram))).sum() / (cells.shape[1] - 1)


def check_laws(form):
    one = np.ones(form.size)
    energy = form.stiffness(ck.Laplace().terms()).matrix
    assert abs(energy - energy.T).max() == 0
    assert np.abs(energy @ one).max() < 1e-13 * abs(energy).max()
    assert one @ (form.mass.matrix @ one) == pytest.approx(form.sampled.samples.weights.sum(), rel=1e-12)


def check_positive(form):
    """Every pivot of the matrix of u - h^2 Lap u is above zero."""
    matrix = form.stiffness(ck.ScreenedPoisson(0.0, c=form.spacing**-2).terms()).matrix
    factors = splu(matrix.tocsc(), "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    np.testing.assert_array_equal(factors.perm_r, factors.perm_c)
    assert factors.U.diagonal().min() > 0


def solved(scene, spacing, **options):
    return ck.solve(scene, spacing, form="galerkin", solver="direct", **options)


@pytest.mark.filterwarnings("ignore::cpmkit.CpmkitWarning")
@pytest.mark.parametrize("case", FIT, ids=str)
def test_constants_symmetry_measure(case):
    source = source_of(case)
    assert is_surface(source)
    spacing, scene = scene_of(source, 6)
    solution = solved(scene, spacing)
    form = solution.discretized
    np.testing.assert_allclose(form.at_points(solution.values), 2.0, rtol=1e-9)
    check_laws(form)
    check_positive(form)
    if isinstance(source, HasMesh):
        drawn = drawn_measure(source, spacing / 4)
        assert drawn is None or form.sampled.samples.weights.sum() == pytest.approx(drawn, rel=0.02)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::cpmkit.CpmkitWarning")
@pytest.mark.parametrize("case", FIT, ids=str)
def test_laws_at_ten_positions(case):
    source = source_of(case)
    spacing, scene = scene_of(source, 15)
    counts = []
    for shift in np.random.default_rng(0).uniform(0, spacing, (10, source.dim)):
        solution = solved(scene, spacing, origin=shift)
        form = solution.discretized
        np.testing.assert_allclose(form.at_points(solution.values), 2.0, rtol=1e-9)
        check_laws(form)
        check_positive(form)
        counts.append(connected_pieces(form.space.dof_map)[0])
    assert len(set(counts)) == 1


def test_what_is_left_out_is_no_surface():
    left_out = [case for case in CASES if case not in SURFACES]
    assert all(any(str(case).startswith(start) for case in left_out) for start in NO_SURFACE)
    assert not any(is_surface(source_of(case)) for case in left_out)


@pytest.mark.parametrize("name", REFUSED)
def test_what_makes_no_surface_is_refused(name):
    (case,) = [one for one in SURFACES if str(one) == name]
    spacing, scene = scene_of(source_of(case), 8)
    with pytest.raises(ck.CpmkitError, match=r"make no surface at the spacing|are single samples; fit a surface"):
        solved(scene, spacing)
