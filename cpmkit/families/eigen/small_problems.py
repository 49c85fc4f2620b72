"""All eigenpairs of small problems, with few unknowns or a B of low rank (Steklov conditions at the ends of a curve).

Lanczos' iteration needs more vectors than the rank of such a B. With S the columns of the identity for the unknowns
in the range of B, ``S' B S = R R'`` and ``G = S' (A - sigma B)^-1 S``, the eigenvalues of the small matrix ``R' G R``
are ``1 / (lambda - sigma)``.
"""

from __future__ import annotations

import numpy as np

from cpmkit.errors import InputError
from cpmkit.families.eigen.inverse_iteration import EigenPairs, InverseIteration
from cpmkit.types import Ints

#: Largest number of unknowns in the range of a small B.
MOST_MASS_UNKNOWNS = 64
#: Largest eigenvalue that counts as zero, as a share of the largest of all: rounding.
ROUNDING_SHARE = 1e-9


def mass_unknowns(iteration: InverseIteration) -> Ints | None:
    """Return the numbers of the unknowns in the range of B if they are few and the problem is symmetric; else None."""
    if not iteration.symmetric or iteration.mass is None or not hasattr(iteration.mass, "to_csr"):
        return None
    matrix = iteration.mass.to_csr()
    if np.count_nonzero(matrix.data) > MOST_MASS_UNKNOWNS**2:  # avoids a pass over a large matrix
        return None
    unknowns = np.unique(matrix.indices[matrix.data != 0])
    return unknowns if len(unknowns) <= min(MOST_MASS_UNKNOWNS, matrix.shape[0] // 2) else None


def pairs_of_small_mass(iteration: InverseIteration, unknowns: Ints, count: int) -> EigenPairs:
    """Return all eigenpairs with finite eigenvalues; ``unknowns`` are the numbers of those in the range of B.

    Raises
    ------
    InputError
        If there are fewer than ``count`` pairs.
    """
    mass, n = iteration.mass.to_csr()[unknowns][:, unknowns].toarray(), iteration.operator.size
    sizes, directions = np.linalg.eigh(0.5 * (mass + mass.T))
    positive = sizes > ROUNDING_SHARE * sizes.max(initial=0.0)
    root = directions[:, positive] * np.sqrt(sizes[positive])
    images = np.zeros((n, root.shape[1]))
    images[unknowns] = root
    inverted = iteration.apply_inverse(images)
    small = root.T @ inverted[unknowns]
    theta, vectors = np.linalg.eigh(0.5 * (small + small.T))
    finite = np.abs(theta) > ROUNDING_SHARE * np.abs(theta).max()
    if finite.sum() < count:
        raise InputError(
            f"count={count} is more than the {int(finite.sum())} eigenvalues that there are: lambda stands in the "
            "conditions of so few points; ask for these."
        )
    return EigenPairs(iteration.shift + 1 / theta[finite], inverted @ (vectors[:, finite] / theta[finite]))


def dense_pairs(iteration: InverseIteration, count: int) -> EigenPairs:
    """Return all eigenpairs with finite eigenvalues of a problem with few unknowns, by a dense matrix.

    Raises
    ------
    InputError
        If there are fewer than ``count`` pairs.
    """
    n = iteration.operator.size
    theta, vectors = np.linalg.eig(iteration.step(np.eye(n)))
    finite = np.abs(theta) > ROUNDING_SHARE * np.abs(theta).max()
    if finite.sum() < count:
        raise InputError(
            f"count={count} is more than the {int(finite.sum())} eigenvalues of a mesh or lattice with {n} unknowns; "
            "ask for fewer, or use a finer mesh or a smaller spacing."
        )
    return EigenPairs(iteration.shift + 1 / theta[finite], vectors[:, finite])
