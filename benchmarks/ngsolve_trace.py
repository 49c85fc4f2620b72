"""The Galerkin form beside trace finite elements of NGSolve, on a sphere and a torus at about equal unknowns.

Trace finite elements restrict those of a background mesh of tetrahedra to the surface, which a level set gives; with a
mapping of the mesh, its geometry is of the order of the elements (ngsxfem). Make an environment for them, with
``python -m venv ENV; ENV/bin/pip install ngsolve xfem``, and run ``python benchmarks/ngsolve_trace.py ENV/bin/python``;
it needs ``pip install . ./plugins/cpmkit-analytic``. It prints tables/ngsolve.md: unknowns, root mean square
errors and processor time of whole solves, from the source to the solution, which take turns on one thread; beside the
trace elements, also those of the Galerkin form of degree 2 on the coarsest lattice that has less error than they. The
background meshes of the trace elements are made beforehand and not counted, nor is the search for that lattice; the
first solve of each, which compiles or loads, is not either.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from statistics import median
from time import process_time
from typing import Any

import numpy as np

#: Unknowns that are aimed at, degrees, rounds of which the median is taken.
UNKNOWNS, DEGREES, ROUNDS = (12_000, 49_000), (2, 3), 3
#: Degree that is also solved on a coarser lattice, with less error than the trace elements still; the spacing is
#: reduced by this factor while the error is not less.
COARSER_DEGREE, REDUCED = 2, 0.97
#: Radii of the torus, and half the sides of the boxes around both surfaces.
MAJOR, MINOR = 1.0, 0.4
BOXES = {"sphere": (1.25, 1.25, 1.25), "torus": (1.6, 1.6, 0.6)}
#: Spacings of the Galerkin form by degree, and lengths of the background's cells by order, that give these unknowns.
SPACINGS = {
    "sphere": {2: (0.0691, 0.0342), 3: (0.0798, 0.0394)},
    "torus": {2: (0.0757, 0.0374), 3: (0.0874, 0.0432)},
}
LENGTHS = {
    "sphere": {2: (0.12, 0.06), 3: (0.215, 0.106)},
    "torus": {2: (0.135, 0.067), 3: (0.245, 0.12)},
}


def posed(surface: str) -> tuple[Any, Any, Any, Any]:
    """Return distance, normal, solution and right-hand side as coefficient functions of NGSolve."""
    from ngsolve import x, y, z
    from ngsolve.fem import CoefficientFunction, sqrt

    if surface == "sphere":
        r = sqrt(x * x + y * y + z * z)
        exact = 5 * x * y * z / r**3
        return r - 1, CoefficientFunction((x, y, z)) / r, exact, 13 * exact
    axis = sqrt(x * x + y * y)
    tube = sqrt((axis - MAJOR) ** 2 + z * z)
    cosine, sine = (axis - MAJOR) / tube, z / tube
    around, width = 2 * x * y / axis**2, MAJOR + MINOR * cosine
    exact = 0.5 * around * cosine
    across = 0.5 * around * (-cosine / MINOR**2 + sine**2 / (MINOR * width))
    normal = CoefficientFunction((cosine * x / axis, cosine * y / axis, sine))
    return tube - MINOR, normal, exact, 4 * exact / width**2 - across + exact


def background(surface: str, length: float) -> Any:
    """Return a mesh of tetrahedra of the box around a surface."""
    from ngsolve.meshes import MakeStructured3DMesh

    half = BOXES[surface]
    cells = [int(np.ceil(2 * side / length)) for side in half]

    def placed(a: float, b: float, c: float) -> tuple[float, ...]:
        return tuple((2 * t - 1) * side for t, side in zip((a, b, c), half, strict=True))

    return MakeStructured3DMesh(hexes=False, nx=cells[0], ny=cells[1], nz=cells[2], mapping=placed)


def by_ngsolve(surface: str, order: int, length: float) -> Iterator[dict[str, float]]:
    """Yield the unknowns, error and seconds of solves of -Lap u + u = f by trace elements."""
    from ngsolve import (
        H1,
        BilinearForm,
        Compress,
        GridFunction,
        InnerProduct,
        Integrate,
        LinearForm,
        dx,
        grad,
        specialcf,
    )
    from ngsolve.fem import CoefficientFunction
    from xfem import IF, CutInfo, GetDofsOfElements, dCut
    from xfem.lsetcurv import LevelSetMeshAdaptation

    mesh, (distance, n, exact, f) = background(surface, length), posed(surface)
    for _ in range(ROUNDS + 1):
        start = process_time()
        adapted = LevelSetMeshAdaptation(mesh, order=order, threshold=1000, discontinuous_qn=True)
        mapped = {"deformation": adapted.CalcDeformation(distance)}
        mapped["definedonelements"] = cut = CutInfo(mesh, adapted.lset_p1).GetElementsOfType(IF)
        whole = H1(mesh, order=order)
        space = Compress(whole, GetDofsOfElements(whole, cut))
        u, v = space.TnT()
        on, near = dCut(adapted.lset_p1, IF, **mapped), dx(**mapped)
        du, dv = (grad(w) - InnerProduct(grad(w), n) * n for w in (u, v))
        matrix, load = BilinearForm(space, symmetric=True), LinearForm(space)
        matrix += (InnerProduct(du, dv) + u * v) * on
        matrix += InnerProduct(grad(u), n) * InnerProduct(grad(v), n) / specialcf.mesh_size * near
        load += f * v * on
        matrix.Assemble()
        load.Assemble()
        solution = GridFunction(space)
        solution.vec.data = matrix.mat.Inverse(space.FreeDofs(), inverse="sparsecholesky") * load.vec
        seconds = process_time() - start
        measure = dCut(adapted.lset_p1, IF, order=2 * order + 4, **mapped)
        area = Integrate(CoefficientFunction(1.0) * measure, mesh)
        square = Integrate((solution - exact) ** 2 * measure, mesh) / area
        yield {"unknowns": space.ndof, "error": float(np.sqrt(square)), "seconds": seconds}


def by_cpmkit(surface: str, degree: int, spacing: float) -> dict[str, float]:
    """Return the same by the Galerkin form."""
    from knobs import on_sphere, on_torus

    import cpmkit as ck

    exact = {"sphere": on_sphere, "torus": on_torus}[surface]
    start = process_time()
    radii = {"sphere": {}, "torus": {"major": MAJOR, "minor": MINOR}}[surface]
    scene = ck.Scene(ck.source(f"analytic.{surface}", **radii), ck.ScreenedPoisson(lambda x: exact(x)[1], c=1.0))
    solution = ck.solve(scene, spacing, form="galerkin", degree=degree, estimate=False)
    seconds, form = process_time() - start, solution.discretized
    off = solution.evaluate(form.points).ravel() - exact(form.points)[0]
    rms = float(np.sqrt(form.point_weights @ off**2 / form.point_weights.sum()))
    return {"unknowns": solution.work.unknowns, "error": rms, "seconds": seconds}


def in_turns(python: str, surface: str, size: int) -> dict[str, dict[str, float]]:
    """Return what both did by every degree, with the median of the seconds; all wait while one of them solves."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    found: dict[str, list[dict[str, float]]] = {}
    coarser: dict[int, float] = {}
    with ExitStack() as stack:
        peers = {}
        for order in DEGREES:
            command = [python, __file__, "--trace", surface, str(order), str(LENGTHS[surface][order][size])]
            pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
            peers[order] = stack.enter_context(subprocess.Popen(command, text=True, env=environment, **pipes))
        for _ in range(ROUNDS + 1):
            for degree, peer in peers.items():
                peer.stdin.write("\n")
                peer.stdin.flush()
                traced = json.loads(_answer(peer.stdout))
                found.setdefault(trace_name(degree), []).append(traced)
                one = by_cpmkit(surface, degree, SPACINGS[surface][degree][size])
                found.setdefault(f"Galerkin form, degree {degree}", []).append(one)
                if degree not in coarser:
                    coarser[degree] = coarser_spacing(surface, size, traced["error"])
                one = by_cpmkit(surface, COARSER_DEGREE, coarser[degree])
                found.setdefault(beside_name(degree), []).append(one)
        for peer in peers.values():
            peer.stdin.close()
    return {name: {**kept[-1], "seconds": median(one["seconds"] for one in kept[1:])} for name, kept in found.items()}


def trace_name(order: int) -> str:
    """Return what trace elements are called in the table."""
    return f"trace elements of order {order}"


def beside_name(order: int) -> str:
    """Return the name of the coarser solves beside trace elements."""
    return f"coarser than {trace_name(order)}"


def coarser_spacing(surface: str, size: int, error: float) -> float:
    """Return a spacing at which the Galerkin form has less than an error, the largest such, about.

    Its error is taken to be of its order, and a solve has to confirm it: on coarse lattices it depends on their
    position by a third.
    """
    spacing = SPACINGS[surface][COARSER_DEGREE][size]
    spacing *= (error / by_cpmkit(surface, COARSER_DEGREE, spacing)["error"]) ** (1 / (COARSER_DEGREE + 1))
    while by_cpmkit(surface, COARSER_DEGREE, spacing)["error"] >= error:
        spacing *= REDUCED
    return spacing


def row(surface: str, name: str, found: dict[str, dict[str, float]]) -> str:
    """Return a row of the table; beside trace elements it goes on with the coarser solve, and its share of the time."""
    one = found[name]
    cells = [surface, name, f"{one['unknowns']:,}", f"{one['error']:.1e}", f"{one['seconds']:.2f}"]
    beside = {trace_name(order): found[beside_name(order)] for order in DEGREES}.get(name)
    if beside is None:
        return f"| {' | '.join(cells)} | | | | |"
    cells += [f"{beside['unknowns']:,}", f"{beside['error']:.1e}", f"{beside['seconds']:.2f}"]
    return f"| {' | '.join([*cells, format(beside['seconds'] / one['seconds'], '.2f')])} |"


def _answer(lines: Iterable[str]) -> str:
    """Return the next line that is a record: the library greets at first."""
    return next(line for line in lines if line.startswith("{"))


def main(python: str) -> None:
    """Print the table."""
    os.environ["CPMKIT_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"
    beside = "unknowns of degree 2 with less error | its error | its seconds | share of the time"
    print(
        f"| surface | by | unknowns | rms error | seconds | {beside} |", "|---|---|" + 7 * "--:|", sep="\n", flush=True
    )
    for surface in BOXES:
        for size in range(len(UNKNOWNS)):
            found = in_turns(python, surface, size)
            for name in sorted(found, reverse=True):
                if not name.startswith("coarser"):
                    print(row(surface, name, found), flush=True)


def trace(surface: str, order: str, length: str) -> None:
    """Answer each line with one solve."""
    solves = by_ngsolve(surface, int(order), float(length))
    for _ in sys.stdin:
        print(json.dumps(next(solves)), flush=True)


if __name__ == "__main__":
    if sys.argv[1] == "--trace":
        trace(*sys.argv[2:])
    else:
        main(sys.argv[1])
