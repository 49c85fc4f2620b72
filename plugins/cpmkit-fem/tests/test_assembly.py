"""The stiffness is the cotangent Laplacian to rounding, and the mass matrix integrates products of linear functions."""

import numpy as np
import pytest
from cpmkit_fem.assembly import stiffness_and_mass
from cpmkit_fem.elements import shape_at
from cpmkit_fem.surface_mapping import jacobians, measure_and_pseudoinverse
from scipy.sparse import coo_array
from skfem import Basis, BilinearForm, ElementTriP1, MeshTri
from skfem.helpers import dot, grad


def bumpy(octahedron, times=3):
    """A sphere with triangles of all shapes."""
    vertices, faces = octahedron(times)
    rng = np.random.default_rng(4)
    return vertices * [1.0, 0.7, 0.4] + 0.02 * rng.normal(size=vertices.shape), faces


def cotangents(vertices, faces):
    """Half the cotangents of the angles opposite each edge, summed over the two triangles."""
    n, total = len(vertices), 0
    for k in range(3):
        i, j, o = faces[:, (k + 1) % 3], faces[:, (k + 2) % 3], faces[:, k]
        a, b = vertices[i] - vertices[o], vertices[j] - vertices[o]
        half = 0.5 * np.sum(a * b, axis=1) / np.linalg.norm(np.cross(a, b), axis=1)
        rows, columns = np.concatenate([i, j, i, j]), np.concatenate([j, i, i, j])
        total = total + coo_array((np.concatenate([-half, -half, half, half]), (rows, columns)), shape=(n, n)).tocsr()
    return total


def unfolded(vertices, faces):
    """Assembled by scikit-fem's own planar mapping on triangles that are laid side by side, then gathered."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    along = np.linalg.norm(b - a, axis=1)
    x = np.sum((b - a) * (c - a), axis=1) / along
    y = np.linalg.norm(np.cross(b - a, c - a), axis=1) / along
    zero, m = np.zeros(len(faces)), len(faces)
    points = np.stack([np.concatenate([zero, along, x]), np.concatenate([zero, zero, y])])
    mesh = MeshTri(points, np.arange(3 * m).reshape(3, m))
    apart = BilinearForm(lambda u, v, _: dot(grad(u), grad(v))).assemble(Basis(mesh, ElementTriP1()))
    gather = coo_array((np.ones(3 * m), (np.arange(3 * m), faces.T.ravel())), shape=(3 * m, len(vertices))).tocsr()
    return gather.T @ apart @ gather


@pytest.mark.parametrize("reference", [cotangents, unfolded])
def test_stiffness_is_the_cotangent_laplacian(octahedron, reference):
    vertices, faces = bumpy(octahedron)
    stiffness, _ = stiffness_and_mass(vertices, faces)
    wanted = reference(vertices, faces)
    assert abs(stiffness - wanted).max() <= 1e-14 * abs(wanted).max()


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_constants_are_the_kernel_at_every_size(octahedron, scale):
    vertices, faces = bumpy(octahedron)
    stiffness, mass = stiffness_and_mass(scale * vertices, faces)
    assert np.abs(stiffness @ np.ones(len(vertices))).max() <= 1e-13 * abs(stiffness).max()
    assert np.linalg.eigvalsh(stiffness.toarray())[1] > 1e-4 * abs(stiffness).max()
    a, b, c = (scale * vertices[faces[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    np.testing.assert_allclose(mass.sum(), area, rtol=1e-13)
    assert type(stiffness).__name__ == type(mass).__name__ == "csr_array"


def test_thin_triangles_keep_their_gradients():
    height = 1e-7
    vertices, faces = np.array([[0, 0, 0], [1, 0, 0], [0.3, height, 0]]), np.array([[0, 1, 2]])
    stiffness, _ = stiffness_and_mass(vertices, faces)
    np.testing.assert_allclose(stiffness.toarray(), cotangents(vertices, faces).toarray(), rtol=1e-14)


def test_the_plane_is_a_surface_too(octahedron):
    vertices, faces = octahedron(2)
    upper = faces[(vertices[faces, 2] >= 0).all(axis=1)]
    flat = vertices * [1, 1, 0]
    for planar, spatial in zip(
        stiffness_and_mass(vertices[:, :2], upper), stiffness_and_mass(flat, upper), strict=True
    ):
        assert abs(planar - spatial).max() == 0


@pytest.mark.parametrize("degree", [1, 2])
def test_pseudo_inverses_undo_jacobians_within_the_tangent_plane(octahedron, degree):
    vertices, faces = bumpy(octahedron, 1)
    if degree == 2:
        middles = 0.5 * vertices[faces[:, [[0, 1], [1, 2], [0, 2]]]].sum(axis=2).reshape(-1, 3)
        middles += 0.05 * np.random.default_rng(1).normal(size=middles.shape)
        faces = np.hstack([faces, len(vertices) + np.arange(len(middles)).reshape(-1, 3)])
        vertices = np.concatenate([vertices, middles])
    shape = shape_at(2, degree, np.array([[0.2, 0.0, 1.0], [0.3, 0.0, 0.0]]))
    jacobian = jacobians(vertices, faces, shape)
    measure, inverse = measure_and_pseudoinverse(jacobian)
    assert jacobian.shape == (2, 3, len(faces), 1 if degree == 1 else 3)
    product = np.einsum("idmq,jdmq->ijmq", inverse, jacobian)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(2)[:, :, None, None], product.shape), atol=1e-12)
    crossed = np.linalg.norm(np.cross(jacobian[0], jacobian[1], axis=0), axis=0)
    np.testing.assert_allclose(measure, crossed, rtol=1e-12)


def test_coefficients_are_linear_between_vertices(octahedron):
    vertices, faces = bumpy(octahedron)
    plain, mass = stiffness_and_mass(vertices, faces)
    for one, other in zip(
        stiffness_and_mass(vertices, faces, *np.full((2, len(vertices)), 3.0)), (plain, mass), strict=True
    ):
        np.testing.assert_allclose(one.toarray(), 3 * other.toarray(), atol=1e-14 * abs(other).max())
    a, c = np.random.default_rng(5).uniform(1, 2, (2, len(vertices)))
    stiffness, weighted = stiffness_and_mass(vertices, faces, a, c)
    np.testing.assert_allclose(weighted.sum(), (mass @ c).sum(), rtol=1e-13)
    corner = np.flatnonzero((faces == 0).any(axis=1))
    apart = sum(
        a[faces[k]].mean() * stiffness_and_mass(vertices[faces[k]], np.array([[0, 1, 2]]))[0].toarray()[at, at]
        for k in corner
        for at in np.flatnonzero(faces[k] == 0)
    )
    np.testing.assert_allclose(stiffness[0, 0], apart, rtol=1e-13)
