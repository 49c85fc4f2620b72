"""Another library that names the nearest triangle agrees with the own tree up to its faults, or says what it lacks."""

import sys

import numpy as np
import pytest
from cpmkit_mesh import triangles
from cpmkit_mesh.box_tree import build_tree
from cpmkit_mesh.engines import nearest_search

from cpmkit.errors import InputError, MissingDependencyError

TRIANGLE = {"vertices": [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]]}


def importable(engine):
    """Skip with the sentence that a user would read, where the library is absent or does not load."""
    try:
        triangles(**TRIANGLE, engine=engine)
    except MissingDependencyError as error:
        pytest.skip(str(error))


def answers(mesh, x, engine, closest="faceted"):
    points, faces = mesh
    own, other = (triangles(vertices=points, faces=faces, closest=closest, engine=name) for name in ("own", engine))
    return own.closest_point(x), other.closest_point(x), other


def queries(mesh, count):
    rng = np.random.default_rng(1)
    return mesh[0][rng.integers(0, len(mesh[0]), count)] + rng.normal(size=(count, 3)) * 0.1


@pytest.mark.parametrize("offset", [0.0, 1e4])
def test_fcl_agrees(sphere, offset):
    importable("fcl")
    mesh = sphere(3)[0] * [1, 0.8, 0.5] + offset, sphere(3)[1]
    x = np.concatenate([queries(mesh, 2000), mesh[0][:50], mesh[0][mesh[1][:50]].mean(axis=1)])
    own, other, source = answers(mesh, x, "fcl")
    round_off = 1e-15 * (1 + offset)
    np.testing.assert_allclose(other.distance, own.distance, atol=4 * round_off)
    np.testing.assert_allclose(other.points, own.points, atol=1e-7 * (offset > 0) + 4 * round_off)
    assert source.exact


@pytest.mark.parametrize("offset", [0.0, 1e4])
def test_open3d_agrees_to_the_precision_of_float32(sphere, offset):
    """It names a neighbour now and then; the foot on the triangle that it names is right to rounding."""
    importable("open3d")
    mesh = sphere(3)[0] * [1, 0.8, 0.5] + offset, sphere(3)[1]
    x = queries(mesh, 20_000)
    own, other, source = answers(mesh, x, "open3d")
    excess = other.distance - own.distance
    assert -1e-15 * (1 + offset) < excess.min()
    assert excess.max() < 1e-6
    apart = np.linalg.norm(other.points - own.points, axis=1)
    assert np.mean(apart > 1e-6) < 0.02
    assert apart.max() < 0.02
    corners = mesh[0][mesh[1][other.element]]
    np.testing.assert_allclose(np.einsum("nc,nck->nk", other.local, corners), other.points, atol=1e-14 * (1 + offset))
    assert not source.exact


@pytest.mark.parametrize("engine", ["fcl", "open3d"])
def test_interpolated_normals_sit_on_top_of_any_engine(sphere, engine):
    """The walk along normals ends on the same foot, whichever neighbour it starts from."""
    importable(engine)
    mesh = sphere(3)
    own, other, _ = answers(mesh, queries(mesh, 1000), engine, closest="smooth")
    np.testing.assert_allclose(other.points, own.points, atol=1e-9)


def test_fcl_refuses_what_it_answers_wrongly():
    importable("fcl")
    with pytest.raises(InputError, match="1 of 2 triangles have no area, and fcl answers wrongly"):
        triangles(
            vertices=[[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1e-13, 0]], faces=[[0, 1, 2], [0, 1, 3]], engine="fcl"
        )


@pytest.mark.parametrize("engine", ["fcl", "open3d"])
def test_no_queries_get_no_answers(engine):
    importable(engine)
    assert triangles(**TRIANGLE, engine=engine, closest="faceted").closest_point(np.zeros((0, 3))).points.shape == (
        0,
        3,
    )


@pytest.mark.parametrize(
    ("engine", "error", "message"),
    [
        ("fcl", ModuleNotFoundError("No module", name="fcl"), r"engine = 'fcl' needs the package python-fcl: `pip"),
        ("open3d", ModuleNotFoundError("No module", name="open3d"), r"needs the package open3d: `pip install open3d`"),
        ("open3d", ModuleNotFoundError("No module", name="dash"), r"needs the package dash: `pip install dash`"),
        (
            "open3d",
            ImportError("libusb-1.0.so.0: cannot open shared object file: No such file or directory"),
            r"cannot load the system library libusb-1.0.so.0; on Debian `apt-get install libusb-1.0-0` adds it",
        ),
        (
            "open3d",
            OSError("libGL.so.1: cannot open shared object file: No"),
            r"libGL.so.1; on Debian `apt-get install libgl1`",
        ),
        ("open3d", ImportError("undefined symbol: f"), "open3d is installed but does not load: undefined symbol: f;"),
    ],
)
def test_what_a_library_lacks_is_named(monkeypatch, engine, error, message):
    """Before the first query, so that no solve stops half way."""

    class Finder:
        @staticmethod
        def find_spec(name, path=None, target=None):
            if name == engine:
                raise error

    monkeypatch.delitem(sys.modules, engine, raising=False)
    monkeypatch.setattr(sys, "meta_path", [Finder, *sys.meta_path])
    with pytest.raises(MissingDependencyError, match=message):
        triangles(**TRIANGLE, engine=engine)


def test_the_own_engine_needs_none_of_them(monkeypatch):
    for name in ("fcl", "open3d"):
        monkeypatch.setitem(sys.modules, name, None)
    assert len(nearest_search("own", build_tree(np.eye(3)[None]))(np.zeros((1, 3))).slot) == 1
    with pytest.raises(InputError, match="one of 'own', 'fcl', 'open3d', got 'cgal'"):
        triangles(**TRIANGLE, engine="cgal")
