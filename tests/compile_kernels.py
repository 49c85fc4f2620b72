"""Compile what most tests call, before they do: two processes would compile the same, each for itself.

Run ``python tests/compile_kernels.py galerkin``, and ``others`` beside it. Solutions are not looked at.
"""

from __future__ import annotations

import sys
import warnings

import cpmkit as ck
from cpmkit.applications import geodesic_distance

SPHERE, SOURCE = ck.source("analytic.sphere"), ck.ScreenedPoisson("x")
CUT = ck.Boundary("cut", ck.source("analytic.circle", normal=[0, 0, 1]), left=1.0, right=ck.Neumann(0.0))
POINT = [[0.0, 0.0, 1.0]]


def galerkin() -> None:
    """Solve on surfaces with a curve, by other degrees, with a velocity, on a curve and a mesh; read, and measure."""
    solution = ck.solve(ck.Scene(SPHERE, SOURCE, [CUT]), 0.06, form="galerkin", solver="multigrid")
    solution.evaluate(POINT)
    solution.gradient(POINT)
    ck.solve(ck.Scene(ck.source("analytic.circle"), SOURCE), 0.1, form="galerkin")
    solution.error.of("rms")
    for degree in (1, 3):
        ck.solve(ck.Scene(SPHERE, SOURCE), 0.3, form="galerkin", degree=degree).evaluate(POINT)
    turning = ck.Elliptic("x", c=1.0, velocity=["-y", "x", "0"])
    ck.solve(ck.Scene(SPHERE, turning), 0.3, form="galerkin")
    geodesic_distance(SPHERE, POINT, spacing=0.3, method="heat")
    ck.solve(ck.Scene(SPHERE.mesh(0.2), ck.Heat("x", until=0.1, step=0.05)), 0.3, form="galerkin")


def others() -> None:
    """Solve on a mesh, a curve, a cloud, a level set and a map by the other form."""
    vertices, faces = SPHERE.mesh(0.2)
    box = [[-1.2] * 3, [1.2] * 3]
    for surface in (
        ck.source("mesh.triangles", vertices=vertices, faces=faces),
        ck.source("pointcloud.points", points=vertices),
        ck.source("levelset.expression", phi="x*x + y*y + z*z - 1", bounds=box),
        ck.source("parametric.klein"),
        ck.source("parametric.helix"),
    ):
        ck.solve(ck.Scene(surface, SOURCE), 0.3, form="collocation")
    ck.solve(ck.Scene(SPHERE, SOURCE, [CUT]), 0.2, form="collocation")


if __name__ == "__main__":
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        {"galerkin": galerkin, "others": others}[sys.argv[1]]()
