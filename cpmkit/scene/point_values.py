"""Warnings of values on boundaries that are too small for the equation or the spacing: points and short curves."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from cpmkit.scene.data import evaluate_data
from cpmkit.scene.nonlinear_equations import PLaplacian
from cpmkit.scene.scene import Scene
from cpmkit.types import SIDES, Floats

#: A source has mean zero if its integral is a smaller share of the integral of its absolute value.
ZERO_MEAN_SHARE = 0.01


def has_limit(scene: Scene, points: int, others: bool, samples: tuple[Floats, Floats] | None = None) -> bool:
    """Return True if the solution with values at points of a surface has a limit as the spacing goes to zero.

    In two dimensions a point has capacity zero for equations of second order: u behaves like the logarithm of the
    distance to it. A single value is well posed where it fixes a free constant and nothing flows into it. Equations of
    fourth order, and the p-Laplacian for p > 2, have limits.

    Parameters
    ----------
    scene : Scene
    points : int
        Number of points with a value.
    others : bool
        Whether another boundary has a value.
    samples : (n, d) and (n,) float64, optional
        Quadrature points of the manifold and their weights, for the integral of a source.
    """
    problem = scene.problem
    if problem.family == "biharmonic" or (isinstance(problem, PLaplacian) and problem.p > 2):
        return True
    if points > 1 or others or problem.family in ("time", "eigen"):
        return False
    terms = problem.terms()
    if terms.fixes_constant:
        return False
    if samples is None:  # the mean of a function is not known
        return callable(terms.f) or not np.any(np.asarray(terms.f))
    f = evaluate_data(terms.f, samples[0], scene.channels, "f")
    total, size = samples[1] @ f, samples[1] @ np.abs(f)
    return bool((np.abs(total) <= ZERO_MEAN_SHARE * size).all())


def valued_boundaries(scene: Scene) -> list[str]:
    """Return the names of the boundaries with a Dirichlet or Robin condition on a side."""
    return [
        boundary.name
        for boundary in scene.boundaries
        if any(boundary.condition(side).law.involves_value for side in SIDES)
    ]


def point_value_warnings(
    scene: Scene, points: Mapping[str, int], samples: tuple[Floats, Floats] | None = None
) -> tuple[str, ...]:
    """Return a warning of values at points that have no limit as the spacing goes to zero.

    ``points`` are the numbers of points of the boundaries without sides, 2 for two or more; ``samples`` as for
    :func:`has_limit`.
    """
    valued = valued_boundaries(scene)
    pins = [name for name in valued if name in points]
    on_rim = any(condition.law.involves_value for condition in scene.edge_conditions)
    count = sum(points[name] for name in pins)
    if not pins or has_limit(scene, count, on_rim or len(valued) > len(pins), samples):
        return ()
    return (
        f"Boundary {', '.join(map(repr, pins))}: a point of a surface, or a point or curve of a solid, is too small "
        "for the equation to feel a value there; what comes out depends on the spacing, as with a hole of a third of "
        "it; use a small circle or a thin tube instead.",
    )


def short_curve_warnings(scene: Scene, sizes: Mapping[str, float], spacing: float, least: float) -> tuple[str, ...]:
    """Return a warning of curves with values on a surface that are smaller than ``least``: they act as larger ones.

    ``sizes`` are the diagonals of the bounds of the boundaries that are curves.
    """
    if scene.surface.manifold_dim != 2:
        return ()
    short = {name: sizes[name] for name in valued_boundaries(scene) if sizes.get(name, least) < least}
    if not short or scene.problem.family == "biharmonic":  # of fourth order: points have an effect
        return ()
    return (
        f"Boundary {', '.join(map(repr, short))}: at spacing={spacing:g} a curve smaller than {least:.2g} acts as a "
        f"hole of about that size; use spacing={spacing * min(short.values()) / least:.2g} or less.",
    )


def small_boundary_warnings(scene: Scene, cutting: Collection[str], spacing: float, least: float) -> tuple[str, ...]:
    """Return the warnings of points, and of curves on a surface smaller than ``least``, with values.

    ``cutting`` are the boundaries with two sides; others are points, or curves in a solid. Sizes are those of bounds.
    """
    extents = {each.name: np.ptp(np.asarray(each.source.bounds), axis=0) for each in scene.boundaries}
    sizes = {name: float(np.linalg.norm(extent)) for name, extent in extents.items()}
    points = {name: 2 if size else 1 for name, size in sizes.items() if name not in cutting}
    curves = {name: size for name, size in sizes.items() if name in cutting}
    return (*point_value_warnings(scene, points), *short_curve_warnings(scene, curves, spacing, least))
