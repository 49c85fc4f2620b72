"""Linear finite elements on a triangulation: a reference that shares nothing with the closest point method."""

from cpmkit_fem import plugin
from cpmkit_fem.backend import fem, solve_fem
from cpmkit_fem.solution import FemSolution, FemWork

__all__ = ["FemSolution", "FemWork", "fem", "plugin", "solve_fem"]
