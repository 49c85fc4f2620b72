"""A form of fifty lines, cotangent finite elements on a mesh, gets every family of equations through the contract."""

from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
import pytest
from model_problems import octahedron, order_of
from scipy.sparse import coo_array, diags_array
from scipy.spatial import cKDTree

import cpmkit as ck
from cpmkit.linear.solver_options import SolverOptions
from cpmkit.plugin import CsrOperator, Discretized, Nonlinear, Scene
from cpmkit.preparing import Prepared


@dataclass(frozen=True, eq=False)
class Cotangent(Discretized):
    """Values at the vertices of a triangle mesh, one lumped mass each; radiation on the rim, else nothing flows out."""

    scene: Scene
    vertices: np.ndarray
    faces: np.ndarray
    radiation: tuple = (0.0, 0.0)  # du/db = first - second u on the rim
    form = "cotangent"
    cannot = MappingProxyType({"explicit steps": "use scheme 'implicit'", "second Laplacian": "use 'collocation'"})
    spacing = property(lambda self: float(np.sqrt(self.areas.mean())))
    size = property(lambda self: len(self.vertices))
    points = property(lambda self: self.vertices)
    mass = property(lambda self: CsrOperator(diags_array(self.areas).tocsr(), True))

    @property
    def areas(self):
        corners = self.vertices[self.faces]
        twice = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        return np.bincount(self.faces.ravel(), np.repeat(twice / 6, 3), self.size)

    @property
    def lengths(self):  # of the rim, at its vertices
        pairs = np.sort(np.concatenate([self.faces[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
        edges, count = np.unique(pairs, axis=0, return_counts=True)
        start, end = edges[count == 1].T
        half = np.linalg.norm(self.vertices[end] - self.vertices[start], axis=1) / 2
        return np.bincount(np.r_[start, end], np.r_[half, half], self.size)

    def stiffness(self, terms):
        corners, parts = self.vertices[self.faces], []
        for k in range(3):
            a, b = corners[:, (k + 1) % 3] - corners[:, k], corners[:, (k + 2) % 3] - corners[:, k]
            weight = terms.diffusivity * np.sum(a * b, axis=1) / np.linalg.norm(np.cross(a, b), axis=1) / 2
            i, j = self.faces[:, (k + 1) % 3], self.faces[:, (k + 2) % 3]
            parts += [(i, i, weight), (j, j, weight), (i, j, -weight), (j, i, -weight)]
        i, j, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        onto = diags_array(terms.c * self.areas + self.radiation[1] * self.lengths)
        return CsrOperator((coo_array((values, (i, j)), shape=(self.size,) * 2) + onto).tocsr(), True)

    def load(self, f, time=None):
        return self.areas[:, None] * self.data_at_points(f, "f", time, self.scene.channels)

    def condition_load(self, stiffness, time=None, of="value"):
        return np.zeros((self.size, self.scene.channels)) + (self.radiation[0] * self.lengths)[:, None]

    def at_points(self, u, rows=None):
        return u if rows is None else u[rows]

    def project(self, values, start=None, time=None):
        return values

    def inner(self, u, v):
        return u.T @ (self.areas[:, None] * v) / self.areas.sum()

    def evaluation_matrix(self, points, side=None):  # nearest vertices
        nearest = cKDTree(self.vertices).query(points)[1]
        return coo_array((np.ones(len(nearest)), (np.arange(len(nearest)), nearest)), (len(nearest), self.size)).tocsr()

    def describe(self):
        return {"degree": 1}

    @property
    def state_fluxes(self):
        laws = [one.law for one in self.scene.edge_conditions if isinstance(one.law, Nonlinear)]
        return [Radiation(self, law) for law in laws]

    def linearise(self, seen):  # j(v) + j'(v) (u - v)
        (flux,) = self.state_fluxes
        slope = flux.law.slope_at(seen[0], self.vertices)
        return replace(self, radiation=(flux.law.flux_at(seen[0], self.vertices) - slope * seen[0], -slope))


@dataclass(frozen=True, eq=False)
class Radiation:
    """u at all vertices; only those of the rim have a length on which the flux acts."""

    form: Cotangent
    law: Nonlinear
    points = property(lambda self: self.form.vertices)
    guess = property(lambda self: self.law.guess)

    def read(self, u):
        return u[:, 0]

    def grows(self, seen):
        return bool(np.any(self.law.slope_at(seen, self.points)))


def sphere(rounds, problem):
    vertices, faces = octahedron(rounds)
    return Cotangent(ck.Scene(ck.source("mesh.triangles", vertices=vertices, faces=faces), problem), vertices, faces)


def disc(rings, problem, edge):
    """The unit disc, its triangles in rings."""
    r, k = np.divmod(np.arange(1 + 3 * rings * (rings + 1)), 1)
    counts = np.r_[1, 6 * np.arange(1, rings + 1)]
    ring = np.repeat(np.arange(rings + 1), counts)
    turn = 2 * np.pi * (np.arange(len(r)) - np.repeat(np.cumsum(counts) - counts, counts)) / np.maximum(6 * ring, 1)
    flat = np.stack([np.cos(turn), np.sin(turn)], axis=1) * (ring / rings)[:, None]
    from scipy.spatial import Delaunay

    faces = Delaunay(flat).simplices.astype(np.int64)
    vertices = np.column_stack([flat, 0 * k])
    surface = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="faceted")
    return Cotangent(ck.Scene(surface, problem, edge=edge), vertices, faces)


def solved(form):
    return Prepared(form, SolverOptions()).solve()


def test_heat():
    problem = ck.Heat(lambda x: x[:, 2], until=0.2, step=0.005, scheme="bdf2")
    sizes, errors, total = [], [], []
    for rounds in (2, 3, 4):
        form = sphere(rounds, problem)
        u = solved(form).values[:, 0]
        errors.append(np.abs(u - np.exp(-0.4) * form.vertices[:, 2]).max())
        sizes.append(form.spacing)
        total.append(form.areas @ u)
    assert order_of(sizes, errors) > 1.7
    assert np.abs(total).max() < 1e-12


def test_eigenvalues():
    errors, sizes = [], []
    for rounds in (2, 3, 4):
        form = sphere(rounds, ck.Eigen(9))
        solution = solved(form)
        errors.append(np.abs(solution.eigenvalues - np.repeat([0.0, 2.0, 6.0], [1, 3, 5])).max())
        sizes.append(form.spacing)
        np.testing.assert_allclose(form.inner(solution.values, solution.values), np.eye(9), atol=1e-7)
    assert order_of(sizes, errors) > 1.7


def test_a_flux_that_depends_on_the_solution():
    """-Lap u = 4 in the disc, du/db = -u^4 on its rim: u = 2^(1/4) + 1 - r^2."""
    errors, sizes = [], []
    for rings in (6, 12, 24):
        form = disc(rings, ck.Poisson(4.0), ck.NonlinearFlux(lambda u: -(u**4)))
        solution = solved(form)
        error = solution.values[:, 0] - (2**0.25 + 1 - np.sum(form.vertices**2, axis=1))
        errors.append(np.sqrt(form.areas @ error**2))
        sizes.append(1 / rings)
        assert "Newton's method converged" in solution.report.reason
    assert errors[-1] < 5e-3
    assert order_of(sizes, errors) > 1.7


def test_a_constant_that_is_free_and_data_that_do_not_balance():
    form = sphere(3, ck.Poisson(lambda x: 2 * x[:, 2]))
    solution = solved(form)
    assert np.abs(solution.values[:, 0] - form.vertices[:, 2]).max() < 0.01
    assert abs(form.areas @ solution.values[:, 0]) < 1e-12
    solution = solved(sphere(3, ck.Poisson(1.0)))
    assert solution.imbalances[0].relative > 0.9
    assert any("do not balance" in text for text in solution.warnings)


def test_waves_reading_and_what_the_form_lacks(tmp_path):
    wave = solved(sphere(3, ck.Wave(lambda x: x[:, 2], until=0.2, step=0.1, scheme="implicit")))
    np.testing.assert_allclose(wave.evaluate([[0, 0, 1.0]]), np.cos(np.sqrt(2) * 0.2), atol=0.02)
    wave.save(tmp_path / "wave.vtp")
    assert wave.summary()["discretization"]["degree"] == 1
    with pytest.raises(ck.SceneError, match=r"'cotangent' has no explicit steps, .* use scheme 'implicit'"):
        solved(sphere(2, ck.Wave(lambda x: x[:, 2], until=0.2, step=0.1, scheme="leapfrog")))
    with pytest.raises(ck.SceneError, match="'cotangent' has no second Laplacian"):
        solved(sphere(2, ck.Biharmonic(1.0)))
    one = solved(sphere(3, ck.ScreenedPoisson(1.0)))
    assert one.integrate() == pytest.approx(4 * np.pi, rel=2e-2)
