"""Where a value at one point of a surface has no limit: what comes out depends on the spacing, like its logarithm."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Floats
from cpmkit.scene.compound_equations import Biharmonic, Eigen
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.equations_in_time import Evolution
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
