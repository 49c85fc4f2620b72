"""Warnings about values prescribed at points and on short curves, whose effect depends on the spacing."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from cpmkit.scene.data import evaluate_data, is_zero
from cpmkit.scene.nonlinear_equations import PLaplacian
from cpmkit.scene.scene import Scene
from cpmkit.types import SIDES, Floats


def _valued_boundaries(scene: Scene) -> list[str]:
    """Return the names of the boundaries with a condition on u, such as Dirichlet or Robin, on a side."""
    return [each.name for each in scene.boundaries if any(each.condition(side).law.involves_value for side in SIDES)]


def point_value_warnings(
    scene: Scene, points: Mapping[str, int], samples: tuple[Floats, Floats] | None = None
) -> tuple[str, ...]:
    """Return a warning, in a tuple, if values at points leave u without a limit for small spacings; else ().

    In two dimensions a point has capacity zero for equations of second order: u behaves like the logarithm of the
    distance to the point. A single value is well posed if it fixes the constant up to which u is determined, and the
    total source is zero. Equations of fourth order, and the p-Laplacian for p > 2, have limits.

    ``points`` maps the name of each boundary without sides to its number of points, 2 for two or more. ``samples`` are
    quadrature points (n, d) of the manifold and their weights (n,), for the integral of f; without them a function f
    counts as one of integral zero.
    """
    valued = _valued_boundaries(scene)
    pins = [name for name in valued if name in points]
    problem, terms = scene.problem, scene.problem.terms()
    if not pins or problem.family == "biharmonic" or (isinstance(problem, PLaplacian) and problem.p > 2):
        return ()
    others = len(valued) > len(pins) or any(condition.law.involves_value for condition in scene.edge_conditions)
    is_single = sum(points[name] for name in pins) == 1 and not others
    if is_single and problem.family not in ("time", "eigen") and not (callable(terms.c) or terms.c != 0):
        if samples is None:  # the mean of a function is not known
            balanced = callable(terms.f) or is_zero(terms.f)
        else:
            f = evaluate_data(terms.f, samples[0], scene.channels, "f")
            total, size = samples[1] @ f, samples[1] @ np.abs(f)
            balanced = bool((np.abs(total) <= 0.01 * size).all())
        if balanced:
            return ()
    return (
        f"Boundary {', '.join(map(repr, pins))}: a point of a surface, or a point or curve of a solid, is too small "
        "for the equation to feel a value there; what comes out depends on the spacing, as with a hole of a third of "
        "it; use a small circle or a thin tube instead.",
    )


def short_curve_warnings(scene: Scene, sizes: Mapping[str, float], spacing: float, least: float) -> tuple[str, ...]:
    """Return a warning, in a tuple, if values are prescribed on curves of a surface smaller than ``least``; else ().

    Such a curve acts as a hole of size ``least``, the smallest that the lattice's ``spacing`` resolves. Equations of
    fourth order have no such effect and no warning. ``sizes`` maps the name of each boundary that is a curve to the
    diagonal of its bounds. Lengths are in the scene's unit.
    """
    if scene.surface.manifold_dim != 2:
        return ()
    short = {name: sizes[name] for name in _valued_boundaries(scene) if sizes.get(name, least) < least}
    if not short or scene.problem.family == "biharmonic":  # equations of fourth order: values at points have an effect
        return ()
    return (
        f"Boundary {', '.join(map(repr, short))}: at spacing={spacing:g} a curve smaller than {least:.2g} acts as a "
        f"hole of about that size; use spacing={spacing * min(short.values()) / least:.2g} or less.",
    )


def small_boundary_warnings(scene: Scene, cutting: Collection[str], spacing: float, least: float) -> tuple[str, ...]:
    """Return the warnings about values prescribed at points, and on curves of a surface smaller than ``least``.

    ``cutting`` are the names of the boundaries with two sides; other boundaries are points, or curves in a solid. The
    size of a boundary is the diagonal of its bounds; ``least`` is the smallest size that ``spacing`` resolves.
    """
    extents = {each.name: np.ptp(np.asarray(each.source.bounds), axis=0) for each in scene.boundaries}
    sizes = {name: float(np.linalg.norm(extent)) for name, extent in extents.items()}
    points = {name: 2 if size else 1 for name, size in sizes.items() if name not in cutting}
    curves = {name: size for name, size in sizes.items() if name in cutting}
    return (*point_value_warnings(scene, points), *short_curve_warnings(scene, curves, spacing, least))
