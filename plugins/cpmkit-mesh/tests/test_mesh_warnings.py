"""A mesh says what about it may spoil a solution, and how far from the smooth surface it leaves a solution."""

import re

import numpy as np
import pytest
from cpmkit_mesh import triangles

import cpmkit as ck
from cpmkit.errors import InputError
from cpmkit.plugin import HasAdvice


def ridge(degrees, edge, half=1.0):
    """Return two squares that meet along one side, at which the surface turns by so many degrees."""
    steps = round(half / edge)
    s, y = np.linspace(-half, half, 2 * steps + 1), np.linspace(0, half, steps + 1)
    lean = np.deg2rad(degrees) / 2
    points = np.stack([np.tile(s * np.cos(lean), steps + 1), np.repeat(y, len(s))], axis=1)
    points = np.column_stack([points, np.tile(-np.abs(s) * np.sin(lean), steps + 1)])
    row, column = np.divmod(np.arange(2 * steps * steps), 2 * steps)
    a = row * len(s) + column
    b, c, d = a + 1, a + 1 + len(s), a + len(s)
    return points, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def tee(per_side=4):
    """Return three squares that share one side."""
    points, faces = ridge(0.0, 1 / per_side)
    third = np.flatnonzero(points[:, 0] >= 0)
    rank = np.full(len(points), -1)
    rank[third] = len(points) + np.arange(len(third))
    upright = points[third][:, [2, 1, 0]]
    return np.concatenate([points, upright]), np.concatenate([faces, rank[faces][(rank[faces] >= 0).all(axis=1)]])


def warned(mesh, spacing, **keys):
    advice = triangles(vertices=mesh[0], faces=mesh[1], **keys).advice(spacing)
    return (*advice.warnings, *advice.closest_point_warnings)


def test_a_coarse_but_smooth_mesh_is_not_reported(sphere):
    for level in (2, 3, 4):
        for closest in ("smooth", "faceted"):
            assert warned(sphere(level), 0.1, closest=closest) == ()


@pytest.mark.parametrize("closest", ["smooth", "faceted"])
@pytest.mark.parametrize("edge", [0.5, 0.05])
def test_a_ridge_of_90_degrees_is_reported_with_its_place_and_angle(edge, closest):
    (sentence,) = warned(ridge(90, edge), 0.1, closest=closest)
    assert f": {round(1 / edge)} edges of the mesh turn by more than 40 degrees, the sharpest by 90 " in sentence
    assert "near (0, " in sentence
    share = float(re.search(r"and (\d+)% of the surface lies within two spacings", sentence)[1])
    assert share == pytest.approx(20, abs=2)
    assert sentence.endswith(".")
    assert sentence.count(". ") == 0


def test_what_a_reader_can_do_depends_on_the_triangles_beside_the_crease():
    """Triangles 0.05 wide round a right angle off over a radius of 0.032."""
    assert "; below 0.021 most are rounded off." in warned(ridge(90, 0.05), 0.1)[0]
    assert "are rounded off over the triangles beside them" in warned(ridge(90, 0.5), 0.1)[0]
    assert "at any spacing" in warned(ridge(90, 0.05), 0.1, closest="faceted")[0]


def test_mild_short_and_few_creases_are_not_reported():
    assert warned(ridge(30, 0.1), 0.1) == ()
    assert warned(ridge(60, 0.1), 0.1) == ()
    assert warned(ridge(90, 0.1), 0.2) == ()  # five spacings long


def test_the_angle_of_creases_is_the_users():
    assert warned(ridge(90, 0.1), 0.1, crease_angle=100.0) == ()
    assert "more than 60 degrees" in warned(ridge(90, 0.1), 0.1, crease_angle=60)[0]
    with pytest.raises(InputError, match="crease_angle must be an angle between 0 and 180 degrees, got 200"):
        triangles(vertices=np.eye(3), faces=[[0, 1, 2]], crease_angle=200)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_creases_do_not_depend_on_units_or_winding(scale):
    points, faces = ridge(90, 0.1)
    flipped = faces.copy()
    flipped[::3] = flipped[::3, ::-1]
    count = [
        warned((points * s, cells), 0.1 * s)[-1].split(" near")[0] for s in (1.0, scale) for cells in (faces, flipped)
    ]
    assert len(set(count)) == 1


def test_needles_do_not_look_like_creases():
    """A triangle so flat that its normal is noise: six digits in a file make such of any sliver."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0.5, 0.5, 1e-7]])
    mesh = triangles(vertices=points, faces=[[0, 1, 2], [1, 4, 2], [1, 3, 4], [4, 3, 2]])
    assert mesh.inner_edges.angle.max() < 1e-3


def test_edges_at_which_three_triangles_meet_are_reported():
    warnings_found = warned(tee(), 0.1, crease_angle=170)
    assert len(warnings_found) == 1
    assert warnings_found[0].startswith(
        "4 edges of the mesh are shared by three or more triangles, the first near (0, "
    )


@pytest.mark.parametrize("closest", ["smooth", "faceted"])
def test_junctions_are_reported_for_the_form_that_is_off_there_alone(closest):
    """The Galerkin form is cut at junctions."""
    scene = ck.Scene(triangles(vertices=tee()[0], faces=tee()[1], closest=closest), ck.ScreenedPoisson("x", 1.0))
    assert ck.solve(scene, 0.1, form="galerkin").warnings == ()
    with pytest.warns(ck.CpmkitWarning, match="shared by three or more triangles"):
        ck.solve(scene, 0.1, form="collocation")


@pytest.mark.parametrize("closest", ["smooth", "faceted"])
def test_sheets_that_branch_at_an_edge_stay_flat_there(closest):
    """Three unit squares on one edge: eigenvalues pi^2 (m/2)^2 + pi^2 n^2, odd m twice."""
    points, faces = [], []
    for angle in 0.3 + 2 * np.pi / 3 * np.arange(3):
        sheet, cells = ridge(0.0, 0.5)
        remaining = np.flatnonzero(sheet[:, 0] >= 0)
        number = np.full(len(sheet), -1)
        number[remaining] = sum(map(len, points)) + np.arange(len(remaining))
        points.append(sheet[remaining] @ [[np.cos(angle), np.sin(angle), 0], [0, 0, 1], [0, 0, 0]])
        faces.append(number[cells][(number[cells] >= 0).all(axis=1)])
    mesh = triangles(vertices=np.concatenate(points), faces=np.concatenate(faces), closest=closest)
    found = ck.solve(ck.Scene(mesh, ck.Eigen(count=7)), spacing=0.1).eigenvalues
    np.testing.assert_allclose(found[1:], np.pi**2 * np.array([0.25, 0.25, 1, 1, 1.25, 1.25]), rtol=2e-3)


def test_triangles_given_twice_count_once(sphere):
    """A sheet that was stored with both windings is one sheet, not four triangles an edge."""
    points, faces = sphere(2)
    once = triangles(vertices=points, faces=faces)
    twice = triangles(vertices=points, faces=np.concatenate([faces, faces[:, ::-1]]))
    assert [text.split(" of ")[0] for text in twice.advice(0.1).warnings] == [str(len(faces))]
    for moved in (twice, twice.translate(np.ones(3))):
        assert moved.advice(0.1).integral_floor > 0
    x = np.random.default_rng(1).normal(size=(500, 3))
    np.testing.assert_array_equal(twice.closest_point(x).points, once.closest_point(x).points)
    np.testing.assert_array_equal(twice.closest_point(x).element, once.closest_point(x).element)


@pytest.mark.parametrize(
    ("form", "floor", "level", "closest"),
    [
        ("collocation", "floor", 3, "smooth"),
        ("collocation", "floor", 4, "smooth"),
        ("collocation", "floor", 3, "faceted"),
        ("galerkin", "integral_floor", 3, "smooth"),
        ("galerkin", "integral_floor", 4, "smooth"),
    ],
)
def test_the_floor_is_predicted_to_a_factor_of_three(sphere, level, closest, form, floor):
    """u = z on the unit sphere by -Lap u + u = 3 z, at a spacing where the mesh is what is left of the error."""
    mesh = triangles(vertices=sphere(level)[0], faces=sphere(level)[1], closest=closest)
    scene = ck.Scene(mesh, ck.ScreenedPoisson(lambda x: 3 * x[:, 2] / np.linalg.norm(x, axis=1), c=1.0))
    points, spacing = sphere(4)[0], {3: 0.08, 4: 0.05}[level]
    share = np.abs(ck.solve(scene, spacing, form=form).evaluate(points) - points[:, 2]).max() / 2.0
    assert share / 3 < getattr(mesh.advice(spacing), floor) < 3 * share


def test_the_floor_falls_with_the_edges_and_does_not_depend_on_units_or_spacing(sphere):
    floors = {
        closest: [triangles(vertices=p, faces=f, closest=closest).advice(0.1).floor for p, f in map(sphere, (2, 3, 4))]
        for closest in ("smooth", "faceted")
    }
    assert np.allclose(np.log2(np.divide(floors["smooth"][:-1], floors["smooth"][1:])), 2, atol=0.1)
    assert np.allclose(np.log2(np.divide(floors["faceted"][:-1], floors["faceted"][1:])), 1, atol=0.1)
    points, faces = sphere(3)
    assert triangles(vertices=1e-6 * points, faces=faces).advice(1e-7).floor == pytest.approx(floors["smooth"][1])
    flat = ridge(0, 0.1)
    assert triangles(vertices=flat[0], faces=flat[1]).advice(0.1).floor == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("crease_angle", [40.0, 100.0])
def test_a_body_with_flat_sides_has_no_floor_unless_it_stands_for_a_smooth_one(sphere, crease_angle):
    """Sheets that meet at 90 degrees are what they are; where that is no crease, at 20 degrees, or smoothed, not.

    In integrals triangles that are read as they are are the surface, at whatever angle.
    """
    sharp, blunt = ridge(90, 0.25), ridge(20, 0.25)
    floors = lambda mesh, closest: [  # noqa: E731
        getattr(
            triangles(vertices=mesh[0], faces=mesh[1], closest=closest, crease_angle=crease_angle).advice(0.1), name
        )
        for name in ("floor", "integral_floor")
    ]
    assert (floors(sharp, "faceted") == [0.0, 0.0]) == (crease_angle < 90)
    assert min(floors(sharp, "smooth")) > 0
    for mesh in (blunt, sphere(3)):
        closest_points, integrals = floors(mesh, "faceted")
        assert closest_points > 0
        assert integrals == 0


def test_every_mesh_says_so(sphere):
    for mesh in (sphere(1), tee()):
        source = triangles(vertices=mesh[0], faces=mesh[1])
        assert isinstance(source, HasAdvice)
