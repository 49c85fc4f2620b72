"""Bytes that are predicted of small solves hold the arrays that the solves make, as the interpreter counts them.

What the system counts of a process depends on what else runs, and on what was compiled or freed before:
``benchmarks/seconds_foretold.py`` compares that.
"""

import gc
import tracemalloc

import numpy as np
import pytest

import cpmkit as ck

BALL = ck.source("analytic.sphere")
RING = ck.source("analytic.circle", normal=[0, 0, 1])
CUT = ck.Boundary("ring", RING, left=ck.Dirichlet(1), right=ck.Dirichlet(lambda x: x[:, 0]))
F = ck.ScreenedPoisson(lambda x: np.cos(6 * x[:, 0]))
#: Of compiled kernels and of LAPACK, which the interpreter does not count.
UNCOUNTED_BYTES = 6e6


def array_bytes(solve):
    """Return what ``solve`` returns the second time, and the peak of the arrays that it makes then."""
    solve()  # what is compiled or read for the first time is no table
    gc.collect()
    tracemalloc.start()
    try:
        return solve(), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def are_predicted(predicted, arrays):
    assert 0.95 * arrays < predicted < 2 * arrays + UNCOUNTED_BYTES


def scene_of(name):
    if name == "mesh":
        vertices, faces = BALL.mesh(0.06)
        return ck.Scene(ck.source("mesh.triangles", vertices=vertices, faces=faces), F)
    return ck.Scene(BALL, F, [CUT] if name == "ring" else [])


@pytest.mark.parametrize("spacing", [0.25, 0.15])
@pytest.mark.parametrize("name", ["ball", "ring", "mesh"])
def test_bytes_of_small_solves(name, spacing):
    scene = scene_of(name)
    _, arrays = array_bytes(lambda: ck.solve(scene, spacing))
    are_predicted(ck.explain(scene, spacing, dry_run=True).bytes, arrays)


LEVEL_SET = ck.source("levelset.expression", phi="x*x + y*y + z*z - 1", bounds=[[-1.2] * 3, [1.2] * 3])
TO_A_TOLERANCE = {
    "cut": scene_of("ring"),
    "level set": ck.Scene(LEVEL_SET, ck.ScreenedPoisson(lambda x: 7 * x[:, 0] * x[:, 1])),
    "steps": ck.Scene(BALL, ck.Heat(lambda x: x[:, 2], until=0.1, step=0.02)),
}


@pytest.mark.parametrize("name", TO_A_TOLERANCE)
def test_bytes_of_whole_solves_to_a_tolerance(name):
    solution, arrays = array_bytes(lambda: ck.solve(TO_A_TOLERANCE[name], tolerance=0.05))
    are_predicted(solution.solve_history.predicted_bytes, arrays)
