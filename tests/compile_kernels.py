"""Compile what most tests call, before they do: two processes would compile the same, each for itself.

Run ``python tests/compile_kernels.py galerkin``, and ``others`` beside it. Solutions are not looked at.
"""

from __future__ import annotations

import sys
import warnings

import numpy as np

import cpmkit as ck
from cpmkit.applications import geodesic_distance

SPHERE, CIRCLE, SOURCE = ck.source("analytic.sphere"), ck.source("analytic.circle"), ck.ScreenedPoisson("x")
CUT = ck.Boundary("cut", ck.source("analytic.circle", normal=[0, 0, 1]), left=1.0, right=ck.Neumann(0.0))
HEAT, POINT = ck.Heat("x", until=0.1, step=0.05), [[0.0, 0.0, 1.0]]


def galerkin() -> None:
    """Solve on surfaces with a curve, by other degrees, with a velocity, on curves, a mesh and a cloud; and read."""
    solution = ck.solve(ck.Scene(SPHERE, SOURCE, [CUT]), 0.06, form="galerkin", solver="multigrid")
    solution.evaluate(POINT)
    solution.gradient(POINT)
    ck.solve(ck.Scene(CIRCLE, HEAT), 0.1, form="galerkin")
    solution.error.of("rms")
    for degree in (1, 3):
        ck.solve(ck.Scene(SPHERE, HEAT), 0.3, form="galerkin", degree=degree).evaluate(POINT)
        ck.solve(ck.Scene(CIRCLE, SOURCE), 0.2, form="galerkin", degree=degree)
    turning = ck.Elliptic("x", c=1.0, velocity=["-y", "x", "0"])
    ck.solve(ck.Scene(SPHERE, turning), 0.3, form="galerkin")
    geodesic_distance(SPHERE, POINT, spacing=0.3, method="heat")
    ck.solve(ck.Scene(SPHERE.mesh(0.2), HEAT), 0.3, form="galerkin")
    for source in (ck.source("pointcloud.points", points=SPHERE.mesh(0.2)[0]), ck.source("parametric.helix")):
        ck.solve(ck.Scene(source, SOURCE), 0.3, form="galerkin")


def others() -> None:
    """Solve on a mesh, a curve, a cloud, a level set and a map by the other form; then on a bent sheet, and solids.

    The last ones are in the Galerkin form: the kernels that they share with `galerkin` are compiled there by then.
    """
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
    angles = np.linspace(-0.5, 0.5, 9) * np.pi
    turn = [[-0.5, -0.02], *0.02 * np.stack([np.cos(angles), np.sin(angles)], axis=1), [-0.5, 0.02]]
    corners = [[x, y, z] for y in (0.0, 0.5) for x, z in turn]
    sheet = corners, [face for i in range(10) for face in ([i, i + 1, i + 12], [i, i + 12, i + 11])]
    ck.solve(ck.Scene(sheet, SOURCE), 0.1, form="galerkin").evaluate(corners)
    disks = ck.source("union", members=[CIRCLE, ck.source("analytic.circle", center=[2.02, 0.0])])
    fast = ck.Elliptic("x", c=1.0, velocity=["-50*y", "50*x"])
    scene = ck.Scene(ck.source("solid", of=disks), fast, edge=ck.Dirichlet(0.0))
    ck.solve(scene, 0.2, form="galerkin").gradient([[0.1, 0.2]])
    cube = ck.source("analytic.box", lower=[-0.5] * 3, upper=[0.5] * 3, rotation=[0.3, 0.2, 0.5])
    ck.solve(ck.Scene(cube, SOURCE), 0.3, form="galerkin").evaluate([[0.0, 0.0, 0.0]])


if __name__ == "__main__":
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        {"galerkin": galerkin, "others": others}[sys.argv[1]]()
