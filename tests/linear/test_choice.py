"""Without a name, the quicker solver is taken; a multigrid only where a form has levels for it."""

from cpmkit.linear.multigrid.solver import MultigridSolver
from cpmkit.linear.solver_options import choose_solver, make_solver


def test_what_is_quicker_is_taken():
    assert choose_solver("auto", 100_000, 2) == "reference"
    assert choose_solver("auto", 100_000, 2, iterative="multigrid") == "multigrid"
    assert choose_solver("auto", 100_000, 1, iterative="multigrid") == "direct"
    assert choose_solver("auto", 500, 2) == choose_solver("auto", 5_000, 2, 4.0, iterative="multigrid") == "direct"
    assert choose_solver("auto", 5_000, 2, iterative="multigrid") == "multigrid"
    assert choose_solver("auto", 100_000, 2, iterative="direct") == "direct"
    assert choose_solver("reference", 5_000, 2, iterative="multigrid") == "reference"


def test_a_multigrid_takes_its_most_iterations():
    assert make_solver("multigrid", {"max_iterations": 7}) == MultigridSolver(7)
