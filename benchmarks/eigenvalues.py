"""Eigenvalues by both forms beside each other, and what more modes cost where there are many unknowns.

Run ``python benchmarks/eigenvalues.py``; it needs ``pip install . ./plugins/*`` and, for the last problems,
``CPMKIT_DATA`` set to a folder with fish.obj, koala.obj and spot.obj; those whose mesh is missing are left out. It
prints the table of tables/eigenvalues.md: the largest relative error of an eigenvalue other than zero, in percent
(of meshes: differences from linear finite elements on their own triangles), and the range of what
``cpmkit.estimate_error`` tells over the errors themselves. ``python benchmarks/eigenvalues.py block`` prints what
twenty-five modes cost. It needs this repository's folder ``tests`` beside it.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).parents[1] / "tests")]

from exact_eigenvalues import sphere_eigenvalues, torus_eigenvalues  # noqa: E402

import cpmkit as ck  # noqa: E402
from cpmkit.errors import CpmkitError  # noqa: E402
from cpmkit.studies.tables import table_row, table_rule  # noqa: E402

FORMS = ("collocation", "galerkin")
SPHERE, CAP = ck.source("analytic.sphere"), ck.source("analytic.cap")
MAJOR, MINOR = 1.0, 0.4
#: Modes on meshes, and about how many unknowns there are.
MESH_MODES, MESH_UNKNOWNS = 6, 5000
#: Eigenvalues below this share of the largest are zero.
ZERO_SHARE = 1e-6
#: The block iteration's modes and spacings.
BLOCK_MODES, BLOCK_SPACINGS = 25, (0.06, 0.03, 0.0139)


def smooth_problems() -> Iterator[tuple[str, ck.Scene, Any, float]]:
    """Yield name, scene, exact eigenvalues and spacing."""
    ring = ck.source("analytic.circle", center=[0, 0, 0], radius=1.0, normal=[1, 2, 3])
    both = ck.Boundary("circle", ring, both=ck.Steklov())
    torus = ck.source("analytic.torus", major=MAJOR, minor=MINOR)
    steklov = np.array([0, 1, 1, 2, 2, 3, 3])
    neumann, dirichlet = np.repeat([0, 2, 6, 12], [1, 2, 3, 4]), np.repeat([2, 6, 12, 20], [1, 2, 3, 4])
    problems = {
        "sphere": (ck.Scene(SPHERE, ck.Eigen(100)), sphere_eigenvalues(100)),
        "torus": (ck.Scene(torus, ck.Eigen(50)), torus_eigenvalues(50, MAJOR, MINOR)),
        "hemisphere, Neumann rim": (ck.Scene(CAP, ck.Eigen(10)), neumann),
        "hemisphere, Dirichlet rim": (ck.Scene(CAP, ck.Eigen(10), edge=ck.Dirichlet(0)), dirichlet),
        "hemisphere, Steklov": (ck.Scene(CAP, ck.Eigen(7), edge=ck.Steklov()), steklov),
        "both sides of a great circle, Steklov": (
            ck.Scene(SPHERE, ck.Eigen(10), [both]),
            np.sort(np.concatenate([steklov[:5], steklov[:5]])),
        ),
    }
    for name, (scene, exact) in problems.items():
        for spacing in (0.2, 0.1):
            yield name, scene, exact, spacing


def mesh_problems() -> Iterator[tuple[str, ck.Scene, Any, float]]:
    """Yield the same of meshes whose files are there, with the values of finite elements."""
    from cpmkit_fem.assembly import stiffness_and_mass
    from scipy.sparse.linalg import eigsh

    for name in ("spot", "fish", "koala"):
        try:
            vertices, faces = ck.read_mesh(f"{name}.obj")
        except CpmkitError:
            continue
        vertices = vertices / np.ptp(vertices, axis=0).max()
        stiffness, mass = stiffness_and_mass(vertices, faces)
        values = np.sort(eigsh(stiffness, MESH_MODES, M=mass, sigma=-0.5, v0=np.ones(len(vertices)))[0])
        scene = ck.Scene(ck.source("mesh.triangles", vertices=vertices, faces=faces), ck.Eigen(MESH_MODES))
        yield name, scene, values, float(f"{np.sqrt(4.5 * mass.sum() / MESH_UNKNOWNS):.3g}")


def cells(name: str, scene: ck.Scene, exact: Any, spacing: float) -> Iterator[str]:
    """Yield the cells of a problem's row: both forms of each quantity beside each other."""
    yield from (name, str(len(exact)), f"{spacing:g}")
    counted = np.asarray(exact) > ZERO_SHARE * np.max(exact)
    errors, unknowns, ratios = [], [], []
    for form in FORMS:
        estimate = ck.estimate_error(scene, spacing, form=form)
        off = np.abs(estimate.solution.eigenvalues - exact)[counted]
        ratio = estimate.error[counted] / off
        errors.append(f"{100 * (off / exact[counted]).max():.2g}")
        unknowns.append(f"{estimate.solution.work.unknowns:,}")
        ratios.append(f"{ratio.min():.2g} to {ratio.max():.2g}")
    yield from (*errors, *unknowns, *ratios)


def compare() -> None:
    """Print the table of errors."""
    titles = ["problem", "modes", "spacing", *[f"{form}, largest error, %" for form in FORMS]]
    titles += [f"{form}, unknowns" for form in FORMS] + [f"{form}, estimate over error" for form in FORMS]
    print(table_row(titles), table_rule(1, len(titles) - 1), sep="\n")
    for make in (smooth_problems, mesh_problems):
        for problem in make():
            print(table_row(list(cells(*problem))), flush=True)


def block() -> None:
    """Print what the block iteration costs, in solves of one right-hand side by the same multigrid."""
    titles = ["unknowns", "rounds", "seconds", "seconds of one solve", "ratio", "largest error, %"]
    print(table_row(titles), table_rule(0, len(titles)), sep="\n")
    for spacing in BLOCK_SPACINGS:
        prepared = ck.prepare(ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x: x[:, 0])), spacing, solver="multigrid")
        prepared.solve()
        seconds = []
        for problem in (ck.ScreenedPoisson(lambda x: x[:, 1]), ck.Eigen(BLOCK_MODES)):
            start = process_time()
            solution = prepared.solve(problem=problem)
            seconds.append(process_time() - start)
        assert isinstance(solution, ck.EigenSolution)
        error = np.abs(solution.eigenvalues[1:] / sphere_eigenvalues(BLOCK_MODES)[1:] - 1).max()
        numbers = (f"{solution.work.unknowns:,}", str(solution.report.iterations), f"{seconds[1]:.1f}")
        ratio = f"{seconds[1] / seconds[0]:.0f}"
        print(table_row([*numbers, f"{seconds[0]:.2f}", ratio, f"{100 * error:.2g}"]), flush=True)


if __name__ == "__main__":
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        block() if "block" in sys.argv[1:] else compare()
