"""What docs/explanation/resolves.md says is resolved is, and what it says is warned of or refused is."""

from __future__ import annotations

import pytest
from extremes.envelope_outcomes import RESOLVED, outcome
from extremes.envelope_scenes import FAMILIES

import cpmkit as ck

MAKE = {family.name: family.make for family in FAMILIES}


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("fold angle", 150),
        ("plate thickness", 2),
        ("gap of curves", 1e-3),
        ("radius of curvature", 3),
        ("noise of closest points", 1e-4),
        ("edges of a smooth mesh", 0.2),
        ("layer of the diffusivity", 0.5),
        ("wave length", 12),
        ("distance from zero", 1e9),
    ],
)
def test_what_is_resolved(name, size):
    found = outcome(MAKE[name](size), "galerkin")
    assert found.state == "right"
    assert found.error < RESOLVED


@pytest.mark.parametrize(
    ("name", "size"),
    [("plate thickness", 0.1), ("plate thickness", 1), ("fold angle", 5), ("fold angle", 45)]
    + [("junction, smallest angle", 5), ("junction, smallest angle", 45)],
)
def test_creases_and_junctions_are_resolved(name, size):
    assert outcome(MAKE[name](size), "galerkin").error < 1e-4


def test_waves_of_three_spacings_have_no_estimate():
    assert outcome(MAKE["wave length"](3), "galerkin").state == "warned"
    known = MAKE["wave length"](3)
    with pytest.raises(ck.CpmkitError):
        _ = ck.solve(known.scene, known.spacing, form="galerkin").error


def test_a_hole_of_many_spacings_agrees_with_finite_elements():
    found = outcome(MAKE["hole side"](6), "galerkin")
    assert found.error < 0.005
