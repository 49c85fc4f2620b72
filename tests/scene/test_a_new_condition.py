"""A new kind of condition is one class, wherever it is defined: it tells which of the standard laws it is."""

from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from arc_problems import tilted_circle

import cpmkit as ck
from cpmkit import plugins
from cpmkit.plugin import Condition, Interface, Mixed, Nonlinear, hookimpl

BAR = ck.source("analytic.segment", start=[0, 0], end=[1, 0])


@dataclass(frozen=True, eq=False)
class Convection(Condition):
    """du/db = transfer (ambient - u)."""

    transfer: float
    ambient: object = 0.0
    order: int | None = None
    kind = "convection"

    @property
    def law(self):
        if not callable(self.ambient):
            return Mixed(1.0, self.transfer, self.transfer * self.ambient)
        return Mixed(1.0, self.transfer, lambda points: self.transfer * self.ambient(points))


@dataclass(frozen=True, eq=False)
class Radiation(Condition):
    """du/db = emissivity (sky^4 - u^4)."""

    emissivity: float
    sky: float = 0.0
    kind = "radiation"

    @property
    def law(self):
        return Nonlinear(lambda u: self.emissivity * (self.sky**4 - u**4))


@dataclass(frozen=True, eq=False)
class Membrane(Condition):
    """What passes is in proportion to the difference of u across."""

    permeability: float
    kind = "membrane"

    @property
    def law(self):
        return Interface(0.0, 0.0, 1.0 / self.permeability)

    def refusal(self, problem):
        return "" if problem.family == "time" else "needs a problem in time"


def ambient(points):
    return 1.0 + points[:, 0]


def at_one_end(condition, problem=None):
    return ck.Scene(BAR, problem or ck.Poisson(1.0), edge={0: ck.Dirichlet(0.0), 1: condition})


def on_the_sphere(problem, **conditions):
    circle, axis = tilted_circle()
    return ck.Scene(ck.source("analytic.sphere"), problem, [ck.Boundary("seam", circle, left_of=axis, **conditions)])


@pytest.mark.parametrize("order", [1, 2])
def test_on_an_edge_it_is_the_robin_condition_that_it_says(order):
    own, robin = (
        ck.solve(at_one_end(one), 0.1, order=order) for one in (Convection(2.0, 3.0), ck.Robin(1.0, 2.0, 6.0))
    )
    assert np.array_equal(own.values, robin.values)


def test_on_one_side_of_a_boundary_it_is_the_robin_condition_that_it_says():
    def solved(left):
        scene = on_the_sphere(ck.Poisson(lambda x: x[:, 1]), left=left, right=ck.Neumann(0.0))
        return ck.solve(scene, 0.2)

    own = solved(Convection(2.0, ambient))
    robin = solved(ck.Robin(1.0, 2.0, lambda points: 2.0 * ambient(points)))
    assert np.array_equal(own.values, robin.values)
    assert own.imbalances == robin.imbalances  # one piece is fixed by the condition, the other by its mean
    assert len(own.imbalances) == 1


def test_a_nonlinear_one_is_found_by_newtons_method():
    own = ck.solve(at_one_end(Radiation(2.0, 1.5)), 0.1)
    flux = ck.solve(at_one_end(ck.NonlinearFlux(lambda u: 2.0 * (1.5**4 - u**4))), 0.1)
    assert np.array_equal(own.values, flux.values)
    assert "Newton's method converged" in own.report.reason


def test_one_that_couples_both_sides_is_given_across():
    heat = ck.Heat(lambda x: x[:, 2], until=0.02, step=0.01)
    own = ck.solve(on_the_sphere(heat, across=Membrane(4.0)), 0.25)
    contact = ck.solve(on_the_sphere(heat, across=ck.Transmission(resistance=0.25)), 0.25)
    assert np.array_equal(own.values, contact.values)
    with pytest.raises(ck.SceneError, match=r"`both` must be Dirichlet, .* condition of one side, .*got Membrane"):
        on_the_sphere(heat, both=Membrane(4.0))
    with pytest.raises(ck.SceneError, match=r"`across` must be Transmission or another .*, got Convection"):
        on_the_sphere(heat, across=Convection(1.0))


def test_equations_that_do_not_take_it_say_why():
    for problem, message in (
        (ck.Biharmonic(1.0), "'convection' says nothing of Lap u; a biharmonic problem takes SimplySupported"),
        (ck.Eigen(), "data where an eigenvalue problem takes zero"),
    ):
        with pytest.raises(ck.SceneError, match=f"the edge's condition.* {message}"):
            at_one_end(Convection(2.0, 1.0), problem)
    assert at_one_end(Convection(2.0), ck.Eigen()).channels == 1
    with pytest.raises(ck.SceneError, match="the edge's condition: 'radiation' needs a steady equation; use Dirichlet"):
        at_one_end(Radiation(1.0), ck.Heat(0.0, until=1.0, step=0.1))
    with pytest.raises(ck.SceneError, match="boundary 'seam': 'membrane' needs a problem in time"):
        on_the_sphere(ck.Poisson(0.0), across=Membrane(1.0))


def test_its_data_have_channels():
    colours = Convection(2.0, np.array([1.0, 2.0, 3.0]))
    assert at_one_end(colours).channels == 3
    with pytest.raises(ck.SceneError, match="the right-hand side f has 2 channels where others have 3"):
        at_one_end(colours, ck.Poisson([1.0, 2.0]))


def test_it_is_described_by_its_kind_and_its_data():
    scene = on_the_sphere(ck.ScreenedPoisson(1.0), left=Convection(2.0, ambient), right=Convection(2.0, 3.0))
    assert "Convection left, Convection right" in str(ck.explain(scene, spacing=0.2, dry_run=True))
    described = ck.solve(scene, 0.3).summary()["scene"]["boundaries"][0]
    assert described["left"] == "convection transfer=2.0 ambient=of position"
    assert described["right"] == "convection transfer=2.0 ambient=3.0"


def test_two_that_say_the_same_are_one_condition_for_both_sides():
    scene = on_the_sphere(ck.ScreenedPoisson(1.0), left=Convection(2.0, ambient), right=Convection(2.0, ambient))
    assert scene.boundaries[0].condition("left") is scene.boundaries[0].condition("right")


class Plugin:
    """Two of these conditions, offered to scene files."""

    @hookimpl
    def cpmkit_conditions(self):
        return {"heat.convection": Convection, "heat.membrane": Membrane}


@pytest.fixture
def _installed(monkeypatch):
    plugin = Plugin()
    points = [SimpleNamespace(name=name, value=name, load=lambda: plugin) for name in plugin.cpmkit_conditions()]
    real = plugins.entry_points

    def entry_points(group, name):
        return [*real(group=group, name=name), *(point for point in points if point.name == name)]

    monkeypatch.setattr(plugins, "entry_points", entry_points)
    for name in ("manager", "_entry_point"):  # with empty caches
        monkeypatch.setattr(plugins, name, cache(getattr(plugins, name).__wrapped__))


@pytest.mark.usefixtures("_installed")
def test_a_plugin_offers_it_to_scene_files(tmp_path):
    def read(edge, side="both = { dirichlet = 0.0 }"):
        (tmp_path / "scene.toml").write_text(
            '[surface]\nkind = "analytic.segment"\nstart = [0, 0]\nend = [1, 0]\n'
            f'edge = {{ 0 = {{ dirichlet = 0.0 }}, 1 = {edge} }}\n[problem]\nkind = "heat"\ninitial = 0\nuntil = 1\n'
            f'step = 0.1\n[[boundary]]\nkind = "analytic.point"\nat = [0.5, 0]\n{side}\n'
        )
        return ck.load_scene(tmp_path / "scene.toml").scene

    scene = read('{ kind = "heat.convection", transfer = 2, ambient = "1 + x", order = 1 }')
    condition = scene.edge[1]
    assert isinstance(condition, Convection)
    assert condition.order == 1
    assert condition.law.datum(np.array([[1.0, 0.0]])) == 4.0
    coupled = read("{ neumann = 0.0 }", 'across = { kind = "heat.membrane", permeability = 2.0 }')
    assert coupled.boundaries[0].condition("left").law.resistance == 0.5
    with pytest.raises(ck.SceneError, match=r"edge 1 has the unknown key 'transfr' .*; accepted are transfer"):
        read('{ kind = "heat.convection", transfr = 2 }')
    with pytest.raises(ck.PluginError, match=r"'analytic\.sphere' is not among .* the hook cpmkit_conditions"):
        read('{ kind = "analytic.sphere" }')
