"""What parting sheets leaves is told by kind, with its share, the error to be expected and the spacing that cures."""

import numpy as np
import pytest
from layouts import lay_out

import cpmkit as ck
from cpmkit.combinations.rectangle import rectangle
from cpmkit.forms.collocation.diagnosis.survey import find_unresolved


def told(source, spacing, **options):
    return {
        one.kind: one for one in find_unresolved(lay_out(ck.Scene(source, ck.ScreenedPoisson(1.0)), spacing, **options))
    }


def turned(seed):
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]


def fold(degrees, axes, half=1.0):
    """A rectangle folded along its middle: the source, its vertices, and how far each lies past the fold."""
    flat, faces = rectangle(np.array([-half, 0.0]), np.array([half, 0.6]), 0.1)
    s, angle = flat[:, 0], np.deg2rad(degrees)
    vertices = np.stack([np.where(s < 0, s, s * np.cos(angle)), flat[:, 1], np.where(s < 0, 0, s * np.sin(angle))], 1)
    vertices = vertices @ axes
    return ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="faceted"), vertices, s


def cube(axes, closest="faceted"):
    """The surface of a cube of side 1."""
    sides = []
    for axis in range(3):
        for end in (-0.5, 0.5):
            flat, faces = rectangle(np.array([-0.5, -0.5]), np.array([0.5, 0.5]), 0.25)
            corners = np.insert(flat, axis, end, axis=1)
            inwards = (end < 0) != (axis == 1)
            sides.append((corners, faces[:, ::-1] if inwards else faces))
    starts = np.cumsum([0, *(len(corners) for corners, _ in sides)])
    vertices = np.concatenate([corners for corners, _ in sides]) @ axes
    faces = np.concatenate([faces + start for (_, faces), start in zip(sides, starts, strict=False)])
    return ck.source("mesh.triangles", vertices=vertices, faces=faces, closest=closest)


@pytest.mark.parametrize("degrees", [20, 45, 90, 120, 150])
def test_a_fold_is_reported_with_its_angle_and_without_a_cure(degrees):
    found = told(fold(degrees, turned(3))[0], 0.1)["crease"]
    assert found.typical == pytest.approx(degrees, abs=3)
    assert found.cure is None
    assert "a smaller spacing hardly lessens" in found.sentence


@pytest.mark.parametrize("degrees", [30, 60, 120])
def test_the_error_expected_of_a_fold_is_about_the_measured_one(degrees):
    """-Lap u + u = f with u = sin(pi s / 2), which flows across the fold; the largest error as a share of the range."""
    angle, rate, expected, measured = np.deg2rad(degrees), np.pi / 2, [], []
    for seed in (3, 4, 5):
        source, vertices, s = fold(degrees, turned(seed))
        ahead = np.array([[1, 0, 0], [np.cos(angle), 0, np.sin(angle)]]) @ turned(seed)  # before and past the fold

        def f(x, ahead=ahead):
            before, past = ahead @ x.T
            travelled = np.where(before + past > 0, np.maximum(past, 0), np.minimum(before, 0))
            return (rate**2 + 1) * np.sin(rate * travelled)

        scene = ck.Scene(source, ck.ScreenedPoisson(f, c=1.0))
        solution = ck.solve(scene, 0.1, solver_tolerance=1e-7, form="collocation")
        assert any("The surface has creases" in text for text in solution.warnings)
        expected.append(told(source, 0.1)["crease"].error)
        measured.append(np.abs(solution.evaluate(vertices) - np.sin(rate * s)).max() / 2)
    assert 1 / 3 <= np.median(expected) / np.median(measured) <= 3


def test_a_cube_is_reported_with_the_share_beside_its_edges():
    for spacing in (0.15, 0.08):
        found = told(cube(turned(3)), spacing)
        assert set(found) == {"crease"}
        assert found["crease"].typical == pytest.approx(90, abs=1)
        assert found["crease"].worst == pytest.approx(90, abs=5)
        within = 1 - (1 - 2 * 2 * spacing) ** 2  # two spacings, half a stencil, on each side of an edge
        assert found["crease"].share == pytest.approx(within, rel=0.2)
    aligned = told(cube(np.eye(3)), 0.1)["crease"]
    assert aligned.error > 2 * found["crease"].error  # errors do not average out along an edge that follows the lattice


def test_a_tube_that_is_thinner_than_the_band_is_a_bend_with_a_cure():
    torus = ck.source("analytic.torus", major=0.3, minor=0.1)
    found = told(torus, 0.05)
    assert set(found) == {"bend"}
    bend = found["bend"]
    assert bend.share == pytest.approx(1.0, abs=0.05)
    assert bend.typical == pytest.approx(0.1, rel=0.05)
    assert bend.cure == pytest.approx(0.1 / np.sqrt(17), rel=0.05)
    assert told(torus, bend.cure) == {}


def test_the_share_of_a_bend_is_that_of_its_length():
    """The tips of an ellipse: the share of its length that is curved more than one over the band's reach."""
    spacing, width = 0.02, 0.2
    ellipse = ck.source("parametric.curve", x=["cos(t)", f"{width}*sin(t)"], range=[0, 2 * np.pi], periodic=True)
    found = told(ellipse, spacing)
    assert set(found) == {"bend"}
    t = np.linspace(0, 2 * np.pi, 100_000, endpoint=False)
    arc = np.hypot(np.sin(t), width * np.cos(t))
    sharp = width / arc**3 * spacing * np.sqrt(13) > 1
    assert found["bend"].share == pytest.approx(np.sum(arc * sharp) / np.sum(arc), rel=1 / 3)
    assert found["bend"].worst == pytest.approx(width**2, rel=0.1)
    assert abs(found["bend"].place[0]) == pytest.approx(1, abs=0.01)
    assert told(ellipse, width**2 / 4) == {}


def circles(gap):
    return ck.source("union", members=[ck.source("analytic.circle"), ck.source("analytic.circle", radius=1 + gap)])


def planes(gap):
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) @ turned(3)
    both = np.concatenate([corners, corners + gap * turned(3)[2]])
    return ck.source(
        "mesh.triangles", vertices=both, faces=[[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], closest="faceted"
    )


@pytest.mark.parametrize(("two", "spacing"), [(circles, 0.025), (planes, 0.2)])
def test_two_sheets_nearer_than_half_a_spacing_are_reported_and_the_cure_parts_them(two, spacing):
    gap = 0.3 * spacing
    found = told(two(gap), spacing)
    assert set(found) == {"sheets"}
    assert found["sheets"].typical == pytest.approx(gap, rel=0.1)
    assert found["sheets"].share >= 2 / 3
    assert found["sheets"].cure == pytest.approx(gap, rel=0.1)
    assert told(two(gap), found["sheets"].cure) == {}
    assert told(two(spacing), spacing) == {}


@pytest.mark.parametrize(
    ("kind", "keys", "spacing"),
    [
        ("analytic.circle", {}, 0.1),
        ("analytic.sphere", {}, 0.2),
        ("analytic.torus", {"major": 1.0, "minor": 0.4}, 0.1),
        ("analytic.cap", {"height": 0.3}, 0.1),
        ("analytic.cylinder", {}, 0.1),
        pytest.param("levelset.dziuk", {}, 0.05, marks=pytest.mark.slow),
    ],
)
def test_what_the_band_resolves_is_not_reported(kind, keys, spacing):
    assert told(ck.source(kind, **keys), spacing) == {}


def test_facets_of_a_smooth_mesh_are_no_creases():
    from cpmkit_mesh import triangles

    for closest, edges in (("smooth", 0.25), ("faceted", 0.1)):
        vertices, faces = ck.source("analytic.sphere").mesh(edges)
        assert told(triangles(vertices=vertices, faces=faces, closest=closest), 0.1) == {}


def test_a_real_mesh_is_reported_alike_by_the_explanation_and_the_solution(real_mesh):
    vertices, faces = ck.read_mesh(real_mesh("fish.obj"))
    vertices = (vertices - vertices.min(axis=0)) / np.ptp(vertices, axis=0).max()
    scene = ck.Scene(ck.source("mesh.triangles", vertices=vertices, faces=faces), ck.ScreenedPoisson(1.0))
    explained = ck.explain(scene, 0.06, form="collocation", rehearse=True)
    assert "bend" in {one.kind for one in explained.remains}
    sentences = [one.sentence for one in explained.remains]
    assert all(text in str(explained) for text in sentences)
    solved = ck.solve(scene, 0.06, solver_tolerance=1e-4, form="collocation").warnings
    assert [text for text in solved if text in sentences] == sentences


def test_an_explanation_from_coarser_lattices_is_of_the_spacing_that_was_asked_for(monkeypatch):
    monkeypatch.setattr("cpmkit.forecast.cost.REHEARSED_CELLS", 400)
    scene = ck.Scene(ck.source("analytic.torus", major=1.0, minor=0.15), ck.ScreenedPoisson(1.0))
    for spacing, kinds in ((0.06, {"bend"}), (0.03, set())):
        explained = ck.explain(scene, spacing, form="collocation", rehearse=True)
        assert not explained.exact
        assert {one.kind for one in explained.remains} == kinds


def test_the_explanation_names_where_nodes_are_doubled():
    """Two circles that touch but for two spacings: twins are where they are near each other, and nowhere else."""
    second = ck.source("analytic.circle", center=[2.05, 0])
    scene = ck.Scene(ck.source("union", members=[ck.source("analytic.circle"), second]), ck.ScreenedPoisson(1.0))
    explained = ck.explain(scene, 0.025, form="collocation", rehearse=True)
    (cluster,) = explained.doubled
    assert np.all(np.abs(np.array([cluster.lower, cluster.upper]) - [1.025, 0]) < [0.1, 0.5])
    (twins,) = [part for part in explained.parts if part.name == "twins"]
    assert f"twins: {cluster}" in str(explained)
    assert twins.amount == f"{cluster.twins:,}"
