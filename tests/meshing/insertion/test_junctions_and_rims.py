"""Crossings, branches, figures eight, coincident curves, corners and rims: what a plate is cut into."""

import numpy as np
import pytest
from cut_meshes import check_sound, cut, plate, polyline, zones_and_tips

import cpmkit as ck
from cpmkit.meshing.insertion.boundary_insertion import insert_boundaries
from cpmkit.plugin import LocalSource, Mesh, localize

PLATE = plate(30)
TURN = 2 * np.pi * np.arange(100) / 100


def line(*points, closed=False):
    return polyline([[*point, 0.0] for point in points], closed)


def around(x, y, closed=True):
    return polyline(np.stack([x, y, np.zeros(len(x))], axis=1), closed)


def circle(count=100, radius=0.3, centre=(0.5, 0.5)):
    angle = 2 * np.pi * np.arange(count) / count
    return around(centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle))


def true_circle(**keys):
    return ck.source("analytic.circle", center=[0.5, 0.5, 0.0], radius=0.3, **keys)


def turned_circle():
    circle = ck.source("analytic.circle", center=[0.0, 0.0, 0.0], radius=0.3)
    return ck.source("moved", of=circle, rotation=[0.0, 0.0, 0.5], translation=[0.5, 0.5, 0.0])


EIGHT = around(0.5 + 0.3 * np.sin(TURN) + 0.1 * np.sin(2 * TURN), 0.5 + 0.15 * np.sin(2 * TURN))
ZIGZAG = around(1 + 0.05 * np.sin(np.linspace(0, 40, 300)), np.linspace(0.1, 0.9, 300), closed=False)
CASES = {
    "X": ([line((0.2, 0.23), (0.8, 0.77)), line((0.2, 0.8), (0.83, 0.2))], (1, 4)),
    "T": ([line((0.2, 0.53), (0.8, 0.53)), line((0.5, 0.53), (0.51, 0.9))], (1, 3)),
    "T that does not quite meet": ([line((0.2, 0.53), (0.8, 0.53)), line((0.5, 0.5315), (0.51, 0.9))], (1, 3)),
    "T that goes a little too far": ([line((0.2, 0.53), (0.8, 0.53)), line((0.5, 0.5285), (0.51, 0.9))], (1, 3)),
    "Y": ([line((0.5, 0.5), end) for end in [(0.8, 0.53), (0.31, 0.9), (0.3, 0.1)]], (1, 3)),
    "eight": ([EIGHT], (3, 0)),
    "circle": ([circle()], (2, 0)),
    "two circles": ([circle(centre=(0.4, 0.5)), circle(centre=(0.6, 0.5))], (4, 0)),
    "the same circle twice": ([circle(), circle()], (2, 0)),
    "the same circle with other vertices": ([circle(100), circle(77)], (2, 0)),
    "the same true circle twice": ([true_circle(), true_circle()], (2, 0)),
    "the same true circle turned": ([true_circle(), turned_circle()], (2, 0)),
    "the same true circle reversed": ([true_circle(), true_circle(normal=[0, 0, -1])], (2, 0)),
    "corners": ([line((0.21, 0.2), (0.8, 0.21), (0.78, 0.8), (0.2, 0.79), closed=True)], (2, 0)),
    "along edges": ([line((0.2, 0.2), (0.8, 0.2), (0.8, 0.8), (0.2, 0.8), closed=True)], (2, 0)),
    "an acute corner": ([line((0.2, 0.5), (0.8, 0.51), (0.2, 0.53), closed=True)], (2, 0)),
    "ends on a rim": ([line((0.5, 0.5), (1, 0.53))], (1, 1)),
    "ends just before a rim": ([line((0.3, 0.4), (0.998, 0.53))], (1, 1)),
    "rim to rim": ([line((0, 0.4), (1, 0.53))], (2, 0)),
    "corner to corner": ([line((0, 0), (1, 1))], (2, 0)),
    "leaves over a rim": ([line((0.3, 0.4), (1.5, 0.53))], (1, 1)),
    "passes both rims": ([line((-0.3, 0.4), (1.5, 0.53))], (2, 0)),
    "circle over a rim": ([circle(centre=(1.0, 0.5))], (2, 0)),
    "circle over a corner": ([circle(centre=(1.0, 1.0))], (2, 0)),
    "circle over four rims": ([circle(radius=0.55)], (5, 0)),
    "zigzag over a rim": ([ZIGZAG], (7, 0)),
    "the rim itself": ([line((0, 0), (1, 0), (1, 1), (0, 1), closed=True)], (1, 0)),
    "part of the rim": ([line((1, 0.2), (1, 0.8))], (1, 0)),
    "along the rim, then inwards": ([line((1, 0.2), (1, 0.5), (0.5, 0.5))], (1, 1)),
    "a tenth of a spacing apart": ([line((0, 0.513), (1, 0.513)), line((0, 0.518), (1, 0.518))], (3, 0)),
    "1e-6 spacings apart": ([line((0, 0.413), (1, 0.513)), line((0, 0.413 + 5e-8), (1, 0.513 + 5e-8))], (3, 0)),
    "beside a rim": ([line((0, 0.9975), (1, 0.9975))], (2, 0)),
}


@pytest.mark.parametrize("name", CASES)
def test_zones_and_tips_of(name):
    sources, expected = CASES[name]
    after = cut(PLATE, *sources, spacing=0.05).mesh
    assert zones_and_tips(after) == expected
    check_sound(PLATE, after)


@pytest.mark.parametrize("share", [-0.01, 0.01])
@pytest.mark.parametrize("end", ["first", "last"])
def test_what_ends_beside_a_vertex_of_the_rim_does_not_go_along_the_rim(share, end):
    """Where vertices are moved later a line goes through those beside it, and its end stays where it is."""
    along = 0.4 + share / 30
    for inside, outer in [((along, 0.5), (along, 1.0)), ((along, 0.5), (along, 0.0)), ((0.5, along), (1.0, along))]:
        source = line(outer, inside) if end == "first" else line(inside, outer)
        after = insert_boundaries(PLATE, [localize(source, np.zeros(3))], 0.05, movable=True).mesh
        times = np.bincount(after.edges.of_cells.ravel())
        assert (times[after.cut_edges] == 2).all()
        assert zones_and_tips(after) == (1, 1)


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_the_unit_of_length_does_not_matter(unit):
    mesh = Mesh.of(unit * PLATE.vertices, PLATE.cells)
    sources = [ck.source("moved", of=source, scale=unit) for source in (*CASES["X"][0], circle(radius=0.55), EIGHT)]
    expected = cut(PLATE, *CASES["X"][0], circle(radius=0.55), EIGHT, spacing=0.05).mesh
    after = cut(mesh, *sources, spacing=0.05 * unit).mesh
    assert zones_and_tips(after) == zones_and_tips(expected)
    assert len(after.cut) == pytest.approx(len(expected.cut), abs=3)
    check_sound(mesh, after)


def test_a_plate_in_the_plane_is_cut_as_one_in_space():
    mesh = Mesh.of(PLATE.vertices[:, :2].copy(), PLATE.cells)
    after = cut(mesh, ck.source("analytic.circle", center=[0.5, 0.5], radius=0.3), spacing=0.05).mesh
    assert after.vertices.shape[1] == 2
    assert np.abs(np.linalg.norm(after.vertices[after.cut] - 0.5, axis=2) - 0.3).max() < 1e-3


def test_a_coincident_boundary_leaves_its_edges_to_the_first():
    result = cut(PLATE, true_circle(), turned_circle(), spacing=0.05)
    assert result.coincident == {(1, 0)}
    assert result.empty == (1,)
    assert not result.mesh.owner.any()


def test_a_boundary_far_from_the_surface_leaves_what_its_feet_are():
    result = cut(PLATE, line((2.0, 0.2), (2.0, 0.8)), circle(), spacing=0.05)
    assert result.empty == (0,)
    assert zones_and_tips(result.mesh) == (2, 0)


def test_edges_of_the_rim_are_cut_as_well():
    after = cut(PLATE, CASES["the rim itself"][0][0], spacing=0.05).mesh
    lengths = np.linalg.norm(after.vertices[after.cut[:, 0]] - after.vertices[after.cut[:, 1]], axis=1)
    assert lengths.sum() == pytest.approx(4.0, rel=1e-12)


def test_an_extension_stops_at_another_curve():
    result = cut(PLATE, line((0.3, 0.513), (0.7, 0.513)), line((0.75, 0.0), (0.75, 1.0)), spacing=0.05)
    past = result.mesh.vertices[result.mesh.cut[result.mesh.beyond_tip]][..., 0]
    assert result.counts["tips"] == 2
    assert past.max() == pytest.approx(0.75, abs=1e-9)
    assert past.min() == pytest.approx(0.15, abs=2e-3)
    assert zones_and_tips(result.mesh) == (2, 2)


def test_an_extension_stops_at_a_rim():
    after = cut(PLATE, line((0.3, 0.513), (0.9, 0.513)), spacing=0.05).mesh
    assert after.vertices[after.cut[after.beyond_tip]][..., 0].max() == pytest.approx(1.0, abs=1e-9)


def test_extensions_meet_in_a_gap():
    """Each tip goes on until it meets the other's extension, straight ahead or across."""
    for ends in [(0.46, 0.513), (0.5, 0.6), (0.47, 0.54)]:
        result = cut(PLATE, line((0.1, 0.513), (0.4, 0.513)), line(ends, (0.9, ends[1] + 0.1)), spacing=0.05)
        assert zones_and_tips(result.mesh) == (1, 4)
        check_sound(PLATE, result.mesh)


def test_an_origin_elsewhere():
    """Boundaries are asked relative to the mesh's origin, whether they can be translated or not."""
    origin, source = np.array([100.0, -50.0, 3.0]), ck.source("analytic.circle", center=[100.5, -49.5, 3], radius=0.3)
    for local in (localize(source, origin), LocalSource(source, origin)):
        after = insert_boundaries(PLATE, [local], 0.05).mesh
        assert zones_and_tips(after) == (2, 0)
        assert np.abs(np.linalg.norm(after.vertices[after.cut] - [0.5, 0.5, 0], axis=2) - 0.3).max() < 1e-3


def test_a_mesh_without_boundaries_stays():
    assert cut(PLATE).mesh is PLATE
