"""A point beside a gap far below the spacing is read on its own side: lips of slits, thin boxes, close sheets."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import cpmkit as ck

pytestmark = pytest.mark.filterwarnings("ignore::cpmkit.errors.CpmkitWarning")
#: c of -Lap u + c u = c s, s = 1 on one side and -1 on the other: u = s to exp(-6 d), d from where the sides meet.
SHARP, FAR = 36.0, 0.6
#: By which it is off there at these spacings; the other side's value is off by 2.
OFF = 0.15


def turned(vertices):
    axes, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    return vertices @ axes.T


def as_they_are(vertices):
    return vertices


def rows_of_triangles(count):
    """Return the triangles of a square of ``count`` squares a side, its (count + 1)^2 vertices numbered by rows."""
    i, j = (one.ravel() for one in np.meshgrid(np.arange(count), np.arange(count), indexing="ij"))
    a = i * (count + 1) + j
    b = a + count + 1
    return np.concatenate([np.stack([a, b, b + 1], axis=1), np.stack([a, b + 1, a + 1], axis=1)])


def sheet(count, height):
    x, y = (one.ravel() for one in np.meshgrid(*[np.linspace(-1, 1, count + 1)] * 2, indexing="ij"))
    return np.stack([x, y, height(x, y)], axis=1)


def slit_plate(gap, bend):
    """Return two half plates, joined along x > .5 alone, and the side of each vertex."""
    whole, faces = sheet(20, lambda x, y: bend * (x**2 - 0.5 * y**2)), rows_of_triangles(20)
    upper = whole[faces].mean(axis=1)[:, 1] > 0
    lip = np.flatnonzero((np.abs(whole[:, 1]) < 1e-9) & (whole[:, 0] < 0.5 - 1e-9))
    copies = np.arange(len(whole))
    copies[lip] = len(whole) + np.arange(len(lip))
    faces = np.where(upper[:, None], faces, copies[faces])
    vertices = np.concatenate([whole, whole[lip]])
    vertices[lip, 1], vertices[len(whole) :, 1] = gap / 2, -gap / 2
    return vertices, faces, np.sign(vertices[:, 1])


def two_sheets(count, gap, bend=0.0):
    """Return two sheets that do not touch, and the side of each vertex."""
    first = sheet(count, lambda x, y: bend * (x**2 + 0.5 * y**2) + gap / 2)
    second = first - [0.0, 0.0, gap]
    faces = rows_of_triangles(count)
    both = np.concatenate([faces, faces[:, ::-1] + len(first)])
    return np.concatenate([first, second]), both, np.repeat([1.0, -1.0], len(first))


def thin_box(gap):
    count = 12
    vertices, faces, sides = two_sheets(count, gap)
    one, places = len(vertices) // 2, np.arange((count + 1) ** 2).reshape(count + 1, count + 1)
    loop = np.concatenate([places[:-1, 0], places[-1, :-1], places[:0:-1, -1], places[0, :0:-1]])
    following = np.roll(loop, -1)
    walls = [(loop + one, following + one, following), (loop + one, following, loop)]
    return vertices, np.concatenate([faces, *(np.stack(wall, axis=1) for wall in walls)]), sides


def sharp(vertices, faces, sides, closest, spacing):
    source = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest=closest)
    return ck.solve(ck.Scene(source, ck.ScreenedPoisson(SHARP * sides, c=SHARP)), spacing, form="galerkin")


@pytest.mark.parametrize(("spacing", "place"), [(0.2, turned), (0.13, as_they_are)])
@pytest.mark.parametrize(("gap", "bend"), [(1e-2, 0.0), (1e-3, 0.0), (1e-3, 0.3), (1e-5, 0.0), (1e-5, 0.3)])
def test_lips_of_a_slit_are_read_on_their_own_side(gap, bend, spacing, place):
    vertices, faces, sides = slit_plate(gap, bend)
    solution = sharp(place(vertices), faces, sides, "smooth" if bend else "faceted", spacing)
    lip = (np.abs(vertices[:, 1]) < 0.3) & (vertices[:, 0] < 0.5 - FAR)
    np.testing.assert_allclose(solution.at_vertices()[lip], sides[lip], atol=OFF)
    inside = np.flatnonzero(lip[faces].all(axis=1))
    points = place(vertices[faces[inside]].mean(axis=1))
    np.testing.assert_allclose(solution.evaluate(points), sides[faces[inside, 0]], atol=OFF)


@pytest.mark.parametrize("place", [as_they_are, turned])
@pytest.mark.parametrize("gap", [1e-3, 1e-5])
def test_the_faces_of_a_thin_box_are_distinguished(gap, place):
    vertices, faces, sides = thin_box(gap)
    solution = sharp(place(vertices), faces, sides, "faceted", 0.13)
    far = (np.abs(vertices[:, :2]) < 1 - FAR).all(axis=1)
    np.testing.assert_allclose(solution.at_vertices()[far], sides[far], atol=OFF)
    inside = np.flatnonzero(far[faces].all(axis=1))
    points = place(vertices[faces[inside]].mean(axis=1))
    np.testing.assert_allclose(solution.evaluate(points), sides[faces[inside, 0]], atol=OFF)


@pytest.mark.parametrize("count", [4, 20])
@pytest.mark.parametrize("gap", [1e-3, 1e-5])
def test_close_sheets_that_bend_are_distinguished_by_the_triangle_that_holds_a_point(gap, count):
    """Their samples stand off the triangles by up to a hundred gaps."""
    vertices, faces, sides = two_sheets(count, gap, bend=0.3)
    source = ck.source("mesh.triangles", vertices=turned(vertices), faces=faces)
    form = ck.discretize(ck.Scene(source, ck.ScreenedPoisson(1.0)), 0.2, form="galerkin")
    cells = form.sampled.mesh.cells
    graph = coo_array((np.ones(cells.size), (cells.ravel(), np.roll(cells, 1, axis=1).ravel())))
    label = connected_components(graph)[1]
    on = np.random.default_rng(0).integers(0, len(faces), 1000)
    points = turned(
        (vertices[faces[on]] * np.random.default_rng(1).dirichlet(np.ones(3), 1000)[:, :, None]).sum(axis=1)
    )
    found = label[cells[form.coefficients._locate_points(points, None)[2], 0]]
    upper = sides[faces[on, 0]] > 0
    assert len(set(found[upper])) == len(set(found[~upper])) == 1
    assert found[upper][0] != found[~upper][0]


@pytest.mark.parametrize("gap", [1e-2, 1e-3, 1e-5])
def test_the_strands_of_a_hairpin_are_distinguished(gap):
    x = np.linspace(-1, 1, 41)
    strands = [np.stack([one, np.full_like(one, at)], axis=1) for one, at in ((x, gap / 2), (x[::-1], -gap / 2))]
    sides = np.repeat([1.0, -1.0], len(x))
    source = ck.source("mesh.polyline", points=np.concatenate(strands), closed=False)
    solution = ck.solve(ck.Scene(source, ck.ScreenedPoisson(SHARP * sides, c=SHARP)), 0.13, form="galerkin")
    far = np.concatenate([x, x[::-1]]) < 1 - FAR
    np.testing.assert_allclose(solution.at_vertices()[far], sides[far], atol=OFF)


def test_smooth_surfaces_are_read_without_further_searches(monkeypatch):
    def refuse(*_):
        raise AssertionError("no sheets are beside one another here")

    monkeypatch.setattr("cpmkit.forms.galerkin.patch_locator.PatchLocator._on_own_sheet", refuse)
    vertices, faces = ck.source("analytic.torus").mesh(0.15)
    for surface in (ck.source("analytic.sphere"), (vertices, faces)):
        scene = ck.Scene(surface, ck.ScreenedPoisson("z"))
        form = ck.discretize(scene, 0.2, form="galerkin")
        points = scene.surface.closest_point(np.random.default_rng(0).uniform(-1, 1, (2000, 3))).points
        rows = form.evaluation_matrix(points)
        assert np.abs(rows.sum(axis=1) - 1).max() < 1e-9
