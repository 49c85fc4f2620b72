"""Signed distance from a ring round Spot against the exact one, and against the signed heat method on the mesh.

Run ``python benchmarks/signed_distances.py [SPACING ...]``; it needs ``pip install . ./plugins/*``, potpourri3d and
pygeodesic, and ``CPMKIT_DATA`` set to a folder with spot.obj. It prints the mean error and the largest as shares of the
mean distance, in percent, the share of vertices with the wrong sign, and seconds of processor time.
"""

from __future__ import annotations

import sys
from time import process_time

import numpy as np

import cpmkit as ck
from cpmkit.applications import signed_distance
from cpmkit.studies.tables import table_row, table_rule

HEADER = ["method", "spacing", "unknowns", "mean error, %", "largest, %", "wrong signs, %", "seconds"]
#: Where a plane across the body cuts Spot in one ring.
HEIGHT = 0.41
SPACINGS = (0.0635, 0.0355)


def ring(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the edges (k, 2) that the plane cuts, in order round the ring, and where (k,), from 0 to 1 along each."""
    above = vertices[:, 2] - HEIGHT
    beside: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for face in faces.tolist():
        sides = [tuple(sorted((face[i], face[i - 1]))) for i in range(3)]
        cut = [side for side in sides if above[side[0]] * above[side[1]] < 0]
        if cut:
            beside.setdefault(cut[0], []).append(cut[1])
            beside.setdefault(cut[1], []).append(cut[0])
    way = [next(iter(beside))]
    while ahead := [side for side in beside[way[-1]] if side not in way]:
        way.append(ahead[0])
    edges = np.array(way)
    return edges, above[edges[:, 0]] / (above[edges[:, 0]] - above[edges[:, 1]])


def split(faces: np.ndarray, edges: np.ndarray, first: int) -> np.ndarray:
    """Return the triangles parted along the ring, whose points are the vertices from ``first`` on."""
    number = {tuple(edge): first + k for k, edge in enumerate(edges.tolist())}
    found = []
    for face in faces.tolist():
        cut = [number.get(tuple(sorted((face[i], face[(i + 1) % 3])))) for i in range(3)]
        if cut.count(None) != 1:
            found.append(face)
            continue
        i = cut.index(None)
        x, y, w = face[i], face[(i + 1) % 3], face[(i + 2) % 3]
        b, a = cut[(i + 1) % 3], cut[(i + 2) % 3]
        found += [[w, a, b], [a, x, y], [a, y, b]]
    return np.array(found)


def by_signed_heat(vertices: np.ndarray, faces: np.ndarray, edges: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return potpourri3d's distance at the vertices; it numbers edges in the order in which faces have them."""
    from potpourri3d import MeshSignedHeatSolver

    number: dict[tuple[int, int], tuple[int, bool]] = {}
    for face in faces.tolist():
        for i in range(3):
            side = (face[i], face[(i + 1) % 3])
            number.setdefault(tuple(sorted(side)), (len(number), side[0] < side[1]))
    curve = []
    for edge, share in zip(edges.tolist(), at.tolist(), strict=True):
        which, forwards = number[tuple(edge)]
        curve.append((which, [share if forwards else 1 - share]))
    return np.asarray(MeshSignedHeatSolver(vertices, faces).compute_distance([[*curve, curve[0]]], [True]))


def main() -> None:
    """Print the table."""
    from pygeodesic.geodesic import PyGeodesicAlgorithmExact

    vertices, faces = ck.read_mesh("spot.obj")
    edges, at = ring(vertices, faces)
    points = (1 - at)[:, None] * vertices[edges[:, 0]] + at[:, None] * vertices[edges[:, 1]]
    all_points = np.concatenate([vertices, points])
    exactly = PyGeodesicAlgorithmExact(all_points, split(faces, edges, len(vertices)))
    far = exactly.geodesicDistances(np.arange(len(vertices), len(all_points)))[0][: len(vertices)]
    exact = far * np.sign(vertices[:, 2] - HEIGHT)

    def row(method: str, spacing: str, unknowns: int, found: np.ndarray, seconds: float) -> str:
        found = found * np.sign(found @ exact)
        error, wrong = np.abs(found - exact) / far.mean(), (found * exact < 0).mean()
        numbers = [f"{100 * one:.2g}" for one in (error.mean(), error.max(), wrong)]
        return table_row([method, spacing, f"{unknowns:,}", *numbers, f"{seconds:.2g}"])

    print(table_row(HEADER))
    print(table_rule(1, len(HEADER) - 1))
    began = process_time()
    theirs = by_signed_heat(vertices, faces, edges, at)
    print(row("signed heat method on the mesh", "", len(vertices), theirs, process_time() - began), flush=True)
    surface = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="faceted")
    curve = ck.source("mesh.polyline", points=np.concatenate([points, points[:1]]))
    for spacing in [float(one) for one in sys.argv[1:]] or SPACINGS:
        for method in ("heat", "transport"):
            began = process_time()
            distance = signed_distance(surface, curve, spacing=spacing, method=method)
            seconds, found = process_time() - began, distance.evaluate(vertices)
            print(row(method, f"{spacing:g}", distance.solution.discretized.size, found, seconds), flush=True)


if __name__ == "__main__":
    main()
