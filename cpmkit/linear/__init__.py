"""Linear operators and solvers; they know no equation and no form."""
