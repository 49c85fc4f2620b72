"""Curves that meet share a vertex where they meet, at any place and spacing, and solutions obey Kirchhoff's laws."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from bare import Bare

import cpmkit as ck
from cpmkit.manifold.local_source import localize
from cpmkit.mesh.subdivision import subdivide
from cpmkit.meshing.contouring.contoured_curves import contour_curve
from cpmkit.meshing.source_cells import source_cells


def segment(a, b):
    return ck.source("analytic.segment", start=list(a), end=list(b))


def arc(center, start, end):
    return ck.source("analytic.arc", center=center, radius=0.5, start=start, end=end)


CIRCLE = ck.source("analytic.circle")
TENT = ck.source("mesh.polyline", points=[[-1, 0], [0, 1], [1, 0]], closed=False)
#: Members of a union, its length, and the number of its vertices of 1, 2, 3, ... segments, apart from those of 2.
MEETING = {
    "switch": (
        [segment([-1, -0.5], [1, -0.5]), arc([1, 0], -pi / 2, pi / 2), arc([0, 0], -pi / 2, 0)],
        2 + 3 * pi / 4,
        {1: 3, 3: 1},
    ),
    "circles": ([CIRCLE, ck.source("analytic.circle", center=[1, 0.3])], 4 * pi, {4: 2}),
    "tent": ([TENT, segment([0, -1], [0, 2])], 3 + 2 * 2**0.5, {1: 4, 4: 1}),
    "chain": ([segment([k, 0], [k + 1, 0]) for k in range(3)], 3.0, {1: 2}),
    "acute": ([segment([-2, -0.08], [2, 0.08]), segment([-2, 0], [2, 0])], 4 + 4 * (1 + 0.04**2) ** 0.5, {1: 4, 4: 1}),
    "rounded": ([CIRCLE, segment([0.7071068, 0.7071068], [2, 2])], 2 * pi + 2**0.5 * 1.2928932, {1: 1, 3: 1}),
}


@pytest.mark.parametrize("spacing", [0.2, 0.1, 0.07])
@pytest.mark.parametrize("name", MEETING)
def test_meeting_curves_have_one_vertex_where_they_meet(name, spacing):
    members, length, counts = MEETING[name]
    source = localize(ck.source("union", members=members), spacing * np.array([0.3, 0.17]))
    mesh = subdivide(source_cells(source, 0.5 * spacing).mesh, 0.5 * spacing)
    segments = np.bincount(np.bincount(mesh.cells.ravel()))
    assert {k: n for k, n in enumerate(segments) if n and k != 2} == counts
    assert mesh.edge_lengths.sum() == pytest.approx(length, rel=0.05 * spacing**2)


@pytest.mark.parametrize(
    "other",
    [ck.source("analytic.circle", center=[2, 0]), CIRCLE, segment([-1, 1], [1, 1])],
    ids=["outside", "same", "line"],
)
def test_curves_that_touch_are_left_to_their_closest_points(other):
    assert source_cells(localize(ck.source("union", members=[CIRCLE, other]), np.zeros(2)), 0.05) is None


def star(seed, dim):
    """Return the centre (d,) and ends (n, d) of two to five arms, no two at less than 25 degrees."""
    rng = np.random.default_rng(seed)
    while True:
        arms = rng.normal(size=(rng.integers(2, 6), dim)) if seed % 3 else rng.integers(-1, 2, (4, dim)).astype(float)
        size = np.linalg.norm(arms, axis=1)[:, None]
        if size.min() > 0 and (np.triu(arms @ arms.T / size / size.T, 1) < 0.9).all():
            centre = rng.uniform(-1, 1, dim) if seed % 3 else np.zeros(dim)
            return centre, centre + arms / size * rng.uniform(0.6, 1.2, size.shape)


@pytest.mark.parametrize("spacing", [0.2, 0.137, 0.08])
@pytest.mark.parametrize("dim", [2, 3])
def test_linear_solutions_are_exact_on_straight_arms(dim, spacing):
    for seed in range(4):
        centre, ends = star(seed, dim)
        given = np.sin(5 * np.arange(len(ends)))
        conductances = 1 / np.linalg.norm(ends - centre, axis=1)
        inner = given @ conductances / conductances.sum()
        union = ck.source("union", members=[segment(centre, end) for end in ends])
        edge = {1000 * arm + 1: ck.Dirichlet(value) for arm, value in enumerate(given.tolist())}
        solution = ck.solve(ck.Scene(union, ck.Laplace(), edge=edge), spacing, estimate=False)
        share = np.linspace(0, 0.95, 30)[:, None]
        for end, value in zip(ends, given, strict=True):
            u = solution.evaluate(centre + share * (end - centre))
            np.testing.assert_allclose(u, inner + share[:, 0] * (value - inner), atol=1e-10)
        fluxes = [solution.flux(loop) for loop in edge]
        np.testing.assert_allclose(fluxes, (given - inner) * conductances, atol=1e-10)


@pytest.mark.parametrize(
    ("first", "second", "spacing"), [(0.5, -0.7, 0.1), (0.695, -0.853, 0.092), (0.8, 0.0, 0.2), (0.6, -0.6, 0.15)]
)
def test_arms_on_a_circle_obey_kirchhoffs_laws(first, second, spacing):
    ends = np.array([[2, first], [2, second]])
    union = ck.source("union", members=[CIRCLE, *(segment([1, 0], end) for end in ends)])
    lengths = np.linalg.norm(ends - [1, 0], axis=1)
    points = np.concatenate([[1, 0] + np.linspace(0.1, 0.9, 9)[:, None] * (end - [1, 0]) for end in ends])
    exact = (lengths[1] + np.outer([lengths[0], -lengths[1]], np.linspace(0.1, 0.9, 9)).ravel()) / lengths.sum()
    edge = [(ck.Dirichlet(1.0), lambda x: x[:, 1] > 0.5 * (first + second)), ck.Dirichlet(0.0)]
    for source, error in ((union, 1e-11), (Bare(union), 1e-3 * spacing**2)):
        solution = ck.solve(ck.Scene(source, ck.Laplace(), edge=edge), spacing, form="galerkin", estimate=False)
        assert np.abs(solution.evaluate(points) - exact).max() < error
        assert np.bincount(np.bincount(solution.discretized.sampled.mesh.cells.ravel()))[3:].tolist() == [0, 1]


def test_corners_of_a_trace_at_one_place_are_one_junction():
    arms = [[0, 0, 1.2155199], [0.73532358, -0.73532358, 0], [0, 0.9324047, 0], [-0.8368135, -0.8368135, -0.8368135]]
    source = Bare(ck.source("union", members=[segment([0, 0, 0], end) for end in arms]))
    mesh, _ = contour_curve(localize(source, np.array([-0.06946836, 0.01621169, 0.19618254])), 0.11105867)
    assert np.bincount(np.bincount(mesh.cells.ravel()))[3:].tolist() == [0, 1]
