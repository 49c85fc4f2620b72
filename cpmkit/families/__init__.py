"""Solvers of the families of equations (steady, in time, eigenvalue, coupled, biharmonic) for any form."""
