"""What the stages of the Galerkin form's set-up cost, from samples to the matrix, in products with the matrix.

Run ``python benchmarks/galerkin_stages.py``; it needs ``pip install . trimesh``. Samples lie on an icosphere with
edges of about half a spacing, three on a triangle. Costs are processor time, the least of several rounds.
"""

from __future__ import annotations

from collections.abc import Callable
from time import process_time
from typing import Any

import numpy as np
from trimesh.creation import icosphere

from cpmkit.forms.galerkin.dof_map import build_dof_map
from cpmkit.forms.galerkin.options import STABILISATIONS
from cpmkit.forms.galerkin.space.energy import add_ghosts, energy_data, load, stiffness_with_floor, values_at_samples
from cpmkit.forms.galerkin.space.spline_space import build_spline_space
from cpmkit.mesh.cell_quadrature import Samples

CORNERS = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4]]) / 6
STRENGTH = STABILISATIONS[2]["default"]
ROUNDS = 5


def sphere(subdivisions: int) -> tuple[Samples, np.ndarray, float]:
    """Return three samples on each triangle, the corners of their triangles, and the spacing for them."""
    ball = icosphere(subdivisions=subdivisions)
    cells = np.asarray(ball.faces, dtype=np.int64)
    points = np.ascontiguousarray(np.einsum("sj,mjd->msd", CORNERS, ball.vertices[cells]).reshape(-1, 3))
    cell = np.arange(len(cells)).repeat(3)
    normals = np.ascontiguousarray(ball.face_normals[cell][:, None, :])
    samples = Samples(points, ball.area_faces[cell] / 3, normals, cell)
    return samples, cells[cell], 2.1 * float(ball.edges_unique_length.mean())


def seconds(stage: Callable[[], Any]) -> float:
    """Return the least processor time of several rounds, the first of which compiles."""
    times = []
    for _ in range(ROUNDS):
        begin = process_time()
        stage()
        times.append(process_time() - begin)
    return min(times)


def main(subdivisions: tuple[int, ...] = (5, 6, 7, 8)) -> None:
    """Print the table."""
    for count in subdivisions:
        samples, contacts, h = sphere(count)
        dof_map = build_dof_map(samples.points, contacts, h)
        space = build_spline_space(dof_map, samples)
        data = energy_data(space, 1.0, None, STRENGTH)
        matrix = stiffness_with_floor(space, 1.0, STRENGTH, c=1.0)
        u = np.ones((dof_map.size, 1))
        product = seconds(lambda: matrix @ u[:, 0])  # noqa: B023
        stages = {
            "parting": lambda: build_dof_map(samples.points, contacts, h),  # noqa: B023
            "pattern": lambda: build_spline_space(dof_map, samples),  # noqa: B023
            "energy": lambda: energy_data(space, 1.0, 1.0, STRENGTH),  # noqa: B023
            "ghosts": lambda: add_ghosts(space, 1.0, STRENGTH, data),  # noqa: B023
            "load": lambda: load(space, samples.points[:, :1]),  # noqa: B023
            "values": lambda: values_at_samples(space, u),  # noqa: B023
        }
        costs = {name: seconds(stage) / product for name, stage in stages.items()}
        n = dof_map.size
        print(f"{n} unknowns, {len(samples) / n:.1f} samples and {matrix.nnz / n:.0f} entries each; in products:")
        print("   ", "  ".join(f"{name} {cost:.0f}" for name, cost in costs.items()), f" all {sum(costs.values()):.0f}")
        print(f"    a product takes {1e9 * product / n:.0f} ns an unknown")


if __name__ == "__main__":
    main()
