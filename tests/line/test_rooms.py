"""The rooms of the house stand on each other: no way of imports leads back, and the page shows each of them."""

import importlib.util
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def house():
    """Return the documentation's own reading of the rooms."""
    spec = importlib.util.spec_from_file_location("house", DOCS / "house.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["house"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["house"]


def test_imports_are_seen_wherever_they_stand(house):
    seen = {(one.importer, one.imported, one.late) for one in house.imports()}
    assert ("cpmkit.grid.band", "cpmkit.grid.lattice", False) in seen
    assert ("cpmkit.cli", "cpmkit.scenefile.scene_files", True) in seen  # from cpmkit import load_scene, in a function
    assert ("cpmkit.dispatch", "cpmkit.families.steady", False) in seen  # imported by its name in a table
    assert not any(one.imported == "cpmkit.testing" for one in house.imports() if one.importer == "cpmkit.hookspecs")


def test_no_way_leads_from_a_room_back_to_it(house):
    arrows = house.arrows()
    assert len(arrows) > 100
    assert house.cycle(arrows) == []


def test_no_way_leads_from_a_package_within_a_room_back_to_it(house):
    assert house.package_of("cpmkit.forms.collocation.ghosts.ghosts") == "cpmkit.forms.collocation.ghosts"
    assert house.package_of("cpmkit.forms.collocation.band_layout") == "cpmkit.forms.collocation.band_layout"
    assert house.package_of("cpmkit.grid.band") == "cpmkit.grid"
    assert house.cycle(house.arrows(house.package_of)) == []


def test_no_way_leads_from_a_file_back_to_it(house):
    """Within a room, two files may ask each other inside functions."""
    pairs = {(one.importer, one.imported) for one in house.imports() if not one.late}
    assert house.cycle(pairs) == []


def test_a_way_back_would_be_found(house):
    assert {"errors", "solving"} <= {*house.cycle(house.arrows() | {("errors", "solving")})}
    assert house.cycle({("a", "b"), ("b", "c"), ("c", "b")}) == ["b", "c", "b"]


def test_every_room_imports_only_what_is_below_it_in_the_contract(house):
    place = {room: number for number, room in enumerate(house.rooms())}
    assert {room for pair in house.arrows() for room in pair} <= set(place)
    assert [pair for pair in sorted(house.arrows()) if place[pair[0]] >= place[pair[1]]] == []


def test_every_face_is_one_that_the_code_has(house):
    assert house.faces() <= {(one.importer, one.imported) for one in house.imports()}


def test_every_room_is_in_the_contract_and_says_what_it_holds(house):
    assert {house.room_of(name) for name in house.modules()} - {"cpmkit"} == set(house.rooms())
    for name, file in house.modules().items():
        if file.name == "__init__.py":
            assert house.sentence(house.modules()[name]).endswith("."), name


def test_table_and_picture(house, tmp_path, monkeypatch):
    from matplotlib.image import imread

    monkeypatch.syspath_prepend(str(DOCS))
    monkeypatch.setattr("house_drawing.TRIES", 3)
    monkeypatch.setattr("house_drawing.MOVES", 20)
    table, *pictures = house.write_all(tmp_path)
    assert all(f"| `{room}" in table.read_text(encoding="utf-8") for room in house.rooms())
    assert all(imread(picture)[..., :3].std() > 0.05 for picture in pictures)
    page = (DOCS / "contributing" / "code-layout.md").read_text(encoding="utf-8")
    assert all(f"../generated/{file.name}" in page for file in (table, *pictures))
