"""Which cells are left of a boundary: whatever the windings, named by the scene once for each piece of the boundary."""

from dataclasses import replace

import numpy as np
import pytest
from bare import Bare
from cylinder_problems import AXIS, CUT, LENGTH, RADIUS, cylinder_mesh, local, placed
from small_galerkin import small

import cpmkit as ck
from cpmkit.plugin import Mesh

SPACING = 0.2
SURFACE = ck.source("analytic.cylinder", axis=AXIS, radius=RADIUS, length=LENGTH)
UNLIKE = {"left": ck.Dirichlet(1.0), "right": ck.Dirichlet(0.0)}


def ring(normal=AXIS):
    return ck.source("analytic.circle", center=(CUT - 0.5 * LENGTH) * AXIS, normal=normal, radius=RADIUS)


def solved(mesh, boundary, surface=SURFACE, **points):
    scene = ck.Scene(surface, ck.ScreenedPoisson(0.0, 1.0), [boundary])
    return small(scene, mesh, SPACING, 0.3 * SPACING * np.arange(3), **points)


def is_above(one):
    """Which boundary samples belong to cells above the cut: their conormals point down."""
    return one.conditions.samples.conormals @ AXIS < 0


def shuffled(mesh, seed=0):
    """The same triangles, each wound at random."""
    turned = np.random.default_rng(seed).random(len(mesh.cells)) < 0.5
    order = np.where(turned[:, None], [0, 2, 1], [0, 1, 2])
    cells = np.take_along_axis(mesh.cells, order, axis=1)
    return replace(mesh, cells=cells, midpoints=np.take_along_axis(mesh.midpoints, order[..., None], axis=1))


@pytest.mark.parametrize("mesh", [cylinder_mesh(2 * SPACING), shuffled(cylinder_mesh(2 * SPACING))])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_left_is_what_the_sources_say(mesh, sense):
    one = solved(mesh, ck.Boundary("cut", ring(sense * AXIS), **UNLIKE))
    assert (one.left == (is_above(one) == (sense > 0))).all()


@pytest.mark.parametrize("height", [0.1, 0.9])
def test_left_of_names_it_where_the_sources_do_not(height):
    point = placed(height, 1.0)
    boundary = ck.Boundary("cut", Bare(ring()), left_of=point, **UNLIKE)
    one = solved(shuffled(cylinder_mesh(2 * SPACING)), boundary, Bare(SURFACE))
    assert (one.left == (is_above(one) == (height > CUT))).all()


def test_a_crooked_drawing_does_not_change_it():
    """The boundary's own source swings about the curve in the mesh by three quarters of a spacing."""
    angles = np.linspace(0, 2 * np.pi, 41)[:-1]
    swung = placed(CUT + 0.75 * SPACING * np.sin(10 * angles), angles)
    line = ck.source("mesh.polyline", points=swung, closed=True)
    one = solved(cylinder_mesh(2 * SPACING), ck.Boundary("cut", line, **UNLIKE))
    assert (one.left == is_above(one)).all()


def test_both_sides_of_a_facet_are_read_at_the_same_points():
    samples = solved(shuffled(cylinder_mesh(2 * SPACING)), ck.Boundary("cut", ring(), **UNLIKE)).conditions.samples
    order = np.lexsort((samples.place, samples.facet))
    first, second = samples.take(order[0::2]), samples.take(order[1::2])
    order = np.lexsort((samples.half, samples.place, samples.facet))
    first, second = samples.take(order[0::2]), samples.take(order[1::2])
    assert (first.points == second.points).all()
    assert np.allclose(first.conormals, -second.conormals, atol=1e-3)
    height, _ = local(samples.points + 0.3 * SPACING * np.arange(3))
    assert np.allclose(height, CUT)
    assert samples.weights.sum() / 2 == pytest.approx(2 * np.pi * RADIUS, rel=1e-5)
    assert np.abs(samples.conormals @ AXIS) == pytest.approx(1.0, abs=1e-3)
    assert np.abs(np.einsum("bcd,bd->bc", samples.normals, samples.conormals)).max() < 1e-14


def test_crossing_curves_have_each_its_own_sides():
    """A line along the cylinder crosses the ring: the ring falls in two pieces, each with the same left."""
    mesh = cylinder_mesh(2 * SPACING)
    z, angle = local(mesh.vertices)
    along = np.flatnonzero(np.isclose(np.mod(angle + 1e-9, 2 * np.pi), 0, atol=1e-6))
    along = along[np.argsort(z[along])]
    line = np.stack([along[:-1], along[1:]], axis=1)
    owner = np.concatenate([mesh.owner, np.ones(len(line), dtype=np.int64)])
    mesh = replace(mesh, cut=np.concatenate([mesh.cut, line]), owner=owner, beyond_tip=owner > 1)
    segment = ck.source("analytic.segment", start=placed(0.0, 0.0), end=placed(LENGTH, 0.0))
    cuts = [ck.Boundary("ring", ring(), **UNLIKE), ck.Boundary("line", segment, **UNLIKE)]
    scene = ck.Scene(SURFACE, ck.ScreenedPoisson(0.0, 1.0), cuts)
    one = small(scene, shuffled(mesh), SPACING)
    samples = one.conditions.samples
    on = samples.owner == 0
    assert (one.left[on] == is_above(one)[on]).all()
    onward = samples.conormals[~on] @ (placed(0.5, 0.1) - placed(0.5, -0.1))
    assert (one.left[~on] == (onward > 0)).all()  # walking up with the head outwards, left is where angles fall


def moebius_mesh(count, rows):
    """Quadratic triangles on the strip of half width 0.35 about the unit circle, cut along its core."""
    u, v = 2 * np.pi * np.arange(count + 1) / count, np.linspace(-0.35, 0.35, 2 * rows + 1)
    number = np.arange((count + 1) * len(v)).reshape(count + 1, len(v))
    number[-1] = number[0, ::-1]
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    cells = np.concatenate([np.stack(three, axis=-1).reshape(-1, 3) for three in ((a, b, c), (a, c, d))])
    grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    corner = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    places = np.concatenate(
        [np.stack([corner[k] for k in three], axis=-2).reshape(-1, 3, 2) for three in ((0, 1, 2), (0, 2, 3))]
    )
    core = number[:, rows]
    cut = np.stack([core[:-1], core[1:]], axis=1)
    middles = on_strip(0.5 * (np.roll(places, -1, axis=1) + np.roll(places, -2, axis=1)))
    nothing = np.zeros(count, dtype=np.int64)
    return Mesh(on_strip(grid[:-1].reshape(-1, 2)), cells, middles, cut, nothing, nothing > 0)


def on_strip(places):
    u, v = places[..., 0], places[..., 1]
    radius = 1 + v * np.cos(u / 2)
    return np.stack([radius * np.cos(u), radius * np.sin(u), v * np.sin(u / 2)], axis=-1)


def test_the_core_of_a_one_sided_strip_holds_on_both_its_sides():
    strip = ck.source("parametric.moebius")
    boundary = ck.Boundary("core", ck.source("analytic.circle", normal=[0, 0, 1]), both=ck.Dirichlet(2.0))
    one = solved(moebius_mesh(80, 4), boundary, strip)
    samples = one.conditions.samples
    assert (np.bincount(samples.facet) == 2 * 6).all()
    assert one.definite()
    u = one.solved()[:, 0]
    away = np.hypot(np.hypot(*one.points[:, :2].T) - 1, one.points[:, 2])
    assert np.abs(u - 2 * np.cosh(0.35 - away) / np.cosh(0.35)).max() < 0.02  # that of a straight strip, nearly


def fan(angles, count):
    """Half planes that leave one axis at several angles, cut along the axis."""
    x = np.linspace(0, 1, count + 1)
    axis = np.stack([x, 0 * x, 0 * x], axis=1)
    vertices, cells, start = [axis], [], len(x)
    for angle in angles:
        across = np.array([0.0, np.cos(angle), np.sin(angle)])
        vertices += [axis + y * across for y in x[1:]]
        number = np.concatenate([np.arange(len(x)), start + np.arange(count * len(x))]).reshape(count + 1, len(x))
        start += count * len(x)
        a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
        cells += [np.stack(three, axis=-1).reshape(-1, 3) for three in ((a, b, c), (a, c, d))]
    cut = np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)
    nothing = np.zeros(count, dtype=np.int64)
    return Mesh(np.concatenate(vertices), np.concatenate(cells), None, cut, nothing, nothing > 0)


@pytest.mark.parametrize("angles", [(0.3,), (0.3, 2.0), (0.3, 2.0, 4.5), (0.3, 1.4, 2.9, 4.4, 5.6)])
def test_a_boundary_where_sheets_meet_and_on_a_rim_holds_on_each_of_them(angles):
    """u = cosh(1 - y) / cosh(1) on each sheet, y the distance from the axis: 1 there, no slope at the far rim."""
    sheets = [
        ck.source("mesh.triangles", vertices=part.vertices, faces=part.cells, closest="faceted")
        for part in (fan((angle,), 2) for angle in angles)
    ]
    surface = sheets[0] if len(sheets) == 1 else ck.source("union", members=sheets)
    line = ck.source("analytic.segment", start=[0, 0, 0], end=[1, 0, 0])
    one = solved(fan(angles, 20), ck.Boundary("axis", line, both=ck.Dirichlet(1.0)), surface)
    assert (np.bincount(one.conditions.samples.facet) == 6 * len(angles)).all()
    y = np.hypot(*one.points[:, 1:].T)
    assert np.abs(one.solved()[:, 0] - np.cosh(1 - y) / np.cosh(1)).max() < 1e-3
