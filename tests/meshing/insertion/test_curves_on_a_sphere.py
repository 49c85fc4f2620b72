"""Curves cut a sphere into as many zones as topology says, with a tip at each end, however far off they are drawn."""

import numpy as np
import pytest
from cut_meshes import check_sound, cut, great_circles, icosphere, mean_edge, polyline, zones_and_tips

import cpmkit as ck

SPHERE = icosphere(4)
TURN = 2 * np.pi * np.arange(200) / 200
RING = polyline(np.stack([0.8 * np.cos(TURN), 0.8 * np.sin(TURN), np.full(200, 0.6)], axis=1), closed=True)
ARCH = polyline(np.stack([np.cos(TURN[:100]), np.full(100, 0.1), np.sin(TURN[:100])], axis=1))


@pytest.mark.parametrize(
    ("sources", "expected"),
    [([RING], (2, 0)), ([ARCH], (1, 2)), ([RING, ARCH], (3, 2)), ([ARCH, RING], (3, 2)), ([RING, RING], (2, 0))],
    ids=["closed", "open", "closed then open", "open then closed", "the same twice"],
)
def test_zones_and_tips(sources, expected):
    after = cut(SPHERE, *sources).mesh
    assert zones_and_tips(after) == expected
    check_sound(SPHERE, after)


def test_an_analytic_circle_is_followed():
    result = cut(SPHERE, ck.source("analytic.circle", radius=0.8, center=[0, 0, 0.6]))
    on_it = result.mesh.vertices[np.unique(result.mesh.cut)]
    on_sphere = on_it / np.linalg.norm(on_it, axis=1)[:, None]
    assert zones_and_tips(result.mesh) == (2, 0)
    assert np.abs(on_sphere[:, 2] - 0.6).max() < 0.02 * mean_edge(SPHERE)


def test_edges_go_along_the_curve():
    mesh = cut(SPHERE, RING).mesh
    tail, head = mesh.vertices[mesh.cut[:, 0]], mesh.vertices[mesh.cut[:, 1]]
    assert (np.cross(tail, head)[:, 2] > 0).all()
    assert (np.sort(mesh.cut[:, 0]) == np.sort(mesh.cut[:, 1])).all()


def test_tips_go_on_straight_by_three_spacings():
    spacing = 1.5 * mean_edge(SPHERE)
    result = cut(SPHERE, ARCH, spacing=spacing)
    mesh, past = result.mesh, result.mesh.cut[result.mesh.beyond_tip]
    lengths = np.linalg.norm(mesh.vertices[past[:, 1]] - mesh.vertices[past[:, 0]], axis=1)
    assert result.counts["tips"] == 2
    assert lengths.sum() == pytest.approx(6 * spacing, rel=0.02)
    assert np.abs(mesh.vertices[past][..., 1] - 0.1).max() < 0.2 * spacing


def crossings(corners, closed):
    ways = list(zip(corners, [*corners[1:], corners[0]], strict=True))[: None if closed else -1]
    count = 0
    for i, (a, b) in enumerate(ways):
        for c, d in ways[i + 2 : len(ways) - (closed and i == 0)]:
            place = np.cross(np.cross(a, b), np.cross(c, d))
            count += any(_between(a, s * place, b) and _between(c, s * place, d) for s in (1, -1))
    return count


def _between(a, p, b):
    n = np.cross(a, b)
    return np.cross(a, p) @ n > 0 and np.cross(p, b) @ n > 0


def random_polygon(rng, most_off):
    """Return a polygon of great circles, points of it drawn up to ``most_off`` off the sphere, and what to expect."""
    closed = bool(rng.integers(2))
    while True:
        corners = rng.normal(size=(rng.integers(3, 8), 3)) + [0, 0, rng.choice([0, 1.5])]
        corners /= np.linalg.norm(corners, axis=1)[:, None]
        if np.einsum("nd,nd->n", corners, np.roll(corners, 1, axis=0)).min() > -0.94:
            break
    points = great_circles(corners, closed)
    off = most_off * rng.choice([0.0, 0.3, 1.0])
    waves = np.sin(rng.uniform(0.05, 2) * np.arange(len(points)))
    shift = [np.ones(len(points)), waves, rng.uniform(-1, 1, len(points))][rng.integers(3)]
    return points * (1 + off * shift)[:, None], closed, (crossings(corners, closed) + 1 + closed, 0 if closed else 2)


@pytest.mark.parametrize("seeds", [range(12), pytest.param(range(12, 40), marks=pytest.mark.slow)])
def test_random_polygons_have_the_zones_that_topology_says(seeds):
    wrong = []
    for seed in seeds:
        points, closed, expected = random_polygon(np.random.default_rng(seed), mean_edge(SPHERE))
        result = cut(SPHERE, polyline(points, closed))
        joined = result.counts.get("joined", 0) + result.counts.get("pruned", 0)
        if zones_and_tips(result.mesh) != expected and not joined:
            wrong.append((seed, zones_and_tips(result.mesh), expected))
        assert result.counts.get("disconnected", 0) == 0
        if seed % 10 == 0:
            check_sound(SPHERE, result.mesh)
    assert not wrong
