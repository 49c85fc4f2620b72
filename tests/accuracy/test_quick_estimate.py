"""Without a dry run an explanation is an estimate: soon there at any spacing, and within what it says of itself."""

import numpy as np
import pytest
from click.testing import CliRunner

import cpmkit as ck
from cpmkit.cli import main

SCREENED = ck.ScreenedPoisson(1.0)
SPHERE = ck.source("analytic.sphere")


def cloud():
    points = np.random.default_rng(0).normal(size=(800, 3))
    return ck.source("pointcloud.points", points=points / np.linalg.norm(points, axis=1, keepdims=True))


def two_sided(name="ring", radius=1.0, **keys):
    curve = ck.source("analytic.circle", normal=[0, 0, 1], radius=radius, **keys)
    return ck.Boundary(name, curve, left=ck.Dirichlet(0), right=ck.Dirichlet(1))


SCENES = {
    "sphere": lambda: (SPHERE, [], 0.2),
    "sphere with a circle": lambda: (SPHERE, [two_sided()], 0.2),
    "thin torus with two circles": lambda: (
        ck.source("analytic.torus", major=1, minor=0.2),
        [two_sided(radius=1.2), two_sided("inner", 0.8)],
        0.1,
    ),
    "cap": lambda: (ck.source("analytic.cap"), [], 0.15),
    "circle in the plane": lambda: (ck.source("analytic.circle"), [], 0.02),
    "knot": lambda: (ck.source("parametric.torus_knot"), [], 0.15),
    "level set": lambda: (ck.source("levelset.dziuk"), [], 0.35),
    "cloud": lambda: (cloud(), [], 0.25),
    "Moebius strip": lambda: (ck.source("parametric.moebius"), [], 0.15),
    "coarse Moebius strip": lambda: (ck.source("parametric.moebius"), [], 0.3),
    "segment": lambda: (ck.source("analytic.segment", start=[0, 0, 0], end=[1, 2, 0]), [], 0.02),
}


@pytest.mark.parametrize("form", ["galerkin", "collocation"])
@pytest.mark.parametrize("name", SCENES)
def test_unknowns_are_within_a_factor_of_two(name, form):
    surface, boundaries, spacing = SCENES[name]()
    scene = ck.Scene(surface, SCREENED, boundaries)
    explanation, counted = (ck.explain(scene, spacing, form=form, dry_run=one) for one in (False, True))
    assert explanation.off_by == 2
    assert counted.off_by is None
    assert 1 / explanation.off_by < explanation.unknowns / counted.unknowns < explanation.off_by
    if explanation.solver == counted.solver:
        assert 1 / explanation.off_by < explanation.bytes / counted.bytes < explanation.off_by


@pytest.mark.parametrize("degree", [2, 3, 5])
@pytest.mark.parametrize("surface", [SPHERE, ck.source("analytic.circle", normal=[1, 0, 0])], ids=["sphere", "circle"])
def test_the_ghosts_of_a_point_are_within_it_too(surface, degree):
    pin = ck.Boundary("pin", ck.source("analytic.point", at=[0, 0, 1.0]), both=ck.Dirichlet(1.0))
    scene, options = ck.Scene(surface, SCREENED, [pin]), {"form": "collocation", "degree": degree}
    counts = []
    for dry_run in (False, True):
        parts = ck.explain(scene, 0.1, dry_run=dry_run, **options).parts
        (amount,) = (part.amount for part in parts if "'pin'" in part.name)
        counts.append(int(amount.removeprefix("about ")))
    assert 0.5 < counts[0] / counts[1] < 2
    assert any("about 0" in part.amount for part in ck.explain(scene, 0.1, form="galerkin").parts)


@pytest.mark.parametrize("form", ["galerkin", "collocation"])
def test_a_real_mesh_is_within_it_too(real_mesh, form):
    scene = ck.Scene(ck.source("mesh.triangles", file=real_mesh("spot.obj")), SCREENED)
    explanation, counted = (ck.explain(scene, 0.1, form=form, dry_run=one) for one in (False, True))
    assert 1 / explanation.off_by < explanation.unknowns / counted.unknowns < explanation.off_by


@pytest.mark.parametrize("form", ["galerkin", "collocation"])
def test_what_it_asks_of_a_surface_does_not_grow_with_fineness(form):
    class Counted:
        dim, manifold_dim, bounds, exact = SPHERE.dim, SPHERE.manifold_dim, SPHERE.bounds, True
        target = 0

        def closest_point(self, points):
            Counted.target += len(points)
            return SPHERE.closest_point(points)

    def target(spacing):
        Counted.target = 0
        found = ck.explain(ck.Scene(Counted(), SCREENED), spacing, form=form)
        return Counted.target, found.unknowns

    spacings = np.array([0.1, 0.03, 0.01])
    queries, unknowns = np.array([target(spacing) for spacing in spacings]).T
    assert queries.max() < 20_000
    np.testing.assert_allclose(unknowns * spacings**2 / (unknowns[0] * 0.01), 1, rtol=0.1)


def test_it_says_that_it_is_an_estimate_and_how_to_count(tmp_path):
    (tmp_path / "ball.toml").write_text('[surface]\nkind = "analytic.sphere"\n[problem]\nkind = "screened"\nf = "x"\n')
    command = ["explain", str(tmp_path / "ball.toml"), "--spacing", "0.2"]
    quick, counted = (CliRunner().invoke(main, [*command, *more]).output for more in ([], ["--dry-run"]))
    assert "An estimate" in quick
    assert "within a factor of 2" in quick
    assert "An estimate" not in counted
    assert "closest point queries" in counted


def test_what_does_not_fit_into_memory_is_refused_at_once():
    for form in ("galerkin", "collocation"):
        with pytest.raises(ck.ResolutionError, match="or more would fit"):
            ck.explain(ck.Scene(SPHERE, SCREENED), 1e-5, form=form)
