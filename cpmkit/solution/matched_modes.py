"""Modes at a spacing held against those at twice it, by their functions: how large errors of eigenvalues are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.protocols import Floats
from cpmkit.scene.compound_equations import Eigen
from cpmkit.scene.scene import Scene
from cpmkit.solution.modes import EigenSolution

#: At twice the spacing so many more eigenvalues are sought: there modes may come in another order.
FURTHER_MODES = 6
#: A mode is seen at twice the spacing where at least this share of its mean square lies in modes found there.
SEEN_SHARE = 0.5


def with_further_modes(scene: Scene) -> Scene:
    """Return the scene of the coarse solution: with some more modes than are asked for."""
    assert isinstance(scene.problem, Eigen)
    return replace(scene, problem=replace(scene.problem, count=scene.problem.count + FURTHER_MODES))


def compare_modes(fine: EigenSolution, coarse: EigenSolution, points: Floats) -> tuple[Floats, Floats]:
    """Return the differences (count,) of eigenvalues, and of functions (n, count), infinite where one is not seen.

    Each function of the finer solution is a sum of those of the coarser one, as near as may be, which also tells those
    of a multiplet, that are any basis of it; the eigenvalues of those, weighed as in the sum, are what is compared.

    Parameters
    ----------
    fine, coarse : EigenSolution
        At a spacing and at twice it.
    points : (n, d) float64
        Where functions are compared, in the scene's coordinates.
    """
    ours, theirs = (one.evaluate(points).reshape(len(points), -1) for one in (fine, coarse))
    weights = np.linalg.lstsq(theirs, ours, rcond=None)[0]
    apart = np.abs(ours - theirs @ weights)
    seen = 1 - np.mean(apart**2, axis=0) / np.mean(ours**2, axis=0)
    shares = weights**2 / np.sum(weights**2, axis=0)
    differences = np.abs(fine.eigenvalues - coarse.eigenvalues @ shares)
    return np.where(seen >= SEEN_SHARE, differences, np.inf), apart
