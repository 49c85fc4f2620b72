"""Logarithmic maps and transported vectors on a mesh, against its shortest ways and the vector heat method on meshes.

Run ``python benchmarks/logarithms.py``; it needs ``pip install . ./plugins/* potpourri3d pygeodesic``, and
``CPMKIT_DATA`` set to a folder with spot.obj. It prints the rows of tables/logarithms.md: by distance, the mean
angle between what is transported and the exact one, in degrees, and the mean error of logarithms as a share of the
distance, in percent; over several points, all by the same ways. Along a shortest way over facets a vector keeps its
angle to the way. Angles round a vertex are those of its triangles, scaled to a full turn, as potpourri3d has them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

import cpmkit as ck
from cpmkit.applications import logarithmic_map
from cpmkit.studies.tables import table_row, table_rule

HEADER = ["method", "spacing", "unknowns", "distance", "ways", "angle, degrees", "logarithm, %"]
#: Points that vectors start from, and how many vertices in each range of distances, on Spot, which is 1.8 long.
STARTS, TARGETS = 3, 25
RANGES = ((0.1, 0.25), (0.25, 0.5), (0.5, 0.8))


@dataclass(frozen=True, eq=False)
class Mesh:
    """A closed mesh with the angles round its vertices.

    Attributes
    ----------
    vertices : (n, 3) float64
        Of it.
    faces : (m, 3) int64
        Of it, all seen counter-clockwise from outside.
    """

    vertices: np.ndarray
    faces: np.ndarray

    @cached_property
    def _rings(self) -> dict[int, tuple[np.ndarray, np.ndarray]]:
        return {}

    def ring(self, vertex: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the neighbours (k,) of a vertex in turn, the first not repeated, and their scaled angles (k + 1,)."""
        if vertex not in self._rings:
            self._rings[vertex] = self._ring(vertex)
        return self._rings[vertex]

    def _ring(self, vertex: int) -> tuple[np.ndarray, np.ndarray]:
        following = {}
        for face in self.faces[(self.faces == vertex).any(axis=1)]:
            at = int(np.flatnonzero(face == vertex)[0])
            following[int(face[(at + 1) % 3])] = int(face[(at + 2) % 3])
        ring = [min(following)]
        while following[ring[-1]] != ring[0]:
            ring.append(following[ring[-1]])
        spokes = self.vertices[[*ring, ring[0]]] - self.vertices[vertex]
        spokes /= np.linalg.norm(spokes, axis=1, keepdims=True)
        corners = np.arccos(np.clip((spokes[:-1] * spokes[1:]).sum(axis=1), -1, 1))
        angles = np.concatenate([[0.0], np.cumsum(corners)])
        return np.array(ring), 2 * np.pi * angles / angles[-1]

    def angle(self, vertex: int, towards: np.ndarray) -> float:
        """Return the angle of a direction (3,) in one of the triangles at a vertex."""
        ring, angles = self.ring(vertex)
        spokes = self.vertices[[*ring, ring[0]]] - self.vertices[vertex]
        best, found = np.inf, 0.0
        for k in range(len(ring)):
            pair = spokes[k : k + 2].T
            shares = np.linalg.lstsq(pair, towards, rcond=None)[0]
            off = float(np.linalg.norm(pair @ np.maximum(shares, 0) - towards))
            if off < best:
                one, other = spokes[k], pair @ np.maximum(shares, 0)
                whole = _between(spokes[k], spokes[k + 1])
                best, found = off, angles[k] + (angles[k + 1] - angles[k]) * _between(one, other) / whole
        return found

    def frame(self, vertex: int, normal: np.ndarray) -> np.ndarray:
        """Return (2, 3) orthonormal tangents at a vertex: the first spoke, laid down, and what is left of it."""
        first = self.vertices[self.ring(vertex)[0][0]] - self.vertices[vertex]
        first = first - normal * (normal @ first)
        first /= np.linalg.norm(first)
        return np.stack([first, np.cross(normal, first)])


def _between(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


@dataclass(frozen=True)
class Ways:
    """Shortest ways from a vertex to others.

    Attributes
    ----------
    start : int
        The vertex.
    ends : (k,) int64
        The others.
    lengths, leaving, arriving : (k,) float64
        How long each is; its angle at the start, and at its end, where it would go on.
    """

    start: int
    ends: np.ndarray
    lengths: np.ndarray
    leaving: np.ndarray
    arriving: np.ndarray


def ways_from(mesh: Mesh, start: int, rng: np.random.Generator) -> Ways:
    """Return exact shortest ways to vertices in all `RANGES`."""
    from pygeodesic.geodesic import PyGeodesicAlgorithmExact

    exact = PyGeodesicAlgorithmExact(mesh.vertices, mesh.faces)
    far = exact.geodesicDistances([start])[0]
    ends = np.concatenate(
        [rng.choice(np.flatnonzero((far > a) & (far < b)), TARGETS, replace=False) for a, b in RANGES]
    )
    leaving, arriving = [], []
    for end in ends.tolist():
        way = np.asarray(exact.geodesicDistance(start, end)[1])
        way = way if np.allclose(way[0], mesh.vertices[start]) else way[::-1]
        way = way[np.append(True, np.linalg.norm(np.diff(way, axis=0), axis=1) > 1e-9)]
        leaving.append(mesh.angle(start, way[1] - way[0]))
        arriving.append(mesh.angle(end, way[-2] - way[-1]) + np.pi)
    return Ways(start, ends, far[ends], np.array(leaving), np.array(arriving))


#: Transported angles (k,) in the frames at the ends, and logarithms (k, 2) in that at the start, of some ways.
Measure = Callable[[Ways], tuple[np.ndarray, np.ndarray]]


def by_mesh(mesh: Mesh) -> Measure:
    """Return what measures by potpourri3d."""
    from potpourri3d import MeshVectorHeatSolver

    solver = MeshVectorHeatSolver(mesh.vertices, mesh.faces)
    x, y, normals = solver.get_tangent_frames()

    def turned(vertex: int) -> float:
        """Return the angle of our first tangent in its frame."""
        first = mesh.frame(vertex, normals[vertex])[0]
        return float(np.arctan2(first @ y[vertex], first @ x[vertex]))

    def measure(ways: Ways) -> tuple[np.ndarray, np.ndarray]:
        own = turned(ways.start)
        moved = solver.transport_tangent_vector(ways.start, [np.cos(own), np.sin(own)])[ways.ends]
        angles = np.arctan2(moved[:, 1], moved[:, 0]) - [turned(one) for one in ways.ends.tolist()]
        logarithms = solver.compute_log_map(ways.start)[ways.ends]
        turn = np.array([[np.cos(own), np.sin(own)], [-np.sin(own), np.cos(own)]])
        return angles, logarithms @ turn.T

    return measure


def by_splines(mesh: Mesh, prepared: Any) -> Measure:
    """Return what measures by cpmkit."""
    from potpourri3d import MeshVectorHeatSolver

    normals = MeshVectorHeatSolver(mesh.vertices, mesh.faces).get_tangent_frames()[2]

    def measure(ways: Ways) -> tuple[np.ndarray, np.ndarray]:
        axes = mesh.frame(ways.start, normals[ways.start])
        found = logarithmic_map(prepared, mesh.vertices[ways.start], axis=axes[0])
        points = mesh.vertices[ways.ends]
        moved = found.transported[0].evaluate(points, normalized=True)
        frames = np.array([mesh.frame(one, normals[one]) for one in ways.ends.tolist()])
        along = np.einsum("kid,kd->ki", frames, moved)
        logarithms = found.evaluate(points) * [1, np.sign(found.axes[1] @ axes[1])]
        return np.arctan2(along[:, 1], along[:, 0]), logarithms

    return measure


def rows(name: list[str], measure: Measure, all_ways: list[Ways]) -> Iterator[list[str]]:
    """Yield a row for each range of distances."""
    angles, errors, lengths = [], [], []
    for ways in all_ways:
        turned, logarithms = measure(ways)
        angles.append(np.angle(np.exp(1j * (turned - (ways.arriving - ways.leaving)))))
        exact = ways.lengths[:, None] * np.stack([np.cos(ways.leaving), np.sin(ways.leaving)], axis=1)
        errors.append(np.linalg.norm(logarithms - exact, axis=1) / ways.lengths)
        lengths.append(ways.lengths)
    off, error, length = np.abs(np.concatenate(angles)), np.concatenate(errors), np.concatenate(lengths)
    for low, high in RANGES:
        on = (length > low) & (length < high)
        numbers = [f"{np.degrees(off[on]).mean():.2g}", f"{100 * error[on].mean():.2g}"]
        yield [*name, f"{low:g} to {high:g}", str(on.sum()), *numbers]


def main() -> None:
    """Print the table."""
    vertices, faces = ck.read_mesh("spot.obj")
    mesh, rng = Mesh(vertices, faces), np.random.default_rng(1)
    all_ways = [ways_from(mesh, int(one), rng) for one in rng.choice(len(vertices), STARTS, replace=False)]
    print(table_row(HEADER))
    print(table_rule(1, len(HEADER) - 1))
    jobs: list[tuple[list[str], Measure]] = [(["mesh vector heat", "", f"{len(vertices):,}"], by_mesh(mesh))]
    source = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="faceted")
    for spacing in (0.0635, 0.045, 0.0355):
        prepared = ck.prepare(ck.Scene(source, ck.Poisson(0.0)), spacing, form="galerkin")
        jobs.append((["splines", f"{spacing:g}", f"{prepared.discretized.size:,}"], by_splines(mesh, prepared)))
    for name, measure in jobs:
        for row in rows(name, measure, all_ways):
            print(table_row(row), flush=True)


if __name__ == "__main__":
    main()
