"""A saved solution is loaded with the scene that was solved alone: equation, conditions and edge with their numbers."""

import json

import numpy as np
import pytest

import cpmkit as ck

ENDS = ck.source("analytic.segment", start=[0, 0], end=[1, 0])
CUT = ck.source("analytic.point", at=[0.5, 0])


def scene(edge=None, cut=None, problem=None):
    return ck.Scene(
        ENDS,
        problem or ck.ScreenedPoisson(1.0, c=2.0),
        [ck.Boundary("cut", CUT, **(cut or {"both": ck.Dirichlet(0.5)}))],
        edge=edge or ck.Dirichlet(0.0),
    )


def saved(one, folder, spacing=0.1, **options):
    ck.solve(one, spacing, **options).save(folder / "bar.npz")
    return folder / "bar.npz"


ROBIN = {"both": ck.Robin(1.0, 2.0, 3.0)}
PARTED = {"across": ck.Transmission(jump=1.0, resistance=0.5)}
OTHERS = {
    "kind of the edge": (
        scene(),
        scene(edge=ck.Neumann(0.0)),
        "its edge: 'dirichlet 0.0', and here it is 'neumann 0.0'",
    ),
    "value on the edge": (
        scene(),
        scene(edge=ck.Dirichlet(0.1)),
        "its edge: 'dirichlet 0.0', and here it is 'dirichlet",
    ),
    "one end": (
        scene(edge={0: ck.Dirichlet(0.0), 1: ck.Neumann(1.0)}),
        scene(edge={0: ck.Dirichlet(0.0), 1: ck.Neumann(2.0)}),
        "its edge, 1: 'neumann 1.0', and here it is 'neumann 2.0'",
    ),
    "value inside": (
        scene(),
        scene(cut={"both": ck.Dirichlet(0.6)}),
        "its boundaries, number 1, left: 'dirichlet 0.5', and here it is 'dirichlet 0.6'",
    ),
    "factor of a Robin condition": (
        scene(cut=ROBIN),
        scene(cut={"both": ck.Robin(1.0, 2.5, 3.0)}),
        "beta=2.0 .*beta=2.5",
    ),
    "resistance of a contact": (
        scene(cut=PARTED),
        scene(cut={"across": ck.Transmission(jump=1.0, resistance=0.6)}),
        "resistance=0.5.*resistance=0.6",
    ),
    "order of a condition": (scene(), scene(cut={"both": ck.Dirichlet(0.5, order=1)}), "value=0.5 order=1"),
    "number and function": (scene(), scene(edge=ck.Dirichlet(lambda x: x[:, 0])), "'dirichlet of position'"),
    "constant of the equation": (
        scene(),
        scene(problem=ck.ScreenedPoisson(1.0, c=3.0)),
        r"its problem, equation: '-Lap u \+ 2 u = f', and here it is '-Lap u \+ 3 u = f'",
    ),
    "right-hand side": (
        scene(),
        scene(problem=ck.ScreenedPoisson(2.0, c=2.0)),
        "its problem, constants, f: 1.0, and here it is 2.0",
    ),
}


@pytest.mark.parametrize("name", OTHERS)
def test_a_scene_that_differs_in_one_thing_is_refused_and_the_thing_named(name, tmp_path):
    ours, other, message = OTHERS[name]
    file = saved(ours, tmp_path)
    np.testing.assert_array_equal(ck.load(file, ours).evaluate([[0.3, 0]]), ck.solve(ours, 0.1).evaluate([[0.3, 0]]))
    with pytest.raises(ck.InputError, match=f"another scene than the one given: .*{message}"):
        ck.load(file, other)


def test_the_same_numbers_written_otherwise_are_the_same_scene(tmp_path):
    file = saved(scene(), tmp_path)
    ck.load(
        file, scene(edge=ck.Dirichlet([0]), cut={"left": ck.Dirichlet(np.float64(0.5)), "right": ck.Dirichlet(0.5)})
    )


@pytest.mark.parametrize("form", ["collocation", "galerkin"])
@pytest.mark.parametrize("height", [0.3, 0.0])
def test_a_scene_whose_left_and_right_are_swapped_is_refused(tmp_path, form, height):
    def cut(turn, left, right):
        center, radius = [0, 0, height], np.sqrt(1 - height**2)
        ring = ck.source("analytic.circle", center=center, radius=radius, normal=[0, 0, turn])
        sides = ck.Boundary("ring", ring, left=ck.Dirichlet(left), right=ck.Dirichlet(right))
        return ck.Scene(ck.source("analytic.sphere"), ck.Laplace(), [sides])

    file = saved(cut(1, 1.0, 0.0), tmp_path, 0.35, form=form)
    with pytest.raises(ck.InputError, match="another scene than the one given: left and right of its boundaries are"):
        ck.load(file, cut(-1, 1.0, 0.0))
    ck.load(file, cut(1, 1.0, 0.0))


def test_functions_are_not_compared_and_a_file_without_an_edge_is_compared_by_kinds(tmp_path):
    ours = scene(edge=ck.Dirichlet(lambda x: x[:, 0]))
    file = saved(ours, tmp_path)
    ck.load(file, scene(edge=ck.Dirichlet(lambda x: 2 * x[:, 0])))
    with np.load(file) as opened:
        arrays = {name: opened[name] for name in opened.files}
    summary = json.loads(str(arrays["summary"]))
    del summary["scene"]["edge"]
    arrays["summary"] = np.array(json.dumps(summary))
    np.savez(tmp_path / "earlier.npz", **arrays)
    ck.load(tmp_path / "earlier.npz", scene(cut={"both": ck.Dirichlet(0.7)}))
    with pytest.raises(ck.InputError, match="another scene"):
        ck.load(tmp_path / "earlier.npz", scene(cut={"both": ck.Neumann(0.5)}))


FAMILIES = {
    "eigen": ck.Eigen(3),
    "heat": ck.Heat(lambda x: x[:, 0], until=0.1, step=0.05, frames=2),
    "reaction-diffusion": ck.ReactionDiffusion([1, 0.5], lambda u: -u, [0.1, 0.2], until=0.1, step=0.05, frames=2),
    "wave": ck.Wave(lambda x: x[:, 0], until=0.1, step=0.05),
    "biharmonic": ck.Biharmonic(lambda x: x[:, 0]),
}


@pytest.mark.parametrize("kind", FAMILIES)
def test_problems_of_each_family_are_loaded(kind, tmp_path):
    one = ck.Scene(ck.source("analytic.circle"), FAMILIES[kind])
    solution = ck.solve(one, 0.2)
    solution.save(tmp_path / "circle.npz")
    np.testing.assert_array_equal(ck.load(tmp_path / "circle.npz", one).evaluate([[0, 1]]), solution.evaluate([[0, 1]]))
    light = ck.load(tmp_path / "circle.npz")
    assert {f"lattice_{name}" for name in solution.arrays()} <= light.arrays.keys()
