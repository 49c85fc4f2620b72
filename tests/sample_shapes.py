"""Small meshes for the tests of samples."""

import numpy as np

from cpmkit.plugin import Mesh


def octahedron(rounds=0, radius=1.0):
    """Return an octahedron, each triangle split in four and its vertices moved onto the sphere, ``rounds`` times."""
    vertices = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]], dtype=float)
    faces = [(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)]
    for _ in range(rounds):
        made, known, points = [], {}, list(vertices)
        for a, b, c in faces:
            middles = []
            for i, j in ((a, b), (b, c), (c, a)):
                key = (min(i, j), max(i, j))
                if key not in known:
                    known[key] = len(points)
                    points.append((points[i] + points[j]) / np.linalg.norm(points[i] + points[j]))
                middles.append(known[key])
            p, q, r = middles
            made += [(a, p, r), (p, b, q), (r, q, c), (p, q, r)]
        faces, vertices = made, np.array(points)
    return Mesh.of(radius * vertices, np.array(faces, dtype=np.int64))


def box(lower, upper):
    """Return the vertices of a box between two corners, and its twelve triangles."""
    corners = np.stack(np.meshgrid(*zip(lower, upper, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
    sides = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return corners.astype(float), np.concatenate([sides[:, [0, 1, 2]], sides[:, [0, 2, 3]]])


def joined(*meshes):
    """Return several meshes side by side."""
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    cells = [mesh.cells + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh.of(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(cells))


def grid(n, m, width=1.0, height=1.0):
    """Return a rectangle of n times m squares, two triangles each; vertex (i, j) has the number i (m + 1) + j."""
    i, j = np.meshgrid(np.arange(n + 1), np.arange(m + 1), indexing="ij")
    vertices = np.stack([width * i / n, height * j / m, 0 * i], axis=-1).reshape(-1, 3)
    number = np.arange((n + 1) * (m + 1)).reshape(n + 1, m + 1)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    return Mesh.of(vertices, np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3))


def moebius(n=24):
    """Return a strip with one side, two squares across; its core is the first of what is returned besides."""
    number = np.arange(3 * n).reshape(n, 3)
    number = np.vstack([number, number[0, ::-1]])
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    angle, across = 2 * np.pi * np.arange(n)[:, None] / n, np.array([-0.4, 0.0, 0.4])
    reach = 1 + across * np.cos(angle / 2)
    points = np.stack([reach * np.cos(angle), reach * np.sin(angle), across * np.sin(angle / 2)], axis=-1)
    core = np.arange(n)
    mesh = Mesh.of(points.reshape(-1, 3), np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3))
    return mesh, np.stack([3 * core + 1, 3 * ((core + 1) % n) + 1], axis=1)


def with_cut(mesh, cut, owner=0):
    """Return the mesh with the facets ``cut`` on a boundary."""
    cut = np.asarray(cut, dtype=np.int64).reshape(-1, mesh.manifold_dim)
    whole = np.full(len(cut), owner)
    return Mesh(mesh.vertices, mesh.cells, mesh.midpoints, cut, whole, np.zeros(len(cut), dtype=bool))


def pieces(cells):
    """Return how many components cells (m, k) have that hang together over the numbers of their corners."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    rows = np.repeat(np.arange(len(cells)), cells.shape[1])
    incidence = csr_array((np.ones(cells.size), (rows, cells.ravel())))
    return connected_components(incidence @ incidence.T, directed=False)[0]


def equator(mesh):
    """Return the edges of triangles that lie in the plane z = 0, each once."""
    edges = np.unique(np.sort(mesh.facets.reshape(-1, 2), axis=1), axis=0)
    return edges[(np.abs(mesh.vertices[edges][:, :, 2]) < 1e-12 * np.ptp(mesh.vertices)).all(axis=1)]
