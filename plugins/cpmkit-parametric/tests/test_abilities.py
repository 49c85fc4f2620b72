"""Meshes close where parameters are glued, normals and tangents follow the parameters, derivatives are right."""

from __future__ import annotations

import numpy as np
import pytest
from cpmkit_parametric import curve, helix, klein, moebius, planar_curve, revolution, surface, torus_knot

from cpmkit.plugin import HasNormals, HasTangents, formula_tree

TURN = [0, "2*pi"]
SURFACES = {  # source, number of rims, Euler characteristic, orientable
    "torus": (revolution(profile=["2+0.5*cos(t)", "0.5*sin(t)"], range=TURN, periodic=True), 0, 0, True),
    "sphere": (revolution(profile=["cos(t)", "sin(t)"], range=["-pi/2", "pi/2"]), 0, 2, True),
    "cap": (revolution(profile=["cos(t)", "sin(t)"], range=[0.5, "pi/2"]), 1, 1, True),
    "cylinder": (surface(x=["cos(u)", "sin(u)", "v"], u=TURN, v=[0, 1], periodic_u=True), 2, 0, True),
    "sheet": (surface(x=["u", "v", "u*v"], u=[0, 1], v=[0, 1]), 1, 1, True),
    "moebius": (moebius(), 1, 0, False),
    "klein": (klein(), 0, 0, False),
}


def directed(cells):
    return np.concatenate([cells[:, [0, 1]], cells[:, [1, 2]], cells[:, [2, 0]]])


def rims(edges):
    """Number of closed loops that undirected edges form."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if not len(edges):
        return 0
    corners, number = np.unique(edges, return_inverse=True)
    a, b = number.reshape(-1, 2).T
    assert (np.bincount(number.ravel()) == 2).all()
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(len(corners),) * 2)
    return connected_components(graph, directed=False)[0]


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("spacing", [10.0, 0.3, 0.1])
def test_a_mesh_is_closed_but_for_its_rims(name, spacing):
    source, loops, euler, orientable = SURFACES[name]
    vertices, cells = source.mesh(spacing)
    assert np.array_equal(np.unique(cells), np.arange(len(vertices)))
    edges, count = np.unique(np.sort(directed(cells), axis=1), axis=0, return_counts=True)
    assert count.max() == 2
    assert rims(edges[count == 1]) == loops
    assert len(vertices) - len(edges) + len(cells) == euler
    once = np.unique(directed(cells), axis=0)
    assert (len(once) == 3 * len(cells)) == orientable


@pytest.mark.parametrize("name", [name for name, entry in SURFACES.items() if entry[3]])
def test_triangles_are_wound_along_the_normals(name):
    source = SURFACES[name][0]
    vertices, cells = source.mesh(0.05)
    a, b, c = vertices[cells.T]
    across = np.cross(b - a, c - a)
    normals = source.normals(source.closest_point((a + b + c) / 3))
    assert (np.einsum("nd,nd->n", across, normals) > 0.8 * np.linalg.norm(across, axis=1)).all()
    edges = directed(cells)
    assert np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1).max() < 2 * 0.05


def test_normals_of_a_sphere_point_outwards_at_the_poles_too():
    x = np.array([[0, 0, 2.0], [0, 0, -0.5], [1e-9, 0, 1], [3, 1, 1], [-1, 1e-7, -2], [0, 0, 1.0]])
    sphere = SURFACES["sphere"][0]
    feet = sphere.closest_point(x)
    assert sphere.normals(feet) == pytest.approx(feet.points, abs=1e-9)


def test_only_surfaces_with_two_sides_and_plane_curves_have_normals():
    for source in (moebius(), klein(), helix(), torus_knot()):
        assert not isinstance(source, HasNormals)
    for source in (SURFACES["sheet"][0], planar_curve()):
        assert isinstance(source, HasNormals)
    assert isinstance(helix(), HasTangents)
    assert not isinstance(moebius(), HasTangents)


def test_tangents_and_plane_normals_follow_growing_t():
    circle = curve(x=["cos(t)", "sin(t)"], range=TURN, periodic=True)
    feet = circle.closest_point([[2, 0], [0, 0.5]])
    assert circle.tangents(feet) == pytest.approx(np.array([[0, 1], [-1, 0]]), abs=1e-12)
    assert circle.normals(feet) == pytest.approx(np.array([[1, 0], [0, 1]]), abs=1e-12)
    cusp = curve(x=["t**3", "t**2"], range=[-1, 1])
    assert cusp.tangents(cusp.closest_point([[0, -1]])) == pytest.approx(np.array([[1, 0]]), abs=1e-4)


def test_the_mesh_of_a_curve_is_a_chain_of_equal_segments():
    for source, closed in ((torus_knot(), True), (helix(), False)):
        vertices, cells = source.mesh(0.05)
        assert np.array_equal(cells[:, 1], (np.arange(len(cells)) + 1) % len(vertices))
        assert len(vertices) == len(cells) + (not closed)
        length = np.linalg.norm(vertices[cells[:, 1]] - vertices[cells[:, 0]], axis=1)
        assert length.max() <= 0.05 * 1.001
        assert length.min() > 0.98 * length.max()


FORMULAS = {
    "smooth": ["exp(sin(3*t))", "hypot(t, 2) + arctan2(t, 3)", "log(2 + cosh(t)) * 2**t"],
    "kinks": [
        "abs(t - 0.1) + minimum(t, 0.3)**2",
        "maximum(t**3, t) + floor(3*t)",
        "t % 0.7 + (t > 0.2) * t - sign(t)",
    ],
}


@pytest.mark.parametrize("name", FORMULAS)
def test_derivatives_of_formulas_agree_with_differences_between_kinks(name):
    from cpmkit_parametric.formulas import formula_map

    made = formula_map([formula_tree(text, "t") for text in FORMULAS[name]], "t")
    t, h = np.array([[-0.8], [0.05], [0.55], [0.93]]), 1e-4
    p, J, H = made.jet(t)
    ahead, behind = made.value(t + h), made.value(t - h)
    assert J[:, 0] == pytest.approx((ahead - behind) / (2 * h), abs=1e-5)
    assert H[:, 0, 0] == pytest.approx((ahead - 2 * p + behind) / h**2, abs=1e-4)


def test_differences_of_a_callable_are_close_inside_and_good_up_to_the_bounds():
    from cpmkit_parametric.differences import Differences

    def x(u, v):
        return np.stack([np.sin(5 * u) * np.cos(v), np.exp(u * v), u * u * v], axis=1)

    made = Differences(x, np.zeros(2), np.array([1.0, 2.0]), np.zeros(2, dtype=bool))
    u, v = np.meshgrid([0.0, 0.001, 0.4, 1.0], [0.0, 0.7, 2.0])
    u, v = u.ravel(), v.ravel()
    found = made(u, v)
    first = [
        np.stack([5 * np.cos(5 * u) * np.cos(v), v * np.exp(u * v), 2 * u * v], axis=1),
        np.stack([-np.sin(5 * u) * np.sin(v), u * np.exp(u * v), u * u], axis=1),
    ]
    middle = (u == 0.4) & (v == 0.7)
    for a, b in zip(found[:2], first, strict=True):
        assert np.abs(a - b).max() < 1e-9
        assert np.abs(a - b)[middle].max() < 1e-11
    mixed = np.stack([-5 * np.cos(5 * u) * np.sin(v), (1 + u * v) * np.exp(u * v), 2 * u], axis=1)
    assert np.abs(found[3] - mixed)[middle].max() < 1e-7
