"""Linear operators and solvers, which know no equation."""
