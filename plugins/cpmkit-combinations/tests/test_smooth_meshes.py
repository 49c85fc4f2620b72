"""A mesh that is read as smooth stands for the same surface in a union and where it is trimmed."""

import numpy as np
import pytest
from coarse_meshes import hull, icosphere

import cpmkit as ck
from cpmkit.plugin import HasSmoothSurface

DISTANT = ck.source("analytic.sphere", center=[5.0, 0.0, 0.0])


def sphere_mesh(level):
    vertices, faces = hull(icosphere(level))
    return ck.source("mesh.triangles", vertices=vertices, faces=faces)


def errors(source, spacing, level, lowest, **edge):
    """Return the largest error of u = z, and the area."""
    solution = ck.solve(ck.Scene(source, ck.ScreenedPoisson("3 * z"), **edge), spacing=spacing)
    x = icosphere(level)
    x = x[x[:, 2] > lowest]
    assert not solution.warnings
    return np.abs(solution.evaluate(x) - x[:, 2]).max(), solution.integrate(1.0)


@pytest.mark.parametrize("level", [3, 4])
def test_a_union_and_a_trimmed_mesh_are_as_accurate_as_the_mesh_alone(level):
    """The flat triangles of level 3 are off by 6e-3, those of level 4 by 1.5e-3, at every spacing."""
    mesh = sphere_mesh(level)
    cases = {
        "union": (ck.source("union", members=[mesh, DISTANT]), -2.0, 8 * np.pi, {}),
        "half": (ck.source("trimmed", of=mesh, trim="-z"), 0.05, 2 * np.pi, {"edge": ck.Dirichlet(0.0)}),
        "cap": (ck.source("trimmed", of=mesh, trim="0.3 - z"), 0.35, 1.4 * np.pi, {"edge": ck.Dirichlet(0.3)}),
    }
    for spacing in (0.4, 0.2, 0.1):
        alone, area = errors(mesh, spacing, level, -2.0)
        assert abs(area / (4 * np.pi) - 1) < 3e-5
        for name, (source, lowest, exact_area, edge) in cases.items():
            error, area = errors(source, spacing, level, lowest, **edge)
            assert error < 1.3 * alone, (name, spacing)
            assert abs(area / exact_area - 1) < 3e-5, (name, spacing)


def test_the_smooth_surface_of_a_mesh_converges_with_the_fourth_power_of_its_edges():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(3000, 3))
    x *= rng.uniform(0.7, 1.4, (3000, 1)) / np.linalg.norm(x, axis=1, keepdims=True)
    off = []
    for level in (1, 2, 3, 4):
        feet = sphere_mesh(level).smooth_surface().closest_point(x)
        off.append(np.abs(np.linalg.norm(feet.points, axis=1) - 1).max())
    assert np.log2(np.array(off[:-1]) / off[1:]).min() > 3.5


def test_the_smooth_surface_of_a_mesh_is_a_source():
    mesh = sphere_mesh(3).smooth_surface()
    x = np.random.default_rng(1).uniform(-1.2, 1.2, (2000, 3))
    feet = mesh.closest_point(x)
    again, moved = mesh.closest_point(feet.points), mesh.translate([3.0, 0.0, 0.0])
    assert max(np.abs(again.points - feet.points).max(), again.distance.max()) < 1e-14
    assert np.allclose(feet.distance, np.linalg.norm(x - feet.points, axis=1), atol=1e-15)
    assert np.allclose(moved.closest_point(x + [3.0, 0.0, 0.0]).points - feet.points, [3.0, 0.0, 0.0], atol=1e-12)
    rows, minima = mesh.local_minima(x, 3.0)
    assert np.array_equal(minima.points[np.flatnonzero(np.diff(rows, prepend=-1))], feet.points)
    assert np.abs(np.linalg.norm(minima.points, axis=1) - 1).max() < 2e-5


def test_which_sources_have_a_smooth_surface():
    mesh, turn = sphere_mesh(2), {"rotation": [0.3, 0.2, 0.1], "scale": 2.0}
    moved, both = ck.source("moved", of=mesh, **turn), ck.source("union", members=[mesh, DISTANT])
    assert all(isinstance(source, HasSmoothSurface) for source in (mesh, moved, both))
    lone = ck.source("union", members=[DISTANT])
    assert not any(isinstance(source, HasSmoothSurface) for source in (DISTANT, lone))
    x = icosphere(3)
    norms = [np.linalg.norm(source.closest_point(2 * x).points, axis=1) for source in (moved, moved.smooth_surface())]
    assert norms[0].min() < 1.98
    assert np.abs(norms[1] - 2).max() < 1e-3
    assert np.abs(np.linalg.norm(both.smooth_surface().closest_point(x).points, axis=1) - 1).max() < 1e-3
    faceted = mesh.read_as_facets()
    assert faceted.smooth_surface() is faceted
    assert mesh.smooth_surface().read_as_facets().exact
