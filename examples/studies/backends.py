"""Both forms of the method against finite elements on real meshes: how far, and where, they differ.

No exact solution is known on these meshes; linear finite elements on their own triangles are the reference. Two
problems: the screened Poisson equation with a smooth right-hand side, and the Laplace equation between two plane cuts
on which finite elements pin the nearest vertices, so that beside them they are of first order.

    python examples/studies/backends.py benchmarks/tables/backends.md docs/images      (some minutes, needs the meshes)
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

import cpmkit as ck

#: By mesh, its spacings, and the direction from which its picture is taken.
MESHES = {
    "spot.obj": ([0.04, 0.03, 0.02], (-1.0, 0.35, -0.6), (0.0, 1.0, 0.0)),
    "fish.obj": ([0.06, 0.045, 0.03], (1.0, 0.35, -0.5), (0.0, 1.0, 0.0)),
    "nefertiti-lowres.obj": ([8.0, 6.0, 4.0], (0.6, 0.1, 1.0), (0.0, 1.0, 0.0)),
}
#: Pictures are of the last.
FORMS = ("collocation", "galerkin")
#: A difference of more than this share of the range is worth a word.
WORTH_A_WORD = 0.01


@dataclass(frozen=True)
class Row:
    """How one mesh, problem and spacing came out; differences are shares of the range at the mesh's vertices."""

    mesh: str
    problem: str
    form: str
    spacing: float
    unknowns: int
    mean: float
    largest: float
    share_over: float
    where: tuple[float, float, float]
    warnings: int


def scenes(vertices: Any, faces: Any) -> dict[str, ck.Scene]:
    """Return the two problems on a mesh."""
    surface = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    size, middle = float((upper - lower).max()), 0.5 * (lower + upper)
    axis = int((upper - lower).argmax())
    c = 16 / size**2

    def f(x):
        return c * np.sin(3 * (x[:, axis] - middle[axis]) / size + x[:, (axis + 1) % 3] / size)

    def cut(share, value):
        point = middle.copy()
        point[axis] = lower[axis] + share * size
        plane = ck.source("cut.plane", surface=surface, point=point, normal=np.eye(3)[axis])
        return ck.Boundary(f"at {share:g}", plane, both=ck.Dirichlet(value))

    return {
        "screened Poisson": ck.Scene(surface, ck.ScreenedPoisson(f, c)),
        "Laplace between cuts": ck.Scene(surface, ck.Laplace(), [cut(0.2, 0.0), cut(0.8, 1.0)]),
    }


def compare(
    mesh: str, problem: str, scene: ck.Scene, vertices: Any, spacing: float, fem: Any, form: str
) -> tuple[Row, Any]:
    """Solve by closest points, and return the row and the differences at the vertices."""
    solution = ck.solve(scene, spacing, form=form)
    truth = fem.evaluate(vertices)
    difference = np.abs(solution.evaluate(vertices) - truth) / np.ptp(truth)
    worst = vertices[difference.argmax()]
    row = Row(
        mesh.removesuffix(".obj"),
        problem,
        form,
        spacing,
        solution.work.unknowns,
        float(difference.mean()),
        float(difference.max()),
        float(np.mean(difference > WORTH_A_WORD)),
        (float(worst[0]), float(worst[1]), float(worst[2])),
        len(solution.warnings),
    )
    print(row, flush=True)
    return row, difference


def as_markdown(rows: list[Row]) -> str:
    """Return the table."""
    lines = [
        "| mesh | problem | form | spacing | unknowns | mean difference | largest | over 1 % at | largest near "
        "| warnings |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        where = "(" + ", ".join(f"{x:.3g}" for x in row.where) + ")" if row.largest > WORTH_A_WORD else ""
        lines.append(
            f"| {row.mesh} | {row.problem} | {row.form} | {row.spacing:g} | {row.unknowns:,} | {row.mean:.2%} "
            f"| {row.largest:.1%} | {row.share_over:.1%} of vertices | {where} | {row.warnings} |"
        )
    return "\n".join(lines) + "\n"


def study(mesh: str, images: Path | None) -> list[Row]:
    """Compare on one mesh; draw where the finest differs on the first problem."""
    spacings, view, up = MESHES[mesh]
    vertices, faces = ck.read_mesh(mesh)
    rows = []
    for number, (problem, scene) in enumerate(scenes(vertices, faces).items()):
        fem = ck.solve(scene, backend="fem")
        for form, spacing in product(FORMS, spacings):
            row, difference = compare(mesh, problem, scene, vertices, spacing, fem, form)
            rows.append(row)
        if number == 0 and images is not None:
            shown = replace(fem, values=100 * difference[:, None])
            shown.picture(
                images / f"difference-{mesh.removesuffix('.obj').removesuffix('-lowres')}.png",
                width=700,
                view=view,
                up=up,
            )
    return rows


def main() -> None:
    """Run the study and write the table and the pictures."""
    if len(sys.argv) != 3:
        sys.exit("usage: python examples/studies/backends.py TABLE.md FOLDER-OF-PICTURES")
    rows = [row for mesh in MESHES for row in study(mesh, Path(sys.argv[2]))]
    Path(sys.argv[1]).write_text(as_markdown(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
