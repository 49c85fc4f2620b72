"""Rows of benchmarks/acceptance.py on costs: iterations, products, memory, and errors beside the collocation form."""

from __future__ import annotations

from collections.abc import Iterator
from time import process_time
from typing import Any

import numpy as np
from forms import main as fifteen
from galerkin_memory import SPACINGS as FOR_MEMORY
from galerkin_memory import peak_of
from palm_mesh import FINGER_RADIUS, palm
from problems_of_documentation import EXAMPLES
from sphere_zones import coupled, unlike
from test_hard_meshes import FACES, VERTICES, doubled, flipped, rms, solved, soup, torn, with_slivers

import cpmkit as ck
from cpmkit.families.steady import assemble
from cpmkit.forms.galerkin.dof_map import connected_pieces

Row = Iterator[tuple[str, float, float]]
SMOOTH, WITH_CONDITIONS, ON_LIMBS = 25, 32, 45
#: Of a sphere: 20, 90 and 360 thousand unknowns.
SPACINGS = (0.053, 0.025, 0.0125)


def wave(x: Any) -> Any:
    """Return a load."""
    return np.cos(3 * x[:, 0]) + x[:, 1] * np.sin(4 * x[:, 2])


def iterations() -> Row:
    """Iterations of the cycle to 1e-10: on a sphere, with conditions, on thin limbs and among many curves."""
    sphere = ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(wave))
    vertices, faces = palm()
    hand = ck.Scene(ck.source("mesh.triangles", vertices=vertices, faces=faces), ck.ScreenedPoisson(wave))
    cases: dict[str, tuple[Any, tuple[float, ...], int]] = {
        "sphere": (sphere, SPACINGS[:2], SMOOTH),
        "sphere, unlike values on a circle": (unlike("dirichlet", "neumann"), (0.1, 0.05), WITH_CONDITIONS),
        "sphere, transmission 1 : 1000": (coupled(1000.0, 0.0), (0.1, 0.05), WITH_CONDITIONS),
        "palm, fingers 2 and 4 h thick": (hand, (FINGER_RADIUS, FINGER_RADIUS / 2), ON_LIMBS),
    }
    for name in ("02-nefertiti", "03-spot", "09-fish-fins"):
        file = ck.load_scene(EXAMPLES / f"{name}.toml")
        assert file.spacing is not None
        cases[f"{name}.toml"] = (file.scene, (1.5 * file.spacing,), ON_LIMBS)
    for name, (scene, spacings, limit) in cases.items():
        options = {"form": "galerkin", "solver": "multigrid", "solver_tolerance": 1e-10}
        found = [ck.solve(scene, h, **options).report.iterations for h in spacings]
        yield f"{name}, iterations", max(found), limit


def products() -> Row:
    """A whole solve on the sphere, processor time in products of SciPy with the matrix, and how it grows."""
    found = []
    for spacing in (0.1, *SPACINGS):
        scene, start = ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(wave)), process_time()
        solution = ck.solve(scene, spacing, form="galerkin", solver="multigrid")
        spent = process_time() - start
        system = assemble(solution.discretized)
        matrix, start = system.operator.to_csr(), process_time()
        for _ in range(10):
            matrix @ system.right_side[:, 0]
        found.append((solution.work.unknowns, spent / ((process_time() - start) / 10), spent))
    for unknowns, cost, _ in found[1:]:
        yield f"sphere, {unknowns:,} unknowns, products", cost, 800
    each = [spent / unknowns for unknowns, _, spent in found[1:]]
    yield "seconds an unknown, most over least", max(each) / min(each), 1.3


def peak_memory() -> Row:
    """Bytes an unknown at the peak of a whole solve on the sphere."""
    unknowns, peak = peak_of(FOR_MEMORY[-1])
    yield f"sphere, {unknowns:,} unknowns, bytes an unknown at the peak", peak, 2400


def problems() -> Row:
    """What share of the collocation form's rms error is left on fifteen problems."""
    for name, left in fifteen(origins=1).items():
        yield f"{name}, share of the rms error", left, 0.5


def dirty_meshes() -> Row:
    """A sphere's mesh flipped, doubled, as a soup, torn by 1e-7, with slivers: error over that of the clean mesh."""
    clean = rms(solved(VERTICES, FACES))
    for name, made in {
        "flipped": flipped,
        "doubled": doubled,
        "soup": soup,
        "torn by 1e-7": lambda: torn(1e-7),
        "slivers": with_slivers,
    }.items():
        dirty = solved(*made())
        assert connected_pieces(dirty.discretized.space.dof_map)[0] == 1
        yield f"{name}, error over the clean one's", rms(dirty) / clean, 1.02


ROWS = {
    "iterations": iterations,
    "products": products,
    "peak-memory": peak_memory,
    "fifteen-problems": problems,
    "dirty-meshes": dirty_meshes,
}
