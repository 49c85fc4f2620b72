"""Meshes of few vertices, and of slivers, whose matrices are badly conditioned, have their eigenvalues."""

import numpy as np
import pytest

import cpmkit as ck


def strip(around=150, rows=16, length=2000.0):
    """Return a tube of radius 1 without ends, of triangles that are ``length / rows`` long and 1 / 24 wide."""
    turn = np.linspace(0, 2 * np.pi, around, endpoint=False)
    z = np.repeat(np.linspace(0, length, rows + 1), around)
    vertices = np.column_stack([np.tile(np.cos(turn), rows + 1), np.tile(np.sin(turn), rows + 1), z])
    a = np.arange(around)
    b = (a + 1) % around
    first = np.concatenate([np.stack([a, b, b + around], axis=1), np.stack([a, b + around, a + around], axis=1)])
    faces = (first[None] + around * np.arange(rows)[:, None, None]).reshape(-1, 3)
    return ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="faceted")


def test_slivers_have_their_eigenvalues():
    rows, length = 16, 2000.0
    solution = ck.solve(ck.Scene(strip(rows=rows, length=length), ck.Eigen(count=4)), backend="fem")
    h, k = length / rows, np.pi * np.arange(4) / length
    along = 6 * (1 - np.cos(k * h)) / (2 + np.cos(k * h)) / h**2  # of linear elements on an interval
    np.testing.assert_allclose(solution.eigenvalues, along, rtol=1e-6, atol=1e-10)


class Nothing:
    """The unit sphere, drawn by a triangle whose corners are one."""

    dim, manifold_dim, exact, bounds = 3, 2, True, np.array([[-1.0] * 3, [1.0] * 3])

    def closest_point(self, x):
        return ck.source("analytic.sphere").closest_point(x)

    def mesh(self, spacing):
        del spacing
        return np.ones((3, 3)), np.array([[0, 1, 2]])


def test_a_mesh_of_which_no_triangle_is_left_is_refused():
    with pytest.raises(ck.InputError, match=r"got none; take a finer mesh"):
        ck.solve(ck.Scene(Nothing(), ck.ScreenedPoisson(f="x", c=1.0)), 3.0, backend="fem")


def test_as_many_eigenvalues_as_a_mesh_has_vertices_are_found_and_no_more():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    mesh = ck.source("mesh.triangles", vertices=vertices, faces=[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    found = ck.solve(ck.Scene(mesh, ck.Eigen(count=4)), backend="fem").eigenvalues
    assert len(found) == 4
    assert abs(found[0]) < 1e-12
    assert (np.diff(found) > -1e-12).all()
    with pytest.raises(ck.InputError, match=r"count=5 is more than the 4 eigenvalues of a mesh .* finer mesh"):
        ck.solve(ck.Scene(mesh, ck.Eigen(count=5)), backend="fem")
