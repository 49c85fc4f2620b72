"""Geodesic paths on meshes: they pass what they are told to, are as short as they should be, and say what is amiss."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from cpmkit_mesh import path, triangles

import cpmkit as ck
from cpmkit.errors import InputError, MissingDependencyError


def length(curve) -> float:
    return float(np.linalg.norm(np.diff(curve.vertices[curve.segments], axis=1), axis=2).sum())


def test_the_length_approaches_that_of_the_great_circle(sphere):
    ends, off = np.array([[1.0, 0, 0], [0, 0.6, 0.8]]), []
    for level in (2, 3, 4):
        points, faces = sphere(level)
        curve = path(vertices=points, faces=faces, through=ends)
        first, last = curve.vertices[[0, -1]]
        off.append(abs(length(curve) / np.arccos(first @ last) - 1))
        np.testing.assert_array_equal([first, last], points[[np.argmax(points @ end) for end in ends]])
    assert (np.log2(np.divide(off[:-1], off[1:])) > 1.7).all()


def test_it_passes_the_vertices_in_their_order_and_lies_on_the_mesh(sphere):
    points, faces = sphere(3)
    through = [0, 20, 40, 7]
    for closed in (False, True):
        curve = path(vertices=points, faces=faces, through=[*through, 7], closed=closed)
        places = [np.flatnonzero((curve.vertices == points[one]).all(axis=1))[0] for one in through]
        assert places == sorted(places)
        assert curve.closed == closed
        flat = triangles(vertices=points, faces=faces, closest="faceted")
        assert flat.closest_point(curve.vertices).distance.max() < 1e-12
    legs = [length(path(vertices=points, faces=faces, through=pair)) for pair in ([0, 20], [20, 40], [40, 7], [7, 0])]
    assert length(curve) == pytest.approx(sum(legs))


def test_numbers_are_those_of_the_given_vertices(sphere):
    """Though corners are split, and a vertex is of no triangle."""
    points, faces = sphere(2)
    soup = np.concatenate([[[9.0, 9, 9]], points[faces].reshape(-1, 3)])
    cells = np.arange(1, len(soup)).reshape(-1, 3)
    curve = path(vertices=soup, faces=cells, through=[5, 180])
    np.testing.assert_array_equal(curve.vertices[[0, -1]], soup[[5, 180]])
    with pytest.raises(InputError, match="vertex 0 of through is a corner of no triangle"):
        path(vertices=soup, faces=cells, through=[5, 0])


def test_a_tight_loop_ends_at_the_waist():
    count, rows = 24, np.linspace(-1, 1, 13)
    turn = 2 * np.pi * np.arange(count) / count
    points = np.array([[(1 + z * z) * np.cos(a), (1 + z * z) * np.sin(a), z] for z in rows for a in turn])
    a = np.arange(12 * count)
    b = a - a % count + (a + 1) % count
    tube = np.concatenate([np.stack([a, b, b + count], axis=1), np.stack([a, b + count, a + count], axis=1)])
    ring = [8 * count + k for k in (0, 6, 12, 18)]
    loose, tight = (path(vertices=points, faces=tube, through=ring, closed=True, tight=one) for one in (False, True))
    waist = 2 * count * np.sin(np.pi / count)
    assert length(tight) == pytest.approx(waist, rel=1e-2)
    assert length(loose) > 1.05 * waist


def test_a_tight_loop_without_a_waist_is_refused(sphere):
    """It shrinks to an edge that is passed there and back, which used to be the answer."""
    points, faces = sphere(2)
    with pytest.raises(InputError, match="the tight closed curve shrinks to a point"):
        path(vertices=points, faces=faces, through=faces[0], closed=True, tight=True)


def test_a_scene_file_takes_the_scenes_own_surface(tmp_path, sphere):
    points, faces = sphere(2)
    rows = [f"v {x} {y} {z}" for x, y, z in points] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    (tmp_path / "ball.obj").write_text("\n".join(rows))
    scene = tmp_path / "scene.toml"
    scene.write_text(
        '[surface]\nkind = "mesh.triangles"\nfile = "ball.obj"\n'
        '[[boundary]]\nname = "way"\nkind = "mesh.path"\nthrough = [0, 2, 1]\nboth = { dirichlet = 1.0 }\n'
        '[problem]\nkind = "laplace"\n'
    )
    (boundary,) = ck.load_scene(scene).scene.boundaries
    np.testing.assert_array_equal(boundary.source.vertices[[0, -1]], points[[0, 1]])


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"through": [0, 66]}, "vertices from 0 to 65, got 66"),
        ({"through": [0, -1]}, "got -1"),
        ({"through": [0.5, 1.0]}, r"whole numbers of vertices \(k,\) or points \(k, 3\), got float64"),
        ({"through": ["a", "b"]}, "array of numbers"),
        ({"through": [[0, 0]]}, r"shape \(n, 3\)"),
        ({"through": [[0, 0, 1], [0, 99.0, 0]]}, "point 1 of through is 98 from the nearest vertex of a mesh 2 across"),
        ({"through": [4]}, "at least 2 vertices .* got 1"),
        ({"through": []}, "at least 2 vertices .* got 0"),
        ({"through": [4, 5, 5, 4], "closed": True}, "at least 3 vertices .* closed curve, got 2"),
    ],
)
def test_wrong_input_is_answered_in_one_sentence(sphere, keys, message):
    points, faces = sphere(2)
    with pytest.raises(InputError, match=message):
        path(vertices=points, faces=faces, **keys)


def test_vertices_on_other_pieces_are_refused(sphere):
    points, faces = sphere(1)
    both = {"vertices": np.concatenate([points, points + 3.0]), "faces": np.concatenate([faces, faces + len(points)])}
    with pytest.raises(InputError, match="entries 0 and 2 of through lie on pieces"):
        path(**both, through=[0, 1, len(points)])


def test_edges_that_three_triangles_share_are_refused_if_they_stop_the_tracing():
    points = np.array([[0, 0, 0], [0, 0, 1], [1, 0.1, 0.5], [1, 0, 0.5], [-1, 0, 0.5]])
    with pytest.raises(InputError, match="no geodesic is traced on this mesh"):
        path(vertices=points, faces=[[0, 1, 2], [0, 1, 3], [0, 1, 4]], through=[0, 4])


def test_without_potpourri3d_it_says_what_to_install(sphere, monkeypatch):
    monkeypatch.setitem(sys.modules, "potpourri3d", None)
    points, faces = sphere(1)
    with pytest.raises(MissingDependencyError, match=r"pip install 'cpmkit-mesh\[geodesics\]'"):
        path(vertices=points, faces=faces, through=[0, 1])
