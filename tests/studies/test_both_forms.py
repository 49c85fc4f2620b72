"""Studies of the documentation at coarse spacings: the Galerkin form leaves no more error than the collocation form."""

from pathlib import Path

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.studies.reference_values import compute_reference
from cpmkit.studies.run_one import tie_step_to_spacing
from cpmkit.studies.studyfile import load_study

STUDIES = Path(__file__).parents[2] / "examples" / "studies"
#: Errors that differ by less than a tenth are equal.
WORSE = 1.1


@pytest.mark.filterwarnings("ignore::cpmkit.CpmkitWarning")
@pytest.mark.parametrize(
    ("name", "spacing"),
    [
        ("panel-a-circle-jump", 0.1),
        ("interior-robin-circle", 0.1),
        ("forms-sphere", 0.4),
        ("forms-hemisphere", 0.4),
        ("forms-two-sides", 0.3),
        ("time-heat", 0.4),
    ],
)
def test_no_more_error_is_left(name, spacing):
    study = load_study(STUDIES / f"{name}.toml")
    scene, truth = tie_step_to_spacing(study.scene, study.sweep.step_per_spacing, spacing), compute_reference(study)
    errors = {
        form: [off := ck.solve(scene, spacing, form=form).evaluate(truth.points) - truth.values, np.abs(off).max()]
        for form in ("collocation", "galerkin")
    }
    for measure in (lambda one: np.sqrt(np.mean(one[0] ** 2)), lambda one: one[1]):
        assert measure(errors["galerkin"]) <= WORSE * measure(errors["collocation"])
