"""Linear operators and solvers, independent of equations and forms."""
