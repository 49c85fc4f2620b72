"""Eight real tasks are done by short scripts, none longer than the shortest one of other tools by more than three."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import cpmkit as ck

ROOT = Path(__file__).parents[2]
TASKS, TABLE = ROOT / "examples" / "tasks", ROOT / "benchmarks" / "tables" / "eight-tasks.md"
#: How many lines more than the best of other tools a script may have.
ALLOWANCE = 3
TORUS = ck.source("analytic.torus")


def run(name, monkeypatch, folder, spacing):
    """Run a script in ``folder`` with another spacing and small pictures, and return what it holds at the end."""
    script = (TASKS / f"{name}.py").read_text(encoding="utf-8")
    coarse, replaced = re.subn(r"spacing=[0-9.]+", f"spacing={spacing}", script)
    assert replaced == 1
    coarse = re.sub(r"width=[0-9]+", "width=200", coarse)
    monkeypatch.chdir(folder)
    names = {}
    exec(compile(coarse, name, "exec"), names)
    return names


def counted(name):
    """Return how many lines of a script say something: no blank line, no comment, and not its docstring."""
    script = (TASKS / f"{name}.py").read_text(encoding="utf-8")
    docstring = ast.parse(script).body[0].end_lineno
    return sum(bool(re.match(r"\s*[^\s#]", line)) for line in script.splitlines()[docstring:])


def rows():
    table = [line.split("|")[1:-1] for line in TABLE.read_text(encoding="utf-8").splitlines()[2:]]
    return {re.search(r"tasks/(\w+)\.py", row[0])[1]: (int(row[1]), int(row[2])) for row in table}


def save_line(curve, file, count=60):
    """Write ``count`` points along a closed curve, and its first again, with three digits, as drawn by hand."""
    points = curve.mesh(0.02)[0]
    chosen = points[np.linspace(0, len(points), count, endpoint=False).astype(int)]
    np.savetxt(file, np.concatenate([chosen, chosen[:1]]), fmt="%.3f", delimiter=",")


def test_each_script_is_as_short_as_the_best_of_other_tools_nearly():
    assert set(rows()) == {file.stem for file in TASKS.glob("*.py")}
    assert len(rows()) == 8
    for name, (own, best) in rows().items():
        assert own == counted(name), name
        assert own <= best + ALLOWANCE, name


def test_diffusion_curves_on_an_own_obj_with_a_drawn_line(monkeypatch, tmp_path):
    vertices, faces = TORUS.mesh(0.15)
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    (tmp_path / "model.obj").write_text("\n".join(lines))
    save_line(ck.source("analytic.circle", radius=1.4, normal=[0, 0, 1]), tmp_path / "line.csv")
    painted = run("diffusion_curves", monkeypatch, tmp_path, 0.2)["painted"]
    start = painted.solution.scene.boundaries[0].source.vertices[:1]
    left, right = (painted.evaluate(start, side)[0] for side in ("left", "right"))
    assert left == pytest.approx([1.0, 0.843, 0.0], abs=0.05)  # gold
    assert right == pytest.approx([0.0, 0.5, 0.5], abs=0.05)  # teal
    assert (tmp_path / "painted.png").stat().st_size > 3000


def test_poisson_on_a_noisy_scan(monkeypatch, tmp_path):
    points = TORUS.mesh(0.1)[0]
    noise = np.random.default_rng(0).normal(scale=0.01, size=points.shape)
    np.savetxt(tmp_path / "scan.xyz", points + noise)
    found = run("noisy_scan", monkeypatch, tmp_path, 0.25)["solution"]  # the noise moves the mean of f a little
    exact = ck.solve(ck.Scene(TORUS, ck.Poisson("x*y")), spacing=0.2)
    difference = found.evaluate(points) - exact.evaluate(points)
    assert np.abs(difference).max() < 0.05 * np.ptp(exact.evaluate(points))


def test_heat_on_spot_as_a_film(monkeypatch, tmp_path, real_mesh):
    real_mesh("spot.obj")
    found = run("heat_film", monkeypatch, tmp_path, 0.3)["solution"]
    totals = np.array([frame.totals[0] for frame in found.frames])
    np.testing.assert_allclose(totals, totals[0], rtol=1e-6)  # no heat is lost
    with Image.open(tmp_path / "heat.gif") as film:
        assert film.n_frames == 16


def test_six_modes_of_a_tube_around_a_knot_as_a_sheet(monkeypatch, tmp_path):
    modes = run("modes_of_a_knot", monkeypatch, tmp_path, 0.35)["modes"]
    points, cells = ck.source("parametric.torus_knot", a=2, b=3).mesh(0.02)
    length = np.linalg.norm(points[cells[:, 0]] - points[cells[:, 1]], axis=1).sum()
    of_a_circle = (2 * np.pi / length * np.array([0, 1, 1, 2, 2, 3])) ** 2  # so far the tube is hardly felt
    np.testing.assert_allclose(modes.eigenvalues, of_a_circle, rtol=0.05, atol=1e-6)
    assert (tmp_path / "modes.png").stat().st_size > 3000


def test_a_gyroid_with_a_flux_through_its_edge(monkeypatch, tmp_path):
    found = run("gyroid", monkeypatch, tmp_path, 0.5)["solution"]
    points = found.display_mesh().points[::7]
    values = found.evaluate(points)
    assert np.abs(values + found.evaluate(-points)).max() < 0.05 * values.max()  # phi is odd, and so is the flux
    assert abs(found.integrate()) < 0.01 * found.integrate(lambda x, u: np.abs(u))
    assert (tmp_path / "gyroid.png").stat().st_size > 3000


def test_a_two_sided_cut_both_values_to_a_ply_of_the_own_vertices(monkeypatch, tmp_path, real_mesh):
    meshio = pytest.importorskip("meshio")
    vertices, faces = ck.read_mesh(real_mesh("spot.obj"))
    save_line(ck.source("mesh.polyline", file=ROOT / "examples/curves/spot-belly.npy"), tmp_path / "line.csv")
    solution = run("two_sided_cut", monkeypatch, tmp_path, 0.25)["solution"]
    read = meshio.read(tmp_path / "both.ply")
    assert np.array_equal(read.cells_dict["triangle"], faces)
    assert np.abs(read.points - vertices).max() == 0
    for side in ("left", "right"):
        assert np.array_equal(read.point_data[side], solution.at_vertices(side))
    assert (np.abs(read.point_data["left"] - 1) < 1e-6).mean() > 0.3  # one part takes the value of its side


def test_a_point_source_and_a_robin_edge(monkeypatch, tmp_path):
    found = run("robin", monkeypatch, tmp_path, 0.2)["solution"]
    assert found.flux("edge") == pytest.approx(-1, abs=0.01)  # all that flows in flows out
    assert (tmp_path / "robin.png").stat().st_size > 3000


def test_convergence_against_finite_elements(monkeypatch, tmp_path, capsys):
    script = (TASKS / "convergence.py").read_text(encoding="utf-8")
    assert "(0.4, 0.2, 0.1)" in script
    exec(compile(script.replace("(0.4, 0.2, 0.1)", "(0.4, 0.2)"), "convergence", "exec"), {})
    errors = np.array(re.findall(r"\d\.\de-\d+", capsys.readouterr().out), dtype=float).reshape(2, 2)
    assert (errors[1] < errors[0] / 2).all()
    assert (errors[:, 0] < errors[:, 1]).all()  # of closest points, and of finite elements of the first degree
