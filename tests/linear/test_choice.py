"""Without a name, the quicker solver is taken; multigrid only where a form has levels for it."""

import pytest

import cpmkit as ck

CIRCLE, SPHERE = ck.source("analytic.circle"), ck.source("analytic.sphere")


@pytest.mark.parametrize(
    ("surface", "form", "spacing", "expected"),
    [
        (SPHERE, "collocation", 0.03, "reference"),
        (SPHERE, "galerkin", 0.03, "multigrid"),
        (SPHERE, "galerkin", 0.1, "multigrid"),
        (SPHERE, "galerkin", 0.5, "direct"),
        (CIRCLE, "galerkin", 0.001, "direct"),
        (CIRCLE, "collocation", 0.01, "direct"),
    ],
)
def test_what_is_quicker_is_taken(surface, form, spacing, expected):
    scene = ck.Scene(surface, ck.ScreenedPoisson(1.0))
    assert ck.explain(scene, spacing, form=form).solver == expected
    assert ck.explain(scene, spacing, form=form, solver="reference").solver == "reference"
