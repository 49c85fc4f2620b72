"""The largest eigenvalue of D^-1 A, by Lanczos' method."""

from __future__ import annotations

import numpy as np

from cpmkit.linear.multigrid_exact import Indefinite
from cpmkit.linear.multigrid_matrix import UnsignedCsr
from cpmkit.linear.multigrid_symmetric import SymmetricCsr
from cpmkit.protocols import Floats

#: Relative residual of the eigenvector at which the iteration stops: the eigenvalue is then right to 1e-2, measured on
#: matrices with conditions and without, three hundredths at most.
LANCZOS_RESIDUAL = 3e-2
#: Products with A at most; 8 to 12 are usual.
LANCZOS_STEPS = 50


def largest_eigenvalue(matrix: UnsignedCsr | SymmetricCsr, inverse: Floats, waves: bool = False) -> float:
    """Return the largest eigenvalue of ``D^-1 A`` on the unknowns where ``inverse`` (n,), which is D^-1, is not zero.

    It is met from below, to about a hundredth.

    Raises
    ------
    Indefinite
        If an eigenvalue below zero shows, and there are to be no ``waves``.
    """
    root = np.sqrt(inverse)[:, None]
    v = np.random.default_rng(0).standard_normal(root.shape) * (root > 0)
    before, beta = np.zeros_like(v), _dot(v, v) ** 0.5
    diagonal: list[float] = []
    beside: list[float] = []
    while beta > 0 and len(diagonal) < LANCZOS_STEPS:
        v *= 1 / beta
        before *= -beta
        w = matrix.apply(root * v)
        w *= root
        w += before  # zero at first
        diagonal.append(_dot(v, w))
        w -= diagonal[-1] * v
        before, v, beta = v, w, _dot(w, w) ** 0.5
        values, vectors = np.linalg.eigh(np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1))
        beside.append(beta)
        if beta * abs(vectors[-1, -1]) <= LANCZOS_RESIDUAL * values[-1]:
            break
    if diagonal and not waves and not values[0] > -LANCZOS_RESIDUAL * abs(values[-1]):
        raise Indefinite("it has eigenvalues of the wrong sign")
    return float(values[-1]) if diagonal else 1.0


def _dot(a: Floats, b: Floats) -> float:
    return float(np.einsum("nc,nc->", a, b))  # on this thread; BLAS would wake others, which then wait for more
