"""The Python example of the conventions runs as it is written, on a mesh of a user's own."""

import numpy as np
import pytest
from model_problems import octahedron

import cpmkit as ck


@pytest.fixture
def in_folder(tmp_path, monkeypatch):
    """A folder with a mesh file 500 across and a curve on it, as the working directory."""
    vertices, faces = octahedron(3)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in (250 * vertices).tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    (tmp_path / "bust.obj").write_text("\n".join(lines))
    theta = np.linspace(0.2, 2.0, 60)
    curve = np.stack([np.cos(theta), np.sin(theta), 0.3 * np.sin(theta)], axis=1)
    mesh = ck.source("mesh.triangles", vertices=250 * vertices, faces=faces)
    np.save(tmp_path / "brow.npy", mesh.closest_point(250 * curve).points)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_example(in_folder):
    V, F = ck.read_mesh("bust.obj")  # arrays in, arrays out
    bust = ck.source("mesh.triangles", vertices=V, faces=F)
    brow = ck.source("mesh.polyline", points=np.load("brow.npy"))
    scene = ck.Scene(
        bust,
        problem=ck.Laplace(),
        boundaries=[
            ck.Boundary("brow", brow, left=ck.Dirichlet([0.9, 0.2, 0.1]), right=ck.Neumann(0.0)),
            ck.Boundary("pin", ck.source("analytic.point", at=V[0]), both=ck.Dirichlet([0, 0, 1.0])),
        ],
    )
    assert "ghosts of 'brow'" in str(ck.explain(scene, spacing=50.0, form="collocation", dry_run=True))
    told = ck.explain(scene, spacing=50.0, dry_run=True)
    assert "'brow'" in str(told)
    solution = ck.solve(scene, spacing=50.0)
    rgb = solution.evaluate(V)
    assert rgb.shape == (len(V), 3)
    assert solution.report.residual <= solution.report.tolerance <= 1e-6
    assert solution.report.iterations >= 0
    assert solution.work.unknowns == pytest.approx(told.unknowns, rel=0.2)
    for name in ("bust.vtp", "bust.npz", "bust.png"):
        (solution.picture if name.endswith("png") else solution.save)(name)
        assert (in_folder / name).stat().st_size > 1000
    on_curve = np.load("brow.npy")[20:40]
    np.testing.assert_allclose(solution.evaluate(on_curve, side="left"), np.tile([0.9, 0.2, 0.1], (20, 1)), atol=0.02)
