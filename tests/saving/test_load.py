"""A saved solution that is loaded with its scene reads as before, to the last bit; anything else is refused."""

import numpy as np
import pytest
from model_problems import circle_jump, on_circle, sphere_points

import cpmkit as ck

TOML = """
[surface]
kind = "analytic.sphere"

[[boundary]]
name = "ring"
kind = "analytic.circle"
center = [0, 0, 0.3]
radius = {radius}
normal = [0, 0, 1]
left = {{ dirichlet = [1.0, "x"] }}
right = {{ neumann = 0.0 }}

[problem]
kind = "screened"
f = "x*y + z"
"""


@pytest.fixture
def ring(tmp_path):
    """Return the path of a scene file, the solution of its scene, and where it is saved."""
    (tmp_path / "ring.toml").write_text(TOML.format(radius=np.sqrt(0.91)))
    scene = ck.load_scene(tmp_path / "ring.toml").scene
    solution = ck.solve(scene, 0.3, degree=2, order=1, origin=[0.01, 0.02, 0.03])
    solution.save(tmp_path / "ring.npz")
    return tmp_path / "ring.toml", solution, tmp_path / "ring.npz"


def test_with_its_scene_or_scene_file_it_reads_as_before(ring):
    file, solution, saved = ring
    points = sphere_points(300)
    on = solution.scene.boundaries[0].source.mesh(0.2)[0]
    for scene in (solution.scene, file, str(file)):
        again = ck.load(saved, scene)
        np.testing.assert_array_equal(again.evaluate(points), solution.evaluate(points))
        np.testing.assert_array_equal(again.evaluate(on, side="right"), solution.evaluate(on, side="right"))
        np.testing.assert_array_equal(again.gradient(points), solution.gradient(points))
    assert again.report == solution.report
    assert again.work == solution.work
    assert again.seconds == solution.seconds
    assert again.warnings == solution.warnings
    assert again.discretization() == solution.discretization()


def test_what_was_loaded_can_be_saved_and_loaded_again(ring, tmp_path):
    file, solution, saved = ring
    ck.load(saved, file).save(tmp_path / "again.npz")
    points = sphere_points(50)
    np.testing.assert_array_equal(ck.load(tmp_path / "again.npz", file).evaluate(points), solution.evaluate(points))


@pytest.mark.parametrize(
    ("problem", "form"),
    [
        (ck.Poisson(lambda x: x[:, 0] + 1), "collocation"),
        (ck.Poisson(lambda x: x[:, 0] + 1), "galerkin"),
        (ck.ScreenedPoisson(lambda x: x[:, 0] + 1), "collocation"),  # the other form keeps the mean by itself
    ],
)
def test_corrections_of_data_are_reported_as_before(problem, form, tmp_path):
    scene = ck.Scene(ck.source("analytic.sphere"), problem)
    solution = ck.solve(scene, 0.3, form=form)
    assert solution.imbalances
    solution.save(tmp_path / "ball.npz")
    again = ck.load(tmp_path / "ball.npz", scene)
    assert again.imbalances == solution.imbalances


def test_in_the_plane_with_a_jump_it_reads_as_before(tmp_path):
    scene = circle_jump(center=(1e3, -7.0))[0]
    solution = ck.solve(scene, 0.05)
    solution.save(tmp_path / "jump.npz")
    points = on_circle(np.linspace(0, 6.2, 500), center=(1e3, -7.0))
    np.testing.assert_array_equal(ck.load(tmp_path / "jump.npz", scene).evaluate(points), solution.evaluate(points))


def test_without_its_scene_the_mesh_and_the_summary_are_there(ring):
    _, solution, saved = ring
    light = ck.load(saved)
    assert not isinstance(light, ck.Solution)
    np.testing.assert_array_equal(light.points, solution.display_mesh().points)
    np.testing.assert_array_equal(light.cells, solution.display_mesh().cells)
    np.testing.assert_array_equal(light.values, solution.display_mesh().values)
    assert light.summary["discretization"]["spacing"] == 0.3
    with pytest.raises(ck.InputError, match=r"cannot be evaluated; give scene= to cpmkit\.load"):
        light.evaluate([[0, 0, 1.0]], side="left")


def test_finite_elements_are_loaded_without_a_scene_only(tmp_path):
    vertices, faces = ck.source("analytic.sphere").mesh(0.3)
    scene = ck.Scene(ck.source("mesh.triangles", vertices=vertices, faces=faces), ck.ScreenedPoisson(1.0))
    solution = ck.solve(scene, backend="fem")
    solution.save(tmp_path / "fem.npz")
    np.testing.assert_array_equal(ck.load(tmp_path / "fem.npz").values, solution.values)
    with pytest.raises(ck.InputError, match="of another back end than 'cpm'; load it without a scene"):
        ck.load(tmp_path / "fem.npz", scene)


def other_scenes(scene):
    """Scenes that differ from that of the fixture, each in one thing."""
    ring = scene.boundaries[0]
    sides = {"left": ring.left, "right": ring.right}
    lower = ck.source("analytic.circle", center=[0, 0, 0.2], radius=np.sqrt(0.96), normal=[0, 0, 1])
    yield ck.Scene(ck.source("analytic.sphere", radius=1.5), scene.problem, scene.boundaries)
    yield ck.Scene(scene.surface, scene.problem, [ck.Boundary("ring", lower, **sides)])
    yield ck.Scene(scene.surface, scene.problem, [ck.Boundary("ring", ring.source, left=ring.left, right=ring.left)])
    yield ck.Scene(scene.surface, scene.problem, [ck.Boundary("wring", ring.source, **sides)])
    yield ck.Scene(scene.surface, scene.problem, [])
    yield ck.Scene(scene.surface, ck.Poisson(1.0), scene.boundaries)
    yield circle_jump()[0]


def test_another_scene_is_refused(ring):
    _, solution, saved = ring
    for scene in other_scenes(solution.scene):
        with pytest.raises(ck.InputError, match=r"was saved from another scene than the one given"):
            ck.load(saved, scene)


def altered(path, tmp_path, **changes):
    """Save a copy of a .npz with arrays changed, or left out where they are None."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files} | changes
    np.savez(tmp_path / "altered.npz", **{name: array for name, array in arrays.items() if array is not None})
    return tmp_path / "altered.npz"


def test_files_that_are_none_are_answered_in_one_sentence(ring, tmp_path):
    file, _, saved = ring
    whole = saved.read_bytes()
    cases = {"empty.npz": b"", "text.npz": b"values\n1\n", "half.npz": whole[: len(whole) // 2], "file.npz": b"PK"}
    damaged = bytearray(whole)
    damaged[len(whole) // 3 : len(whole) // 3 + 50] = bytes(50)
    for name, content in {**cases, "damaged.npz": bytes(damaged)}.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(
            ck.InputError, match=r"is damaged or not a solution that was saved as \.npz|damaged\.npz' ends before"
        ):
            ck.load(tmp_path / name, file)
    np.save(tmp_path / "array.npy", np.zeros(3))
    with pytest.raises(ck.InputError, match=r"'array\.npy' is damaged or not a solution"):
        ck.load(tmp_path / "array.npy")
    with pytest.raises(ck.InputError, match="There is no file"):
        ck.load(tmp_path / "absent.npz")
    with pytest.raises(ck.InputError, match=r"is not a solution that was saved as \.npz: it lacks the array 'summary'"):
        ck.load(altered(saved, tmp_path, summary=None))
    with pytest.raises(ck.InputError, match="is of format 99, and this cpmkit reads format 1"):
        ck.load(altered(saved, tmp_path, format=np.array(99)))
    with pytest.raises(ck.InputError, match="another scene"):
        ck.load(altered(saved, tmp_path, lattice_unknowns=np.zeros((7, 2))), file)
