"""What a solve costs is foretold from two coarse ones: here in counts, which no clock disturbs."""

from types import SimpleNamespace

import pytest
from click.testing import CliRunner

import cpmkit as ck
from cpmkit.cli import main
from cpmkit.solving import extrapolated_cost

BALL = ck.source("analytic.sphere")
RING = ck.Boundary("ring", ck.source("analytic.circle", normal=[0, 0, 1]), left=ck.Dirichlet(1), right=ck.Dirichlet(0))
F = ck.ScreenedPoisson(lambda x: x[:, 0])


def work(solution):
    """Queries, each of some hundred products of an entry, and products of entries."""
    counted = solution.work.as_dict()
    return 100 * counted["closest_point_queries"] + counted["nonzeros"] * (50 + counted["operator_applications"])


@pytest.mark.parametrize("boundaries", [[], [RING]])
@pytest.mark.parametrize("form", ["galerkin", "collocation"])
def test_the_work_of_a_solve_is_foretold_within_two(boundaries, form):
    scene, spacing = ck.Scene(BALL, F, boundaries), 0.09
    explanation = ck.explain(scene, spacing, form=form, dry_run=True)
    spacings = []

    def solve_coarse(coarse):
        spacings.append(coarse)
        solution = ck.solve(scene, coarse, estimate=False, form=form, solver=explanation.solver)
        return solution, work(solution)

    found = extrapolated_cost(solve_coarse, spacing, explanation.unknowns, 2)
    assert spacings[0] == spacings[1] == 2 * spacings[2]
    assert spacings[2] >= 2 * spacing  # what is asked for is not solved to foretell itself
    assert 0.5 < found / work(ck.solve(scene, spacing, form=form, estimate=False)) < 2


@pytest.mark.parametrize(("costs", "expected"), [((3.0, 5.0), 1.0 + 0.02 * 1000), ((6.0, 5.0), 2.5 + 0.0125 * 1000)])
def test_a_line_goes_through_both_and_never_below_half_a_share(costs, expected):
    solves = iter([(100, 0.0), (100, costs[0]), (200, costs[1])])

    def solve_coarse(_):
        size, cost = next(solves)
        return SimpleNamespace(discretized=SimpleNamespace(size=size)), cost

    assert extrapolated_cost(solve_coarse, 0.01, 1000, 2) == pytest.approx(expected)


def test_seconds_are_reported_where_they_are_requested(tmp_path):
    scene = ck.Scene(BALL, F)
    assert ck.explain(scene, 0.1, dry_run=True).seconds is None
    explanation = ck.explain(scene, 0.1, seconds=True)
    assert explanation.seconds > 0
    assert "seconds on this machine about" in str(explanation)
    assert ck.explain(scene, 0.4, seconds=True).seconds is None  # too coarse to be timed
    (tmp_path / "ball.toml").write_text('[surface]\nkind = "analytic.sphere"\n[problem]\nkind = "screened"\nf = "x"\n')
    done = CliRunner().invoke(main, ["explain", str(tmp_path / "ball.toml"), "--spacing", "0.1", "--seconds"])
    assert "seconds on this machine about" in done.output
