"""On the way to a tolerance, a time or a memory a solve that fails loses nothing of what was found before."""

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
    assert found.trade.status == "not reached"
    assert found.spacing == spacings[-1]
    assert found.trade.error == found.error.of("rms")
    points = CIRCLE.mesh(0.1)[0]
    assert np.abs(found.evaluate(points) - points[:, 0]).max() < 4 * found.error.error[0]


def test_a_first_solution_alone_is_returned_though_its_error_is_not_known():
    recipe, spacings = refused_from(1, ck.SceneError("no more."))
    with pytest.warns(ck.CpmkitWarning, match="seconds=100 not reached: root mean square not known .*no more"):
        found = ck.solve_by(recipe, SCENE, seconds=100.0)
    assert found.spacing == spacings[0]
    assert np.isnan(found.trade.error)


def test_where_nothing_is_found_the_first_reason_is_the_error_and_speaks_of_what_was_asked():
    def recipe(spacing, origin):
        raise ck.ResolutionError(f"spacing={spacing:.3g} is no good; use less.")

    with pytest.raises(
        ck.ResolutionError, match=r"^tolerance=0.001 was asked for, and .* tried, from (\S+) to .*=\1 is"
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
    assert len(solved) > 3
    assert found.spacing == solved[2].spacing
