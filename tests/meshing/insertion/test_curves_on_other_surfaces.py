"""Curves on tori, limbs, one-sided surfaces, cubes of twelve triangles and sheets that meet: topology alone decides."""

import numpy as np
import pytest
from cut_meshes import area, check_sound, cut, moebius_band, polyline, torus, tube, zones_and_tips
from sample_shapes import box

import cpmkit as ck
from cpmkit.plugin import Mesh

TURN = 2 * np.pi * np.arange(200) / 200
TWICE = 2 * TURN
NONE = np.zeros(200)


def ring(points):
    return polyline(np.stack(points, axis=1), closed=True)


def meridian(side):
    return ring([side * (1 + 0.4 * np.cos(TURN)), NONE + 0.01, 0.4 * np.sin(TURN)])


AWAY = 1 + 0.4 * np.cos(3 * TURN)
KNOT = ring([AWAY * np.cos(2 * TURN), AWAY * np.sin(2 * TURN), 0.4 * np.sin(3 * TURN)])
HALF = 1 + 0.15 * np.cos(TWICE / 2)
CASES = {
    "meridian of a torus": (torus, [meridian(1)], (1, 0)),
    "two meridians": (torus, [meridian(1), meridian(-1)], (2, 0)),
    "knot on a torus": (
        torus,
        [KNOT],
        (1, 0),
    ),
    "core of a Moebius band": (moebius_band, [ring([np.cos(TURN), np.sin(TURN), NONE])], (1, 0)),
    "twice round a Moebius band": (
        moebius_band,
        [ring([HALF * np.cos(TWICE), HALF * np.sin(TWICE), 0.15 * np.sin(TWICE / 2)])],
        (2, 0),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_zones_and_tips_of(name):
    make, sources, expected = CASES[name]
    mesh = make()
    after = cut(mesh, *sources).mesh
    assert zones_and_tips(after) == expected
    check_sound(mesh, after)


@pytest.mark.parametrize("radius", [0.1, 0.05, 0.02])
def test_a_ring_around_a_limb_parts_it(radius):
    mesh = tube(radius, around=max(8, int(240 * radius)))
    drawn_off = ring([1.05 * radius * np.cos(TURN), 1.05 * radius * np.sin(TURN), 0.5 + 0.02 * np.sin(TURN)])
    for source in (drawn_off, ck.source("analytic.circle", center=[0, 0, 0.3], radius=radius)):
        after = cut(mesh, source).mesh
        assert zones_and_tips(after) == (2, 0)
        check_sound(mesh, after)


def test_a_curve_on_a_thin_plate_stays_on_its_side():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    faces = [(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7)] + [
        cell for k in range(4) for cell in [(k, (k + 1) % 4, 4 + (k + 1) % 4), (k, 4 + (k + 1) % 4, 4 + k)]
    ]
    vertices = np.concatenate([np.c_[square, np.zeros(4)], np.c_[square, np.full(4, 0.01)]])
    mesh = Mesh.of(vertices, np.array(faces, dtype=np.int64))
    wave = ring([0.5 + 0.3 * np.cos(TURN), 0.5 + 0.3 * np.sin(TURN), 0.0062 + 0.004 * np.sin(5 * TURN)])
    after = cut(mesh, wave, spacing=0.1).mesh
    assert zones_and_tips(after) == (2, 0)
    assert after.vertices[after.cut][..., 2].min() == pytest.approx(0.01)
    assert area(after) == pytest.approx(area(mesh), rel=1e-12)


def test_triangles_larger_than_the_spacing():
    cube = Mesh.of(*box([0] * 3, [1] * 3))
    on_top = ring([0.5 + 0.2 * np.cos(TURN), 0.5 + 0.2 * np.sin(TURN), NONE + 1])
    corner = polyline([[0, 0.3, 0], [0.3, 0, 0], [0, 0, 0.3]], closed=True)
    girdle = polyline([[0, 0, 0.3], [1, 0, 0.4], [1, 1, 0.5], [0, 1, 0.4]], closed=True)
    for sources, zones in (([on_top], 2), ([corner], 2), ([girdle], 2), ([on_top, corner, girdle], 4)):
        after = cut(cube, *sources, spacing=0.05).mesh
        assert zones_and_tips(after) == (zones, 0)
        check_sound(cube, after)


def test_a_curve_crosses_the_line_where_three_sheets_meet():
    x = np.linspace(0, 1, 13)
    sheets, first = [], 0
    vertices = [np.c_[np.zeros(13), np.zeros(13), x]]
    for angle in (0.0, 2.0, 4.2):
        away = np.c_[np.cos(angle) * x[1:], np.sin(angle) * x[1:]]
        vertices.append(np.c_[np.repeat(away, 13, axis=0), np.tile(x, 12)])
        first = 13 + len(sheets) * 12 * 13
        numbers = np.concatenate([np.arange(13)[None], first + np.arange(12 * 13).reshape(12, 13)])
        a, b, c, d = numbers[:-1, :-1], numbers[1:, :-1], numbers[1:, 1:], numbers[:-1, 1:]
        sheets.append(np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))]))
    mesh = Mesh.of(np.concatenate(vertices), np.concatenate(sheets).astype(np.int64))
    ends = [[np.cos(angle), np.sin(angle), 0.43] for angle in (0.0, 2.0, 4.2)]
    both = polyline([ends[0], [0, 0, 0.43], ends[1]])
    after = cut(mesh, both).mesh
    assert zones_and_tips(after) == (1, 0)
    assert area(after) == pytest.approx(area(mesh), rel=1e-12)
    assert zones_and_tips(cut(mesh, both, polyline([[0, 0, 0.43], ends[2]])).mesh) == (2, 0)
