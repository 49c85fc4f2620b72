"""Every scene in examples/ loads, and its explanation names what it holds."""

from functools import cache
from pathlib import Path

import pytest

import cpmkit as ck
from cpmkit.scenefile.application_files import load_application

SCENES = sorted(path.name for path in (Path(__file__).parents[2] / "examples").glob("*.toml"))
APPLICATIONS = sorted(path.name for path in (Path(__file__).parents[2] / "examples" / "applications").glob("*.toml"))
MESHES = {
    "02-nefertiti.toml": ["nefertiti-lowres.obj"],
    "03-spot.toml": ["spot.obj"],
    "08-nefertitis-ear.toml": ["nefertiti-lowres.obj"],
    "09-fish-fins.toml": ["fish.obj"],
    "10-gray-scott.toml": ["spot.obj"],
    "11-heat-on-spot.toml": ["spot.obj"],
}


def test_there_are_scenes():
    assert {"01-first-curves.toml", *MESHES} <= set(SCENES)
    assert {name.split("-")[0] for name in APPLICATIONS} == {"vectors", "map", "paint"}


loaded = cache(ck.load_scene)  # meshes are read, and cut, once

#: Its seven cuts take long.
SLOW = "09-fish-fins.toml"


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name == SLOW)) for name in SCENES])
def test_scene_loads_and_is_explained(name, example):
    wanted = loaded(example(name, *MESHES.get(name, [])))
    assert wanted.spacing is not None
    message = str(ck.explain(wanted.scene, spacing=(5 if name in MESHES else 3) * wanted.spacing, dry_run=True))
    for boundary in wanted.scene.boundaries:
        assert boundary.name in message


@pytest.mark.parametrize("name", APPLICATIONS)
def test_scene_of_an_application_loads(name, example):
    command, on = name.removesuffix(".toml").split("-", 1)
    wanted = load_application(example(f"applications/{name}", *(["spot.obj"] if on == "spot" else [])), command)
    assert wanted.spacing is not None
    assert wanted.arguments
    assert wanted.output.picture is not None


def test_nefertiti_has_six_curves_with_two_sides_and_one_wall(example):
    scene = loaded(example("02-nefertiti.toml", "nefertiti-lowres.obj")).scene
    sides = [tuple(type(curve.condition(side)) for side in ("left", "right")) for curve in scene.boundaries]
    assert sides.count((ck.Dirichlet, ck.Dirichlet)) >= 6
    walls = [curve for curve, kinds in zip(scene.boundaries, sides, strict=True) if kinds == (ck.Neumann, ck.Dirichlet)]
    assert [curve.condition("left").flux for curve in walls] == [0.0]
