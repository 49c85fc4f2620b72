"""The nearest point of a triangulation is exact: as near as brute force finds, on meshes of mixed sizes too."""

import numpy as np
import pytest
from cpmkit_fem.location import nearest_cells


def brute_force(vertices, faces, queries):
    """Distances by sampling no triangle: Lagrange conditions on the plane, else each side."""
    best = np.full(len(queries), np.inf)
    for corners in vertices[faces]:
        for i in range(3):
            start, along = corners[i], corners[(i + 1) % 3] - corners[i]
            t = np.clip((queries - start) @ along / (along @ along), 0, 1)
            best = np.minimum(best, np.linalg.norm(queries - start - t[:, None] * along, axis=1))
        basis = (corners[1:] - corners[0]).T
        uv = np.linalg.lstsq(basis, (queries - corners[0]).T, rcond=None)[0].T
        inside = (uv >= 0).all(axis=1) & (uv.sum(axis=1) <= 1)
        height = np.linalg.norm(queries - corners[0] - uv @ basis.T, axis=1)
        best = np.where(inside, np.minimum(best, height), best)
    return best


@pytest.mark.parametrize("spread", [0.02, 0.5, 20.0])
@pytest.mark.parametrize("shape", ["round", "mixed", "stretched"])
def test_no_point_is_nearer(octahedron, spread, shape):
    rng = np.random.default_rng(8)
    vertices, faces = octahedron(2)
    if shape == "stretched":  # nearest centroids belong to the wrong triangles
        vertices = vertices * [100, 1, 1]
    if shape == "mixed":  # one fine corner, and a triangle that is larger than all the rest
        fine_vertices, fine_faces = octahedron(3)
        more = [0.1 * fine_vertices + [0.9, 0, 0], [[-3, -3, -2], [4, -3, -2], [0, 5, -2]]]
        extra = np.arange(3) + len(vertices) + len(fine_vertices)
        faces = np.concatenate([faces, fine_faces + len(vertices), extra[None]])
        vertices = np.concatenate([vertices, *more])
    queries = vertices[rng.integers(len(vertices), size=300)] + spread * rng.normal(size=(300, 3))
    face, local = nearest_cells(vertices, faces, queries)
    points = np.einsum("nc,ncd->nd", local, vertices[faces[face]])
    wanted = brute_force(vertices, faces, queries)
    np.testing.assert_allclose(np.linalg.norm(points - queries, axis=1), wanted, rtol=1e-12, atol=1e-13)
    assert local.min() >= 0
    np.testing.assert_allclose(local.sum(axis=1), 1, rtol=1e-12)


def test_no_query_and_one_triangle():
    vertices, faces = np.eye(3), np.array([[0, 1, 2]])
    assert [len(part) for part in nearest_cells(vertices, faces, np.zeros((0, 3)))] == [0, 0]
    face, local = nearest_cells(vertices, faces, np.array([[5.0, 5.0, 5.0], [9.0, 0.0, 0.0]]))
    assert face.tolist() == [0, 0]
    np.testing.assert_allclose(local, [[1 / 3] * 3, [1, 0, 0]], atol=1e-14)
