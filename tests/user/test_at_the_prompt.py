"""What a prompt and a notebook show of sources, scenes, solutions and explanations: a line or two, and a table."""

import pickle

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.applications import geodesic_distance, logarithmic_map, vector_field
from cpmkit.testing import installed_cases

CIRCLE = ck.source("analytic.circle")
CUT = ck.Boundary("cut", ck.source("analytic.point", at=[1, 0]), left=1.0, right="x < 5")
#: A mesh as a pair of arrays.
TETRAHEDRON = (np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
#: Kinds that are made slowly, or of a function that no module holds by a name, which Python does not pickle.
LEFT_OUT = ("pointcloud", "levelset.grid", "levelset.callable")


@pytest.fixture(scope="module")
def solution():
    return ck.solve(ck.Scene(CIRCLE, ck.Laplace(), [CUT]), spacing=0.2)


def sources():
    first = {case.kind: case for case in reversed(installed_cases()) if not case.kind.startswith(LEFT_OUT)}
    return [
        *(pytest.param(case.make, id=kind) for kind, case in first.items()),
        pytest.param(lambda: ck.source("cut.plane", surface=TETRAHEDRON, point=[0.2] * 3, normal=[0, 0, 1]), id="cut"),
    ]


@pytest.mark.parametrize("make", sources())
def test_a_source_has_a_repr_of_one_line_and_pickles(make):
    source = make()
    assert "\n" not in repr(source)
    assert len(repr(source)) < 200
    assert f"in {source.dim}D" in repr(source)
    again = pickle.loads(pickle.dumps(source))
    x = source.bounds.mean(axis=0) + np.linspace(-0.3, 0.3, 7)[:, None] * np.arange(1, source.dim + 1)
    np.testing.assert_array_equal(source.closest_point(x).points, again.closest_point(x).points)


def test_results_of_applications_have_reprs_of_two_lines():
    sphere = ck.source("analytic.sphere")
    found = [
        geodesic_distance(sphere, [[0.0, 0.0, 1.0]], spacing=0.4),
        vector_field(sphere, [([0.0, 0.0, 1.0], [1.0, 0.0, 0.0])], spacing=0.4),
        logarithmic_map(sphere, [0.0, 0.0, 1.0], spacing=0.4),
    ]
    for one in found:
        first, second = repr(one).split("\n")
        assert first.startswith(type(one).__name__)
        assert "a surface in 3D" in first
        assert "unknowns" in second
        assert len(repr(one)) < 250


def test_a_cloud_has_a_repr_of_one_line():
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    points = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for normals in (None, points):
        cloud = ck.source("pointcloud.points", points=points, normals=normals)
        assert "60 vertices" in repr(cloud)
        assert len(repr(cloud)) < 200


@pytest.mark.parametrize(
    ("problem", "text"),
    [
        (ck.Laplace(), "Solution of laplace with 1 boundary, form galerkin, spacing 0.2"),
        (ck.Heat("x", until=0.2, step=0.1, frames=1), "time 0.2 after 2 steps, 2 frames"),
        (ck.Eigen(6), "eigenvalues .*, ..."),
        (ck.PLaplacian(3.0, "x", 1.0, regularization=0.1), "Solution of p-laplacian"),
    ],
    ids=lambda one: getattr(one, "kind", None),
)
def test_a_solution_has_a_repr_of_two_lines_and_pickles(problem, text):
    cut = ck.Boundary("cut", CUT.source, both=0.0) if problem.kind == "eigen" else CUT
    prepared = ck.prepare(ck.Scene(CIRCLE, problem, [cut]), spacing=0.2)
    solution = prepared.solve()
    assert repr(solution).count("\n") == 1
    assert text.partition(" .*")[0] in repr(solution)
    again = pickle.loads(pickle.dumps(solution))
    points = np.array([[0.6, 0.8], [1.0, 0.0]])
    np.testing.assert_array_equal(again.evaluate(points, "both"), solution.evaluate(points, "both"))
    assert again.summary() == solution.summary()
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(prepared)).solve().values, solution.values)
    assert repr(prepared).count("\n") == 1


def test_scenes_boundaries_and_explanations_have_short_reprs(solution):
    scene = solution.scene
    assert repr(scene).count("\n") == 1
    assert "'cut'" in repr(scene)
    assert repr(CUT) == f"Boundary('cut', {CUT.source!r}, left=dirichlet, right=dirichlet)"
    explained = ck.explain(scene, spacing=0.2)
    assert "\n" not in repr(explained)
    assert f"{explained.unknowns:,} unknowns" in repr(explained)
    assert pickle.loads(pickle.dumps(explained)) == explained
    vertices, faces = ck.source("analytic.sphere").mesh(0.5)
    mesh = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    assert len(repr(ck.Dirichlet(ck.VertexData(mesh, vertices)))) < 300


def test_a_notebook_shows_tables_and_a_picture_where_one_can_be_drawn(solution, monkeypatch):
    import cpmkit.view.showing as thumbnail

    for shown in (solution.scene, ck.explain(solution.scene, spacing=0.2)):
        assert shown._repr_html_().count("<tr>") > 2
    monkeypatch.setattr(thumbnail, "thumbnail", lambda _: b"a picture")
    assert "data:image/png;base64,YSBwaWN0dXJl" in solution._repr_html_()
    assert "dirichlet on the left" in solution.scene._repr_html_()


def test_a_notebook_shows_figures_where_no_renderer_answers(solution, monkeypatch):
    import cpmkit.view.showing as thumbnail

    def broken(*_, **__):
        raise RuntimeError("no renderer")

    monkeypatch.setattr(thumbnail, "picture", broken)
    shown = solution._repr_html_()
    assert "<img" not in shown
    assert "unknowns" in shown
