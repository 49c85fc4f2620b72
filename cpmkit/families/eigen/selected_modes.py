"""Selection of the modes that a problem requests among the modes that were computed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.scene.compound_equations import Eigen
from cpmkit.scene.scene import Scene
from cpmkit.solution.modes import EigenRecord
from cpmkit.types import Floats

#: Eigenvalues that differ by at most this share of their distance from the shift may be one multiple eigenvalue.
ONE_EIGENVALUE_SHARE = 1e-3
#: The words by which a warning of :func:`split_multiplet_warning` is recognised.
SPLIT_MULTIPLET = "ends inside a multiplet"


def split_multiplet_warning(problem: Eigen, values: Floats, shift: float) -> list[str]:
    """Return a warning in a list if an eigenvalue that is left out is nearly equal to a returned one; else [].

    Parameters
    ----------
    problem : Eigen
        The problem, with the number of eigenvalues and the number near which they are sought.
    values : (k,) float64
        More eigenvalues than are requested, in any order.
    shift : float
        The shift, from which distances are measured.
    """
    about = shift if problem.near is None else problem.near
    ordered = values[np.argsort(np.abs(values - about), kind="stable")]
    returned, others = ordered[: problem.count], ordered[problem.count :]
    gaps = np.abs(others[:, None] - returned).min(axis=1, initial=np.inf)
    equal = others[gaps <= ONE_EIGENVALUE_SHARE * np.abs(others - shift)]
    if not len(equal):
        return []
    complete, many = len(equal) < len(others), len(equal) > 1
    return [
        f"count={problem.count} {SPLIT_MULTIPLET}: {'' if complete else 'at least '}{len(equal)} further eigenvalue"
        f"{'s' if many else ''} near {equal[0]:.6g} {'are' if many else 'is'} left out, and which functions of the "
        f"multiplet are returned is arbitrary; use count={problem.count + len(equal)}{'' if complete else ' or more'}."
    ]


def fewer_modes(solution: EigenRecord, scene: Scene) -> EigenRecord:
    """Return the solution with only the modes that ``scene`` requests, as if that scene had been solved."""
    problem, values = scene.problem, solution.eigenvalues
    assert isinstance(problem, Eigen)
    if problem.count >= len(values):
        return solution
    # without a number they were sought from below the spectrum: from about zero, if no eigenvalue is negative
    below = min(float(values.min()), 0.0)
    about = below if problem.near is None else problem.near
    chosen = np.sort(np.argsort(np.abs(values - about), kind="stable")[: problem.count])
    warnings = [text for text in solution.warnings if SPLIT_MULTIPLET not in text]
    return replace(
        solution,
        discretized=solution.discretized.with_scene(scene),
        values=np.ascontiguousarray(solution.values[:, chosen]),
        eigenvalues=values[chosen],
        imaginary=solution.imaginary[chosen],
        residuals=solution.residuals[chosen],
        warnings=(*warnings, *split_multiplet_warning(problem, values, below)),
    )
