"""The modes that are asked for, out of more that were solved for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.families.eigen.multiplets import CUT, cut_multiplet
from cpmkit.scene.compound_equations import Eigen
from cpmkit.scene.scene import Scene
from cpmkit.solution.modes import EigenRecord


def fewer_modes(solution: EigenRecord, scene: Scene) -> EigenRecord:
    """Return a solution of the same scene with the modes alone that ``scene`` asks for, as if it had been solved."""
    problem, values = scene.problem, solution.eigenvalues
    assert isinstance(problem, Eigen)
    if problem.count >= len(values):
        return solution
    # where no number is given, they were sought from below all of them; about from zero, if none is below it
    below = min(float(values.min()), 0.0)
    about = below if problem.near is None else problem.near
    kept = np.sort(np.argsort(np.abs(values - about), kind="stable")[: problem.count])
    told = [text for text in solution.warnings if CUT not in text]
    return replace(
        solution,
        discretized=solution.discretized.with_scene(scene),
        values=np.ascontiguousarray(solution.values[:, kept]),
        eigenvalues=values[kept],
        imaginary=solution.imaginary[kept],
        residuals=solution.residuals[kept],
        warnings=(*told, *cut_multiplet(problem, values, below)),
    )
