"""Values on what is too small for a spacing, or for the equation: points of a surface, and short curves."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from cpmkit.protocols import SIDES, Floats
from cpmkit.scene.compound_equations import Biharmonic, Eigen
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.equations_in_time import Evolution
from cpmkit.scene.laws import Mixed, Value
from cpmkit.scene.nonlinear_equations import PLaplacian
from cpmkit.scene.scene import Scene

#: A source whose integral is a smaller share of that of its size has mean zero: one value fixes the constant then.
ZERO_MEAN_SHARE = 0.01


def has_limit(scene: Scene, points: int, others: bool, samples: tuple[Floats, Floats] | None = None) -> bool:
    """Tell whether values at ``points`` points of a surface have a limit as the spacing goes to zero.

    In two dimensions a point has capacity zero for equations of second order: u near it is like the logarithm of the
    distance. One value alone, where nothing else is given and nothing flows into it, fixes a free constant. Equations
    of fourth order, and the p-Laplacian for p > 2, feel points.

    Parameters
    ----------
    scene : Scene
    points : int
        How many points hold a value.
    others : bool
        Whether anything else holds one.
    samples : (n, d) and (n,) float64, optional
        Points of the manifold and their weights, by which a source is integrated.
    """
    problem = scene.problem
    if isinstance(problem, Biharmonic) or (isinstance(problem, PLaplacian) and problem.p > 2):
        return True
    if points > 1 or others or isinstance(problem, (Evolution, Eigen)):
        return False
    terms = problem.terms()
    if terms.fixes_constant:
        return False
    if samples is None:  # nothing is known of the mean of a function
        return callable(terms.f) or not np.any(np.asarray(terms.f))
    f = evaluate_data(terms.f, samples[0], scene.channels, "f")
    total, size = samples[1] @ f, samples[1] @ np.abs(f)
    return bool((np.abs(total) <= ZERO_MEAN_SHARE * size).all())


def valued_boundaries(scene: Scene) -> list[str]:
    """Return the names of the boundaries that hold a value on a side."""
    return [
        one.name
        for one in scene.boundaries
        if any(isinstance(one.condition(side).law, (Value, Mixed)) for side in SIDES)
    ]


def point_value_warnings(
    scene: Scene, points: Mapping[str, int], samples: tuple[Floats, Floats] | None = None
) -> tuple[str, ...]:
    """Name boundaries that hold values at points, where these have no limit.

    ``points`` are how many points each boundary is that has no sides, two standing for more; ``samples`` as of
    :func:`has_limit`.
    """
    valued = valued_boundaries(scene)
    pins = [name for name in valued if name in points]
    on_rim = any(isinstance(one.law, (Value, Mixed)) for one in scene.edge_conditions)
    count = sum(points[name] for name in pins)
    if not pins or has_limit(scene, count, on_rim or len(valued) > len(pins), samples):
        return ()
    return (
        f"Boundary {', '.join(map(repr, pins))}: a point of a surface, or a point or curve of a solid, is too small "
        "for the equation to feel a value there; what comes out depends on the spacing, as with a hole of a third of "
        "it; use a small circle or a thin tube instead.",
    )


def short_curve_warnings(scene: Scene, sizes: Mapping[str, float], spacing: float, least: float) -> tuple[str, ...]:
    """Name boundaries that hold values and are smaller than ``least``: they act as larger ones.

    ``sizes`` are the diagonals of the bounds of those that are curves: on a surface, for a curve of a curve is none.
    """
    if scene.surface.manifold_dim != 2:
        return ()
    short = {name: sizes[name] for name in valued_boundaries(scene) if sizes.get(name, least) < least}
    if not short or isinstance(scene.problem, Biharmonic):  # which feels points
        return ()
    return (
        f"Boundary {', '.join(map(repr, short))}: at spacing={spacing:g} a curve smaller than {least:.2g} acts as a "
        f"hole of about that size; use spacing={spacing * min(short.values()) / least:.2g} or less.",
    )


def small_boundary_warnings(scene: Scene, cutting: Collection[str], spacing: float, least: float) -> tuple[str, ...]:
    """Name points, and curves on a surface smaller than ``least``, that hold values, by their bounds.

    ``cutting`` are the boundaries that have two sides; others are points, or curves of a solid.
    """
    sizes = {one.name: float(np.linalg.norm(np.ptp(np.asarray(one.source.bounds), axis=0))) for one in scene.boundaries}
    points = {name: 2 if size else 1 for name, size in sizes.items() if name not in cutting}
    curves = {name: size for name, size in sizes.items() if name in cutting}
    return (*point_value_warnings(scene, points), *short_curve_warnings(scene, curves, spacing, least))
