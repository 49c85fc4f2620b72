"""Energies over samples are symmetric to the last bit, blind to constants, positive, right for what splines hold."""

import numpy as np
import pytest
from galerkin_scenes import SHIFT, Drawn, plane, plane_circle, space_circle, sphere, together
from galerkin_systems import stiffness

from cpmkit.forms.galerkin.dof_map import connected_pieces, dof_map_from_patches
from cpmkit.forms.galerkin.options import STABILISATIONS, Stabilisation
from cpmkit.forms.galerkin.space.energy import load, mass, stiffness_with_floor, values_at_samples
from cpmkit.forms.galerkin.space.spline_space import build_spline_space, value_rows
from cpmkit.mesh.cell_quadrature import Samples

H = 0.4
NOTHING = Stabilisation(0.0, 0.0, 0.0)
DEFAULT = STABILISATIONS[2]["default"]
SCENES = {
    "sphere": lambda: sphere(0.5 * H),
    "circle in the plane": lambda: plane_circle(H),
    "circle in space": lambda: space_circle(H),
    "two sheets": lambda: together(sphere(0.5 * H), sphere(0.5 * H, radius=1 + 0.3 * H)),
    "slit plane": lambda: plane(0.5 * H, side=2.0, slit=(0.5, 1.5)),
    "halves and a speck": lambda: together(
        plane(0.5 * H, side=2.0, slit=(-1.0, 3.0)), plane(0.5 * H, side=H).moved(np.full(3, 2.0))
    ),
}
MEASURES = (4 * np.pi, 2 * np.pi, 2 * np.pi, 4 * np.pi * (1 + (1 + 0.3 * H) ** 2), 4.0, 4 + H**2)


@pytest.fixture(params=SCENES)
def drawn(request):
    return SCENES[request.param]()


@pytest.fixture
def space(drawn):
    return drawn.space(H)


def varying(space):
    return 1 + 0.5 * np.sin(5 * space.samples.points[:, 0])


def linear(space):
    """The coefficients of a linear function, and its gradient; a speck has its mean alone."""
    slope = np.array([0.3, -1.2, 0.7])[: space.dof_map.dim]
    return space.dof_map.nodes @ slope * space.dof_map.spacing, slope


def tangential(slope, normals):
    across = np.einsum("qcd,d->qc", normals, slope)
    return slope - np.einsum("qc,qcd->qd", across, normals)


def test_symmetric_to_the_last_bit_and_blind_to_constants(space):
    a = varying(space)
    one = np.ones(space.dof_map.size)
    for strength in (NOTHING, DEFAULT):
        K = stiffness(space, a, strength)
        assert (K != K.T).nnz == 0
        assert np.abs(K @ one).max() < 1e-14 * np.abs(K).max() * 100
    M = mass(space, a)
    assert (M != M.T).nnz == 0


def test_positive_with_one_constant_a_piece(space):
    count, of_unknown = connected_pieces(space.dof_map)
    for K in (stiffness(space, 1.0, DEFAULT), stiffness_with_floor(space, varying(space), DEFAULT)):
        values = np.linalg.eigvalsh(K.toarray())
        assert values[0] > -1e-13 * values[-1]
        assert values[count - 1] < 1e-13 * values[-1]
        assert len(values) == count or values[count] > 1e-7 * values[-1]
        assert np.abs(K @ (of_unknown == 0)).max() < 1e-13 * values[-1]


@pytest.mark.parametrize(("name", "measure"), list(zip(SCENES, MEASURES, strict=True)))
def test_the_mass_of_one_is_the_measure(name, measure):
    space = SCENES[name]().space(H)
    one = np.ones(space.dof_map.size)
    assert one @ mass(space, 1.0) @ one == pytest.approx(space.samples.weights.sum(), rel=1e-13)
    assert one @ mass(space, 1.0) @ one == pytest.approx(measure, rel=2e-5)
    assert load(space, np.ones((len(space.samples), 2))).sum(axis=0) == pytest.approx(measure, rel=2e-5)


@pytest.mark.parametrize("name", [n for n in SCENES if "speck" not in n])
def test_linear_functions_have_their_energy(name):
    space = SCENES[name]().space(H)
    u, slope = linear(space)
    a = varying(space)
    along = tangential(slope, space.samples.normals)
    exact = (space.samples.weights * a * (along**2).sum(axis=1)).sum()
    off = (space.samples.weights * a * ((slope - along) ** 2).sum(axis=1)).sum()
    assert u @ stiffness(space, a, NOTHING) @ u == pytest.approx(exact, rel=1e-12)
    # Neither second derivatives nor ghosts nor the floor feel a linear function.
    assert u @ stiffness_with_floor(space, a, Stabilisation(1e-2, 1.0, 1.0)) @ u == pytest.approx(
        exact + 1e-2 * off, rel=1e-12
    )
    d = space.dof_map.dim
    tensor = np.eye(d) + np.outer(np.arange(d), np.arange(d))
    tensors = a[:, None, None] * tensor
    exact = (space.samples.weights * a * np.einsum("qi,ij,qj->q", along, tensor, along)).sum()
    assert u @ stiffness(space, tensors, NOTHING) @ u == pytest.approx(exact, rel=1e-12)


def test_a_tensor_that_is_a_number_is_that_number(space):
    a = varying(space)
    K, T = (stiffness(space, x, DEFAULT) for x in (a, a[:, None, None] * np.eye(space.dof_map.dim)))
    assert np.abs(K - T).max() < 1e-13 * np.abs(K).max()


@pytest.mark.parametrize("name", [n for n in SCENES if "speck" not in n])
def test_ghosts_do_not_feel_quadratic_functions(name):
    space = SCENES[name]().space(H)
    assert len(space.short_runs) == 0
    ghosts = stiffness(space, 1.0, Stabilisation(0.0, 0.0, 1.0)) - stiffness(space, 1.0, NOTHING)
    z = space.dof_map.nodes
    assert np.abs(ghosts @ (z[:, 0] ** 2 - 3 * z[:, 0] * z[:, 1] + z[:, 1])).max() < 1e-11
    assert np.abs(ghosts @ z[:, 1].astype(float) ** 3).max() > 1e-2


def test_the_second_derivative_along_normals_is_exact():
    space = plane(0.5 * H, side=2.0).space(H)
    n = space.samples.normals[0, 0]
    z = space.dof_map.nodes.astype(float)
    u = H**2 * ((z @ n) ** 2 - 0.25) / 2  # the spline of (n . x)^2 / 2, for n is a unit vector
    energy = stiffness(space, 2.0, Stabilisation(0.0, 1.0, 0.0)) - stiffness(space, 2.0, NOTHING)
    assert u @ energy @ u == pytest.approx(2 * H**2 * 4.0, rel=1e-11)


def test_loads_and_values_are_those_of_rows(space):
    s = space.samples
    rows = value_rows(space.dof_map, space.dof_map.patch, s.points)
    f = np.random.default_rng(0).normal(size=(len(s), 2))
    u = np.random.default_rng(1).normal(size=(space.dof_map.size, 2))
    assert load(space, f) == pytest.approx(rows.T @ (s.weights[:, None] * f), abs=1e-13)
    assert values_at_samples(space, u) == pytest.approx(rows @ u, abs=1e-13)
    exact = rows.T @ (rows * (s.weights * f[:, 0])[:, None])
    assert np.abs(mass(space, f[:, 0]) - exact).max() < 1e-13


def test_samples_without_weight_change_nothing_but_read_what_they_touch():
    drawn = plane(0.5 * H, side=2.0)
    space = drawn.space(H)
    extra = drawn.reordered(np.arange(40))
    extra.samples.weights[:] = 0
    s, e = drawn.samples, extra.samples
    fields = [np.concatenate([getattr(s, f), getattr(e, f)]) for f in ("points", "weights", "normals", "cell")]
    more = Drawn(type(s)(*fields), np.concatenate([drawn.contacts, extra.contacts])).space(H)
    K, L = stiffness(space, 1.0, DEFAULT), stiffness(more, 1.0, DEFAULT)
    assert (K != L).nnz == 0


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_units_do_not_count(drawn, unit):
    space, scaled = drawn.space(H), drawn.moved(0.0, unit).space(H * unit)
    m = space.manifold_dim
    assert scaled.manifold_dim == m
    K, L = (stiffness_with_floor(s, 1.0, DEFAULT) for s in (space, scaled))
    assert np.abs(K - L * unit ** (2 - m)).max() < 1e-12 * np.abs(K).max()
    M, N = (mass(s, 1.0) for s in (space, scaled))
    assert np.abs(M - N * unit**-m).max() < 1e-12 * np.abs(M).max()


def test_whole_spacings_do_not_count(drawn):
    drawn = drawn.moved(np.zeros(drawn.samples.points.shape[1]))
    far = H * np.array([512, -256, 64])[: drawn.samples.points.shape[1]]
    K, L = (stiffness_with_floor(d.space(H), 1.0, DEFAULT) for d in (drawn, drawn.moved(far)))
    assert np.abs(K - L).max() < 1e-9 * np.abs(K).max()


def test_the_floor_lifts_what_is_grazed():
    space = sphere(0.5 * H).moved(SHIFT).space(H)
    bare = stiffness(space, 1.0, Stabilisation(1e-2, 1e-2, 0.0)) + mass(space, 1.0)
    light = bare.diagonal() < 1e-4 * np.median(bare.diagonal())
    assert 0.05 < light.mean() < 0.25
    plain = stiffness(space, 1.0, DEFAULT) + mass(space, 1.0)
    floored = stiffness_with_floor(space, 1.0, DEFAULT, c=1.0)
    lifted = (floored - plain).diagonal()
    assert (lifted[light] > 0.9e-3 * np.median(bare.diagonal())).all()
    assert lifted.min() > -1e-15
    z = space.dof_map.nodes
    assert np.abs((floored - plain) @ (1 + z[:, 0] - 3 * z[:, 2])).max() < 1e-13


def test_where_no_run_of_four_is_runs_of_three_hold_the_spline():
    one = np.zeros(1, dtype=np.int64)
    cell = dof_map_from_patches(H, np.zeros((1, 3), dtype=np.int64), np.zeros((0, 2), dtype=np.int64), one, one > 0)
    normal = np.array([[[0.0, 0.0, 1.0]]])
    space = build_spline_space(cell, Samples(np.zeros((1, 3)), np.ones(1), normal, one))
    assert len(space.runs) == 0
    assert len(space.short_runs) == 27  # nine along each axis, each once
    ghosts = stiffness(space, 1.0, Stabilisation(0.0, 0.0, 1.0)) - stiffness(space, 1.0, NOTHING)
    values = np.linalg.eigvalsh(ghosts.toarray())
    assert (values > 1e-10).sum() == 27 - 8  # all but what is linear along each axis
    x, y, z = cell.nodes.T
    assert np.abs(ghosts @ (1.0 + x * y * z)).max() < 1e-13
