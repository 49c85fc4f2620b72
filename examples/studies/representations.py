"""A sphere and a torus, each in five representations, with the same two problems.

The closed form is the reference. For the others the table shows the error of their closest points, the error of their
solutions at three spacings, the difference of the finest solution from that of the closed form, and the error of the
representation that `explain` predicts.

    python examples/studies/representations.py benchmarks/tables/representations.md      (some minutes)
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import cpmkit as ck

MAJOR, MINOR = 1.0, 0.4
ORIGIN = np.zeros(3)
#: Curves that meet no node of the lattice: there sides are a matter of convention, and differ with the normal's sign.
TILTED = np.array([0.31, 0.22, 0.925]) / np.linalg.norm([0.31, 0.22, 0.925])
MEETS = MAJOR * np.array([np.cos(0.7), np.sin(0.7), 0.0])


@dataclass(frozen=True)
class Manifold:
    """A surface in several representations, and what is known of it.

    Attributes
    ----------
    name : str
    makers : dict
        By representation, a function that returns a source; ``closed form`` first.
    normal_and_curvature : callable
        Returns unit normals (n, 3) and their divergence (n,) at points of the surface.
    curve : source
        Where the Dirichlet condition holds.
    spacings : list of float
    """

    name: str
    makers: dict[str, Callable[[], Any]]
    normal_and_curvature: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
    curve: Any
    spacings: list[float]

    def points(self, count: int = 4000) -> np.ndarray:
        """Return points (count, 3) of the surface."""
        x = np.random.default_rng(7).normal(size=(count, 3)) * [1.0, 1.0, 0.4]
        return self.makers["closed form"]().closest_point(x).points


def u(x):
    """The solution."""
    return x[:, 0] * x[:, 1] + x[:, 2]


def right_hand_side(manifold: Manifold, c: float):
    """Return f of -Lap u + c u = f; Lap_S u = Lap u - n . Hess(u) n - (div n) du/dn."""

    def f(x):
        n, curvature = manifold.normal_and_curvature(x)
        slope = n[:, 0] * x[:, 1] + n[:, 1] * x[:, 0] + n[:, 2]
        return 2 * n[:, 0] * n[:, 1] + curvature * slope + c * u(x)

    return f


def scenes(manifold: Manifold, surface: Any) -> dict[str, ck.Scene]:
    """Return the two problems on one representation."""
    on_curve = ck.Boundary("curve", manifold.curve, both=ck.Dirichlet(u))
    return {
        "screened Poisson, closed": ck.Scene(surface, ck.ScreenedPoisson(right_hand_side(manifold, 1.0), 1.0)),
        "Poisson, Dirichlet on a curve": ck.Scene(surface, ck.Poisson(right_hand_side(manifold, 0.0)), [on_curve]),
    }


def sphere_facts(x):
    """Return the normal of the unit sphere and its divergence."""
    radius = np.linalg.norm(x, axis=1)
    return x / radius[:, None], 2 / radius


def torus_facts(x):
    """Return the normal of the torus and its divergence: 1/r + cos(angle)/distance from the axis."""
    around = np.hypot(x[:, 0], x[:, 1])
    across = np.stack([x[:, 0] * (1 - MAJOR / around), x[:, 1] * (1 - MAJOR / around), x[:, 2]], axis=1)
    length = np.linalg.norm(across, axis=1)
    return across / length[:, None], (1 + (around - MAJOR) / around) / length


def octasphere(times: int):
    """Return vertices and triangles of a subdivided octahedron on the unit sphere: 4^(times + 1) + 2 vertices."""
    vertices = [np.array(v, dtype=float) for v in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))]
    faces = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
    for _ in range(times):
        middle: dict[tuple[int, int], int] = {}

        def half(a, b, middle=middle):
            key = (min(a, b), max(a, b))
            if key not in middle:
                middle[key] = len(vertices)
                vertices.append((vertices[a] + vertices[b]) / np.linalg.norm(vertices[a] + vertices[b]))
            return middle[key]

        finer = []
        for a, b, c in faces:
            ab, bc, ca = half(a, b), half(b, c), half(c, a)
            finer += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = finer
    return np.array(vertices), np.array(faces)


def torus_grid(around: int, across: int):
    """Return vertices and triangles of a torus of ``around`` times ``across`` quads."""
    a, b = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    s, t = 2 * np.pi * a.ravel() / around, 2 * np.pi * b.ravel() / across
    rho = MAJOR + MINOR * np.cos(t)
    vertices = np.stack([rho * np.cos(s), rho * np.sin(s), MINOR * np.sin(t)], axis=1)
    number = a * across + b
    right, up = np.roll(number, -1, axis=0), np.roll(number, -1, axis=1)
    corner = np.roll(right, -1, axis=1)
    faces = [np.stack(t, axis=-1).reshape(-1, 3) for t in ((number, right, corner), (number, corner, up))]
    return vertices, np.concatenate(faces)


def cloud_on(surface: Any, count: int):
    """Return points of a surface that lie at random, about evenly: of many, those first in small cells."""
    lower, upper = np.asarray(surface.bounds)
    rng = np.random.default_rng(3)
    x = rng.uniform(lower - 0.05, upper + 0.05, (60 * count, 3))
    feet = surface.closest_point(x)
    near = feet.points[feet.distance < 0.05]
    return near[:count]


def sphere(cloud: int = 100_000, times: int = 6) -> Manifold:
    """Return the unit sphere."""
    closed = ck.source("analytic.sphere")
    vertices, faces = octasphere(times)
    angles = {"u": [0, 2 * np.pi], "v": [0, np.pi], "periodic_u": True}
    return Manifold(
        "sphere",
        {
            "closed form": lambda: closed,
            "level set": lambda: ck.source(
                "levelset.expression", phi="x**2 + y**2 + z**2 - 1", bounds=[[-1.5] * 3, [1.5] * 3]
            ),
            "parametric": lambda: ck.source(
                "parametric.surface", x=["sin(v)*cos(u)", "sin(v)*sin(u)", "cos(v)"], **angles
            ),
            f"mesh of {len(vertices):,} vertices": lambda: ck.source("mesh.triangles", vertices=vertices, faces=faces),
            f"cloud of {cloud:,} points": lambda: ck.source("pointcloud.points", points=cloud_on(closed, cloud)),
        },
        sphere_facts,
        ck.source("analytic.circle", normal=TILTED, center=0.1 * TILTED, radius=np.sqrt(0.99)),
        [0.2, 0.1, 0.05],
    )


def torus(cloud: int = 100_000, around: int = 200, across: int = 80) -> Manifold:
    """Return the torus of radii 1 and 0.4."""
    closed = ck.source("analytic.torus", major=MAJOR, minor=MINOR)
    vertices, faces = torus_grid(around, across)
    rho = f"({MAJOR} + {MINOR}*cos(v))"
    turn = [0, 2 * np.pi]
    return Manifold(
        "torus",
        {
            "closed form": lambda: closed,
            "level set": lambda: ck.source(
                "levelset.expression",
                phi=f"(sqrt(x**2 + y**2) - {MAJOR})**2 + z**2 - {MINOR}**2",
                bounds=[[-1.6, -1.6, -0.6], [1.6, 1.6, 0.6]],
            ),
            "parametric": lambda: ck.source(
                "parametric.surface",
                x=[f"{rho}*cos(u)", f"{rho}*sin(u)", f"{MINOR}*sin(v)"],
                u=turn,
                v=turn,
                periodic_u=True,
                periodic_v=True,
            ),
            f"mesh of {len(vertices):,} vertices": lambda: ck.source("mesh.triangles", vertices=vertices, faces=faces),
            f"cloud of {cloud:,} points": lambda: ck.source("pointcloud.points", points=cloud_on(closed, cloud)),
        },
        torus_facts,
        ck.source("analytic.circle", center=MEETS, normal=[-MEETS[1], MEETS[0], 0], radius=MINOR),
        [0.1, 0.05, 0.025],
    )


@dataclass(frozen=True)
class Row:
    """One representation of one manifold, one problem."""

    representation: str
    feet_off: float
    errors: list[float]
    difference: float
    floor: float


def feet_off(surface: Any, manifold: Manifold, reach: float) -> float:
    """Return how far closest points are from those of the closed form, at most, up to ``reach`` from the surface."""
    rng = np.random.default_rng(5)
    normals, _ = manifold.normal_and_curvature(manifold.points())
    x = manifold.points() + reach * rng.uniform(-1, 1, (len(normals), 1)) * normals
    apart = surface.closest_point(x).points - manifold.makers["closed form"]().closest_point(x).points
    return float(np.linalg.norm(apart, axis=1).max())


def study(manifold: Manifold) -> dict[str, list[Row]]:
    """Solve both problems on every representation at every spacing."""
    points, tables, finest = manifold.points(), {}, {}
    spread = np.ptp(u(points))
    for representation, make in manifold.makers.items():
        surface = make()
        off = feet_off(surface, manifold, 4 * manifold.spacings[-1])
        for problem, scene in scenes(manifold, surface).items():
            solved = [ck.solve(scene, h, origin=ORIGIN, form="collocation").evaluate(points) for h in manifold.spacings]
            errors = [float(np.abs(one - u(points)).max() / spread) for one in solved]
            closed = finest.setdefault(problem, solved[-1])
            difference = float(np.abs(solved[-1] - closed).max() / spread)
            floor = ck.explain(scene, manifold.spacings[-1], origin=ORIGIN, form="collocation").floor
            tables.setdefault(problem, []).append(Row(representation, off, errors, difference, floor))
            print(manifold.name, problem, tables[problem][-1], flush=True)
    return tables


def order(spacings: list[float], errors: list[float]) -> float:
    """Return the least-squares slope of log(error) over log(spacing)."""
    return float(np.polyfit(np.log(spacings), np.log(errors), 1)[0])


def as_markdown(manifold: Manifold, tables: dict[str, list[Row]]) -> str:
    """Return the tables of one manifold."""
    lines = []
    for problem, rows in tables.items():
        spacings = " | ".join(f"error at {h:g}" for h in manifold.spacings)
        lines += [f"**{manifold.name.capitalize()}: {problem}**", ""]
        heads = f"closest points off by | {spacings} | order | differs from closed form | floor predicted"
        lines += [f"| representation | {heads} |"]
        lines += ["|---|---|" + "---|" * (len(manifold.spacings) + 3)]
        for row in rows:
            errors = " | ".join(f"{error:.1e}" for error in row.errors)
            lines.append(
                f"| {row.representation} | {row.feet_off:.0e} | {errors} | {order(manifold.spacings, row.errors):.2f} "
                f"| {row.difference:.0e} | {row.floor:.0e} |"
            )
        lines.append("")
    return "\n".join(lines)


def main() -> None:
    """Run the study and write the tables."""
    if len(sys.argv) != 2:
        sys.exit("usage: python examples/studies/representations.py TABLES.md")
    parts = [as_markdown(manifold, study(manifold)) for manifold in (sphere(), torus())]
    Path(sys.argv[1]).write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()
