"""Solids much thinner than the spacing: linear functions are exact, and errors those of thick solids."""

import numpy as np
import pytest
from model_problems import order_of
from scipy.spatial.transform import Rotation
from solid_problems import f, gradient, u

import cpmkit as ck
from cpmkit.forms.galerkin.coefficients import SampleCoefficients

SPACINGS = {2: [0.2, 0.1, 0.05], 3: [0.4, 0.2, 0.1]}


class Slab:
    """A slab of sides 1 and a thickness in spacings, turned at random, on a lattice at a random place."""

    def __init__(self, dim, spacing, thickness, seed):
        rng = np.random.default_rng(seed)
        vector = Rotation.random(random_state=rng).as_rotvec() * ([0, 0, 1] if dim == 2 else 1)
        turn = Rotation.from_rotvec(vector).as_matrix()[:dim, :dim]
        half = 0.5 * np.array([1.0] * (dim - 1) + [thickness * spacing])
        box = ck.source("analytic.box", lower=-half, upper=half)
        self.source = ck.source("moved", of=box, rotation=float(vector[2]) if dim == 2 else vector)
        self.points = rng.uniform(-half, half, (2000, dim)) @ turn.T
        self.half, self.turn, self.spacing, self.origin = half, turn, spacing, spacing * rng.uniform(size=dim)

    def normal(self, x):
        past = np.abs(x @ self.turn) - self.half
        return (np.sign(x @ self.turn) * (past == past.max(axis=1, keepdims=True))) @ self.turn.T

    def solve(self, problem, edge, **options):
        scene = ck.Scene(self.source, problem, edge=edge)
        return ck.solve(scene, self.spacing, form="galerkin", origin=self.origin, **options)

    def conditions(self, value, slope):
        """Conditions of every kind that the function ``value`` with the gradient ``slope`` satisfies."""

        def flux(x):
            return np.sum(slope(x) * self.normal(x), axis=1)

        robin = ck.Robin(1.0, 2.0, lambda x: flux(x) + 2 * value(x))
        return {"Dirichlet": ck.Dirichlet(value), "Neumann": ck.Neumann(flux), "Robin": robin}

    def error(self, problem, edge):
        return float(np.abs(self.solve(problem, edge).evaluate(self.points) - u(self.points)).max())


@pytest.mark.parametrize("thickness", [0.3, 0.05, 0.001])
@pytest.mark.parametrize(("dim", "spacing"), [(2, 0.13), (3, 0.3)])
def test_linear_functions_are_exact_in_thin_slabs(dim, spacing, thickness):
    slope = np.array([1.0, -2.0, 0.7])[:dim]

    def linear(x):
        return x @ slope + 0.3

    for seed in range(3):
        slab = Slab(dim, spacing, thickness, seed)
        for name, edge in slab.conditions(linear, lambda x: np.tile(slope, (len(x), 1))).items():
            found = slab.solve(ck.ScreenedPoisson(linear), edge, solver="direct").evaluate(slab.points)
            assert np.abs(found - linear(slab.points)).max() < (1e-10 if thickness > 0.01 else 1e-8), name


def load_error(slab):
    """The largest difference from the load with the values of f outside, as a share of its largest entry."""
    form = slab.solve(ck.ScreenedPoisson(f), ck.Neumann(0.0)).discretized
    extended, exact = form.coefficients.at_points(f, "f"), SampleCoefficients.at_points(form.coefficients, f, "f")
    loads = form.space.load(extended), form.space.load(exact)
    return np.abs(loads[0] - loads[1]).max() / np.abs(loads[1]).max()


@pytest.mark.parametrize("thickness", [0.05, 0.1, 0.3])
@pytest.mark.parametrize("dim", [2, 3])
def test_loads_in_thin_slabs_are_of_third_order(dim, thickness):
    spacings = SPACINGS[dim]
    errors = [max(load_error(Slab(dim, h, thickness, seed)) for seed in range(4)) for h in spacings]
    assert order_of(spacings, errors) > 2.8


@pytest.mark.parametrize("kind", ["Dirichlet", "Neumann", "Robin"])
@pytest.mark.parametrize("dim", [2, 3])
def test_errors_in_thin_slabs_are_those_of_thick_ones(dim, kind):
    def errors(thickness):
        slabs = [[Slab(dim, h, thickness, seed) for seed in range(2)] for h in SPACINGS[dim]]
        problem = ck.ScreenedPoisson(f)
        return np.array([max(s.error(problem, s.conditions(u, gradient)[kind]) for s in row) for row in slabs])

    thick = errors(0.3)
    assert order_of(SPACINGS[dim], thick) > 2.8
    for thickness in (0.05, 0.1):
        assert (errors(thickness) < 1.5 * thick).all()


def diffusivity(x):
    return 1.5 + 0.9 * np.sin(2 * x[:, 0] + x[:, 1])


def flow_out(x):
    """Minus the divergence of the diffusivity times the gradient of u, plus u."""
    slope = 0.9 * np.cos(2 * x[:, 0] + x[:, 1])[:, None] * [2.0, 1.0, 0.0][: x.shape[1]]
    return diffusivity(x) * (f(x) - u(x)) - np.sum(slope * gradient(x), axis=1) + u(x)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("is_tensor", [False, True])
def test_coefficients_in_thin_slabs(dim, is_tensor):
    def tensor(x):
        return diffusivity(x)[:, None, None] * np.eye(dim)

    problem = ck.Elliptic(flow_out, c=1.0, diffusivity=tensor if is_tensor else diffusivity)
    slabs = [Slab(dim, 0.1, 0.05, seed) for seed in range(3)]
    assert max(slab.error(problem, ck.Dirichlet(u)) for slab in slabs) < 1e-5


@pytest.mark.parametrize("is_tensor", [False, True])
def test_coefficients_that_jump_in_thin_slabs_stay_positive(is_tensor):
    slab = Slab(2, 0.1, 0.3, 0)

    def jump(x):
        a = np.where((x @ slab.turn)[:, 1] < 0.2 * slab.half[1], 1.0, 1000.0)
        return a[:, None, None] * np.eye(2) if is_tensor else a

    found = slab.solve(ck.Elliptic(0.0, c=1.0, diffusivity=jump), ck.Dirichlet(1.0)).evaluate(slab.points)
    assert np.abs(found - 1).max() < 0.1


@pytest.mark.parametrize("thickness", [0.4, 0.05, 0.003])
def test_iterations_in_thin_slabs_with_values_do_not_grow(thickness):
    """Without exact solves on thin parts they are 58, 176 and 300 in the slab of .05 spacings."""
    spacings = (0.1, 0.05, 0.035) if thickness == 0.05 else (0.1, 0.05)
    slabs = [Slab(3, h, thickness, 0) for h in spacings]
    found = [slab.solve(ck.ScreenedPoisson(f), ck.Dirichlet(u), solver="multigrid") for slab in slabs]
    assert max(solution.report.iterations for solution in found) <= 20


@pytest.mark.parametrize("rotation", [[0.0, 0.0, 0.0], [0.3, 0.2, 0.5]])
@pytest.mark.parametrize("width", [0.03, 0.003, 0.001])
def test_rods_much_thinner_than_the_spacing(width, rotation):
    """Energies across a rod are below rounding, and the stabilisation along it must not exceed the energy there."""
    rod = ck.source("analytic.box", lower=[0.0] * 3, upper=[1.0, width, width], rotation=rotation)

    def solve(problem, edge):
        return ck.solve(ck.Scene(rod, problem, edge=edge), 0.1, form="galerkin")

    assert np.abs(solve(ck.ScreenedPoisson(1.0), ck.Neumann(0.0)).values - 1).max() < 1e-8
    assert solve(ck.Eigen(3), ck.Neumann(0.0)).eigenvalues == pytest.approx(np.pi**2 * np.array([0, 1, 4]), 3e-3, 1e-9)
    assert 0.01 < solve(ck.Poisson(1.0), ck.Dirichlet(0.0)).mean() / width**2 < 0.04


def test_iterations_on_a_block_with_a_thin_fin():
    """The part beside the root of the fin is thin too: without it iterations are 41 to 48."""
    outline = np.array([[0, 0], [0.5, 0], [0.5, 0.3], [1.2, 0.3], [1.2, 0.305], [0.5, 0.305], [0.5, 0.6], [0, 0.6]])
    front, count = [[0, 1, 2], [2, 3, 4], [2, 4, 5], [0, 2, 5], [0, 5, 6], [0, 6, 7]], len(outline)
    sides = [[k, (k + 1) % count, (k + 1) % count + count, k + count] for k in range(count)]
    faces = [[*side[:3]] for side in sides] + [[side[0], side[2], side[3]] for side in sides]
    faces += [face[::-1] for face in front] + [[k + count for k in face] for face in front]
    corners = np.concatenate([np.column_stack([outline, np.full(count, z)]) for z in (0.0, 0.6)])
    corners = corners @ Rotation.from_rotvec([0.3, 0.2, 0.5]).as_matrix().T
    mesh = ck.source("mesh.triangles", vertices=corners, faces=faces, closest="faceted")
    scene = ck.Scene(ck.source("solid", of=mesh), ck.ScreenedPoisson(f), edge=ck.Dirichlet(u))
    found = [ck.solve(scene, h, form="galerkin", solver="multigrid").report.iterations for h in (0.1, 0.07, 0.05)]
    assert max(found) <= 30
