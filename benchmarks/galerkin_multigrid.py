"""The multigrid of the Galerkin form on spheres: iterations, cost in products with the fine matrix, peak memory.

``python benchmarks/galerkin_multigrid.py`` takes spheres of 20 thousand to a million unknowns, each in a process of its
own, and prints a table. All is on one thread; a product is SciPy's, of the fine matrix in double precision with a
vector, timed before and after what it is compared with. Peak memory is what levels, set-up and solve need beside the
matrix, in bytes an unknown.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from itertools import product

ONE_THREAD = dict.fromkeys(("CPMKIT_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
SPACINGS = (0.053, 0.0237, 0.0106, 0.0075)


def sphere(spacing):
    """The unit sphere by the midpoints of squares drawn on the faces of a cube, and their corners' numbers."""
    import numpy as np

    from cpmkit.mesh.cell_quadrature import Samples

    count = int(np.ceil(np.pi / 2 / (0.4 * spacing)))
    place = np.stack(np.meshgrid(np.arange(count), np.arange(count), indexing="ij"), axis=-1).reshape(-1, 2)
    points, contacts = [], []
    for axis, side in product(range(3), (0, 1)):
        corners = [np.insert(place + way, axis, side * count, axis=1) for way in product((0, 1), repeat=2)]
        contacts.append(np.stack([corner @ [1, count + 1, (count + 1) ** 2] for corner in corners], axis=1))
        points.append(np.insert(np.tan(np.pi / 4 * ((2 * place + 1) / count - 1)), axis, 2 * side - 1, axis=1))
    x, contact = np.concatenate(points), np.concatenate(contacts)
    size = np.linalg.norm(x, axis=1)
    weights = (1 + x**2).prod(axis=1) / 2 * (np.pi / 2 / count) ** 2 / size**3
    normals = x / size[:, None]
    number = np.unique(contact, return_inverse=True)[1].reshape(contact.shape)
    return Samples(normals.copy(), weights, normals[:, None, :].copy(), np.arange(len(x))), number


def measure(spacing):
    """Print the row of the table of one spacing."""
    import numpy as np

    from cpmkit.forms.galerkin.dof_map import build_dof_map
    from cpmkit.forms.galerkin.options import STABILISATIONS
    from cpmkit.forms.galerkin.space.energy import load, stiffness_with_floor
    from cpmkit.forms.galerkin.space.levels import coarser_levels
    from cpmkit.forms.galerkin.space.spline_space import build_spline_space
    from cpmkit.linear.multigrid.solver import MultigridSolver
    from cpmkit.linear.operators import CsrOperator
    from cpmkit.runtime.memory import peak_growth_bytes, reset_peak_memory

    samples, contacts = sphere(spacing)
    dof_map = build_dof_map(samples.points, contacts, spacing)
    space = build_spline_space(dof_map, samples)
    operator = CsrOperator(stiffness_with_floor(space, 1.0, STABILISATIONS[2]["default"], 1.0), symmetric=True)
    b = load(space, 3 * samples.points[:, 2:])
    del space, samples, contacts
    times = products(operator.matrix, b)
    before = reset_peak_memory()
    marks = [time.process_time()]
    levels = coarser_levels(dof_map, np.zeros(0, dtype=np.int64))
    marks.append(time.process_time())
    prepared = MultigridSolver().prepare(operator, levels)
    marks.append(time.process_time())
    report = prepared.solve(b, 1e-10)[1]
    marks.append(time.process_time())
    used = (peak_growth_bytes(before) or 0) / operator.size
    one = float(np.median(times + products(operator.matrix, b)))
    costs = np.diff(marks) / one
    per_row = operator.matrix.nnz / operator.size
    columns = [f"{cost:.0f}" for cost in (*costs, costs.sum())]
    nanoseconds = one / operator.size * 1e9
    row = (operator.size, f"{per_row:.0f}", f"{nanoseconds:.0f}", report.iterations, *columns, f"{used:.0f}")
    print("| " + " | ".join(map(str, row)) + " |", flush=True)


def products(matrix, b):
    """The CPU seconds of nine products."""
    seconds = []
    for _ in range(9):
        start = time.process_time()
        matrix @ b[:, 0]
        seconds.append(time.process_time() - start)
    return seconds


def main():
    print("| unknowns | entries a row | product, ns a row | iterations | levels | set-up | solve | sum | peak bytes |")
    print("|" + "---|" * 9, flush=True)
    for spacing in SPACINGS:
        subprocess.run([sys.executable, __file__, str(spacing)], env={**os.environ, **ONE_THREAD}, check=True)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        measure(float(sys.argv[1]))
    else:
        main()
