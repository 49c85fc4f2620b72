"""Which form buys which error for what time and memory, on six scenes: the table of "How to choose".

Run ``python benchmarks/how_to_choose.py > benchmarks/tables/how-to-choose.md``, some minutes, with names of scenes for
these alone; it needs ``pip install . ./plugins/*`` and, for Spot, ``CPMKIT_DATA`` set to the folder of the mesh. Every
number is of one run; seconds are of the processor and of this machine.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import cpmkit as ck
from cpmkit.studies.records import group_into_series, read_records
from cpmkit.studies.reference_values import Reference, sample_points
from cpmkit.studies.run_one import run_study
from cpmkit.studies.studyfile import load_study
from cpmkit.studies.tables import attempts, cheapest_table, pareto_table

#: Points of the cloud.
CLOUD = 6000
#: Spacing of the solution that is taken for the truth on Spot.
FINE_SPACING = 0.008
SPOT = """
[surface]
kind = "moved"
of = { kind = "mesh.triangles", file = "spot.obj", closest = "smooth" }
scale = 0.5626920538
translation = [0.2607661277, 0.4108940558, 0.3936430428]
[problem]
kind = "screened"
f = "cos(6*x) + sin(5*y + 2*z) + z"
[exact]
reference = "fem"
points = 3000
[sweep]
spacings = [0.05, 0.025, 0.0175, 0.0125]
methods = ["galerkin", "collocation", "fem", "fem-refined"]
"""
SPHERE = """
[surface]
{surface}
[problem]
kind = "screened"
f = "37*sin(6*z) - 36*z**2*sin(6*z) + 12*z*cos(6*z)"
[exact]
u = "sin(6*z)"
points = 3000
[sweep]
spacings = {spacings}
tolerances = [1e-2, 1e-3]
methods = {methods}
"""
BALL = 'kind = "analytic.sphere"'
LEVEL = 'kind = "levelset.expression"\nphi = "x*x + y*y + z*z - 1"\nbounds = [[-1.2, -1.2, -1.2], [1.2, 1.2, 1.2]]'
TWO_SIDED = """
[surface]
kind = "analytic.sphere"
[[boundary]]
name = "circle"
kind = "analytic.circle"
center = [0, 0, 0.2]
normal = [0, 0, 1]
radius = 0.9797958971132712
left = { dirichlet = 1.2214027581601699 }
right = { dirichlet = 1.8 }
[problem]
kind = "screened"
f = "inside*exp(z)*(z**2 + 2*z) + (1 - inside)*(2 - 3*z)"
[let]
inside = "z > 0.2"
[exact]
u = "inside*exp(z) + (1 - inside)*(2 - z)"
points = 3000
[sweep]
spacings = [0.2, 0.1, 0.05]
tolerances = [1e-2, 1e-3]
methods = ["galerkin", "collocation"]
"""
#: Rows are the normals of the cube's sides, which lie on no plane of the grid.
TURNED = np.array([[0.8, 0.6, 0.0], [-3 / 13, 4 / 13, 12 / 13], [7.2 / 13, -9.6 / 13, 5 / 13]])
#: Half of the cube's side.
HALF = 0.6
#: Its sides are squares, and u has no slope across its edges.
CUBE = """
[surface]
kind = "mesh.triangles"
file = "cube.obj"
closest = "faceted"
[problem]
kind = "screened"
f = "(1 + k**2)*(waves + 1) - 1"
[let]
k = {k}
p = "{p}"
q = "{q}"
r = "{r}"
waves = "cos(k*p) + cos(k*q) + cos(k*r)"
[exact]
u = "waves"
points = 3000
[sweep]
spacings = [0.2, 0.1, 0.05, 0.025]
methods = ["galerkin", "fem-refined"]
"""


@dataclass(frozen=True)
class Choice:
    """A scene: its study, what it is in words, and what solves it finely where no solution is known."""

    words: str
    text: str
    finely: Callable[[ck.Scene], ck.Solution] | None = None


def of_sphere(surface: str, spacings: Sequence[float], methods: Sequence[str]) -> str:
    """Return the study of sin 6z on a sphere."""
    return SPHERE.format(surface=surface, spacings=list(spacings), methods=list(methods)).replace("'", '"')


def of_cube() -> str:
    """Return the study of waves on the cube."""
    places = [" + ".join(f"({one!r})*{axis}" for one, axis in zip(row, "xyz", strict=True)) for row in TURNED.tolist()]
    return CUBE.format(k=np.pi / HALF, p=places[0], q=places[1], r=places[2])


FORMS = ("galerkin", "collocation")
CHOICES = {
    "sphere": Choice(
        "A sphere by its formula, waves on it",
        of_sphere(BALL, (0.2, 0.1, 0.05), (*FORMS, "fem")),
    ),
    "level-set": Choice("The same sphere as a level set", of_sphere(LEVEL, (0.2, 0.1, 0.05), FORMS)),
    "cloud": Choice(
        f"The same sphere as a cloud of {CLOUD:,} points",
        of_sphere('kind = "pointcloud.points"\nfile = "cloud.npy"', (0.2, 0.1), FORMS),
    ),
    "two-sided": Choice("A sphere with a circle that has another value on each side", TWO_SIDED),
    "cube": Choice("A turned cube: twelve flat triangles that are the surface themselves", of_cube()),
    "spot": Choice(
        "Spot, whose triangles stand for a smooth surface; against the Galerkin form on a finer lattice",
        SPOT,
        lambda scene: ck.solve(scene, FINE_SPACING, form="galerkin"),
    ),
}


def cloud() -> np.ndarray:
    """Return points (n, 3) that lie evenly on the sphere."""
    k = np.arange(CLOUD) + 0.5
    z, turn = 1 - 2 * k / CLOUD, np.pi * (1 + np.sqrt(5)) * k
    return np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)


def cube() -> str:
    """Return the turned cube as the text of an .obj file."""
    corners = np.stack(np.meshgrid(*[[-HALF, HALF]] * 3, indexing="ij"), axis=-1).reshape(-1, 3) @ TURNED
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in corners.tolist()]
    halves = [half for a, b, c, d in sides for half in ((a, b, c), (a, c, d))]
    return "\n".join([*lines, *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in halves)]) + "\n"


def told(name: str, choice: Choice, folder: Path) -> Iterator[str]:
    """Run the study of a scene; yield what to say of it."""
    file = folder / f"{name}.toml"
    file.write_text(choice.text, encoding="utf-8")
    np.save(folder / "cloud.npy", cloud())
    (folder / "cube.obj").write_text(cube(), encoding="utf-8")
    study = load_study(file)
    truth = None
    if choice.finely is not None:
        points = sample_points(study.scene, study.exact.points)
        truth = Reference(points, choice.finely(study.scene).evaluate(points))
    outcome = run_study(study, folder / name, truth=truth, recorded=lambda record: print(record, file=sys.stderr))
    made = attempts(group_into_series(read_records(outcome.file)))
    yield from (f"**{choice.words}**", "", cheapest_table(made), "", "Unbeaten in error and cost:", "")
    yield from (pareto_table(made), "")


def main(names: Sequence[str]) -> None:
    """Print the tables."""
    with tempfile.TemporaryDirectory() as folder:
        for name in names or CHOICES:
            print("\n".join(told(name, CHOICES[name], Path(folder))), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
