"""Plugins are found from metadata, imported when a kind is asked for, and held to the hooks."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pluggy
import pytest
from model_problems import circle_jump

import cpmkit as ck
from cpmkit import plugins
from cpmkit.linear.solver_options import make_solver
from cpmkit.plugin import hookimpl
from cpmkit.scenefile.documented_keys import keys_of


class FakeEntryPoint:
    def __init__(self, name, plugin):
        self.name, self.value, self._plugin = name, f"fake:{name}", plugin
        self.dist = SimpleNamespace(name="cpmkit-fake", version="9.9")

    def load(self):
        if isinstance(self._plugin, Exception):
            raise self._plugin
        return self._plugin


@pytest.fixture
def install(monkeypatch):
    """Return a function that makes a kind look installed, and forget all plugins afterwards."""
    real, fake = plugins.entry_points, []

    def entry_points(group, name=None):
        found = [point for point in real(group=group) if group == plugins.KINDS_GROUP] + fake
        return [point for point in found if name is None or point.name == name]

    monkeypatch.setattr(plugins, "entry_points", entry_points)
    for name in ("manager", "_entry_point"):  # with empty caches
        monkeypatch.setattr(plugins, name, cache(getattr(plugins, name).__wrapped__))
    return lambda kind, plugin: fake.append(FakeEntryPoint(kind, plugin))


class GoodPlugin:
    """A surface and a solver."""

    @hookimpl
    def cpmkit_sources(self):
        return {"fake.ring": lambda *, size=1.0: ck.source("analytic.circle", center=(0, 0), radius=size)}

    @hookimpl
    def cpmkit_solvers(self):
        def patient(*, patience=1):
            assert patience > 0
            return make_solver("direct", {})

        return {"fake.solver": patient}


KINDS = ("fake.ring", "fake.solver")


@pytest.fixture
def good(install):
    plugin = GoodPlugin()
    for kind in KINDS:
        install(kind, plugin)
    return plugin


def test_kinds_are_listed_with_their_origin(good):
    listed = {kind.kind: kind for kind in plugins.installed_kinds()}
    assert {"analytic.torus", "mesh.triangles", *KINDS} <= set(listed)
    assert (listed["fake.ring"].distribution, listed["fake.ring"].version) == ("cpmkit-fake", "9.9")
    assert plugins.manager().get_plugins() == set()  # listing loads nothing


def test_a_kind_loads_its_plugin_and_no_other(good):
    assert ck.source("fake.ring", size=2.0).bounds.tolist() == [[-2, -2], [2, 2]]
    assert good in plugins.manager().get_plugins()
    assert not any("mesh" in str(plugin) for plugin in plugins.manager().get_plugins())


def test_a_source_of_a_plugin_in_a_scene_file(good, tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(
        '[surface]\nkind = "fake.ring"\n[problem]\nkind = "laplace"\n'
        '[[boundary]]\nname = "cut"\nkind = "analytic.point"\nat = [0.0, 1.0]\nboth = { dirichlet = "y" }\n'
    )
    scene = ck.load_scene(path).scene
    assert [boundary.name for boundary in scene.boundaries] == ["cut"]
    np.testing.assert_allclose(ck.solve(scene, 0.1).evaluate([[-1.0, 0.0]]), 1.0, rtol=1e-9)
    path.write_text(path.read_text().replace('fake.ring"', 'fake.ring"\nsise = 1.0'))
    with pytest.raises(ck.SceneError, match=r"unknown key 'sise'.*'size'.*; accepted are size"):
        ck.load_scene(path)


def test_a_solver_of_a_plugin(good):
    scene, points, exact = circle_jump()
    solution = ck.solve(scene, 0.05, solver="fake.solver", patience=3)
    assert np.abs(solution.evaluate(points) - exact).max() < 3e-3
    with pytest.raises(ck.SceneError, match="unknown key 'pace'; accepted are patience"):
        ck.solve(scene, 0.05, solver="fake.solver", pace=3)
    with pytest.raises(ck.InputError, match="'direct' has no option 'patience'; accepted are none"):
        ck.solve(scene, 0.05, solver="direct", patience=3)


def test_a_kind_of_no_plugin_names_the_group_of_entry_points(good):
    with pytest.raises(
        ck.PluginError, match=r"must be installed, with the kind as an entry point in the group 'cpmkit"
    ):
        ck.source("own.ring")


def test_a_kind_of_another_sort(good):
    with pytest.raises(
        ck.PluginError, match=r"'fake\.solver' is not among what its plugin hands to the hook cpmkit_sources"
    ):
        ck.source("fake.solver")
    with pytest.raises(ck.PluginError, match=r"'fake\.ring' is not among"):
        ck.solve(circle_jump()[0], 0.1, solver="fake.ring")


def test_a_plugin_that_does_not_import(install):
    install("broken.kind", ImportError("no module named 'nose'"))
    with pytest.raises(ck.PluginError, match=r"'broken\.kind' does not import: no module named 'nose'"):
        ck.source("broken.kind")


def test_a_misspelt_hook_is_refused(install):
    class Misspelt:
        @hookimpl
        def cpmkit_source(self):
            return {}

    install("misspelt.kind", Misspelt())
    with pytest.raises(pluggy.PluginValidationError, match="cpmkit_source"):
        ck.source("misspelt.kind")


def test_keys_have_the_types_of_annotations():
    def make(*, size: float, name: "str" = "a", other: float | None = None):
        """Return a shape."""

    assert [(key.type, key.declared) for key in keys_of(make)] == [
        ("number", "float"),
        ("string", "str"),
        ("float | None", "float | None"),
    ]
