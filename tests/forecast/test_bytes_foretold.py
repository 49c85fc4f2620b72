"""Memory at the peak of small solves is foretold within a factor of two, of what the system counts."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.runtime.peak import bytes_since, forget_peak

BALL, RING = ck.source("analytic.sphere"), ck.source("analytic.circle", normal=[0, 0, 1])
CUT = ck.Boundary("ring", RING, left=ck.Dirichlet(1), right=ck.Dirichlet(lambda x: x[:, 0]))
F = ck.ScreenedPoisson(lambda x: np.cos(6 * x[:, 0]))


def fine_mesh():
    vertices, faces = BALL.mesh(0.03)
    return ck.source("mesh.triangles", vertices=vertices, faces=faces)


@pytest.mark.parametrize("spacing", [0.25, 0.12])
@pytest.mark.parametrize(
    ("surface", "boundaries"), [(BALL, []), (BALL, [CUT]), (fine_mesh(), [])], ids=["ball", "ring", "mesh"]
)
def test_bytes_of_small_solves(surface, boundaries, spacing):
    scene = ck.Scene(surface, F, boundaries)
    told = ck.explain(scene, spacing).bytes
    ck.solve(scene, spacing)  # what is compiled or read for the first time is no table
    before = forget_peak()
    if before is None:
        pytest.skip("this system does not tell the peak of a process")
    ck.solve(scene, spacing)
    assert 0.5 < told / bytes_since(before) < 2
