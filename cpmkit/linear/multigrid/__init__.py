"""Multigrid: cycles over the levels of a form, their smoothers, and Krylov solvers that they precondition."""
