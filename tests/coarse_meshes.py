"""Coarse meshes with fillets, chamfers and slopes beside flat faces, and of smooth bodies, with what they sample."""

import numpy as np
from scipy.spatial import ConvexHull

HALF = np.array([1.0, 0.6, 0.3])


def hull(points):
    """Return the vertices and triangles of the convex hull of points, wound outward."""
    found = ConvexHull(points)
    used, faces = np.unique(found.simplices, return_inverse=True)
    vertices, faces = points[used], faces.reshape(-1, 3)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a - vertices.mean(axis=0)) < 0
    faces[inward] = faces[inward][:, ::-1]
    return vertices, faces


def icosphere(rounds):
    """Return points of the unit sphere: an icosahedron's, and middles of edges ``rounds`` times."""
    golden = (1 + np.sqrt(5)) / 2
    corners = np.array([(0, s, t * golden) for s in (-1, 1) for t in (-1, 1)])
    points, faces = hull(np.concatenate([np.roll(corners, k, axis=1) for k in range(3)]) / np.hypot(1, golden))
    for _ in range(rounds):
        edges = np.unique(np.sort(np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1), axis=0)
        middles = points[edges].sum(axis=1)
        points = np.concatenate([points, middles / np.linalg.norm(middles, axis=1)[:, None]])
        points, faces = hull(points)
    return points


def rounded_box(rounds, radius):
    """Return a box with its edges and corners rounded by spheres, as CAD writes it, and its exact area."""
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    points = (HALF * signs)[:, None] + radius * icosphere(rounds)
    a, b, c = HALF
    area = 8 * (a * b + b * c + c * a) + 4 * np.pi * radius * HALF.sum() + 4 * np.pi * radius**2
    return hull(points.reshape(-1, 3)), area


def capsule(sections, half=1.0, radius=0.5):
    """Return a cylinder of two rings between half spheres, and its exact area."""
    polar, around = np.meshgrid(np.pi * np.arange(sections // 4 + 1) / (sections // 2), np.arange(sections))
    turn = 2 * np.pi * around / sections
    cap = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1).reshape(-1, 3)
    cap = np.unique(cap.round(14), axis=0) * radius + [0, 0, half]
    return hull(np.concatenate([cap, cap * [1, 1, -1]])), 4 * np.pi * radius * (half + radius)


def terrain(plateau, slope, height, blocks):
    """Return flat ground with square plateaus, and slopes one triangle wide between."""
    starts = (plateau + slope) * np.arange(blocks)
    x = np.stack([starts, starts + plateau], axis=1).ravel()
    up, count = (np.arange(len(x)) // 2) % 2, len(x)
    grid = np.stack([*np.meshgrid(x, x, indexing="ij"), height * np.outer(up, up)], axis=-1).reshape(-1, 3)
    a = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    faces = [np.stack([a, a + count, a + 1], axis=1), np.stack([a + count, a + count + 1, a + 1], axis=1)]
    return grid, np.concatenate(faces)


def chamfered_box(width, degrees):
    """Return a box whose upper edges are cut off at an angle to the upper face."""
    deep = width * np.tan(np.deg2rad(degrees))
    signs = np.array([(x, y) for x in (-1, 1) for y in (-1, 1)])
    rings = [(HALF[:2] - width, HALF[2]), (HALF[:2], HALF[2] - deep), (HALF[:2], -HALF[2])]
    return hull(np.concatenate([np.column_stack([signs * size, np.full(4, z)]) for size, z in rings]))


def random_sphere(count, axes=(1.0, 1.0, 1.0)):
    """Return a random triangulation of an ellipsoid."""
    points = np.random.default_rng(0).normal(size=(count, 3))
    vertices, faces = hull(points / np.linalg.norm(points, axis=1)[:, None])
    return vertices * axes, faces


def torus(around, across, radius=1.0, tube=0.4):
    """Return a torus of ``around`` times ``across`` quadrangles, each cut in two."""
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = 2 * np.pi * i / around, 2 * np.pi * j / across
    reach = radius + tube * np.cos(b)
    points = np.stack([reach * np.cos(a), reach * np.sin(a), tube * np.sin(b)], axis=-1).reshape(-1, 3)
    one, two = i * across + j, (i + 1) % around * across + j
    three, four = (i + 1) % around * across + (j + 1) % across, i * across + (j + 1) % across
    return points, np.stack([one, two, three, one, three, four], axis=-1).reshape(-1, 3)


def facet_area(vertices, faces):
    """Return the area of triangles."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
