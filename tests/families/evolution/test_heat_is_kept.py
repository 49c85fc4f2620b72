"""Heat in the Galerkin form: its total is kept to rounding, spikes stay above zero, constants stay constants."""

import numpy as np
import pytest
from cut_meshes import data_mesh
from model_problems import sphere_points
from palm_mesh import FINGER_RADIUS, palm

import cpmkit as ck

SPHERE = ck.source("analytic.sphere")
WALL = ck.Boundary("wall", ck.source("analytic.circle", normal=[0, 0, 1]), both=ck.Neumann(0.0))
PALM_SPACING = 2 * FINGER_RADIUS / 1.5


def spike(at, width):
    return lambda x: np.exp(-((np.linalg.norm(x - at, axis=1) / width) ** 2))


def drift(solution):
    """The largest change of a total from one frame to another, as a share of it."""
    totals = np.array([frame.totals for frame in solution.frames])
    return np.abs(totals / totals[0] - 1).max()


def mesh_source(vertices, faces):
    return ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="faceted")


@pytest.mark.parametrize("scheme", ["bdf2", "backward-euler", "crank-nicolson"])
@pytest.mark.parametrize("boundaries", [[], [WALL]], ids=["closed", "walls"])
@pytest.mark.parametrize("target", [{"solver": "direct"}, {"solver": "multigrid", "solver_tolerance": 1e-4}], ids=str)
def test_the_total_is_kept_whatever_the_tolerance(scheme, boundaries, target):
    steps = 50 if target["solver"] == "direct" else 20
    heat = ck.Heat(spike([0.6, 0, 0.8], 0.05), until=1.0, step=1.0 / steps, frames=10, scheme=scheme)
    solution = ck.solve(ck.Scene(SPHERE, heat, boundaries), 0.4, form="galerkin", **target)
    assert drift(solution) < 1e-12
    assert solution.summary()["time"]["totals"][-1] == solution.totals.tolist()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::cpmkit.CpmkitWarning")
@pytest.mark.parametrize("walled", [False, True])
@pytest.mark.parametrize("name", ["palm", "koala.obj", "nefertiti-lowres.obj"])
def test_the_total_is_kept_on_meshes_over_a_thousand_steps(name, walled):
    if name == "palm":
        vertices, faces = palm()
    else:
        mesh = data_mesh(name)
        vertices, faces = mesh.vertices, mesh.cells
    spacing, at = np.ptp(vertices, axis=0).max() / 30, vertices[np.argmax(vertices[:, 1])]
    ring = ck.source("analytic.circle", center=at, normal=[0, 1, 0], radius=2 * spacing)
    walls = [ck.Boundary("wall", ring, both=ck.Neumann(0.0))] if walled else []
    heat = ck.Heat(spike(at, spacing), until=50 * spacing**2, step=spacing**2 / 20, frames=10)
    assert drift(ck.solve(ck.Scene(mesh_source(vertices, faces), heat, walls), spacing)) < 1e-11


def test_what_flows_in_is_what_the_total_gains():
    """Through a wall flows 1 in on its left for each length of 2 pi, and f brings 0.5 for each area."""
    inflow = ck.Boundary("wall", WALL.source, left=ck.Neumann(lambda x, t: 1.0 + 0 * x[:, 0]), right=ck.Neumann(0.0))
    heat = ck.Heat(0.0, until=0.2, step=0.05, f=0.5)
    solution = ck.solve(ck.Scene(SPHERE, heat, [inflow]), 0.2, form="galerkin")
    assert solution.totals == pytest.approx(0.2 * (2 * np.pi + 0.5 * 4 * np.pi), rel=1e-4)


@pytest.mark.filterwarnings("ignore::cpmkit.CpmkitWarning")
@pytest.mark.parametrize(
    ("width", "share", "steps"),
    [
        (0.25, 0.125, 50),
        *(
            pytest.param(*one, 200, marks=pytest.mark.slow)
            for one in [(0.25, 0.125), (0.25, 1), (0.5, 0.125), (0.5, 20)]
        ),
    ],
)
def test_a_spike_on_a_palm_stays_above_zero(width, share, steps):
    """Its fingers are 1.5 spacings thick; steps are shares of the spacing squared."""
    vertices, faces = palm()
    at, step = vertices[np.argmax(vertices[:, 1])], share * PALM_SPACING**2
    heat = ck.Heat(spike(at, width * PALM_SPACING), until=steps * step, step=step, frames=steps)
    scene = ck.Scene(mesh_source(vertices, faces), heat)
    solution = ck.solve(scene, PALM_SPACING, form="galerkin", origin=[0.01, 0.02, 0.005])
    lowest = [frame.discretized.at_points(frame.values).min() for frame in solution.frames]
    assert lowest[0] >= 0
    assert min(lowest) > -1e-4
    assert drift(solution) < 1e-12


@pytest.mark.parametrize("step", [1e-3, 0.04, 4.0])
def test_a_jump_stays_within_its_values(step):
    heat = ck.Heat(lambda x: 1.0 * (x[:, 2] > 0.3), until=10 * step, step=step, frames=10)
    solution = ck.solve(ck.Scene(SPHERE, heat), 0.25, form="galerkin")
    at = sphere_points(2000)
    for frame in solution.frames:
        read = frame.evaluate(at)
        assert -1e-3 < read.min() <= read.max() < 1 + 1e-3
    assert solution.frames[0].totals == pytest.approx(2 * np.pi * 0.7, rel=2e-2)


@pytest.mark.parametrize("jump", [0.3, 1.0])
def test_a_jump_spreads_no_data_elsewhere(jump):
    """A narrow bump keeps its height beside a jump two units away, and the total is that of the data."""
    top = np.array([[0.0, 0, 1]])

    def bump(x):
        return np.exp(-60 * ((x - top) ** 2).sum(axis=1))

    first = [
        ck.solve(ck.Scene(SPHERE, ck.Heat(data, until=1.0, step=1.0, frames=[0.0])), 0.14, estimate=False).frames[0]
        for data in (bump, lambda x: bump(x) + jump * (x[:, 2] < -0.7))
    ]
    assert first[0].evaluate(top) == pytest.approx([1.0], abs=0.03)
    assert first[1].evaluate(top) == pytest.approx(first[0].evaluate(top), abs=1e-3)
    assert first[1].totals - first[0].totals == pytest.approx(jump * 2 * np.pi * 0.3, rel=0.02)
    form = first[1].discretized
    exact = form.point_weights @ (bump(form.points) + jump * (form.points[:, 2] < -0.7))
    assert first[1].totals == pytest.approx([exact], rel=1e-10)


def test_kinks_are_not_spread():
    """Kinks two spacings apart everywhere: the projection is off by 5 percent, means would be by 17."""

    def waves(x):
        return np.maximum(0, np.sin(9 * x[:, 0]) * np.cos(9 * x[:, 2]))

    at = sphere_points(2000)
    first = ck.solve(ck.Scene(SPHERE, ck.Heat(waves, until=1.0, step=1.0, frames=[0.0])), 0.15).frames[0]
    assert np.sqrt(np.mean((first.evaluate(at) - waves(at)) ** 2)) < 0.06


def test_smooth_data_are_not_spread():
    """Of the frame at time 0 the error is of third order."""
    at = sphere_points(500)
    errors = []
    for h in (0.4, 0.2):
        heat = ck.Heat(lambda x: x[:, 0] * x[:, 1], until=1.0, step=1.0, frames=[0.0])
        errors.append(np.abs(ck.solve(ck.Scene(SPHERE, heat), h).frames[0].evaluate(at) - at[:, 0] * at[:, 1]).max())
    assert errors[1] < errors[0] / 6


@pytest.mark.parametrize("solver", ["direct", "multigrid"])
def test_constants_stay_constants(solver):
    heat = ck.Heat([1.0, -3.0], until=1.0, step=0.05, kappa=lambda x: 2 + x[:, 2])
    solution = ck.solve(ck.Scene(SPHERE, heat, [WALL]), 0.3, form="galerkin", solver=solver)
    np.testing.assert_allclose(solution.evaluate(sphere_points(50)), np.tile([1.0, -3.0], (50, 1)), atol=1e-9)


@pytest.mark.parametrize("problem", ["heat", "wave"])
def test_lengths_and_times_scale(problem):
    """Twice as large, heat takes four times as long and a wave twice."""

    def solved(size):
        make = {
            "heat": lambda d: ck.Heat(d, 0.1 * size**2, 0.01 * size**2),
            "wave": lambda d: ck.Wave(d, size, size / 40),
        }
        scene = ck.Scene(ck.source("analytic.sphere", radius=size), make[problem](lambda x: x[:, 2] / size))
        return ck.solve(scene, 0.3 * size, origin=[0.03 * size] * 3).evaluate(size * sphere_points(50))

    np.testing.assert_allclose(solved(2.0), solved(1.0), rtol=0, atol=1e-10)


def test_values_at_vertices_are_data():
    pytest.importorskip("trimesh")
    vertices, faces = palm()
    source = mesh_source(vertices, faces)
    given = [ck.VertexData(source, vertices[:, 1]), lambda x: x[:, 1]]
    heat = ck.Heat(given, until=0.01, step=0.005)
    with pytest.warns(ck.CpmkitWarning):
        read = ck.solve(ck.Scene(source, heat), 0.06).evaluate(vertices[::50])
    np.testing.assert_allclose(read[:, 0], read[:, 1], rtol=0, atol=1e-9)


@pytest.mark.parametrize("form", ["galerkin", "collocation"])
def test_a_run_that_begins_later_keeps_heat_as_one_that_begins_at_zero(form):
    sphere = ck.source("analytic.sphere")
    runs = [
        ck.solve(ck.Scene(sphere, ck.Heat(1.0, until=t0 + 0.1, step=0.05, f=1.0, t0=t0)), 0.3, form=form)
        for t0 in (0.0, 5.0)
    ]
    assert not any("Heat was" in sentence for one in runs for sentence in one.warnings)
    np.testing.assert_allclose(*(one.evaluate([[1, 0, 0]]) for one in runs), rtol=1e-9)
