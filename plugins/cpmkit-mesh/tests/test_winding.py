"""Faces wound against most of their component are flipped, with a warning; one-sided components stay."""

import numpy as np
import pytest
from cpmkit_mesh import triangles

import cpmkit as ck
from cpmkit.plugin import HasNormals


def moebius(columns=40, rows=4):
    """Return a strip of triangles, wound as well as may be, whose ends meet upside down."""
    angle = 2 * np.pi * np.arange(columns) / columns
    across = np.linspace(-0.3, 0.3, rows + 1)
    radius = 1 + across * np.cos(0.5 * angle)[:, None]
    height = across * np.sin(0.5 * angle)[:, None]
    points = np.stack([radius * np.cos(angle)[:, None], radius * np.sin(angle)[:, None], height], axis=-1)

    def number(i, j):
        return np.where(i < columns, i * (rows + 1) + j, rows - j)

    i, j = np.divmod(np.arange(columns * rows), rows)
    a, b, c, d = number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)
    return points.reshape(-1, 3), np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def some_reversed(faces, share, seed=0):
    flipped = faces.copy()
    which = np.random.default_rng(seed).permutation(len(faces))[: max(1, round(share * len(faces)))]
    flipped[which] = flipped[which, ::-1]
    return flipped


@pytest.mark.parametrize("share", [0.0, 0.1, 0.4])
def test_what_most_faces_call_left_is_left(sphere, share):
    points, faces = sphere(3)
    mesh = triangles(vertices=points, faces=some_reversed(faces, share))
    ring = ck.source("analytic.circle", center=[0, 0, 0.3], radius=np.sqrt(1 - 0.09), normal=[0, 0, 1])
    cut = ck.Boundary("ring", ring, left=ck.Dirichlet(1.0), right=ck.Dirichlet(0.0))
    solution = ck.solve(ck.Scene(mesh, ck.Laplace(), [cut]), 0.25)
    np.testing.assert_allclose(solution.evaluate([[0, 0, 1.0], [0, 0, -1]]), [1, 0], atol=1e-6)
    (warning,) = [text for text in solution.warnings if "wound" in text]
    assert warning.startswith(f"{max(1, round(share * 512))} of 512 triangles of the mesh were wound against most")


def test_one_reversed_face_changes_nothing_but_the_warning(sphere):
    points, faces = sphere(2)
    even, odd = (triangles(vertices=points, faces=cells) for cells in (faces, some_reversed(faces, 0)))
    assert even.advice(0.1).warnings == ()
    assert isinstance(odd, HasNormals)
    x = np.random.default_rng(1).normal(size=(300, 3))
    one, other = even.closest_point(x), odd.closest_point(x)
    np.testing.assert_allclose(one.points, other.points, atol=1e-14)
    np.testing.assert_allclose(even.normals(one), odd.normals(other), atol=1e-12)
    np.testing.assert_allclose(even.interpolate(points, one), odd.interpolate(points, other), atol=1e-14)


def test_coordinates_in_a_turned_face_are_those_of_the_face_as_given(sphere):
    points, faces = sphere(1)
    given = some_reversed(faces, 0.3)
    mesh = triangles(vertices=points, faces=given, closest="faceted")
    feet = mesh.closest_point(np.random.default_rng(1).normal(size=(300, 3)))
    np.testing.assert_allclose(
        np.einsum("nc,ncd->nd", feet.local, points[given[feet.element]]), feet.points, atol=1e-14
    )


def test_each_piece_has_its_own_majority(sphere):
    points, faces = sphere(2)
    outward, inward = faces.copy(), faces[:, ::-1].copy()
    outward[5], inward[7] = outward[5, ::-1], inward[7, ::-1]
    both = np.concatenate([points, points + [4, 0, 0]])
    mesh = triangles(vertices=both, faces=np.concatenate([outward, inward + len(points)]))
    assert "2 of 256 triangles" in mesh.advice(0.1).warnings[0]
    normals = mesh.normals(mesh.closest_point(np.array([[1.0, 0, 0], [5, 0, 0]])))
    np.testing.assert_allclose(normals, [[1, 0, 0], [-1, 0, 0]], atol=1e-2)


def test_a_strip_with_one_side_stays_as_it_is(sphere):
    points, faces = moebius()
    mesh = triangles(vertices=points, faces=faces)
    assert not isinstance(mesh, HasNormals)
    np.testing.assert_array_equal(mesh.repaired.given_faces, faces)
    assert [text for text in mesh.advice(0.1).warnings if "one-sided, as a Moebius strip" in text]
    ball, cells = sphere(1)
    cells = some_reversed(cells, 0)
    both = triangles(vertices=np.concatenate([points, ball + 9]), faces=np.concatenate([faces, cells + len(points)]))
    assert [text.split(" ")[0] for text in both.advice(0.1).warnings][:2] == [
        "1",
        "A",
    ]  # the ball is mended all the same
