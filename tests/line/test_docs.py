"""What the documentation shows runs, and its reference names everything that the code offers."""

import doctest
import importlib.util
import inspect
import json
import pkgutil
import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from measure_docs import block_texts

import cpmkit
import cpmkit.plugin
from cpmkit import hookspecs, load_scene, plugins
from cpmkit.cli import main
from cpmkit.errors import SceneError
from cpmkit.plugin import COORDINATES, FUNCTIONS
from cpmkit.scenefile.look import PictureRequest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
MODULES = [name for _, name, _ in pkgutil.walk_packages(cpmkit.__path__, "cpmkit.") if not name.endswith("__main__")]
SCENE = {"surface": 'kind = "analytic.circle"', "problem": 'kind = "laplace"'}


def from_docs(name):
    """Return a module of the documentation's folder."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", MODULES)
def test_examples_in_docstrings(name):
    assert doctest.testmod(import_module(name)).failed == 0


def test_docstrings_hold_examples():
    counts = [len(doctest.DocTestFinder(exclude_empty=True).find(import_module(name))) for name in MODULES]
    assert sum(counts) >= 5


def test_python_in_the_readme(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    code = "\n".join(block_texts(ROOT / "README.md", "python"))
    assert code.count("spacing=0.1)") == 1
    exec(code.replace("spacing=0.1)", "spacing=0.2)"), names)
    assert (tmp_path / "torus.png").stat().st_size > 10_000
    read = names["solution"].evaluate
    on_top = [[1.0, 0.0, 0.45], [0.0, -1.0, 0.45]]
    left, right = np.array([0.9, 0.4, 0.1]), np.array([0.1, 0.3, 0.8])
    assert abs(read(on_top, side="left") - left).max() < 0.02
    assert abs(read(on_top, side="right") - right).max() < 0.02
    # around the tube colours are linear in the integral of dv / (1 + 0.45 cos v): of which this is the share at the rim
    assert abs(read([[1.45, 0.0, 0.0]]) - (left + 0.8242883 * (right - left))).max() < 0.002


def documented(page):
    text = (DOCS / "reference" / page).read_text(encoding="utf-8")
    return set(re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)))


def accepted(tmp_path, table, beside=""):
    """Return the keys of a scene's table, as the message lists them that refuses an unknown one."""
    tables = {**SCENE, table: f"{beside}\nnonsense = 1"}
    file = tmp_path / "scene.toml"
    file.write_text("".join(f"[{name}]\n{content}\n" for name, content in tables.items()))
    with pytest.raises(SceneError, match="accepted are") as caught:
        load_scene(file)
    return set(str(caught.value).partition("accepted are ")[2].rstrip(".").split(", "))


def properties(schema):
    """Return the names of the tables and keys in a part of a schema, at any depth."""
    entries = schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ()
    names = schema.get("properties", ()) if isinstance(schema, dict) else ()
    return set(names).union(*map(properties, entries))


def schema_of(command):
    return json.loads(CliRunner().invoke(main, ["schema", command]).output)["properties"]


def test_every_table_of_a_scene_is_documented():
    text = (DOCS / "reference" / "scene-keys.md").read_text()
    for table in {"output", *schema_of("scene")} - {"title"}:
        assert f"## `[{table}]`" in text or f"## `[[{table}]]`" in text


@pytest.mark.parametrize("command", ["vectors", "map", "paint"])
def test_every_table_and_key_of_an_application_is_documented(command):
    text = (DOCS / "reference" / "application-keys.md").read_text()
    assert f"## `cpmkit {command}`" in text
    new = {table: keys for table, keys in schema_of(command).items() if table not in schema_of("scene")}
    assert new
    assert all(f"[{table}]" in text for table in new)
    sources = properties({"properties": {}, "all": [schema_of("scene")["surface"], schema_of("scene")["boundary"]]})
    assert properties(list(new.values())) - sources - documented("application-keys.md") == set()


@pytest.mark.parametrize("table", ["discretization", "solver", "output"])
def test_every_key_of_a_table_is_documented(table, tmp_path):
    assert accepted(tmp_path, table) - documented("scene-keys.md") == set()


@pytest.mark.parametrize(
    "kind", [kind for kind in cpmkit.kinds() if kind.sort == "equation"], ids=lambda kind: kind.name
)
def test_every_key_of_a_problem_is_documented(kind):
    assert {kind.name, *(key.name for key in kind.keys)} - documented("scene-keys.md") == set()


def offered(call):
    """Return the words that the message of an error lists as accepted."""
    with pytest.raises(cpmkit.InputError) as caught:
        call()
    return set(
        re.findall(r"\.?\w+", re.search(r"(?:must be|accepted are) ([^;]*?)(?:, or the|\.$)", str(caught.value))[1])
    )


def test_every_condition_key_and_word_is_documented():
    named = documented("scene-keys.md")
    sides = {name for name in inspect.signature(cpmkit.Boundary).parameters if name != "source"}
    assert {*sides, "kind", "edge", "order"} - named == set()
    assert set(inspect.signature(PictureRequest).parameters) - named == set()
    scene = cpmkit.Scene(cpmkit.source("analytic.circle"), cpmkit.ScreenedPoisson(1.0))
    solvers = offered(lambda: cpmkit.solve(scene, 0.2, solver="nonsense"))
    suffixes = offered(lambda: cpmkit.solve(scene, 0.2).save("nonsense.nonsense"))
    assert {"auto", "multigrid"} < solvers
    assert {".npz", ".vtp"} < suffixes
    assert {*solvers, *suffixes} - named == set()
    for condition in (kind.name for kind in cpmkit.kinds() if kind.sort == "condition"):
        assert any(name.startswith(f"{{ {condition} = ") for name in named), condition
    assert {*COORDINATES, *FUNCTIONS, "pi", "e"} - named == set()


def test_every_installed_kind_and_key_is_documented():
    pages = from_docs("generated_pages")
    page = pages.kinds_page()
    for kind in plugins.installed_kinds():
        section = page.partition(f"### `{kind.kind}`\n")[2].partition("\n##")[0]
        for key in inspect.signature(plugins.any_factory(kind.kind)[1]).parameters:
            assert f"| `{key}` |" in section, (kind.kind, key)


def test_every_command_is_documented():
    page = from_docs("generated_pages").commands_page()
    for name, command in main.commands.items():
        section = page.partition(f"## `cpmkit {name}`\n")[2].partition("\n## ")[0]
        for parameter in (option for option in command.params if not getattr(option, "hidden", False)):
            assert parameter.opts[0] in section or parameter.human_readable_name.upper() in section


def test_every_hook_is_documented():
    text = (DOCS / "reference" / "hooks.md").read_text()
    hooks = [name for name, value in vars(hookspecs).items() if hasattr(value, "cpmkit_spec")]
    assert hooks
    for hook in hooks:
        assert f".. autofunction:: cpmkit.hookspecs.{hook}\n" in text
    assert set(re.findall(r"cpmkit\.hookspecs\.(cpmkit_\w+)", text)) == set(hooks)


def test_every_public_name_is_documented():
    text = (DOCS / "reference" / "api.md").read_text()
    for name in cpmkit.__all__:
        assert re.search(rf"^\.\. auto\w+:: cpmkit\.{name}$", text, re.MULTILINE), name


def test_every_name_that_a_plugin_may_import_is_documented():
    page = from_docs("generated_pages").facade_page()
    for use, names in cpmkit.plugin.USES.items():
        section = page.partition(f"## {use}\n")[2].partition("\n## ")[0]
        for name in names:
            assert f"cpmkit.plugin.{name}\n" in section + "\n" or f"``{name}`` is " in section, name


def test_every_picture_of_the_gallery_stands_with_the_file_that_makes_it():
    listings = from_docs("generated_pages").gallery_listings()
    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    shown = re.findall(r"`(examples/[^`]+)`|(!\[)|\{include\} generated/(\S+)", text)
    waiting, named, included = 0, "", set()
    for example, picture, page in shown:
        if example:
            assert waiting == 0, example  # the pictures before it have their listing
            named = example
        waiting += bool(picture)
        if page:
            assert waiting > 0, page
            assert page == f"gallery-{Path(named).name}.md"
            assert (ROOT / named).read_text(encoding="utf-8").strip() in listings[page]
            waiting, included = 0, {*included, page}
    assert waiting == 0
    assert included == set(listings)
    assert len(included) > 15


def test_drawings(tmp_path):
    from matplotlib.image import imread

    drawings = from_docs("drawings")
    drawings.PIXELS = 80
    for file in drawings.draw_all(tmp_path):
        assert imread(file)[..., :3].std() > 0.05, file.name
        assert any(file.name in page.read_text() for page in (DOCS / "explanation").glob("*.md")), file.name


def test_links_between_pages_lead_somewhere():
    for page in [ROOT / "README.md", *DOCS.rglob("*.md")]:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text()):
            assert "generated/" in target or (page.parent / target).exists(), (page, target)
