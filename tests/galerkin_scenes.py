"""Samples whose measure, normals and contacts are known in closed form: spheres, circles, planes, slit or whole."""

from dataclasses import dataclass, replace

import numpy as np
from sample_shapes import box

from cpmkit.forms.galerkin.dof_map import build_dof_map
from cpmkit.forms.galerkin.space.spline_space import build_spline_space
from cpmkit.mesh.cell_quadrature import Samples

CORNERS = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4]]) / 6
GAUSS = (np.array([0.5 - np.sqrt(0.15), 0.5, 0.5 + np.sqrt(0.15)]), np.array([5, 8, 5]) / 18)
#: A position of the lattice that no scene has been drawn for.
SHIFT = np.array([0.0137, -0.0271, 0.0193])


@dataclass(frozen=True)
class Drawn:
    """Samples and the vertices of each one's cell."""

    samples: Samples
    contacts: np.ndarray

    def space(self, spacing):
        return build_spline_space(build_dof_map(self.samples.points, self.contacts, spacing), self.samples)

    def moved(self, shift, scale=1.0):
        measure = scale ** (self.samples.points.shape[1] - self.samples.normals.shape[1])
        points, weights = self.samples.points * scale + shift, self.samples.weights * measure
        return replace(self, samples=replace(self.samples, points=points, weights=weights))

    def reordered(self, order):
        s = self.samples
        return Drawn(Samples(s.points[order], s.weights[order], s.normals[order], s.cell[order]), self.contacts[order])


def together(*parts):
    fields = [np.concatenate([getattr(p.samples, f) for p in parts]) for f in ("points", "weights", "normals")]
    offsets = np.cumsum([0] + [p.contacts.max() + 1 for p in parts[:-1]])
    contacts = np.concatenate([p.contacts + offset for p, offset in zip(parts, offsets, strict=True)])
    return Drawn(Samples(*fields, np.zeros(len(contacts), dtype=np.int64)), contacts)


def triangles(vertices, cells, midpoints=None):
    """Three samples on each flat or quadratic triangle."""
    c = vertices[cells]
    m = (c[:, [1, 2, 0]] + c[:, [2, 0, 1]]) / 2 if midpoints is None else midpoints
    points, normals, weights = [], [], []
    for b in CORNERS:
        one, two = np.array([1, 0, -1]), np.array([0, 1, -1])
        slopes = [
            np.einsum("mjd,j->md", c, (4 * b - 1) * way)
            + np.einsum("mjd,j->md", m, 4 * (way[[1, 2, 0]] * b[[2, 0, 1]] + way[[2, 0, 1]] * b[[1, 2, 0]]))
            for way in (one, two)
        ]
        points.append(
            np.einsum("mjd,j->md", c, b * (2 * b - 1)) + np.einsum("mjd,j->md", m, 4 * b[[1, 2, 0]] * b[[2, 0, 1]])
        )
        cross = np.cross(*slopes)
        weights.append(np.linalg.norm(cross, axis=1) / 6)
        normals.append(cross / np.linalg.norm(cross, axis=1)[:, None])
    stacked = [np.ascontiguousarray(np.stack(x, 1).reshape(-1, *x[0].shape[1:])) for x in (points, weights, normals)]
    cell = np.repeat(np.arange(len(cells)), 3)
    return Drawn(Samples(stacked[0], stacked[1], stacked[2][:, None, :], cell), cells[cell])


def lattice_triangles(n):
    """The points (i, j) with i + j <= n, and the n^2 triangles between them."""
    i, j = (x.ravel() for x in np.indices((n + 1, n + 1)))
    keep = i + j <= n
    number = np.full((n + 2, n + 2), -1)
    number[i[keep], j[keep]] = np.arange(keep.sum())
    up = np.stack([number[i, j], number[i + 1, j], number[i, j + 1]], axis=1)[i + j < n]
    down = np.stack([number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]], axis=1)[i + j < n - 1]
    return np.stack([i, j], axis=1)[keep], np.concatenate([up, down])


def sphere(edge, radius=1.0):
    """Quadratic triangles on a refined octahedron, no edge longer than ``edge``, turned so that no axis is special."""
    n = int(np.ceil(radius * np.pi / 2 / (0.69 * edge)))
    place, cells = lattice_triangles(n)
    corners = np.concatenate([place, n - place.sum(axis=1, keepdims=True)], axis=1)
    signs = np.stack(np.meshgrid(*[[1, -1]] * 3), axis=-1).reshape(-1, 3)
    raw = (signs[:, None, :] * corners).reshape(-1, 3)
    unique, inverse = np.unique(raw, axis=0, return_inverse=True)
    unit = np.sin(np.pi / 2 * unique / n)
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    unit = unit / np.linalg.norm(unit, axis=1)[:, None] @ turn
    cells = inverse.ravel()[np.concatenate([cells + k * len(place) for k in range(8)])]
    middle = unit[cells[:, [1, 2, 0]]] + unit[cells[:, [2, 0, 1]]]
    middle /= np.linalg.norm(middle, axis=2)[:, :, None]
    return triangles(unit * radius, cells, middle * radius)


def plane(edge, side=1.0, slit=None):
    """A square in a tilted plane of space, drawn by u and v in [0, side]; ``slit``: where v = side / 2 is cut."""
    n = 2 * int(np.ceil(side / edge * 0.75))
    i, j = (x.ravel() for x in np.indices((n, n)))
    number = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = number[i, j], number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]
    cells = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    place = np.indices((n + 1, n + 1)).reshape(2, -1).T * (side / n)
    u, v = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 2)))[0].T
    drawn = triangles(place @ np.stack([u, v]), cells)
    if slit is None:
        return drawn
    on_slit = (place[:, 1] == side / 2) & (place[:, 0] > slit[0]) & (place[:, 0] < slit[1])
    above = place[cells].mean(axis=1)[:, 1] > side / 2
    return replace(
        drawn, contacts=np.where(on_slit[cells] & above[:, None], cells + len(place), cells)[drawn.samples.cell]
    )


def circle(spacing, u, v, centre, arc=2 * np.pi):
    """Three Gauss points on each arc between knot planes of a unit circle spanned by u and v, or of its beginning."""
    d = len(u)
    angles = [np.zeros(1), np.array([arc])]
    for axis in range(d):
        size, phase = np.hypot(u[axis], v[axis]), np.arctan2(v[axis], u[axis])
        knots = (np.arange(-200, 200) + 0.5) * spacing - centre[axis]
        turn = np.arccos(knots[np.abs(knots) < size] / size)
        angles += [np.mod(phase + turn, 2 * np.pi), np.mod(phase - turn, 2 * np.pi)]
    angles = np.unique(np.concatenate(angles))
    angles = angles[angles <= arc]
    width = np.diff(angles)
    theta = (angles[:-1, None] + width[:, None] * GAUSS[0]).ravel()
    points = centre + np.cos(theta)[:, None] * u + np.sin(theta)[:, None] * v
    normals = [np.cos(theta)[:, None] * u + np.sin(theta)[:, None] * v]
    if d == 3:
        normals.append(np.broadcast_to(np.cross(u, v), points.shape))
    cell = np.repeat(np.arange(len(width)), 3)
    ends = np.stack([np.arange(len(width)), np.arange(1, len(width) + 1)], axis=1)
    if arc == 2 * np.pi:
        ends %= len(width)
    samples = Samples(points, (width[:, None] * GAUSS[1]).ravel(), np.stack(normals, axis=1), cell)
    return Drawn(samples, ends[cell])


def plane_circle(spacing):
    return circle(spacing, np.array([1.0, 0.0]), np.array([0.0, 1.0]), SHIFT[:2])


def space_circle(spacing):
    u, v = np.linalg.qr(np.random.default_rng(7).normal(size=(3, 2)))[0].T
    return circle(spacing, u, v, SHIFT)


def plate(thickness):
    """A unit square plate with faces, and walls round it."""
    return box([0, 0, 0], [1, 1, thickness])


def fold(degrees):
    """Two unit squares that meet at an angle."""
    x, z = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    corners = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [x, 0, z], [x, 1, z]])
    return corners, np.array([[0, 2, 3], [0, 3, 1], [0, 1, 5], [0, 5, 4]])
