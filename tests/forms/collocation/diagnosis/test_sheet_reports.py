"""Sharp bends and creases are warned of, beside which the Galerkin form is more exact; smooth surfaces are not."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.plugin import rectangle

SHARP = "bends more sharply than the band is wide"


def warnings_of(source, spacing):
    return ck.solve(ck.Scene(source, ck.ScreenedPoisson(1.0)), spacing, form="collocation").warnings


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


@pytest.mark.parametrize(
    ("source", "spacing"),
    [
        *[pytest.param(fold(degrees, turned(3))[0], 0.1, id=f"fold of {degrees}") for degrees in (45, 90, 150)],
        pytest.param(cube(turned(3)), 0.15, id="cube"),
        pytest.param(cube(np.eye(3)), 0.1, id="cube along the lattice"),
        pytest.param(ck.source("analytic.torus", major=0.3, minor=0.1), 0.05, id="thin tube"),
    ],
)
def test_creases_and_bends_are_warned_of(source, spacing):
    (warning,) = (text for text in warnings_of(source, spacing) if SHARP in text)
    assert 'use form="galerkin", or, for bends, a spacing of' in warning


def test_the_spacing_that_is_named_resolves_a_bend():
    torus = ck.source("analytic.torus", major=0.3, minor=0.1)
    (warning,) = (text for text in warnings_of(torus, 0.06) if SHARP in text)
    assert not warnings_of(torus, float(warning.split()[-1].rstrip(".")))


@pytest.mark.parametrize("degrees", [30, 60, 120])
def test_beside_a_fold_the_galerkin_form_is_more_exact(degrees):
    """-Lap u + u = f with u = sin(pi s / 2), which flows across the fold; the largest error as a share of the range."""
    angle, rate = np.deg2rad(degrees), np.pi / 2
    source, vertices, s = fold(degrees, turned(3))
    ahead = np.array([[1, 0, 0], [np.cos(angle), 0, np.sin(angle)]]) @ turned(3)  # before and past the fold

    def f(x):
        before, past = ahead @ x.T
        travelled = np.where(before + past > 0, np.maximum(past, 0), np.minimum(before, 0))
        return (rate**2 + 1) * np.sin(rate * travelled)

    scene = ck.Scene(source, ck.ScreenedPoisson(f, c=1.0))
    errors = {
        form: np.abs(ck.solve(scene, 0.1, form=form).evaluate(vertices) - np.sin(rate * s)).max() / 2
        for form in ("collocation", "galerkin")
    }
    assert errors["collocation"] > 0.01
    assert errors["galerkin"] < 5e-3


@pytest.mark.parametrize(
    ("kind", "keys", "spacing"),
    [
        ("analytic.circle", {}, 0.1),
        ("analytic.sphere", {}, 0.3),
        ("analytic.torus", {"major": 1.0, "minor": 0.4}, 0.1),
        ("analytic.cap", {"height": 0.3}, 0.1),
        ("analytic.cylinder", {}, 0.1),
        pytest.param("levelset.dziuk", {}, 0.05, marks=pytest.mark.slow),
    ],
)
def test_what_the_band_resolves_is_not_warned_of(kind, keys, spacing):
    assert not warnings_of(ck.source(kind, **keys), spacing)


@pytest.mark.parametrize(("closest", "edges"), [("smooth", 0.25), ("faceted", 0.1)])
def test_facets_of_a_smooth_mesh_are_no_creases(closest, edges):
    from cpmkit_mesh import triangles

    vertices, faces = ck.source("analytic.sphere").mesh(edges)
    assert not any(
        SHARP in text for text in warnings_of(triangles(vertices=vertices, faces=faces, closest=closest), 0.1)
    )


def test_an_explanation_from_coarser_lattices_is_of_the_given_spacing(monkeypatch):
    monkeypatch.setattr("cpmkit.forms.collocation.collocation_cost.DRY_RUN_CELLS", 400)
    scene = ck.Scene(ck.source("analytic.torus", major=1.0, minor=0.15), ck.ScreenedPoisson(1.0))
    for spacing, sharp in ((0.06, True), (0.03, False)):
        explained = ck.explain(scene, spacing, form="collocation", dry_run=True)
        assert not explained.exact
        assert (SHARP in str(explained)) == sharp
