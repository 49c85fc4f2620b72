"""On the way to a tolerance, a time or a memory a solve that fails loses nothing of what was found before."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import cpmkit as ck

CIRCLE = ck.source("analytic.circle")
SCENE = ck.Scene(CIRCLE, ck.ScreenedPoisson(lambda points: 2 * points[:, 0]))


def refused_from(count, error):
    """Return a recipe whose solves from number ``count`` on raise ``error``, and the spacings that were solved at."""
    spacings = []

    def recipe(spacing, origin):
        if len(spacings) >= count:
            raise error
        spacings.append(spacing)
        return ck.solve(SCENE, spacing, origin=origin)

    return recipe, spacings


@pytest.mark.parametrize("error", [ck.ResolutionError("rounding limits it."), MemoryError()])
@pytest.mark.parametrize("count", [2, 3])
def test_the_best_solution_before_a_refusal_is_returned_with_a_warning(count, error):
    recipe, spacings = refused_from(count, error)
    with pytest.warns(ck.CpmkitWarning, match="not reached: root mean square about .* a further solve was refused: "):
        found = ck.solve_by(recipe, SCENE, tolerance=1e-9)
    assert found.solve_history.status == "not reached"
    assert found.spacing == spacings[-1]
    assert found.solve_history.error == found.error.of("rms")
    points = CIRCLE.mesh(0.1)[0]
    assert np.abs(found.evaluate(points) - points[:, 0]).max() < 4 * found.error.error[0]


def test_a_first_solution_alone_is_returned_though_its_error_is_not_known():
    recipe, spacings = refused_from(1, ck.SceneError("no more."))
    with pytest.warns(ck.CpmkitWarning, match="seconds=100 not reached: root mean square not known .*no more"):
        found = ck.solve_by(recipe, SCENE, seconds=100.0)
    assert found.spacing == spacings[0]
    assert np.isnan(found.solve_history.error)


def test_where_nothing_is_found_the_first_reason_is_the_error_and_speaks_of_what_was_requested():
    def recipe(spacing, origin):
        raise ck.ResolutionError(f"spacing={spacing:.3g} is no good; use less.")

    with pytest.raises(
        ck.ResolutionError, match=r"^tolerance=0.001 cannot be reached: .* tried, from (\S+) to .*=\1 is"
    ):
        ck.solve_by(recipe, SCENE, tolerance=1e-3)


def test_a_reason_that_is_not_the_spacing_stays_as_it_is():
    recipe, _ = refused_from(0, ck.SceneError("Nothing fixes the solution."))
    with pytest.raises(ck.SceneError, match=r"^Nothing fixes the solution\.$"):
        ck.solve_by(recipe, SCENE, tolerance=1e-3)


def test_finer_solutions_that_are_worse_are_not_the_answer():
    noise = np.random.default_rng(0)
    solved = []

    def recipe(spacing, origin):
        solution = ck.solve(SCENE, spacing, origin=origin)
        solved.append(solution)
        if len(solved) <= 3:
            return solution
        return replace(solution, values=solution.values + 1e-3 * noise.normal(size=solution.values.shape))

    with pytest.warns(ck.CpmkitWarning, match="not reached"):
        found = ck.solve_by(recipe, SCENE, tolerance=1e-7)
    assert 3 < len(solved) <= 12
    assert max(solution.work.unknowns for solution in solved) < 150_000
    assert found.spacing == solved[2].spacing


@pytest.mark.parametrize(
    ("options", "most_unknowns"),
    [
        ({"tolerance": 1e-7, "form": "collocation", "solver": "reference", "solver_tolerance": 1e-3}, 5_000),
        pytest.param({"tolerance": 1e-12}, 100_000, marks=pytest.mark.slow),
        pytest.param({"memory": "2 GiB"}, 150_000, marks=pytest.mark.slow),
    ],
    ids=["residuals", "rounding", "rounding, by a memory"],
)
def test_a_search_ends_where_linear_solves_leave_more_than_the_spacing_does(options, most_unknowns):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ck.CpmkitWarning)
        found = ck.solve(SCENE, **options)
    steps = found.solve_history.steps
    assert found.solve_history.status == ("not reached" if "tolerance" in options else "within")
    assert len(steps) <= 10
    assert max(step.unknowns for step in steps) <= most_unknowns
    assert found.solve_history.error == min(step.error for step in steps[1:])
    assert steps[-1].error >= steps[-2].error
    assert found.solve_history.summary.endswith(
        "; smaller spacings gave no less: rounding, noise or the residuals of linear solves leave that much."
    )
