"""What the runs of a study are measured against: a formula, or the solution of another back end, at points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.protocols import Floats
from cpmkit.runtime.messages import collected_warnings
from cpmkit.scene.data import evaluate_data
from cpmkit.solving import for_any_backend, solve
from cpmkit.studies.checking import check_comparable, end_of
from cpmkit.studies.sampling import sample_points
from cpmkit.studies.studyfile import Study


@dataclass(frozen=True, eq=False)
class Truth:
    """What every run should give.

    Attributes
    ----------
    points : (n, d) float64
        Of the surface, none on a boundary.
    values : (n,) float64
        The solution there, at the end of the time where there is one.
    """

    points: Floats
    values: Floats

    @property
    def half_range(self) -> float:
        """Half the difference between the largest and the smallest value."""
        return float(np.ptp(self.values) / 2)


def truth_of(study: Study) -> Truth:
    """Return what a study's runs are measured against; a reference is solved, once, at its own resolution.

    Raises
    ------
    SceneError
        If the scene has several channels or seeks eigenvalues, or vertices are of a surface that is no mesh.
    CpmkitError
        If the formula has no value somewhere, or the reference cannot solve the scene.
    """
    scene = study.scene
    check_comparable(scene)
    points = sample_points(scene, study.exact.points)
    if not len(points):
        raise SceneError(
            f"none of the points of [exact], {study.exact.points!r}, lies off the boundaries; ask for more."
        )
    if study.solution is not None:
        return Truth(points, evaluate_data(study.solution, points, 1, "u of [exact]", end_of(scene))[:, 0])
    assert study.exact.reference is not None
    with collected_warnings():
        solution = solve(scene, backend=study.exact.reference, **for_any_backend(study.options))
    return Truth(points, solution.evaluate(points))
