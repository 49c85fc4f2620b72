"""Triangulations of bare surfaces, and u on them, judged by exact areas, the shape's topology and finite elements."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field

import numpy as np
from meshing.contouring.measures import area, pieces, topology
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import splu
from scipy.spatial import KDTree

import cpmkit as ck
from cpmkit.errors import CpmkitError
from cpmkit.meshing.contouring.contoured_surfaces import contour_surface
from cpmkit.meshing.curved_from_points import curve_cells_by_closest_points
from cpmkit.meshing.mesh_warnings import contouring_warnings
from cpmkit.plugin import Mesh, localize

#: A measure off by more than this share is wrong; an open edge farther than this share of the spacing from a rim.
MEASURE, OFF_RIM = 0.02, 0.3
#: The root mean square of u's error that is wrong, as a share of its range, where another origin is so much better.
U_ERROR, U_WORSE = 0.01, 4.0


@dataclass(frozen=True)
class Verdict:
    """What is wrong with a case, what was said about it, how many queries it took, and the error of u."""

    name: str
    faults: list = field(default_factory=list)
    warnings: list = field(default_factory=list)
    queries: int = 0
    u_error: float = 0.0

    @property
    def wrong(self):
        return bool(self.faults)

    @property
    def silent(self):
        return self.wrong and not self.warnings


@dataclass(frozen=True)
class Truth:
    """The topology of a shape and where its rims are, by a mesh of it."""

    components: int
    rims: int
    euler: int
    branches: bool
    rim_points: np.ndarray

    @classmethod
    def of(cls, shape, size):
        vertices, cells = shape.mesh(size / 40)
        mesh = Mesh.of(vertices, cells)
        edges, count = np.unique(np.sort(mesh.facets.reshape(-1, 2), axis=1), axis=0, return_counts=True)
        alone = vertices[edges[count == 1]]
        share = np.linspace(0, 1, 9)[:, None, None]
        points = (share * alone[None, :, 0] + (1 - share) * alone[None, :, 1]).reshape(-1, 3)
        return cls(*topology(mesh), bool((count > 2).any()), points)


def judge(case, truth=None):
    """Return what is wrong with the triangulation of a case."""
    low, high = case.source.bounds
    truth = truth or Truth.of(case.source.shape, (high - low).max())
    seen = localize(case.source, case.origin)
    try:
        mesh, report = contour_surface(seen, case.spacing)
        mesh = curve_cells_by_closest_points(mesh, seen)
    except CpmkitError as error:
        return Verdict(case.name, ["refused"], [str(error)], seen.queries["points"])
    faults = []
    share = area(mesh) / case.source.shape.area - 1
    if abs(share) > MEASURE:
        faults.append(f"area {share:+.1%}")
    edges, count = np.unique(np.sort(mesh.facets.reshape(-1, 2), axis=1), axis=0, return_counts=True)
    euler = len(np.unique(mesh.cells)) - len(edges) + len(mesh.cells)
    for label, found, true in (
        ("components", pieces(edges), truth.components),
        ("rims", pieces(edges[count == 1]), truth.rims),
        ("Euler characteristic", euler, truth.euler),
    ):
        if found != true:
            faults.append(f"{label} {found} not {true}")
    middles = mesh.vertices[edges[count == 1]].mean(axis=1) + case.origin
    if len(middles):
        gap = KDTree(truth.rim_points).query(middles)[0] if len(truth.rim_points) else np.full(len(middles), np.inf)
        if (gap > OFF_RIM * case.spacing).any():
            faults.append(f"{(gap > OFF_RIM * case.spacing).sum()} open edges off rims")
    if (count > 2).any() and not truth.branches:
        faults.append(f"{(count > 2).sum()} crowded edges")
    return Verdict(case.name, faults, list(contouring_warnings(report, seen)), seen.queries["points"])


def load(x):
    return np.exp(x[:, 0]) + np.sin(2 * x[:, 1] - x[:, 2])


def reference(shape, size):
    """Return points of a shape, their share of its area, and u of -Laplace u + u = f there, by linear elements."""
    vertices, cells = shape.mesh(size / 70)
    corners = vertices[cells]
    twice = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    stiffness = []
    for j in range(3):
        a, b = corners[:, (j + 1) % 3] - corners[:, j], corners[:, (j + 2) % 3] - corners[:, j]
        stiffness.append(-0.5 * (a * b).sum(axis=1) / twice)
    first = np.concatenate([cells[:, 1], cells[:, 2], cells[:, 0]])
    second = np.concatenate([cells[:, 2], cells[:, 0], cells[:, 1]])
    off, mass = np.concatenate(stiffness), np.tile(twice / 24, 3)
    n = len(vertices)

    def symmetric(values):
        matrix = coo_array((values, (first, second)), shape=(n, n)).tocsc()
        return matrix + matrix.T

    weight = np.bincount(cells.ravel(), np.repeat(twice / 6, 3), minlength=n)
    k, m = symmetric(off), symmetric(mass)
    k = k - _diagonal(k.sum(axis=1))
    m = m + _diagonal(weight / 2)
    return vertices, weight / weight.sum(), splu(csc_array(k + m)).solve(m @ load(vertices))


def _diagonal(values):
    n = len(values)
    return coo_array((values, (np.arange(n), np.arange(n))), shape=(n, n)).tocsc()


def error_of_u(case, truth):
    """Return the error of u over its range, and what was said: root mean square over every seventh vertex."""
    points, weight, u = truth
    scene = ck.Scene(case.source, ck.ScreenedPoisson(load))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        solution = ck.solve(scene, case.spacing, form="galerkin", origin=case.origin, estimate=False)
    error = solution.evaluate(points[::7]) - u[::7]
    return float(np.sqrt((weight[::7] * error**2).sum() / weight[::7].sum()) / np.ptp(u)), list(solution.warnings)


def judge_three(cases, with_u):
    """Return the verdicts on the three origins of a draw."""
    low, high = cases[0].source.bounds
    size = (high - low).max()
    truth = Truth.of(cases[0].source.shape, size)
    verdicts = [judge(case, truth) for case in cases]
    if not with_u:
        return verdicts
    exact, errors, said = reference(cases[0].source.shape, size), [], []
    for case in cases:
        try:
            error, sentences = error_of_u(case, exact)
        except CpmkitError as refusal:
            error, sentences = np.inf, [str(refusal)]
        errors.append(error)
        said.append(sentences)
    judged = []
    for verdict, error, sentences in zip(verdicts, errors, said, strict=True):
        bad = error > U_ERROR and (error > U_WORSE * min(errors) or not np.isfinite(error))
        faults = verdict.faults + ([f"u {error:.2%}, best {min(errors):.2%}"] if bad else [])
        judged.append(Verdict(verdict.name, faults, verdict.warnings + sentences, verdict.queries, error))
    return judged
