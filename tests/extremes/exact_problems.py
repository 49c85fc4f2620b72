"""More than a hundred problems on smooth shapes whose solutions are known, ends of curves and close curves included.

Errors are measured at points of the shape, in shares of the solution's range, and held against ``solution.error``.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from conformal_arc import arc_scene, on_sphere
from extremes.ambient import Place, Waves
from extremes.cases import STEP, STEPS, Case, Curve, Pin
from extremes.shapes import Arc, Cap, Cylinder, Helix, PlaneCurve, Plate, Shape, Spheroid, Torus
from plane_zones import POINTS, slit

import cpmkit as ck

#: Shapes, their representations, and a spacing.
SHAPES: dict[str, tuple[Shape, str, float]] = {
    "sphere": (Spheroid(), "analytic", 0.2),
    "sphere, level set": (Spheroid(), "level set", 0.16),
    "sphere, bare": (Spheroid(), "bare", 0.18),
    "sphere, cloud": (Spheroid(), "cloud .04", 0.2),
    "flat spheroid": (Spheroid(0.5), "level set", 0.13),
    "long spheroid": (Spheroid(2.0), "level set", 0.2),
    "torus": (Torus(0.4), "analytic", 0.14),
    "thin torus": (Torus(0.25), "moved", 0.1),
    "cylinder": (Cylinder(2.0), "analytic", 0.17),
    "cap": (Cap(0.0), "analytic", 0.15),
    "plate": (Plate(), "smooth .2", 0.15),
    "circle": (PlaneCurve(), "moved", 0.08),
    "flat ellipse": (PlaneCurve(0.5), "parametric", 0.06),
    "arc": (Arc(start=0.3, end=5.0), "analytic", 0.07),
    "helix": (Helix(), "analytic", 0.1),
}
#: A wave for each half of the problems: about two and about five spacings a radian.
SLOW, FAST = 1.7, 4.0
TURNED = (0.3, 0.5, -0.2)


@dataclass(frozen=True, eq=False)
class ExactProblem:
    """A scene, its spacing, points (n, d) of it, and u (n,) there; problems of one group are alike.

    ``make()`` returns the scene, the points and u.
    """

    name: str
    group: str
    spacing: float
    make: Callable[[], tuple[ck.Scene, Any, Any]]

    @cached_property
    def _made(self) -> tuple[ck.Scene, Any, Any]:
        return self.make()

    @property
    def scene(self) -> ck.Scene:
        """What is solved."""
        return self._made[0]

    def solve(self, **options: Any) -> Any:
        """Return the solution at the spacing, or for the tolerance of the options."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ck.CpmkitWarning)
            return ck.solve(self.scene, None if "tolerance" in options else self.spacing, **options)

    @property
    def is_up_to_constant(self) -> bool:
        """Whether nothing fixes a constant."""
        free = all(isinstance(one.condition("left"), ck.Neumann) for one in self.scene.boundaries)
        return isinstance(self.scene.problem, ck.Poisson) and free and not isinstance(self.scene.edge, ck.Dirichlet)

    def errors(self, solution: Any) -> tuple[float, float]:
        """Return the root mean square and the largest error, as shares of the range."""
        _, points, u = self._made
        off = solution.evaluate(points) - u
        if self.is_up_to_constant:
            off = off - off.mean()
        return float(np.sqrt(np.mean(off**2)) / np.ptp(u)), float(np.abs(off).max() / np.ptp(u))


def _waves(fast: float, dim: int) -> Waves:
    return Waves((1.0, 0.5), ((fast, 0.4, -0.7)[:dim], (-0.5, 0.8 * fast, 1.1)[:dim]), (0.3, 1.0))


def _conditions(shape: Shape, spacing: float) -> dict[str, tuple[Curve | Pin, ...]]:
    if shape.manifold_dim == 1:
        return {"points": (Pin(3, "dirichlet"), Pin(4, "dirichlet" if shape.dim == 3 else "robin"))}
    return {
        "a curve with values": (Curve(0.25, "dirichlet"),),
        "a curve with fluxes": (Curve(0.1, "robin,neumann"),),
        "ends inside, u smooth": (Curve(0.2, "dirichlet", (-0.4, 0.7)),),
        "close curves": (Curve(0.2, "dirichlet"), Curve(0.2 + 0.05 * spacing, "dirichlet")),
    }


def _problem(
    name: str, group: str, shape: Shape, kind: str, spacing: float, fast: float, equation: str, **other: Any
) -> ExactProblem:
    place = Place(TURNED if shape.dim == 3 else TURNED[:1], (0.3, -0.2, 0.7)[: shape.dim])
    materials = Waves((0.8,), ((0.7, 0.9, -0.5)[: shape.dim],), (0.3,), 2.0)
    terms = {"screened": {"c": 1.0}, "elliptic": {"c": 1.0, "diffusivity": materials}}.get(equation, {})
    edge = "dirichlet" if equation == "poisson" else "neumann"
    case = Case(
        shape, kind, place, equation, "exact", _waves(fast, shape.dim), spacing, terms, edge=edge, **other
    )  # fmt: skip

    def make() -> tuple[ck.Scene, Any, Any]:
        x = shape.points(1500, np.random.default_rng(0))
        u = case.exact(x, STEP * STEPS if equation == "heat" else None)
        return case.scene(), place.world(x), u

    return ExactProblem(f"{name}, {group}", group, spacing, make)


def exact_problems() -> Iterator[ExactProblem]:
    """Yield all problems."""
    for name, (shape, kind, spacing) in SHAPES.items():
        for fast, group in ((SLOW, "a slow wave"), (FAST, "a fast wave")):
            yield _problem(name, group, shape, kind, spacing, fast, "screened")
        yield _problem(name, "materials", shape, kind, 0.8 * spacing, 2.2, "elliptic")
        yield _problem(name, "no reaction", shape, kind, 0.7 * spacing, 2.6, "poisson")
        for number, (group, inside) in enumerate(_conditions(shape, spacing).items()):
            finer = spacing * (0.75 + 0.1 * number)
            yield _problem(name, group, shape, kind, finer, 2.4, "screened", inside=inside)
    for name in ("sphere", "circle"):
        shape, kind, spacing = SHAPES[name]
        yield _problem(name, "heat", shape, kind, spacing, 2.0, "heat")
    yield from _singular()


def _singular() -> Iterator[ExactProblem]:
    """Yield problems with u as the square root of the distance from an end: slits of a plate, arcs of a sphere."""
    group, on = "ends inside, u singular", on_sphere(np.random.default_rng(0), 1500)

    def made(of: Callable[[str], Any], kind: str, points: Any) -> tuple[ck.Scene, Any, Any]:
        scene, value = of(kind)
        return scene, points, value(points)

    for kind in ("flux", "value"):
        for spacing in (0.2, 0.11, 0.07):
            make = partial(made, slit, kind, POINTS)
            yield ExactProblem(f"slit, {kind}, {spacing}", group, spacing, make)
        for spacing in (0.2, 0.12):
            make = partial(made, arc_scene, kind, on)
            yield ExactProblem(f"arc, {kind}, {spacing}", group, spacing, make)
