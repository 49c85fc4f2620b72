"""Scenes at random: ``scene_case(seed)`` is a source, an equation, conditions, options and the law that it is held to.

Left out are creases that are not right angles, junctions, folds, slots and necks below some spacings: their errors fall
with order 1, as docs/explanation/resolves.md says. Layers that are narrower than a spacing are in envelope.py.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from extremes.ambient import BoxModes, Linear, Place, Waves
from extremes.cases import Case, Curve, Pin
from extremes.shapes import Arc, Box, Cap, Cylinder, Helix, PlaneCurve, Plate, Shape, Spheroid, Torus

#: Laws and how often each is taken.
LAW_SHARES = {
    "exact": 0.52,
    "pair": 0.14,
    "constant": 0.04,
    "shift": 0.04,
    "superposition": 0.04,
    "reciprocity": 0.05,
    "total": 0.04,
    "maximum": 0.06,
    "eigenvalues": 0.07,
}
#: Laws of integrals, which need a surface with a mesh.
INTEGRALS = ("reciprocity", "total")
#: Gaps of curves that nearly coincide, in spacings.
GAPS = (1e-5, 1e-3, 1e-2, 0.1, 0.5, 2.0)
#: Bytes to which a tolerance is sought where curves are far shorter than the spacing.
MOST_BYTES = 2**29


def scene_case(seed: int) -> Case:
    """Return the case of a seed."""
    rng = np.random.default_rng(seed)
    law = str(rng.choice(list(LAW_SHARES), p=list(LAW_SHARES.values())))
    shape = _shape(rng, law)
    kinds = [kind for kind in shape.kinds if law not in INTEGRALS or kind.split()[0] not in ("bare", "cloud")]
    kind = str(rng.choice(kinds))
    place = _place(rng, shape.dim)
    spacing = _spacing(rng, shape)
    equation, terms = _equation(rng, law, shape)
    options = _options(rng, shape, equation, law)
    if "tensor" in terms and (options.get("form") == "collocation" or options.get("degree", 0) > 3):
        options = {}
    inside = _inside(rng, law, shape, kind, equation, terms, spacing)
    step = 1.5 if _may_jump(shape, inside, equation, law) and rng.random() < 0.4 else 0.0
    if equation in ("poisson", "laplace") and law != "exact" and shape.closed and not inside:
        inside = (_pin_or_curve(rng, shape, "dirichlet", spacing),)
    if "tolerance" in options and any(_is_short(one, spacing) for one in inside):
        options = {**options, "memory": MOST_BYTES}  # errors fall like one over a logarithm down to their length
    case = Case(
        shape, kind, place, equation, law, _waves(rng, law, shape, equation), spacing, terms, inside,
        _edge(rng, law, equation, terms), step, _twin(rng, law, shape, inside), _origin(rng, shape.dim), options,
    )  # fmt: skip
    return case if law != "pair" else _with_other(case, rng)


def _is_short(one: Curve | Pin, spacing: float) -> bool:
    return isinstance(one, Curve) and one.span is not None and one.span[1] - one.span[0] < 0.5 * spacing


def _shape(rng: Any, law: str) -> Shape:
    if law == "eigenvalues":
        shapes = [
            Spheroid(),
            Cylinder(float(rng.choice([1.0, 2.0]))),
            Plate(),
            PlaneCurve(),
            Arc(start=0.3, end=float(rng.uniform(1, 5))),
        ]
        return shapes[rng.integers(len(shapes))]
    number = rng.integers(0, 14)
    if number < 3:
        return Spheroid(float(rng.choice([1.0, 1.0, 0.5, 2.0])))
    if number < 5:
        return Torus(float(rng.choice([0.3, 0.4, 0.5])))
    if number < 10:
        return (Cylinder(2.0), Cap(float(rng.choice([-0.5, 0.0, 0.4]))), Plate(), Plate(), Box())[number - 5]
    return (
        PlaneCurve(),
        PlaneCurve(float(rng.choice([0.5, 1.7]))),
        Arc(start=0.3, end=float(rng.uniform(1.0, 6.0))),
        Helix(),
    )[number - 10]


def _place(rng: Any, dim: int) -> Place:
    """Return an axis-aligned, a symmetric or a random place, of scale one or any other."""
    way, axes = rng.integers(3), 3 if dim == 3 else 1
    turn = {0: np.zeros(axes), 1: np.pi / 4 * rng.integers(0, 3, axes), 2: rng.uniform(-2, 2, axes)}[int(way)]
    move = {0: np.zeros(dim), 1: rng.integers(-2, 3, dim) / 2, 2: rng.uniform(-3, 3, dim)}[int(way)]
    scale = 1.0 if rng.random() < 0.75 else float(10 ** rng.uniform(-4, 4))
    return Place(tuple(turn.tolist()), tuple((scale * move).tolist()), scale)


def _spacing(rng: Any, shape: Shape) -> float:
    coarse = 0.14 if shape.manifold_dim == 1 else 0.26
    coarse *= min(1.0, 1.6 * getattr(shape, "minor", 1.0), 1.4 * getattr(shape, "height", 1.0))
    spacing = float(coarse * rng.uniform(0.5, 1.0))
    return [spacing, 1 / round(1 / spacing), 1 / (round(1 / spacing) + 0.5), round(spacing, 2)][rng.integers(4)]


def _equation(rng: Any, law: str, shape: Shape) -> tuple[str, dict[str, Any]]:
    """Return an equation and its terms."""
    if law == "total":
        return "heat", {}
    if law == "maximum":
        return "laplace", {}
    if law == "eigenvalues":
        return "eigen", _spectrum(shape)
    if law in ("reciprocity", "constant"):
        return "screened", {"c": float(rng.choice([0.5, 4.0]))}
    if isinstance(shape, Box):
        return "screened", {"c": 1.0}
    names = ["screened", "poisson", "elliptic", "elliptic", "helmholtz", "heat", "reaction", "biharmonic"]
    if law != "exact":
        names = ["screened", "poisson", "elliptic"]
    name = str(rng.choice(names))
    if name == "screened":
        return name, {"c": float(rng.choice([0.1, 1.0, 20.0]))}
    if name == "helmholtz":
        return name, {"wavenumber": float(rng.uniform(0.5, 4.0))}
    if name == "biharmonic":
        if not shape.closed or getattr(shape, "height", 0.0) != 1.0:
            return "screened", {"c": 2.0}
        return name, {"c": 1.0, "eigenvalue": 2.0 if shape.manifold_dim == 2 else 1.0}
    if name != "elliptic":
        return name, {}
    terms: dict[str, Any] = {"c": 1.0}
    way = rng.integers(3)
    if way == 0:
        wave = tuple(rng.uniform(-2, 2, shape.dim).tolist())
        terms["diffusivity"] = Waves((float(rng.choice([0.5, 1.8])),), (wave,), (0.3,), 2.0)
    elif way == 1 and not isinstance(shape, Helix):
        turn = np.linalg.qr(rng.normal(size=(shape.dim, shape.dim)))[0]
        tensor = turn @ np.diag(rng.choice([1.0, 3.0, 10.0], shape.dim)) @ turn.T
        terms["tensor"] = tuple(tuple(row) for row in (0.5 * (tensor + tensor.T)).tolist())
    else:
        terms["velocity"] = tuple((float(rng.choice([1.0, 10.0])) * rng.normal(size=shape.dim)).tolist())
    return name, terms


def _spectrum(shape: Shape) -> dict[str, Any]:
    """Return how many eigenvalues are sought, and those that are known, with natural rims."""
    k = np.arange(8)
    if isinstance(shape, PlaneCurve):
        known = (k * np.pi / (shape.end - shape.start)) ** 2 if isinstance(shape, Arc) else np.repeat(k, 2)[1:] ** 2.0
    elif isinstance(shape, Cylinder):
        known = ((k[:, None] * np.pi / shape.length) ** 2 + np.repeat(k, 2)[1:] ** 2).ravel()
    elif isinstance(shape, Plate):
        known = (np.pi / 2) ** 2 * (k[:, None] ** 2 + k**2).ravel()
    else:
        known = np.repeat(k * (k + 1), 2 * k + 1)
    return {"count": 6, "known": tuple(np.sort(known)[:4].astype(float).tolist())}


def _waves(rng: Any, law: str, shape: Shape, equation: str) -> Any:
    """Return u, or the load."""
    if law == "constant":
        return Waves((0.0,), ((0.0,) * shape.dim,), (0.0,), float(rng.choice([1.0, -3.0, 250.0])))
    if isinstance(shape, Box):
        return BoxModes(float(rng.uniform(0.5, 2.0)))
    if equation == "biharmonic":
        return Linear(tuple(rng.uniform(-1, 1, shape.dim).tolist()))
    count = int(rng.integers(1, 3))
    fast = 3.0 if shape.manifold_dim == 2 else 4.0
    waves = tuple(tuple(row) for row in rng.uniform(-fast, fast, (count, shape.dim)).tolist())
    offset = float(rng.choice([0.0, 0.0, 1.0, 30.0]))
    if law == "maximum" or (equation == "reaction" and offset > 1):  # u^3 of 30 is faster than a step
        offset = 0.0
    return Waves(
        tuple((rng.uniform(0.4, 1.0, count) / count).tolist()), waves, tuple(rng.uniform(0, 6, count).tolist()), offset
    )


def _edge(rng: Any, law: str, equation: str, terms: dict[str, Any]) -> str:
    if law in ("total", "eigenvalues"):
        return "natural"
    if law == "reciprocity":
        return str(rng.choice(["natural", "zero"]))
    if law == "maximum" or "tensor" in terms or "velocity" in terms or equation == "poisson":
        return "dirichlet"
    return str(rng.choice(["dirichlet", "neumann", "robin"]))


def _inside(
    rng: Any, law: str, shape: Shape, kind: str, equation: str, terms: dict[str, Any], spacing: float
) -> tuple[Curve | Pin, ...]:
    """Return curves and points inside, none in half of all cases."""
    if (
        law in ("eigenvalues", "reciprocity", "superposition", "total")
        or isinstance(shape, Box)
        or equation == "biharmonic"
    ):
        return ()
    if law != "maximum" and rng.random() < 0.45:
        return ()
    names = ["dirichlet", "dirichlet", "neumann", "robin", "transmission", "dirichlet,neumann", "robin,dirichlet"]
    if (
        law == "maximum"
        or "tensor" in terms
        or "velocity" in terms
        or equation == "poisson"
        or isinstance(shape, Helix)
    ):
        names = ["dirichlet"]
    if equation in ("heat", "reaction"):
        names = ["dirichlet", "neumann"]
    first = _pin_or_curve(rng, shape, str(rng.choice(names)), spacing)
    if isinstance(first, Pin) or first.span is not None or rng.random() < 0.6:
        return (first,)
    gap = float(rng.choice(GAPS)) * spacing
    at = first.at + gap / (np.pi * shape.minor if isinstance(shape, Torus) else 1.0)
    return (first, Curve(at, str(rng.choice(names)) if "transmission" not in first.condition else "dirichlet"))


def _pin_or_curve(rng: Any, shape: Shape, condition: str, spacing: float) -> Curve | Pin:
    if shape.manifold_dim == 1 or (condition == "dirichlet" and rng.random() < 0.15):
        return Pin(int(rng.integers(1000)), condition)
    at = float(rng.choice([0.0, 0.25, rng.uniform(-0.6, 0.6)]))
    if rng.random() < 0.6:
        return Curve(at, condition)
    start = float(rng.uniform(-0.9, 0.3))
    length = float(rng.choice([0.1 * spacing, spacing, 4 * spacing, 0.6]))
    return Curve(at, condition, (start, start + length))


def _may_jump(shape: Shape, inside: tuple[Curve | Pin, ...], equation: str, law: str) -> bool:
    """Return whether u may be larger on the left of the first curve, which parts the shape in two."""
    whole = len(inside) == 1 and isinstance(inside[0], Curve) and inside[0].span is None
    plain = equation in ("screened", "elliptic", "helmholtz") and law == "exact"
    return (
        whole
        and plain
        and isinstance(shape, Spheroid | Cylinder | Plate)
        and inside[0].condition in ("dirichlet", "robin", "transmission")
    )


def _twin(rng: Any, law: str, shape: Shape, inside: Any) -> tuple[float, ...] | None:
    if law != "exact" or inside or not shape.closed or rng.random() > 0.12:
        return None
    away = 2 * max(1.0, getattr(shape, "height", 1.0), 1 + getattr(shape, "minor", 0.0))
    return (away + float(rng.choice([0.2, 0.5, 2.0])), *(0.0,) * (shape.dim - 1))


def _origin(rng: Any, dim: int) -> tuple[float, ...] | None:
    way = rng.random()
    if way < 0.6:
        return None
    return (0.0,) * dim if way < 0.75 else tuple(rng.uniform(0, 0.2, dim).tolist())


def _options(rng: Any, shape: Shape, equation: str, law: str) -> dict[str, Any]:
    """Return options of a form, none in half of all cases."""
    if law in ("superposition", "reciprocity"):
        return {"form": "galerkin"}
    if rng.random() < 0.5:
        return {}
    plain = equation in ("screened", "poisson", "laplace", "elliptic")
    ways: list[dict[str, Any]] = [
        {"degree": 1}, {"degree": 3}, {"solver": "direct"}, {"stabilisation": "accurate"}, {"samples": "plain"},
        {"estimate": "tight"}, {"form": "collocation"}, {"form": "collocation", "degree": 2},
        {"form": "collocation", "order": 1}, {"form": "collocation", "degree": 4},
    ]  # fmt: skip
    if plain:
        ways += [{"tolerance": 0.01}, {"tolerance": 0.003}, {"solver": "multigrid", "form": "galerkin"}]
        if shape.manifold_dim == 2:
            ways += [{"refine": "auto"}, {"tips": "singular"}]
    return ways[rng.integers(len(ways))]


def _with_other(case: Case, rng: Any) -> Case:
    """Return the case of a law that compares two, with what is other in the second."""
    ways: list[dict[str, Any]] = [
        {"place": _place(rng, case.shape.dim)},
        {"origin": tuple(rng.uniform(0, 0.3, case.shape.dim).tolist())},
    ]
    ways += [{"kind": str(rng.choice(case.shape.kinds))}, {"spacing": 0.8 * case.spacing}]
    if case.options == {}:
        ways += [{"options": {"form": "collocation"}}] * ("tensor" not in case.terms)
    return replace(case, other=ways[rng.integers(len(ways))])
