"""Biharmonic problems by both forms beside each other, and what standing waves and plates cost the Galerkin form.

Run ``python benchmarks/plates_and_waves.py plates`` for the table of tables/plates.md: greatest errors of u and of
Lap u. Run it with ``waves`` for that of tables/waves.md: iterations and seconds of one thread, and with
``factors`` for what a factorisation of the same systems takes. It needs ``pip install . ./plugins/*``.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from time import process_time
from typing import Any

import numpy as np

import cpmkit as ck
from cpmkit.studies.tables import table_row, table_rule

#: How each problem is solved, and a flat one besides.
FORMS: dict[str, dict[str, str]] = {"collocation": {"form": "collocation"}, "galerkin": {"form": "galerkin"}}
CLIPPED = {"galerkin, samples clipped": {"form": "galerkin", "samples": "clipped"}}
SPHERE, MAJOR, MINOR = ck.source("analytic.sphere"), 1.0, 0.4
#: Spacings of the costs on the sphere, and k h.
COST_SPACINGS, RADIANS = (0.1, 0.05, 0.025), (0.1, 0.5, 0.75)


@dataclass(frozen=True)
class Plate:
    """A biharmonic problem with a known solution, and points at which it is read."""

    name: str
    scene: ck.Scene
    u: Callable[[Any], Any]
    laplacian: Callable[[Any], Any]
    points: Any
    spacings: tuple[float, ...] = (0.2, 0.1, 0.05)
    flat: bool = False


def plates() -> Iterator[Plate]:
    """Yield the problems: c is one, and zero on the square."""
    rng = np.random.default_rng(0)
    t = rng.uniform(0, 2 * np.pi, 2000)
    ring = np.stack([np.cos(t), np.sin(t)], axis=1)
    circle = ck.Scene(ck.source("analytic.circle"), ck.Biharmonic(lambda x: 34 * x[:, 0] * x[:, 1] + 2 * x[:, 0]))
    yield Plate(
        "circle", circle, lambda x: 2 * x[:, 0] * x[:, 1] + x[:, 0], lambda x: -8 * x[:, 0] * x[:, 1] - x[:, 0], ring
    )
    ball = rng.normal(size=(2000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    load = ck.Biharmonic(lambda x: 37 * x[:, 0] * x[:, 1] + 5 * x[:, 2])
    u, laplacian = (lambda x: x[:, 0] * x[:, 1] + x[:, 2]), (lambda x: -6 * x[:, 0] * x[:, 1] - 2 * x[:, 2])
    yield Plate("sphere", ck.Scene(SPHERE, load), u, laplacian, ball)
    support = ck.SimplySupported(u, laplacian)
    upper = np.concatenate([ball[:, :2], np.abs(ball[:, 2:])], axis=1)
    yield Plate(
        "hemisphere, supported rim", ck.Scene(ck.source("analytic.cap"), load, edge=support), u, laplacian, upper
    )
    yield _on_torus(rng)
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    square = ck.source("mesh.triangles", vertices=corners, faces=[[0, 1, 2], [0, 2, 3]], closest="faceted")

    def bend(x: Any) -> Any:
        return np.sin(np.pi * x[:, 0]) * np.sin(np.pi * x[:, 1])

    held = ck.Scene(square, ck.Biharmonic(lambda x: 4 * np.pi**4 * bend(x), c=0.0), edge=ck.SimplySupported())
    inside = np.concatenate([rng.uniform(0, 1, (2000, 2)), np.zeros((2000, 1))], axis=1)
    spacings = (0.1, 0.05, 0.025)
    yield Plate("square, supported rim", held, bend, lambda x: -2 * np.pi**2 * bend(x), inside, spacings, True)


def _on_torus(rng: Any, nodes: int = 65) -> Plate:
    """Return u = cos p cos t on the torus, p the angle around the axis, t the small one; Lap by Fourier sums in t."""
    t = 2 * np.pi * np.arange(nodes) / nodes
    radius, waves = MAJOR + MINOR * np.cos(t), np.fft.fftfreq(nodes, 1 / nodes)

    def slope(values: Any) -> Any:
        return np.real(np.fft.ifft(1j * waves * np.fft.fft(values)))

    def beltrami(values: Any) -> Any:  # of what is values(t) cos p
        return slope(radius * slope(values)) / (MINOR**2 * radius) - values / radius**2

    def read(values: Any) -> Callable[[Any], Any]:
        share = np.real(np.fft.fft(values)) / nodes  # even in t

        def at(x: Any) -> Any:
            small = np.arctan2(x[:, 2], np.hypot(x[:, 0], x[:, 1]) - MAJOR)
            return np.cos(np.outer(small, waves)) @ share * np.cos(np.arctan2(x[:, 1], x[:, 0]))

        return at

    u = np.cos(t)
    value, laplacian, load = read(u), read(beltrami(u)), read(u + beltrami(beltrami(u)))
    around, small = rng.uniform(0, 2 * np.pi, (2, 2000))
    distance = MAJOR + MINOR * np.cos(small)
    points = np.stack([distance * np.cos(around), distance * np.sin(around), MINOR * np.sin(small)], axis=1)
    torus = ck.source("analytic.torus", major=MAJOR, minor=MINOR)
    return Plate("torus", ck.Scene(torus, ck.Biharmonic(load)), value, laplacian, points)


def print_plates() -> None:
    """Print the greatest errors of both forms."""
    print(table_row(["problem", "form", "spacings", "errors of u", "errors of Lap u", "order of u", "of Lap u"]))
    print(table_rule(5, 2))
    for plate in plates():
        exact = plate.u(plate.points), plate.laplacian(plate.points)
        for form, options in (FORMS | CLIPPED if plate.flat else FORMS).items():
            found = [ck.solve(plate.scene, spacing, **options) for spacing in plate.spacings]
            errors = [
                [np.abs(read(one) - value).max() for one in found]
                for read, value in (
                    (lambda one: one.evaluate(plate.points), exact[0]),  # noqa: B023
                    (lambda one: one.laplacian(plate.points), exact[1]),  # noqa: B023
                )
            ]
            told = [", ".join(f"{error:.1e}" for error in row) for row in errors]
            told += [f"{_order(plate.spacings, row):.1f}" for row in errors]
            print(table_row([plate.name, form, ", ".join(map(str, plate.spacings)), *told]), flush=True)


def _order(spacings: Any, errors: Any) -> float:
    return float(np.polyfit(np.log(spacings), np.log(errors), 1)[0])


def _bump(x: Any) -> Any:
    return np.exp(-8 * np.sum((x - [1.0, 0.0, 0.0]) ** 2, axis=1))


def cost_problems(spacing: float) -> Iterator[tuple[str, Any]]:
    """Yield names and equations: waves of several lengths, plates on beds of several strengths."""
    for radians in RADIANS:
        yield f"waves, k h = {radians:g}", ck.Helmholtz(_bump, radians / spacing)
    for c in (0.0, 1.0, 1e6):
        yield f"plate, c = {c:g}", ck.Biharmonic(lambda x: x[:, 0] * _bump(x) - x[:, 0] * _bump(-x), c=c)


def print_costs(solver: str, spacings: tuple[float, ...]) -> None:
    """Print what solves on the sphere take, tables and what a solver prepares included."""
    print(table_row(["problem", *(f"{spacing:g}" for spacing in spacings)]))
    print(table_rule(1, len(spacings)))
    names = [name for name, _ in cost_problems(1.0)]
    for number, name in enumerate(names):
        cells = []
        for spacing in spacings:
            problem = list(cost_problems(spacing))[number][1]
            started = process_time()
            solution = ck.solve(ck.Scene(SPHERE, problem), spacing, form="galerkin", solver=solver)
            took, unknowns = process_time() - started, solution.work.as_dict()["unknowns"]
            cells.append(f"{unknowns:,}: {solution.report.iterations}, {took:.2g} s")
        print(table_row([name, *cells]), flush=True)


if __name__ == "__main__":
    warnings.simplefilter("ignore", ck.CpmkitWarning)
    if sys.argv[1:] == ["plates"]:
        print_plates()
    elif sys.argv[1:] == ["factors"]:
        print_costs("direct", COST_SPACINGS[:2])
    else:
        ck.solve(ck.Scene(SPHERE, ck.Helmholtz(_bump, 2.0)), 0.2, solver="multigrid")  # compiles
        print_costs("multigrid", COST_SPACINGS)
