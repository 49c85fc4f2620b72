"""Eigenpairs by ARPACK's iterations on steps of inverse iteration: Lanczos' on symmetric problems, or Arnoldi's.

They find the largest eigenvalues theta of ``(A - sigma B)^-1 B``; lambda is ``sigma + 1 / theta``, and what is no
eigenvalue of the manifold, of ghosts, of the stabilisation, of functions that B does not see, has theta near zero.
"""

from __future__ import annotations

import numpy as np

from cpmkit.errors import ConvergenceError
from cpmkit.families.eigen.inverse_iteration import InverseIteration, Pairs
from cpmkit.types import Floats

#: Eigenvalues that differ by less than this share of the tolerance are one.
SAME_EIGENVALUE_TOLERANCES = 0.1


def shift_inverted_pairs(stepped: InverseIteration, wanted: int) -> Pairs:
    """Return so many eigenpairs nearest to the shift.

    Raises
    ------
    ConvergenceError
        If a linear solve or the iteration misses the tolerance.
    """
    from scipy.sparse.linalg import ArpackNoConvergence

    context = stepped.context
    tolerance = SAME_EIGENVALUE_TOLERANCES * context.tolerance
    start = np.random.default_rng(0).normal(size=stepped.operator.size)
    find = _lanczos if stepped.symmetric else _arnoldi
    try:
        return find(stepped, wanted, start, tolerance)
    except ArpackNoConvergence as error:
        reason = f"{find.__name__.strip('_').capitalize()}'s iteration found {len(error.eigenvalues)} of {wanted}"
        remedy = "ask for fewer, or for a larger solver_tolerance"
        report = context.report(False, stepped.solves, stepped.products, np.inf, f"{reason} eigenvalues")
        raise ConvergenceError(f"The eigenvalues did not converge: {reason} eigenvalues; {remedy}.", report) from error


def _arnoldi(stepped: InverseIteration, wanted: int, start: Floats, tolerance: float) -> Pairs:
    from scipy.sparse.linalg import LinearOperator, eigs

    matrix = LinearOperator((len(start), len(start)), matvec=stepped.step, dtype=np.float64)
    theta, vectors = eigs(matrix, wanted, which="LM", v0=start, tol=tolerance)
    return Pairs(stepped.shift + 1 / theta, vectors)


def _lanczos(stepped: InverseIteration, wanted: int, start: Floats, tolerance: float) -> Pairs:
    """Return the pairs in B's inner product; that B is singular does no harm, for steps lie in its range."""
    from scipy.sparse.linalg import LinearOperator, eigsh

    shape = (len(start), len(start))
    inverse = LinearOperator(shape, matvec=stepped.inverted, dtype=np.float64)
    matrix = LinearOperator(shape, matvec=stepped.operator.apply, dtype=np.float64)  # not applied in this mode
    mass = None if stepped.mass is None else LinearOperator(shape, matvec=stepped.mass.apply, dtype=np.float64)
    lam, vectors = eigsh(
        matrix, wanted, mass, sigma=stepped.shift, OPinv=inverse, v0=stepped.step(start), tol=tolerance
    )
    return Pairs(lam, vectors)
