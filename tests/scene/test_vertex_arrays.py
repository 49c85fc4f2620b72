"""Arrays with one row a vertex of the surface are values at vertices, wherever data are taken; lists are channels."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.errors import SceneError

pandas = pytest.importorskip("pandas")
VERTICES, FACES = ck.source("analytic.sphere").mesh(0.4)
MESH = ck.source("mesh.triangles", vertices=VERTICES, faces=FACES)
HEIGHT = VERTICES[:, 2]
RING = ck.source("analytic.circle", normal=[0, 0, 1])


def is_height(datum):
    return isinstance(datum, ck.VertexData) and np.allclose(datum(VERTICES), HEIGHT)


@pytest.mark.parametrize("array", [HEIGHT, pandas.Series(HEIGHT)], ids=["NumPy", "pandas"])
def test_one_value_a_vertex_is_one_channel_of_all_data(array):
    heat = ck.Scene((VERTICES, FACES), ck.Heat(array, until=1.0, step=0.5, f=array))
    assert heat.channels == 1
    assert is_height(heat.problem.initial)
    assert is_height(heat.problem.f)
    ring = ck.Boundary("ring", RING, left=array, right=ck.Neumann(array))
    scene = ck.Scene(
        MESH, ck.ScreenedPoisson(array), [ring], edge=[(ck.Dirichlet(array), "x < 0"), ck.Robin(1, 2, array)]
    )
    assert scene.channels == 1
    boundary, (first, second) = scene.boundaries[0], (part.condition for part in scene.edge.parts)
    for datum in (boundary.left.value, boundary.right.flux, first.value, second.gamma, scene.problem.f):
        assert is_height(datum)


def test_a_solution_takes_values_at_vertices():
    """-Lap u + u = 3 z on the unit sphere is solved by u = z."""
    found = ck.solve(ck.Scene(MESH, ck.ScreenedPoisson(3 * HEIGHT)), spacing=0.3).evaluate([[0, 0, 1.0]])
    assert found.shape == (1,)
    assert abs(found[0] - 1) < 0.05


def test_one_row_a_vertex_has_channels():
    scene = ck.Scene(MESH, ck.ScreenedPoisson(np.column_stack([HEIGHT, -HEIGHT])))
    assert scene.channels == 2
    np.testing.assert_allclose(scene.problem.f(VERTICES), np.column_stack([HEIGHT, -HEIGHT]))


def test_both_sides_with_one_array_need_no_left():
    boundary = ck.Boundary("ring", RING, left=ck.Dirichlet(HEIGHT), right=ck.Dirichlet(HEIGHT))
    kept = ck.Scene(MESH, ck.Laplace(), [boundary]).boundaries[0]
    assert kept.left is kept.right


@pytest.mark.parametrize("channels", [[0.1, 0.2, 0.3], np.array([0.1, 0.2, 0.3]), [0.1] * 16])
def test_lists_and_short_arrays_are_channels(channels):
    assert ck.Scene(MESH, ck.ScreenedPoisson(channels)).channels == len(channels)


def test_a_tensor_is_a_tensor_on_a_mesh_of_three_vertices():
    triangle = (np.eye(3), [[0, 1, 2]])
    assert ck.Scene(triangle, ck.Elliptic(1.0, diffusivity=np.eye(3))).has_tensor


@pytest.mark.parametrize(
    ("surface", "array", "message"),
    [
        (
            MESH,
            np.ones(len(FACES)),
            f"f of screened is an array of shape .{len(FACES)},., and the surface has {len(VERTICES)}",
        ),
        (MESH, np.ones(17), "is an array of shape .17,., and the surface has .* vertices; give one row a vertex"),
        (ck.source("analytic.sphere"), np.ones(17), r"carries no values; .* points X, ck.VertexData\(ck.source\("),
        ((np.eye(3), [[0, 1, 2]]), np.ones(3), "which may be one value a vertex of the surface or as many channels"),
    ],
)
def test_an_array_that_is_neither_or_both_is_refused(surface, array, message):
    with pytest.raises(ck.CpmkitError, match=message):
        ck.Scene(surface, ck.ScreenedPoisson(array))


@pytest.mark.parametrize(
    "make",
    [
        lambda: ck.Elliptic("z", diffusivity=np.tile(np.eye(3), (100, 1, 1)), c=1.0),
        lambda: ck.Elliptic("z", diffusivity=pandas.Series(HEIGHT)),
        lambda: ck.Elliptic("z", c=np.ones(100)),
        lambda: ck.Scene(MESH, ck.Laplace(), edge=pandas.DataFrame(np.ones((40, 3)))),
    ],
)
def test_a_refusal_of_an_array_is_one_line_that_names_what_is_accepted(make):
    with pytest.raises(ck.CpmkitError) as refused:
        make()
    text = str(refused.value)
    assert len(text.splitlines()) == 1
    assert len(text) < 320
    assert "ck.VertexData" in text


def test_arrays_of_any_kind_are_shortened_in_messages():
    for value in (np.ones((50, 3)), pandas.Series(np.ones(50)), pandas.DataFrame(np.ones((50, 3)))):
        with pytest.raises(ck.CpmkitError) as refused:
            ck.source("analytic.sphere", radius=value)
        assert len(str(refused.value).splitlines()) == 1
        assert f"{type(value).__name__} of shape {value.shape}" in str(refused.value)


@pytest.mark.parametrize("surface", [MESH, ck.source("analytic.sphere")])
def test_a_long_list_of_numbers_is_no_list_of_channels(surface):
    """One number a vertex in a list would become as many channels."""
    with pytest.raises(SceneError, match=r"f of screened is a list of 17 entries, .* as an array of NumPy, or"):
        ck.Scene(surface, ck.ScreenedPoisson([1.0] * 17))
    many = [lambda x, k=k: x[:, 0] + k for k in range(17)]
    assert ck.Scene(surface, ck.ScreenedPoisson(many)).channels == 17
